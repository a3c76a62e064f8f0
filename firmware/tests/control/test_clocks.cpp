// Beacons: one instant on two clocks, and the correction of a start that was planned without knowing the
// drift.

#include <cmath>

#include "check.h"
#include "control/beacon_clock.h"

namespace {

struct two_clocks {
  double rate_here, rate_there;  // ticks a second
  tick offset_there;
  tick here(double t) const { return static_cast<tick>(static_cast<int64_t>(std::floor(t * rate_here))); }
  tick there(double t) const {
    return static_cast<tick>(static_cast<int64_t>(std::floor(t * rate_there))) + offset_there;
  }
};

}  // namespace

TEST(beacons_give_a_common_instant_despite_late_stamps) {
  std::mt19937 chance(1);
  for (int trial = 0; trial < 500; ++trial) {
    const two_clocks c = {4e6 * (1 + 50e-6), 4e6 * (1 - 50e-6), static_cast<tick>(chance())};
    const double start = static_cast<double>(chance() % 1000);
    beacon_clock clock;
    clock.clear();
    tick there[beacon_count] = {};
    uint8_t heard = 0;
    const unsigned late = static_cast<unsigned>(chance() % 6);  // one stamp, or none, comes 15 us late
    for (uint8_t n = 0; n < beacon_count; ++n) {
      const double t = start + n * 0.005;
      clock.sent(n, c.here(t));
      there[n] = c.there(t) + (n == late ? 60 : 0);
      if (chance() % 5 != 0) heard = static_cast<uint8_t>(heard | 1u << n);
    }
    common_instant i;
    const int count = __builtin_popcount(heard);
    CHECK_EQUAL(clock.pick(heard, there, i), count >= 2);
    if (count < 3) continue;
    // The instant lies on the true relation of the clocks to within a tick or two of rounding.
    const double t = (i.here - c.here(start)) / c.rate_here + start;
    CHECK(std::abs(static_cast<int32_t>(i.there - c.there(t))) <= 2);
  }
}

TEST(late_start_follows_from_the_two_instants) {
  std::mt19937 chance(2);
  for (int trial = 0; trial < 500; ++trial) {
    const double ppm = -120 + static_cast<double>(chance() % 240);
    const two_clocks c = {4e6, 4e6 * (1 + ppm * 1e-6), static_cast<tick>(chance())};
    const double first = 100.0 + static_cast<double>(chance() % 600);
    const double span = 0.5 + static_cast<double>(chance() % 300);
    const double mark = first + 0.06 + 0.001 * static_cast<double>(chance() % 500);
    const common_instant a = {c.here(first), c.there(first)};
    const common_instant b = {c.here(first + span), c.there(first + span)};
    const double expected = (mark - first) * 4e6 * ppm * 1e-6;
    CHECK(std::abs(late_there(a, b, c.here(mark)) - expected) <= 2 + std::abs((mark - first) / span) * 2);
  }
  CHECK_EQUAL(late_there({5, 5}, {5, 5}, 9), 0);
}
