/* What simavr 1.6 gets wrong about the count of timer 1. */
#ifndef EMULATOR_TIMER1_H
#define EMULATOR_TIMER1_H

#include <stdbool.h>
#include <stdint.h>

#include <avr_timer.h>

struct board;

typedef struct timer1 {
    avr_timer_t *simavr;
    uint16_t stopped_at;         /* count while the clock is off */
    avr_cycle_count_t prescaler; /* cycle at which the prescaler was last zero by reset */
    struct timer1_compare {
        struct board *board;
        int unit;
    } compare[2]; /* A and B */
    bool warned_outputs, warned_beyond;
} timer1;

void timer1_install(struct board *b);
void timer1_after_reset(struct board *b);

/* TCNT1 at a cycle that is not before the last overflow handled. */
uint16_t timer1_count_at(const struct board *b, avr_cycle_count_t cycle);

#endif
