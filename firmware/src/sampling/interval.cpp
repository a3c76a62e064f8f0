#include "sampling/interval.h"

#include "boards/flash.h"
#include "boards/hardware.h"
#include "protocol/text_number.h"
#include "units.h"

namespace {
const uint16_t presets[preset_count] = {50, 100, 200, 400, 800};
interval now_set = {1, 40000};
bool interrupt_on = false;
}  // namespace

interval interval_for(uint16_t freq) {
  static const uint16_t prescales[] = {1, 8, 64, 256, 1024};
  if (freq < 1 || freq > 4000) return {0, 0};
  for (const uint16_t prescale : prescales) {
    const uint32_t divisor = static_cast<uint32_t>(prescale) * freq;
    const uint32_t cycles = (cpu_hz + divisor / 2) / divisor;
    if (cycles <= 0xFFFF) return {prescale, static_cast<uint16_t>(cycles)};
  }
  return {0, 0};
}

uint32_t actual_rate_mhz(interval i) {
  if (i.prescale == 0 || i.cycles == 0) return 0;
  const uint32_t divisor = i.cpu_cycles();
  return static_cast<uint32_t>(static_cast<uint64_t>(cpu_hz) * 1000 / divisor);
}

uint16_t preset_rate(uint8_t number) { return number < preset_count ? presets[number] : 0; }

uint8_t preset_number(uint16_t freq) {
  uint8_t number = 0;
  while (number < preset_count && presets[number] != freq) ++number;
  return number;
}

bool interval_setup(uint16_t freq) {
  const interval wanted = interval_for(freq);
  if (wanted.prescale == 0) return false;
  now_set = wanted;
  hardware::timer_prescale(wanted.prescale);
  return true;
}

uint16_t interval_timer_cycles() { return now_set.cycles; }

uint16_t interval_timer_prescale() { return now_set.prescale; }

void interval_interrupt_on() {
  interrupt_on = true;
  hardware::compare_interrupt(true);
}

void interval_interrupt_off() {
  interrupt_on = false;
  hardware::compare_interrupt(false);
}

bool interval_interrupt_status() { return interrupt_on; }

void print_freq(interval i, char *out) {
  const uint32_t mhz = actual_rate_mhz(i);
  out = put_number(out, mhz / 1000);
  *out++ = '.';
  out = put_digits(out, mhz % 1000, 3);
  *put_flash(out, IN_FLASH(" Hz")) = 0;
}
