/* Converter and USART, by small programs and figures from the data sheet. */
#include <math.h>

#include "check.h"
#include "registers.h"

static struct {
    double times[256];
    int count;
} samples[2];

static double ramp(void *owner, double time)
{
    int which = owner != NULL;
    if (samples[which].count < 256)
        samples[which].times[samples[which].count++] = time;
    return which ? 1.65 : 1.0 + 10.0 * time;
}

void test_converter(void)
{
    world *w = check_world("board a elf=converter.elf supply=3.3\n");
    board *b = world_board(w, "a");
    samples[0].count = samples[1].count = 0;
    b->adc.inputs[0].voltage = b->adc.inputs[1].voltage = ramp;
    b->adc.inputs[1].owner = b;
    check_finishes(w, b, 0.1);
    const double *t = samples[0].times, adc_clock = 8e-6;
    for (int i = 0; i < 3; i++)
        CHECK_NEAR(check_result(b, i), floor((1.0 + 10.0 * t[i]) / 3.3 * 1024), 0);
    /* Single conversions start at edges of the ADC clock, which runs from ADEN on. The first one
     * samples 13.5 clocks after its start, the others 1.5, so they are apart by n - 12 and n
     * clocks. */
    double first = (t[1] - t[0]) / adc_clock, second = (t[2] - t[1]) / adc_clock;
    CHECK_NEAR(first, round(first), 1e-6);
    CHECK_NEAR(second, round(second), 1e-6);
    CHECK(second >= 13 && second <= 16 && first >= 13 && first <= 16);
    CHECK(check_result(b, 3) == 0);
    /* Free running: one long conversion, then one every 13 clocks, whatever the program does. */
    const double *f = samples[1].times;
    CHECK_NEAR((f[1] - f[0]) / adc_clock, 13.0, 1e-6); /* 25 + 1.5 - 13.5 */
    CHECK_NEAR((f[2] - f[1]) / adc_clock, 13.0, 1e-6);
    CHECK_NEAR((f[3] - f[2]) / adc_clock, 13.0, 1e-6);
    for (int i = 0; i < 4; i++)
        CHECK_NEAR(check_result(b, 4 + i), 512, 0); /* 1.65 of 3.3 V is 512, not 511 */
    /* By compare match B: 4000 cycles apart to the cycle, whatever the ADC clock's phase was. */
    CHECK_NEAR((t[5] - t[4]) * 4e6, 4000, 1.01);
    CHECK_NEAR((t[6] - t[5]) * 4e6, 4000, 1.01);
    CHECK_NEAR((t[7] - t[6]) * 4e6, 4000, 1.01);
    CHECK(check_result(b, 11) == 0);
    CHECK(t[8] - t[7] > 3e-3); /* the flag stood: no trigger in 3 ms */
    CHECK_NEAR(check_result(b, 12), 64 * floor((1.0 + 10.0 * t[8]) / 3.3 * 1024), 0);
    CHECK_NEAR(check_result(b, 13), floor((1.0 + 10.0 * t[9]) / 2.56 * 1024), 0);
    CHECK_NEAR(check_result(b, 14), floor(1.1 / 3.3 * 1024), 0);
    CHECK_NEAR(check_result(b, 15), floor((1.0 + 10.0 * t[10]) / 3.3 * 1024), 0);
    CHECK(b->adc.lost == 1);
    check_done(w);
}

static struct {
    uint8_t bytes[64];
    double times[64], bit;
    int count;
} line_heard;

static void hear(void *owner, uint8_t byte, double time, double bit)
{
    (void)owner;
    if (line_heard.count == 64)
        return;
    line_heard.bit = bit;
    line_heard.times[line_heard.count] = time;
    line_heard.bytes[line_heard.count++] = byte;
}

void test_usart(void)
{
    world *w = check_world("board a elf=serial.elf ppm=100\ncable a\n");
    board *b = world_board(w, "a");
    line_heard.count = 0;
    b->usart.end = (serial_end){hear, NULL};
    CHECK(timeline_run(&w->line, 1e-3));
    for (uint8_t i = 0; i < 6; i++)
        serial_send(&w->laptop.out, (uint8_t)(0x30 + i), w->line.now);
    check_finishes(w, b, 0.1);
    CHECK(timeline_run(&w->line, w->line.now + 5e-3));
    CHECK(line_heard.count == 22);
    /* UBRR 25: 416 cycles a bit, ten bits a byte, back to back. */
    double byte = 4160 / (4e6 * (1 + 100e-6));
    CHECK_NEAR(line_heard.bit, byte / 10, 1e-12);
    for (int i = 1; i < 20; i++) {
        CHECK(line_heard.bytes[i] == i);
        CHECK_NEAR(line_heard.times[i] - line_heard.times[i - 1], byte, 1e-9);
    }
    CHECK(line_heard.bytes[20] == 0xaa && line_heard.bytes[21] == 0xbb);
    CHECK((check_result(b, 0) & 0x40) != 0 && check_result(b, 1) == 0);
    CHECK(check_result(b, 2) == 0x88); /* RXC and DOR */
    CHECK(check_result(b, 3) == 3);
    CHECK(check_result(b, 4) == 0x30 && check_result(b, 5) == 0x31 && check_result(b, 6) == 0x32);
    CHECK(check_result(b, 10) == 0);
    CHECK(check_result(b, 11) == 0x20 && check_result(b, 12) == 0);
    CHECK(b->usart.total.overruns == 3);
    check_done(w);

    /* The third byte waits in the shift register: the next one is lost when its start bit comes
     * before there is room, though there is room when it ends. */
    w = check_world("board a elf=serial.elf\ncable a\n");
    b = world_board(w, "a");
    check_finishes(w, b, 0.1);
    double bit = 1.0 / 9600;
    for (uint8_t i = 0; i < 3; i++)
        usart_hear(b, i, b->now, bit);
    avr_io_read_t read = b->avr->io[AVR_DATA_TO_IO(REG_UDR0)].r.c;
    void *param = b->avr->io[AVR_DATA_TO_IO(REG_UDR0)].r.param;
    CHECK(read(b->avr, REG_UDR0, param) == 0);
    usart_hear(b, 3, b->now + 5 * bit, bit);
    CHECK(b->usart.total.overruns == 1 && b->usart.count == 2);
    usart_hear(b, 4, b->now + 15 * bit, bit);
    CHECK(b->usart.total.overruns == 1 && b->usart.count == 3);
    CHECK(read(b->avr, REG_UDR0, param) == 1 && read(b->avr, REG_UDR0, param) == 2);
    CHECK(read(b->avr, REG_UDR0, param) == 4);
    check_done(w);

    /* A byte at a baud rate that does not fit is a framing error. */
    w = check_world("board a elf=echo.elf\ncable a baud=19200\n");
    b = world_board(w, "a");
    CHECK(timeline_run(&w->line, 1e-3));
    serial_send(&w->laptop.out, 'x', w->line.now);
    CHECK(timeline_run(&w->line, 5e-3));
    CHECK(b->usart.total.framing == 1);
    check_done(w);
}
