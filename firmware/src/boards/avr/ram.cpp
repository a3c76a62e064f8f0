// How much RAM was never used: the room between the data and the deepest stack is painted before main()
// begins.

#include <stdint.h>

#include "boards/hardware.h"

extern uint8_t _end;     // first byte after the data (linker script)
extern uint8_t __stack;  // last byte of RAM

namespace {
constexpr uint8_t paint = 0xC5;
}

// Runs without a stack frame, before the constructors.
extern "C" void paint_ram() __attribute__((naked, used, section(".init3")));
extern "C" void paint_ram() {
  uint8_t *at = &_end;
  while (at <= &__stack) *at++ = paint;
}

namespace hardware {

uint16_t ram_never_used() {
  const uint8_t *at = &_end;
  uint16_t count = 0;
  while (at <= &__stack && *at == paint) {
    ++at;
    ++count;
  }
  return count;
}

}  // namespace hardware
