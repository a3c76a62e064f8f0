// What a channel's readings are worth, before anybody waits for their transfer.

#ifndef SAMPLING_QUALITY_H
#define SAMPLING_QUALITY_H

#include <stdint.h>

enum class verdict : uint8_t { good = 0, poor = 1, not_judged = 2 };

/// Figures of one channel, gathered reading by reading.
class channel_quality {
 public:
  static constexpr uint8_t flat = 1;    // max - min below flat_range: no sensor, or no motion
  static constexpr uint8_t stuck = 2;   // one value without a break for half the readings or more
  static constexpr uint8_t railed = 4;  // ten readings at 0 or 1023
  static constexpr uint16_t flat_range = 8;

  void add(uint16_t reading);
  uint16_t lowest() const { return count_ > 0 ? lowest_ : 0; }
  uint16_t highest() const { return highest_; }
  /// Sixteen times the mean, rounded down.
  uint16_t mean16() const;
  /// Sixteen times the standard deviation (over n), rounded down.
  uint16_t sd16() const;
  uint8_t flags() const;

 private:
  uint16_t count_ = 0;
  uint16_t lowest_ = 0xFFFF;
  uint16_t highest_ = 0;
  uint16_t last_ = 0xFFFF;
  uint16_t run_ = 0;
  uint16_t longest_run_ = 0;
  uint8_t at_rail_ = 0;
  uint32_t sum_ = 0;
  uint32_t squares_ = 0;  // 4000 readings fit
};

/// Largest whole number whose square is at most `value`.
uint32_t whole_root(uint64_t value);

#endif
