/* Pins, wires and the common time of several boards. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "programs/part.h"

void test_pins(void)
{
    world *w = check_world("board a elf=inputs.elf\nwire one a.C3 a.B0\nwire two a.C1 a.B1\n"
                           "at 0.01 reset a for 1 ms\n");
    board *b = world_board(w, "a");
    wire *button = wire_at(b, 3, 2);
    wire_set(button, check_hand(button, b), WIRE_LOW, 0.0);
    wire *held = wire_at(b, 0, 6);
    wire_set(held, check_hand(held, b), WIRE_HIGH, 0.0);
    check_finishes(w, b, 5e-3);
    for (int start = 1; start <= 2; start++) {
        CHECK(check_result(b, 0) == 0x10); /* PD2 held low, PD4 pulled up */
        CHECK(check_result(b, 1) == 0x30);
        CHECK(check_result(b, 2) == 0x10);
        CHECK(check_result(b, 3) == 2); /* PC3 is JTAG's, PC1 is not */
        CHECK(check_result(b, 4) == 3);
        CHECK(check_result(b, 5) == 0x40);
        CHECK(check_result(b, 20) == (start == 1 ? 1u : 2u)); /* power-on, external reset */
        CHECK_NEAR(check_result(b, 21), start, 0); /* .noinit lives through a reset */
        if (start == 2)
            break;
        b->avr->data[RESULTS + 2 * (RESULTS_COUNT - 1)] = 0;
        CHECK(timeline_run(&w->line, 10.5e-3));
        CHECK(!wire_level(world_wire(w, "two"), b)); /* in reset nothing is driven */
        check_finishes(w, b, 20e-3);
    }
    CHECK(b->resets == 1);
    check_done(w);
}

void test_wire(void)
{
    world *w = check_world("board a elf=inputs.elf\nboard b elf=inputs.elf\n"
                           "wire clash a.D5 b.C1\nwire up a.D4 b.A7 rest=high\n");
    CHECK(timeline_run(&w->line, 1e-3));
    wire *clash = world_wire(w, "clash");
    CHECK(clash->contentions >= 1); /* PD5 ends low, PC1 high */
    CHECK(!wire_level(clash, world_board(w, "a")));
    wire_cut(clash, true, w->line.now);
    CHECK(!wire_level(clash, world_board(w, "a")) && wire_level(clash, world_board(w, "b")));
    CHECK(wire_level(world_wire(w, "up"), world_board(w, "b")));
    check_done(w);

    /* An edge reaches the other board after it was made and before the next but one reading of it:
     * a loop of IN, OUT and RJMP takes 4 cycles, and OUT follows IN by one. */
    w = check_world("board a elf=period.elf\nboard b elf=mirror.elf ppm=997 start=0.1ms\n"
                    "wire one a.C0 b.D6\n");
    static edges made, seen;
    check_watch(&made, world_board(w, "a"), 2, 0);
    check_watch(&seen, world_board(w, "b"), 2, 6);
    CHECK(timeline_run(&w->line, 0.6));
    CHECK(made.count == seen.count && made.count > 470);
    double least = 1, most = 0;
    for (int i = 0; i < made.count; i++) {
        least = fmin(least, seen.times[i] - made.times[i]);
        most = fmax(most, seen.times[i] - made.times[i]);
    }
    CHECK_NEAR(least * 4e6, 1.5, 0.6);
    CHECK_NEAR(most * 4e6, 5.5, 0.6);
    check_done(w);
}

void test_timeline(void)
{
    /* Two sleeping boards do not wake each other by a cycle at a time, and agree about time. */
    world *w = check_world("board a elf=echo.elf ppm=80\nboard b elf=echo.elf ppm=-80 start=3ms\n"
                           "cable a\n");
    board *a = world_board(w, "a"), *b = world_board(w, "b");
    w->laptop.by_control = true;
    CHECK(timeline_run(&w->line, 2.0));
    CHECK_NEAR((double)a->avr->cycle, 8e6 * (1 + 80e-6), 1100);
    CHECK_NEAR((double)b->avr->cycle, 8e6 * (1 - 80e-6), 1100);
    CHECK(a->asleep > 7.9e6 && b->asleep > 7.9e6);
    CHECK_NEAR(a->now, b->now, 3e-4);
    uint8_t bytes[] = {1, 2, 0xff};
    laptop_send(&w->laptop, bytes, 3, w->line.now);
    w->laptop.stop_on_data = true;
    CHECK(timeline_run(&w->line, 3.0));
    /* Ends with the first echo: a byte to the board and one back. */
    CHECK_NEAR(w->line.now, 2.0 + 9.5 / 9600 + 10.0 / 9615, 20e-6);
    w->laptop.stop_on_data = false;
    CHECK(timeline_run(&w->line, 3.0));
    CHECK(w->laptop.heard.count == 3 && w->laptop.heard.bytes[2] == 0x00);
    check_done(w);

    /* A sleeper is woken by another board at once, not when it would have looked up itself. */
    w = check_world("board a elf=wake.elf ppm=31\nboard b elf=steps.elf\nwire one b.C0 a.D2\n");
    static edges caused, woken;
    check_watch(&caused, world_board(w, "b"), 2, 0);
    check_watch(&woken, world_board(w, "a"), 2, 0);
    CHECK(timeline_run(&w->line, 0.5));
    CHECK(caused.count == woken.count && caused.count > 390);
    double longest = 0;
    for (int i = 0; i < caused.count; i++)
        longest = fmax(longest, woken.times[i] - caused.times[i]);
    CHECK_NEAR(longest * 4e6, 20, 8); /* entry, jump, registers saved, OUT */
    check_done(w);

    /* The same seed gives the same run; an input's noise is not disturbed by another device. */
    uint16_t seen[3][16];
    static const char *const scenarios[] = {
        "seed 9\nboard a elf=converter.elf\ninput a.A0 volts=1 noise=10mV\n",
        "seed 9\nboard a elf=converter.elf\ninput a.A0 volts=1 noise=10mV\ninput a.A5 volts=1 "
        "noise=1V\ncable a ber=0.1\n",
        "seed 10\nboard a elf=converter.elf\ninput a.A0 volts=1 noise=10mV\n",
    };
    for (int k = 0; k < 3; k++) {
        w = check_world(scenarios[k]);
        check_finishes(w, world_board(w, "a"), 0.1);
        for (int i = 0; i < 16; i++)
            seen[k][i] = (uint16_t)check_result(world_board(w, "a"), i);
        check_done(w);
    }
    CHECK(memcmp(seen[0], seen[1], sizeof seen[0]) == 0);
    CHECK(memcmp(seen[0], seen[2], sizeof seen[0]) != 0);
}
