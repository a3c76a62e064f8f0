// How the next run is to be taken; the laptop's CONFIG sets it.

#ifndef CONTROL_SETTINGS_H
#define CONTROL_SETTINGS_H

#include <stdint.h>

#include "control/synch.h"
#include "protocol/frame.h"

struct settings {
  static constexpr uint16_t most_pre = 600;  // 200 rows after the trigger leave time to tell Slave 2

  uint16_t rate = 0;  // Hz; 0: by the knob
  uint8_t mode = 0;   // 0 fixed, 1 loop with smart trigger
  synch_method synch = synch_method::six_steps;
  uint8_t readings = 4;
  uint16_t pre = 200;
  uint16_t threshold = 20;

  /// The rate itself, the knob standing at `preset`.
  uint16_t rate_now(uint8_t preset) const;
};

/// Reads CONFIG's payload; bad_value, and `s` left alone, when something is out of its range or a row's
/// conversions do not fit.
result read_settings(const frame &config, uint8_t preset, settings &s);

#endif
