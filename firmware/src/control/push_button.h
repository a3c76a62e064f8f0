// The driver's push button, without the bounces of its contacts.
//
// A press counts at once, since it starts the run; what bounces within 30 ms after an edge is not looked at.

#ifndef CONTROL_PUSH_BUTTON_H
#define CONTROL_PUSH_BUTTON_H

#include <stdint.h>

#include "units.h"

class push_button {
 public:
  enum class sign : uint8_t { none, pressed, held };
  static constexpr moment bounces = ms(30);
  static constexpr moment hold = ms(2000);

  /// Takes the contact's state; `pressed` once at each press, `held` once when it has been down for `hold`.
  sign poll(bool down, moment now);

 private:
  bool down_ = false;
  bool settled_ = true;  // no bounces to be expected
  bool said_held_ = false;
  moment edge_ = 0;
};

#endif
