// The potentiometer that chooses one of the five preset rates (reference 6.3.3).

#ifndef CONTROL_RATE_KNOB_H
#define CONTROL_RATE_KNOB_H

#include <stdint.h>

class rate_knob {
 public:
  static constexpr int16_t hysteresis = 8;  // counts beyond a border before the choice changes

  /// Takes a reading, 0 to 1023; -1 (no reading) changes nothing. Returns the preset's number, 0 to 4.
  uint8_t turn(int16_t reading);
  uint8_t preset() const { return preset_; }

 private:
  uint8_t preset_ = 0;
  bool known_ = false;
};

#endif
