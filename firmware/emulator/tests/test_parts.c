/* Parts that need no board: queue, random numbers, words, recordings, serial lines. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "scenario.h"

static char order[16];

static void note(void *owner, double time)
{
    (void)time;
    strncat(order, owner, 1);
}

void test_queue(void)
{
    queue q = {0};
    static char a[] = "a", b[] = "b", c[] = "c", d[] = "d";
    queue_add(&q, 3.0, note, c);
    queue_add(&q, 1.0, note, a);
    queue_add(&q, 2.0, note, b);
    queue_add(&q, 2.0, note, d);
    queue_add(&q, 0.5, note, c);
    CHECK(queue_cancel(&q, note, c) == 2);
    CHECK_NEAR(queue_next_time(&q), 1.0, 0);
    while (q.count)
        queue_run_next(&q);
    CHECK_TEXT(order, "abd"); /* equal times in the order in which they were added */
    CHECK(isinf(queue_next_time(&q)));

    /* Against sorting: many calls, some taken away. */
    chance random = chance_stream(1, "queue");
    static char kept[1], gone[1];
    for (int i = 0; i < 500; i++)
        queue_add(&q, chance_uniform(&random), note, i % 3 ? kept : gone);
    CHECK(queue_cancel(&q, note, gone) == 167);
    double last = 0.0;
    bool sorted = true;
    while (q.count) {
        sorted &= queue_next_time(&q) >= last;
        last = queue_next_time(&q);
        queue_run_next(&q);
    }
    CHECK(sorted);
    queue_free(&q);
}

void test_chance(void)
{
    chance a = chance_stream(7, "air"), again = chance_stream(7, "air");
    chance other = chance_stream(7, "aire"), seed = chance_stream(8, "air");
    double sum = 0, squares = 0, uniform = 0;
    const int count = 20000;
    bool same = true, differs = false, differs_by_seed = false;
    for (int i = 0; i < count; i++) {
        double x = chance_normal(&a);
        same &= x == chance_normal(&again);
        differs |= x != chance_normal(&other);
        differs_by_seed |= x != chance_normal(&seed);
        sum += x;
        squares += x * x;
        uniform += chance_uniform(&a) + 0 * chance_uniform(&again);
    }
    CHECK(same && differs && differs_by_seed);
    /* Four standard errors: 1/sqrt(n), sqrt(2/n) and sqrt(1/12n). */
    CHECK_NEAR(sum / count, 0.0, 4 / sqrt(count));
    CHECK_NEAR(squares / count, 1.0, 4 * sqrt(2.0 / count));
    CHECK_NEAR(uniform / count, 0.5, 4 / sqrt(12.0 * count));
}

void test_text(void)
{
    double value = 0;
    CHECK(text_quantity("1.5ms", 's', &value));
    CHECK_NEAR(value, 1.5e-3, 1e-15);
    CHECK(text_quantity("20%", '%', &value));
    CHECK_NEAR(value, 0.2, 1e-15);
    CHECK(text_quantity("-50ppm", 'p', &value));
    CHECK_NEAR(value, -50, 0);
    CHECK(text_quantity("4MHz", 'H', &value));
    CHECK_NEAR(value, 4e6, 0);
    CHECK(!text_quantity("1.5V", 's', &value));
    CHECK(!text_quantity("nan", '1', &value));
    CHECK(!text_quantity("fast", '1', &value));
    text t;
    CHECK(text_split(&t, "board one elf=a.elf  ppm=3 # a remark = 4\n"));
    CHECK(t.count == 4 && text_plain(&t, 1) == 1);
    CHECK_TEXT(text_setting(&t, "elf"), "a.elf");
    CHECK(!text_setting(&t, "pp"));
}

void test_analog(void)
{
    analog s = {0};
    char problem[200];
    unsigned at;
    const char *path = check_file("recording.csv",
                                  "# sample_rate = 100 Hz\n"
                                  "time [s],front_wheel [counts],rear_wheel [mV]\n"
                                  "0,512,1000\n"
                                  "0.01,612,2000\n"
                                  "\n"
                                  "0.03,412,500\n");
    CHECK(analog_read(&s, path, "front_wheel", 3.3, problem, &at));
    s.start = 2.0;
    double count = 3.3 / 1024;
    CHECK_NEAR(analog_at(&s, 0.0) / count, 512.5, 1e-9); /* the middle of the step */
    CHECK_NEAR(analog_at(&s, 2.005) / count, 562.5, 1e-6);
    CHECK_NEAR(analog_at(&s, 2.02) / count, 512.5, 1e-6);
    CHECK_NEAR(analog_at(&s, 9.0) / count, 412.5, 1e-9);
    CHECK_NEAR(analog_at(&s, 2.005) / count, 562.5, 1e-6); /* also backwards */
    analog_free(&s);
    CHECK(analog_read(&s, path, "rear_wheel", 3.3, problem, &at));
    CHECK_NEAR(analog_at(&s, 0.0 + s.start), 1.0, 1e-12);
    analog_free(&s);
    s = (analog){.level = 1.0, .noise = 0.01, .chance = chance_stream(3, "noise")};
    double sum = 0, squares = 0;
    for (int i = 0; i < 5000; i++) {
        double x = analog_at(&s, i) - 1.0;
        sum += x;
        squares += x * x;
    }
    CHECK_NEAR(sum / 5000, 0, 4 * 0.01 / sqrt(5000));
    CHECK_NEAR(sqrt(squares / 5000), 0.01, 4 * 0.01 / sqrt(2 * 5000));

    static const struct {
        const char *text, *problem;
        unsigned at;
    } wrong[] = {
        {"time [s],b [counts]\n0,1\n", "there is no column a", 1},
        {"time,a [counts]\n0,1\n", "there is no column time [s] or time [ms]", 1},
        {"time [s],a [g]\n0,1\n", "column a is in [g]; give it in [V], [mV] or [counts]", 1},
        {"time [s],a [V]\n0,1\n0,2\n", "time does not increase", 3},
        {"time [s],a [V]\n0,x\n", "the row has no number for time and a", 2},
        {"time [s],a [V]\n0\n", "the row has no number for time and a", 2},
        {"time [s],a [V]\n", "there are no rows", 0},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        analog bad = {0};
        CHECK(!analog_read(&bad, check_file("wrong.csv", wrong[i].text), "a", 3.3, problem, &at));
        CHECK_TEXT(problem, wrong[i].problem);
        CHECK(at == wrong[i].at);
        analog_free(&bad);
    }
}

static int heard;
static double heard_at;

static void hear(void *owner, uint8_t byte, double time, double bit)
{
    (void)byte, (void)bit;
    heard++;
    heard_at = time;
    *(unsigned *)owner += (unsigned)__builtin_popcount(byte);
}

void test_serial(void)
{
    /* AVR at 4 MHz, UBRR 25: 9615 baud reads 9600; 10200 it does not. */
    CHECK(serial_agrees(1 / 9615.4, 1 / 9600.0));
    CHECK(serial_agrees(1 / 9600.0, 1 / 9615.4));
    CHECK(!serial_agrees(1 / 9600.0, 1 / 10200.0));

    timeline line = {0};
    unsigned ones = 0;
    serial_line s = {.error_rate = 0.01, .chance = chance_stream(1, "bits")};
    serial_start(&s, &line, 9600, (serial_end){hear, &ones});
    const int count = 5000;
    for (int i = 0; i < count; i++)
        serial_send(&s, 0x00, 0.0);
    CHECK(timeline_run(&line, 10.0));
    CHECK(heard == count);
    CHECK_NEAR(heard_at, (10.0 * count - 0.5) / 9600, 1e-9); /* the middle of the last stop bit */
    double expected = 0.01 * 8 * count;
    CHECK_NEAR(ones, expected, 4 * sqrt(expected));
    CHECK_NEAR(s.spoilt, count * (1 - pow(0.99, 8)), 4 * sqrt(0.08 * count));
    serial_free(&s);
    timeline_free(&line);
}

void test_scenario(void)
{
    static const struct {
        const char *text, *problem;
    } wrong[] = {
        {"", "test.scenario: there is no board; add a line such as: board slave_1 elf=slave_1.elf"},
        {"bord a\n", "test.scenario:1: \"bord\" is no statement; there are: seed, duration, speed, "
                     "board, wire, radio, air, modem, channel, cable, button, light, bar, input, "
                     "knob, log, at, include"},
        {"board a elf=none.elf\n", NULL},
        {"board a elf=echo.elf pmp=3\n",
         "test.scenario:1: board does not take pmp=; it takes: elf, ppm, start, clock, supply"},
        {"board a elf=echo.elf ppm=fast\n",
         "test.scenario:1: ppm=fast is not a number with a unit that fits"},
        {"board a\n", "test.scenario:1: board needs elf=, the program's file"},
        {"board a elf=recording.csv\n", NULL},
        {"board a elf=echo.elf\nwire w a.D6\n",
         "test.scenario:2: a wire joins two pins or more"},
        {"board a elf=echo.elf\nwire w a.D6 b.D6\n",
         "test.scenario:2: \"b.D6\" is no pin of a board above this line"},
        {"board a elf=echo.elf\nwire w a.D6 a.D5\nwire v a.D6 a.D4\n",
         "test.scenario:3: a.D6 is on a wire already, or the wire has too many pins"},
        {"board a elf=echo.elf\nradio a ce=B0\n",
         "test.scenario:2: radio needs csn=, a pin such as B3"},
        {"board a elf=echo.elf\nat 1 s press go\n",
         "test.scenario:2: there is no button \"go\" in this scenario"},
        {"board a elf=echo.elf\nat 1 jump a\n",
         "test.scenario:2: \"jump\" is not something that can happen; these can: press, cut, mend, "
         "reset, turn, apply, tune, block, open, set, send"},
        {"board a elf=echo.elf\nair loss=1.2\n",
         "test.scenario:2: loss=1.2 is out of range; it goes from 0 to 1"},
        {"board a elf=echo.elf\nseed 3\n", "test.scenario:2: seed comes before the boards"},
        {"board a elf=echo.elf\ninput a.B0 volts=1\n",
         "test.scenario:2: a.B0 is no input of the converter; those are A0 to A7"},
        {"board a elf=echo.elf\ninput a.A0 file=recording.csv\n",
         "test.scenario:2: file= needs column=, the name of a column"},
        {"board a elf=echo.elf\nmodem a\ncable a\n",
         "test.scenario:3: the laptop is connected already"},
        {"board a elf=echo.elf\ncable a\nat 1 send 4x\n",
         "test.scenario:3: \"4x\" is not hexadecimal"},
    };
    check_file("recording.csv", "time [s],a [V]\n0,1\n");
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        const char *problem = check_problem(wrong[i].text);
        if (wrong[i].problem)
            CHECK_TEXT(problem, wrong[i].problem);
        else
            CHECK(strstr(problem, "cannot read the program") ||
                  strstr(problem, "is not an ELF file for the AVR"));
    }
    world *w = check_world("seed 5\nduration 3 s\nspeed 0\n"
                           "board a elf=echo.elf ppm=40 supply=5V\n"
                           "knob rate a.A2 position=25%\n"
                           "at 1 s turn rate 0.75\nat 2 tune a -40\n");
    board *b = world_board(w, "a");
    CHECK_NEAR(b->frequency, 4e6 * (1 + 40e-6), 1e-3);
    CHECK_NEAR(b->adc.inputs[2].voltage(b->adc.inputs[2].owner, 0), 1.25, 1e-12);
    CHECK(timeline_run(&w->line, 3.0));
    CHECK_NEAR(b->adc.inputs[2].voltage(b->adc.inputs[2].owner, 0), 3.75, 1e-12);
    CHECK_NEAR(b->frequency, 4e6 * (1 - 40e-6), 1e-3);
    /* Two seconds at +40 ppm and one at -40 ppm. */
    CHECK_NEAR((double)b->avr->cycle, 4e6 * (3 + 40e-6), 6);
    check_done(w);
}
