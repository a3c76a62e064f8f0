#include "control/rate_knob.h"

#include "sampling/interval.h"

namespace {
// Part of the travel in which a reading lies: five parts of 204.8 counts.
uint8_t part_of(int16_t reading) {
  const uint16_t part = static_cast<uint16_t>(static_cast<uint32_t>(reading) * preset_count / 1024);
  return static_cast<uint8_t>(part);
}
}  // namespace

uint8_t rate_knob::turn(int16_t reading) {
  if (reading < 0 || reading > 1023) return preset_;
  const uint8_t part = part_of(reading);
  if (!known_) {
    preset_ = part;
    known_ = true;
    return preset_;
  }
  if (part > preset_ && reading >= hysteresis) {
    const uint8_t sure = part_of(static_cast<int16_t>(reading - hysteresis));
    if (sure > preset_) preset_ = sure;
  } else if (part < preset_) {
    const uint8_t sure = part_of(static_cast<int16_t>(reading + hysteresis));
    if (sure < preset_) preset_ = sure;
  }
  return preset_;
}
