// The interval between rows (reference App. B.20): from a frequency, the smallest prescale whose count fits
// 16 bits.
//
// interval = cycles * prescale / 4 MHz, cycles = OCR1A + 1 in the reference's terms. Its text prints (OCR1A -
// 1); the count from 0 to OCR1A has OCR1A + 1 steps. Departures: Timer 1 (its text says Timer 0 in places);
// the timer is not cleared by the match but the match moves on by `cycles`, the same interval on an unbroken
// time line; and interval_interrupt_status() is true when the interrupt is on (there: false).

#ifndef SAMPLING_INTERVAL_H
#define SAMPLING_INTERVAL_H

#include <stdint.h>

struct interval {
  uint16_t prescale;  // 1, 8, 64, 256, 1024; 0 = no such interval
  uint16_t cycles;    // counts of the timer between two rows

  uint32_t cpu_cycles() const { return static_cast<uint32_t>(prescale) * cycles; }
};

/// The interval nearest to `freq` Hz, 1 to 4000 Hz; prescale 0 outside of that.
interval interval_for(uint16_t freq);

/// The actual rate in mHz, rounded down.
uint32_t actual_rate_mhz(interval i);

constexpr uint8_t preset_count = 5;
/// The preset rates in Hz, slowest first; 0 for a number that is too large.
uint16_t preset_rate(uint8_t number);
/// Which preset `freq` is; preset_count when none.
uint8_t preset_number(uint16_t freq);

/// Sets Timer 1's prescale for `freq` and remembers the interval. False when there is none.
bool interval_setup(uint16_t freq);
/// Counts of Timer 1 between two rows.
uint16_t interval_timer_cycles();
/// Prescale of Timer 1.
uint16_t interval_timer_prescale();
void interval_interrupt_on();
void interval_interrupt_off();
bool interval_interrupt_status();

/// Writes the actual rate as text, "800.000 Hz", with a closing zero (16 bytes at most).
void print_freq(interval i, char *out);

#endif
