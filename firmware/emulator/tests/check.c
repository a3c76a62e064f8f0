#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"
#include "programs/part.h"
#include "scenario.h"

/* simavr keeps what it reads of a program, and its interrupts' names, for good. */
const char *__lsan_default_suppressions(void);

const char *__lsan_default_suppressions(void)
{
    return "leak:libsimavr";
}

static const char *folder;
static unsigned checks, failures;

void check_true(bool holds, const char *what, const char *file, int line)
{
    checks++;
    if (holds)
        return;
    failures++;
    fprintf(stderr, "%s:%d: not so: %s\n", file, line, what);
}

void check_near(double got, double wanted, double tolerance, const char *what, const char *file,
                int line)
{
    checks++;
    if (fabs(got - wanted) <= tolerance)
        return;
    failures++;
    fprintf(stderr, "%s:%d: %s is %.9g, not %.9g within %.3g\n", file, line, what, got, wanted,
            tolerance);
}

void check_text(const char *got, const char *wanted, const char *file, int line)
{
    checks++;
    if (strcmp(got, wanted) == 0)
        return;
    failures++;
    fprintf(stderr, "%s:%d: \"%s\", not \"%s\"\n", file, line, got, wanted);
}

const char *check_file(const char *name, const char *text)
{
    static char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    if (!file) {
        perror(path);
        exit(1);
    }
    for (const char *c = text; *c; c++) {
        if (c[0] == '%' && c[1] == 's') {
            fputs(folder, file);
            c++;
        } else {
            fputc(*c, file);
        }
    }
    fclose(file);
    return path;
}

world *check_world(const char *scenario)
{
    char problem[TEXT_PROBLEM * 2];
    world *w = memory_new(sizeof *w);
    world_start(w);
    if (!scenario_read(w, check_file("test.scenario", scenario), problem)) {
        fprintf(stderr, "%s\n", problem);
        exit(1);
    }
    world_settle(w);
    return w;
}

const char *check_problem(const char *scenario)
{
    static char problem[TEXT_PROBLEM * 2];
    world *w = memory_new(sizeof *w);
    world_start(w);
    strcpy(problem, "");
    bool good = scenario_read(w, check_file("test.scenario", scenario), problem);
    check_done(w);
    if (good)
        return "";
    const char *name = strstr(problem, "test.scenario");
    return name ? name : problem;
}

void check_done(world *w)
{
    world_free(w);
    free(w);
}

unsigned check_result(const board *b, int index)
{
    const uint8_t *at = b->avr->data + RESULTS + 2 * index;
    return at[0] | (unsigned)at[1] << 8;
}

void check_finishes(world *w, const board *b, double limit)
{
    double end = w->line.now + limit;
    while (w->line.now < end && !check_result(b, RESULTS_COUNT - 1))
        if (!timeline_run(&w->line, fmin(w->line.now + 1e-3, end)))
            break;
    CHECK(check_result(b, RESULTS_COUNT - 1) == 1);
}

static void note(void *owner, bool level, double time)
{
    (void)level;
    edges *e = owner;
    if (e->count < CHECK_EDGES)
        e->times[e->count++] = time;
}

void check_watch(edges *e, board *b, int port, int bit)
{
    e->count = 0;
    wire *w = wire_at(b, port, bit);
    wire_add_device(w, b, note, e);
    wire_settle(w, 0.0);
    e->count = 0;
}

int check_hand(wire *w, board *b)
{
    int number = wire_add_device(w, b, NULL, NULL);
    wire_settle(w, 0.0);
    return number;
}

int main(int count, char **words)
{
    static const struct {
        const char *name;
        void (*run)(void);
    } tests[] = {
        {"queue", test_queue},       {"chance", test_chance},
        {"text", test_text},         {"analog", test_analog},
        {"serial", test_serial},     {"modem", test_modem},
        {"modem command", test_modem_command}, {"radio", test_radio},
        {"air", test_air},           {"wire", test_wire},
        {"scenario", test_scenario}, {"timer", test_timer},
        {"capture", test_capture},   {"converter", test_converter},
        {"usart", test_usart},       {"pins", test_pins},
        {"timeline", test_timeline},
    };
    if (count != 2) {
        fputs("usage: tests FOLDER-OF-PROGRAMS\n", stderr);
        return 2;
    }
    folder = words[1];
    avr_global_logger_set(NULL);
    for (size_t i = 0; i < sizeof tests / sizeof *tests; i++) {
        unsigned before = failures;
        tests[i].run();
        if (failures != before)
            fprintf(stderr, "FAILED: %s\n", tests[i].name);
    }
    printf("%u checks, %u failures\n", checks, failures);
    return failures != 0;
}
