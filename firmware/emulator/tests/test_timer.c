/* Timer 1, interrupts and input capture, by small programs and figures from the data sheet. */
#include <math.h>

#include "check.h"

void test_timer(void)
{
    /* Compare period (OCR1A + 1) * prescale, to the crystal. */
    for (int prescale = 1; prescale <= 8; prescale *= 8) {
        world *w = check_world("board a elf=period.elf ppm=50\n");
        board *b = world_board(w, "a");
        wire *choice = wire_at(b, 0, 0);
        wire_set(choice, check_hand(choice, b), prescale == 8 ? WIRE_HIGH : WIRE_LOW, 0.0);
        static edges e;
        check_watch(&e, b, 2, 0);
        CHECK(timeline_run(&w->line, 0.5));
        double period = 5000.0 * prescale / (4e6 * (1 + 50e-6));
        CHECK_NEAR(e.count, 0.5 / period, 1.0);
        /* Out of sleep the interrupt comes to the cycle. */
        double worst = 0;
        for (int i = 2; i < e.count; i++)
            worst = fmax(worst, fabs(e.times[i] - e.times[i - 1] - period));
        CHECK_NEAR(worst, 0, 1.01 / 4e6);
        CHECK_NEAR((e.times[e.count - 1] - e.times[1]) / (e.count - 2), period, 1e-9);
        CHECK(b->asleep > 0.99 * b->avr->cycle - 100);
        check_done(w);
    }

    /* A match that moves on: none is left behind where it was before. */
    world *steps = check_world("board a elf=steps.elf\n");
    static edges moved;
    check_watch(&moved, world_board(steps, "a"), 2, 0);
    CHECK(timeline_run(&steps->line, 1.0));
    CHECK_NEAR(moved.count, 800, 1);
    for (int i = 2; i < moved.count; i++)
        CHECK_NEAR((moved.times[i] - moved.times[i - 1]) * 4e6, 5000, 1.01);
    check_done(steps);

    /* 4 cycles into the interrupt, 3 for the vector's jump, and up to 2 to end the loop's own jump.
     */
    world *w = check_world("board a elf=latency.elf\n");
    board *b = world_board(w, "a");
    CHECK(timeline_run(&w->line, 1e-2));
    unsigned seen = check_result(b, 0) & 0xff;
    CHECK(seen >= 7 && seen <= 10);
    check_done(w);

    w = check_world("board a elf=timer.elf\n");
    b = world_board(w, "a");
    check_finishes(w, b, 0.1);
    CHECK_NEAR(check_result(b, 0), 1000, 10);
    CHECK(check_result(b, 1) == check_result(b, 0));
    CHECK_NEAR(check_result(b, 2), check_result(b, 1) + 4, 6);
    CHECK(check_result(b, 3) == 40000);
    CHECK_NEAR(check_result(b, 4), 40004, 6);
    CHECK_NEAR(check_result(b, 5), 20004, 8);
    /* 100 us of prescale 8, and 20 cycles of prescale 1 before. */
    CHECK_NEAR(check_result(b, 6), check_result(b, 5) + 60, 12);
    /* Rounds of 10 cycles until the next tick: 24 cycles after a reset of the prescaler 40 ago, and
     * 40 to 50 in the second case; simavr would let all 64 pass. */
    CHECK_NEAR(check_result(b, 7), 2, 1);
    CHECK_NEAR(check_result(b, 8), 4.5, 0.5);
    check_done(w);

    /* OCR1A = 0: the match follows the overflow by one cycle. The first comes with the start. */
    w = check_world("board a elf=wrap.elf\n");
    b = world_board(w, "a");
    check_finishes(w, b, 1.0);
    /* The least the stack needs: two return addresses, and an interrupt's registers below. */
    CHECK(b->stack_low <= 0x10ff - 10 && b->stack_low >= 0x10ff - 40);
    CHECK_NEAR(check_result(b, 0), 41, 0);
    CHECK_NEAR(check_result(b, 1), 40, 0);
    check_done(w);

    w = check_world("board a elf=flags.elf\nwire tie a.B0 a.D2\nwire two a.B1 a.B2\n");
    b = world_board(w, "a");
    check_finishes(w, b, 0.1);
    static const unsigned wanted[] = {4, 4, 6, 1, 1, 0, 1, 0, 1, 1, 0, 0x0e, 0x0d, 10};
    for (int i = 0; i < 14; i++)
        CHECK_NEAR(check_result(b, i), wanted[i], 0);
    check_done(w);
}

void test_capture(void)
{
    world *w = check_world("board a elf=capture.elf ppm=-30\nboard b elf=capture.elf ppm=40\n"
                           "wire synch a.D6 b.D6\n");
    board *a = world_board(w, "a"), *b = world_board(w, "b");
    wire *synch = world_wire(w, "synch"), *canceller = wire_at(b, 0, 0);
    int driver = wire_add_device(synch, a, NULL, NULL);
    wire_set(canceller, check_hand(canceller, b), WIRE_HIGH, 0.0);
    double times[20], cycles_a[20], cycles_b[20];
    for (int i = 0; i < 20; i++) {
        double at = 1e-3 + i * 5e-3 * (1 + 0.0137 * i);
        CHECK(timeline_run(&w->line, at));
        times[i] = w->line.now;
        cycles_a[i] = board_cycle_of(a, times[i]);
        cycles_b[i] = board_cycle_of(b, times[i]);
        wire_set(synch, driver, WIRE_HIGH, times[i]);
        CHECK(timeline_run(&w->line, at + 20e-6));
        wire_set(synch, driver, WIRE_LOW, w->line.now);
    }
    CHECK(check_result(a, 0) == 20 && check_result(b, 0) == 20);
    for (int i = 1; i < 20; i++) {
        /* The difference of two captures is that of the cycle counter, to the cycle. */
        uint16_t got_a = (uint16_t)(check_result(a, i + 1) - check_result(a, 1));
        uint16_t got_b = (uint16_t)(check_result(b, i + 1) - check_result(b, 1));
        CHECK(got_a == (uint16_t)((long)floor(cycles_a[i]) - (long)floor(cycles_a[0])));
        CHECK(got_b == (uint16_t)((long)floor(cycles_b[i]) - (long)floor(cycles_b[0])));
    }
    check_done(w);

    /* A pulse of two cycles: without the noise canceller it is captured, with it not. */
    for (int noise = 0; noise < 2; noise++) {
        w = check_world("board a elf=capture.elf\nwire synch a.D6 a.D4\n");
        a = world_board(w, "a");
        synch = world_wire(w, "synch");
        driver = check_hand(synch, a);
        canceller = wire_at(a, 0, 0);
        wire_set(canceller, check_hand(canceller, a), noise ? WIRE_HIGH : WIRE_LOW, 0.0);
        CHECK(timeline_run(&w->line, 1e-3));
        wire_set(synch, driver, WIRE_HIGH, w->line.now);
        wire_set(synch, driver, WIRE_LOW, w->line.now + 0.5e-6);
        CHECK(timeline_run(&w->line, 2e-3));
        CHECK(check_result(a, 0) == (noise ? 0u : 1u));
        check_done(w);
    }

    /* A board's own output to its own ICP1 and to another board's, cut in between. */
    w = check_world("board a elf=capture.elf\nboard b elf=capture.elf\n"
                    "wire synch a.D5 a.D6 b.D6\n");
    a = world_board(w, "a"), b = world_board(w, "b");
    wire *go = wire_at(a, 0, 2);
    int finger = check_hand(go, a);
    for (int i = 0; i < 3; i++) {
        wire_cut(world_wire(w, "synch"), i == 1, w->line.now);
        CHECK(timeline_run(&w->line, w->line.now + 1e-3));
        wire_set(go, finger, WIRE_HIGH, w->line.now);
        CHECK(timeline_run(&w->line, w->line.now + 1e-3));
        wire_set(go, finger, WIRE_LOW, w->line.now);
        CHECK(timeline_run(&w->line, w->line.now + 1e-3));
    }
    CHECK(check_result(a, 0) == 3);
    CHECK_NEAR(check_result(b, 0), 2, 0);
    check_done(w);
}
