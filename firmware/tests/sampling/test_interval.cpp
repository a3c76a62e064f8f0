// The interval between rows: smallest prescale that fits, and the rate that comes out.

#include <cmath>

#include "check.h"
#include "sampling/interval.h"

TEST(interval_has_the_smallest_prescale_that_fits) {
  const int prescales[] = {1, 8, 64, 256, 1024};
  for (int freq = 1; freq <= 4000; ++freq) {
    const interval i = interval_for(static_cast<uint16_t>(freq));
    int smallest = 0;
    for (const int p : prescales) {
      if (smallest == 0 && std::floor(4e6 / p / freq + 0.5) <= 65535) smallest = p;
    }
    CHECK_EQUAL(i.prescale, smallest);
    // No other count comes nearer to the interval asked for.
    const double wanted = 4e6 / freq;
    CHECK(std::abs(i.cpu_cycles() - wanted) <= 0.5 * i.prescale);
    const double rate = 4e9 / i.cpu_cycles();
    CHECK(std::abs(actual_rate_mhz(i) - rate) <= 1);
  }
  CHECK_EQUAL(interval_for(0).prescale, 0);
  CHECK_EQUAL(interval_for(4001).prescale, 0);
  CHECK_EQUAL(actual_rate_mhz({0, 0}), 0u);
}

TEST(interval_of_the_presets_is_exact) {
  for (uint8_t n = 0; n < preset_count; ++n) {
    const uint16_t rate = preset_rate(n);
    CHECK_EQUAL(interval_for(rate).cpu_cycles() * rate, 4000000u);
    CHECK_EQUAL(preset_number(rate), n);
  }
  CHECK_EQUAL(interval_for(50).prescale, 8);
  CHECK_EQUAL(interval_for(100).prescale, 1);
  CHECK_EQUAL(preset_rate(5), 0);
  CHECK_EQUAL(preset_number(60), preset_count);
}

TEST(interval_says_the_rate_that_comes_out) {
  char text[20];
  print_freq(interval_for(800), text);
  CHECK_EQUAL(std::string(text), std::string("800.000 Hz"));
  print_freq(interval_for(600), text);  // 6667 cycles
  CHECK_EQUAL(std::string(text), std::string("599.970 Hz"));
  print_freq(interval_for(3), text);
  CHECK_EQUAL(std::string(text), std::string("3.000 Hz"));
}
