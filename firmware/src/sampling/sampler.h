// Takes the rows: what the two interrupts do, and what the program asks of them.
//
// compare() runs at every match of Timer 1, rows or not, so that the 32-bit time line never loses count.
// conversion() runs at the end of every A/D conversion of a row. A row is `readings` conversions of the wheel
// channel, then as many of the chassis channel, each averaged to 10 bits and put into a ring of packed
// numbers. Source: reference 6.3.3 (interrupt-driven rows, averaged readings), 6.3.5 (saturation).

#ifndef SAMPLING_SAMPLER_H
#define SAMPLING_SAMPLER_H

#include <stdint.h>

#include "boards/hardware.h"
#include "sampling/array10bits.h"
#include "units.h"

constexpr int16_t ring_rows = 800;
constexpr int16_t channels = 2;
constexpr int16_t ring_bytes = array10bits::bytes_for(ring_rows * channels);
constexpr uint32_t no_row = 0xFFFFFFFF;
constexpr uint8_t saturation_limit = 10;

class sampler {
 public:
  explicit sampler(array10bits &store) : store_(store) {}

  // --- for the program
  // -------------------------------------------------------------------------------------------

  /// Counts between rows; takes effect with the next match. The timer's prescale changes meanwhile, so all
  /// ticks noted before lose their meaning.
  void set_period(uint16_t cycles);
  /// The present tick.
  tick now() const;
  /// The tick at which Timer 1 last stood at `count`, which was less than 65536 ticks ago.
  tick when(uint16_t count) const;
  /// Row 0 begins at `first`, less than 65536 ticks ahead; rows `readings` conversions a channel, until row
  /// `end` (no_row: until finish()). False when `first` is past or too near; nothing is begun then.
  bool begin(tick first, uint8_t readings, uint32_t end);
  /// The first row that is not kept. If it has begun already, the rows end now.
  void finish(uint32_t end);
  /// Stops at once.
  void cancel();

  /// Rows that have begun; their numbers are 0 to begun() - 1. Goes on after the last row kept.
  uint32_t begun() const { return steady(begun_); }
  /// Rows in the store so far (the last ring_rows of them still there).
  uint32_t stored() const { return steady(stored_); }
  bool taking() const { return taking_ || converting_; }
  /// Rows kept: at most ring_rows, the last ones before stored().
  uint16_t kept() const;
  uint32_t first_kept() const { return stored() - kept(); }
  /// Place in the ring of row `number`.
  static int16_t slot(uint32_t number) { return static_cast<int16_t>(number % ring_rows); }
  uint16_t overruns() const { return steady(overruns_); }
  uint8_t saturated() const { return saturated_; }
  void forget_saturated() { saturated_ = 0; }

  /// CPU cycles from one row's start to the end of its last conversion (data sheet table 20-1: 25 ADC clocks
  /// for the first, 13 for the others, 32 cycles each).
  static constexpr uint32_t busy_cycles(uint8_t readings) {
    return 32 * (25 + 13 * (2 * uint32_t{readings} - 1));
  }
  /// CPU cycles from a row's start to the mean sample-and-hold of the wheel and the chassis channel: the
  /// first conversion holds at 13.5 ADC clocks, each later one at 1.5 after its start. The mean over n of
  /// wheel holds, rounded, and of chassis holds 25 + 13 (n + (n-1)/2 - 1) + 1.5.
  static uint16_t wheel_delay(uint8_t readings);
  static uint16_t chassis_delay(uint8_t readings);
  /// Whether a row's conversions and the program beside them fit into `cpu_cycles`.
  static bool fits(uint8_t readings, uint32_t cpu_cycles);

  // --- for the interrupts
  // ----------------------------------------------------------------------------------------

  // `converter` has static begin(), chassis_next(), last_one(), end() and compare_at(); see
  // boards/avr/converter.h.

  /// At the compare match.
  template <class converter>
  void compare() {
    if (taking_) {
      if (converting_) {
        ++missed_;
      } else {
        converter::begin();
        converting_ = true;
      }
    }
    matched_ = next_;
    next_ += period_;
    converter::compare_at(static_cast<uint16_t>(next_));
    ++begun_;
    if (begun_ == end_) taking_ = false;
    if (readings_ == 1 && converting_) converter::chassis_next();
  }

  /// At the end of a conversion with its result.
  template <class converter>
  void conversion(uint16_t result) {
    sum_ += result;
    ++count_;
    const uint8_t readings = readings_;
    if (count_ == static_cast<uint8_t>(2 * readings - 1)) converter::last_one();
    if (count_ == static_cast<uint8_t>(readings - 1)) {
      converter::chassis_next();
    } else if (count_ == readings) {
      wheel_ = mean();
    } else if (count_ == static_cast<uint8_t>(2 * readings)) {
      converter::end();
      store(mean());
    }
  }

 private:
  uint16_t mean() {
    const uint16_t value = static_cast<uint16_t>((sum_ + (readings_ >> 1)) >> shift_);
    sum_ = 0;
    if ((value == 0 || value == 1023) && saturated_ < 255) ++saturated_;
    return value;
  }
  void store(uint16_t chassis);

  /// A number that an interrupt may change between its bytes: read until two readings agree. No lock, no
  /// jitter.
  template <class number>
  static number steady(const volatile number &value) {
    number once = value;
    for (number again = value; again != once; again = value) once = again;
    return once;
  }

  array10bits &store_;
  volatile bool taking_ = false;
  volatile bool converting_ = false;
  volatile uint8_t saturated_ = 0;
  uint8_t readings_ = 4;
  uint8_t shift_ = 2;
  uint8_t count_ = 0;
  uint8_t missed_ = 0;
  uint16_t sum_ = 0;
  uint16_t wheel_ = 0;
  int16_t put_at_ = 0;
  uint16_t period_ = 40000;
  volatile uint16_t overruns_ = 0;
  volatile tick matched_ = 0;
  tick next_ = 0;
  volatile uint32_t begun_ = 0;
  volatile uint32_t stored_ = 0;
  uint32_t end_ = no_row;
};

#endif
