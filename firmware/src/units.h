// The three times of a board.
//
// tick   one count of Timer 1: `prescale` CPU cycles. 32 bits, modulo 2^32; the low 16 bits are TCNT1.
// cycle  one CPU cycle, 0.25 us at 4 MHz.
// moment one count of Timer 0 at 1/1024: 256 us. For time-outs, lights and the button; it needs no interrupt.

#ifndef UNITS_H
#define UNITS_H

#include <stdint.h>

using tick = uint32_t;
using moment = uint32_t;

constexpr uint32_t cpu_hz = 4000000;
constexpr uint32_t moment_us = 256;

/// Milliseconds as moments, rounded up, so that a time-out is never shorter than it says.
constexpr moment ms(uint32_t milliseconds) { return (milliseconds * 1000 + moment_us - 1) / moment_us; }

/// True from `wait` moments after `since` on. Correct across the roll-over of the count.
constexpr bool passed(moment now, moment since, moment wait) { return now - since >= wait; }

/// True when tick `a` comes before tick `b`, the two less than 2^31 ticks apart.
constexpr bool before(tick a, tick b) { return static_cast<int32_t>(a - b) < 0; }

#endif
