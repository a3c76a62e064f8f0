// The smart trigger: shakes trigger, rest, drift and single blows do not.

#include <cmath>

#include "check.h"
#include "sampling/smart_trigger.h"

namespace {
/// Row at which a signal triggers; -1 when it does not in `rows`.
template <class signal>
int triggers_at(uint16_t threshold, int rows, signal s) {
  smart_trigger t;
  t.start(threshold);
  for (int row = 0; row < rows; ++row) {
    if (t.add(static_cast<uint16_t>(s(row)))) return row;
  }
  return -1;
}
}  // namespace

TEST(trigger_ignores_rest_drift_and_noise) {
  std::mt19937 chance(1);
  std::normal_distribution<double> noise(0, 2);
  CHECK_EQUAL(triggers_at(20, 100000, [](int) { return 560; }), -1);
  CHECK_EQUAL(triggers_at(20, 100000, [](int row) { return 200 + row / 200; }), -1);
  CHECK_EQUAL(triggers_at(20, 100000, [&](int) { return 560 + noise(chance); }), -1);
  CHECK_EQUAL(triggers_at(1, 1000, [](int) { return 1023; }), -1);
}

TEST(trigger_ignores_a_single_blow) {
  CHECK_EQUAL(triggers_at(20, 5000, [](int row) { return row == 1000 ? 1000 : 560; }), -1);
  CHECK_EQUAL(triggers_at(20, 5000, [](int row) { return row >= 1000 && row < 1004 ? 0 : 560; }), -1);
}

TEST(trigger_finds_a_shake_within_a_tenth_of_a_second) {
  for (const double amplitude : {60.0, 120.0, 400.0}) {
    const int row = triggers_at(20, 5000, [&](int r) {
      return r < 1000 ? 560.0 : 560 + amplitude * std::sin(2 * M_PI * 2.0 / 400 * (r - 1000));
    });
    CHECK(row > 1000);
    CHECK(row < 1000 + 100);  // 2 Hz at 400 rows a second
  }
}

TEST(trigger_needs_the_threshold) {
  const auto shake = [](int r) { return 560 + 30 * std::sin(2 * M_PI * 0.05 * r); };  // mean deviation 19
  CHECK(triggers_at(15, 5000, shake) >= 0);
  CHECK_EQUAL(triggers_at(25, 5000, shake), -1);
}

TEST(trigger_takes_the_whole_range_without_overflow) {
  CHECK(triggers_at(300, 5000, [](int row) { return row % 2 == 0 ? 0 : 1023; }) >= 64);
  CHECK_EQUAL(triggers_at(511, 5000, [](int row) { return row % 2 == 0 ? 20 : 1003; }), -1);
}
