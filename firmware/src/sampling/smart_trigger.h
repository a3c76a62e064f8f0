// Looks for "consistent large variations in amplitude" (reference 6.3.5) in one channel, row by row.
//
// The mean follows the signal with a time constant of 64 rows, the mean absolute deviation with 16. Eight
// rows in a row with the deviation at or above the threshold are a shake. A reading counts for four
// thresholds at most, so that a blow of up to four rows, as of a loose plug, is none.

#ifndef SAMPLING_SMART_TRIGGER_H
#define SAMPLING_SMART_TRIGGER_H

#include <stdint.h>

class smart_trigger {
 public:
  static constexpr uint8_t needed = 8;     // rows above the threshold
  static constexpr uint8_t settling = 64;  // rows at the start that cannot trigger

  /// Starts afresh; `threshold` in counts of mean absolute deviation.
  void start(uint16_t threshold);
  /// Takes the next row's reading, 0 to 1023. True when this row completes a shake.
  bool add(uint16_t reading);

 private:
  uint16_t threshold_ = 0;
  uint16_t mean64_ = 0;       // 64 times the mean
  uint16_t deviation16_ = 0;  // 16 times the mean absolute deviation
  uint8_t rows_ = 0;
  uint8_t above_ = 0;
};

#endif
