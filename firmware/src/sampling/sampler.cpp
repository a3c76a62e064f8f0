#include "sampling/sampler.h"

namespace {

constexpr tick too_near = 200;    // ticks that begin() itself may take
constexpr uint32_t beside = 700;  // CPU cycles a row for the interrupts' own work after the last conversion

uint8_t log2_of(uint8_t readings) {
  uint8_t shift = 0;
  while (readings > 1) {
    readings = static_cast<uint8_t>(readings >> 1);
    ++shift;
  }
  return shift;
}

}  // namespace

void sampler::set_period(uint16_t cycles) {
  interrupt_lock off;
  period_ = cycles;
  const uint16_t count = hardware::timer();
  matched_ = (matched_ & 0xFFFF0000) + 0x10000 + count;
  next_ = matched_ + cycles;
  hardware::compare_afresh(static_cast<uint16_t>(next_));
}

tick sampler::now() const {
  interrupt_lock off;
  const tick reference = matched_;
  return reference + static_cast<uint16_t>(hardware::timer() - static_cast<uint16_t>(reference));
}

tick sampler::when(uint16_t count) const {
  const tick present = now();
  return present - static_cast<uint16_t>(static_cast<uint16_t>(present) - count);
}

bool sampler::begin(tick first, uint8_t readings, uint32_t end) {
  const tick present = now();
  interrupt_lock off;
  if (static_cast<int32_t>(first - present) < static_cast<int32_t>(too_near)) return false;
  matched_ = present;
  next_ = first;
  hardware::compare_afresh(static_cast<uint16_t>(first));
  readings_ = readings;
  shift_ = log2_of(readings);
  count_ = 0;
  sum_ = 0;
  missed_ = 0;
  put_at_ = 0;
  overruns_ = 0;
  saturated_ = 0;
  begun_ = 0;
  stored_ = 0;
  end_ = end;
  converting_ = false;
  taking_ = true;
  return true;
}

void sampler::finish(uint32_t end) {
  interrupt_lock off;
  if (begun_ < end) {
    end_ = end;
  } else {
    end_ = begun_;
    taking_ = false;
  }
}

void sampler::cancel() {
  interrupt_lock off;
  taking_ = false;
  converting_ = false;
  hardware::converter_off();
}

uint16_t sampler::kept() const {
  const uint32_t all = stored();
  return all < static_cast<uint32_t>(ring_rows) ? static_cast<uint16_t>(all)
                                                : static_cast<uint16_t>(ring_rows);
}

void sampler::store(uint16_t chassis) {
  // A row that came while this one was still being converted repeats it, so that row numbers stay times.
  for (uint8_t copies = static_cast<uint8_t>(missed_ + 1); copies > 0; --copies) {
    store_.put(put_at_, wheel_);
    store_.put(static_cast<int16_t>(put_at_ + 1), chassis);
    put_at_ = static_cast<int16_t>(put_at_ + channels);
    if (put_at_ == ring_rows * channels) put_at_ = 0;
    ++stored_;
  }
  overruns_ += missed_;
  missed_ = 0;
  count_ = 0;
  converting_ = false;
}

uint16_t sampler::wheel_delay(uint8_t readings) {
  // Holds at 13.5 and at 25 + 13 (k - 1) + 1.5 for k = 1 to n - 1; in halves of an ADC clock, times n.
  const uint32_t n = readings;
  const uint32_t halves = 27 + (n - 1) * 53 + 13 * (n - 1) * (n > 1 ? n - 2 : 0);
  return static_cast<uint16_t>((halves * 16 + n / 2) / n);
}

uint16_t sampler::chassis_delay(uint8_t readings) {
  const uint32_t n = readings;  // holds at 25 + 13 (k - 1) + 1.5 for k = n to 2n - 1
  return static_cast<uint16_t>(16 * (53 + 13 * (2 * n - 2) + 13 * (n - 1)));
}

bool sampler::fits(uint8_t readings, uint32_t cpu_cycles) {
  return busy_cycles(readings) + beside <= cpu_cycles;
}
