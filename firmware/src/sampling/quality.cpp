#include "sampling/quality.h"

#include "sampling/sampler.h"

void channel_quality::add(uint16_t reading) {
  ++count_;
  sum_ += reading;
  squares_ += static_cast<uint32_t>(reading) * reading;
  if (reading < lowest_) lowest_ = reading;
  if (reading > highest_) highest_ = reading;
  if ((reading == 0 || reading == 1023) && at_rail_ < 255) ++at_rail_;
  run_ = reading == last_ ? static_cast<uint16_t>(run_ + 1) : uint16_t{1};
  last_ = reading;
  if (run_ > longest_run_) longest_run_ = run_;
}

uint16_t channel_quality::mean16() const {
  return count_ == 0 ? uint16_t{0} : static_cast<uint16_t>(sum_ * 16 / count_);
}

uint16_t channel_quality::sd16() const {
  if (count_ == 0) return 0;
  // n^2 times the variance is n sum(x^2) - (sum x)^2, exactly.
  const uint64_t n = count_;
  const uint64_t spread = n * squares_ - static_cast<uint64_t>(sum_) * sum_;
  return static_cast<uint16_t>(whole_root(spread * 256) / count_);
}

uint8_t channel_quality::flags() const {
  uint8_t found = 0;
  if (count_ == 0 || highest_ - lowest_ < flat_range) found |= flat;
  if (2UL * longest_run_ >= count_) found |= stuck;
  if (at_rail_ >= saturation_limit) found |= railed;
  return found;
}

uint32_t whole_root(uint64_t value) {
  uint64_t root = 0;
  uint64_t bit = 1ULL << 62;
  while (bit > value) bit >>= 2;
  while (bit != 0) {
    if (value >= root + bit) {
      value -= root + bit;
      root = (root >> 1) + bit;
    } else {
      root >>= 1;
    }
    bit >>= 2;
  }
  return static_cast<uint32_t>(root);
}
