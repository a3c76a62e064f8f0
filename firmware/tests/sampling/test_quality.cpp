// Figures of a channel against the same in floating point.

#include <algorithm>
#include <cmath>
#include <numeric>

#include "check.h"
#include "sampling/quality.h"

namespace {
channel_quality of(const std::vector<uint16_t> &values) {
  channel_quality q;
  for (const uint16_t v : values) q.add(v);
  return q;
}
}  // namespace

TEST(quality_figures_are_the_statistics) {
  std::mt19937 chance(1);
  for (int i = 0; i < 300; ++i) {
    const unsigned range = 1 + static_cast<unsigned>(chance() % 1023);
    std::vector<uint16_t> values(1 + chance() % 800);
    for (uint16_t &v : values) v = static_cast<uint16_t>(chance() % (range + 1));
    const channel_quality q = of(values);
    const double n = static_cast<double>(values.size());
    const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
    double squares = 0;
    for (const uint16_t v : values) squares += (v - mean) * (v - mean);
    CHECK_EQUAL(q.lowest(), *std::min_element(values.begin(), values.end()));
    CHECK_EQUAL(q.highest(), *std::max_element(values.begin(), values.end()));
    CHECK(std::abs(q.mean16() / 16.0 - mean) < 1.0 / 16 + 1e-9);
    CHECK(std::abs(q.sd16() / 16.0 - std::sqrt(squares / n)) < 1.0 / 16 + 1e-6);
  }
}

TEST(quality_flags_name_the_flaw) {
  std::vector<uint16_t> good(800);
  for (size_t i = 0; i < 800; ++i) good[i] = static_cast<uint16_t>(500 + i % 50);
  CHECK_EQUAL(of(good).flags(), 0);
  CHECK_EQUAL(of(std::vector<uint16_t>(800, 512)).flags(), channel_quality::flat | channel_quality::stuck);
  std::vector<uint16_t> stuck = good;
  std::fill(stuck.begin() + 100, stuck.begin() + 500, uint16_t{600});
  CHECK_EQUAL(of(stuck).flags(), channel_quality::stuck);
  std::fill(stuck.begin() + 100, stuck.begin() + 498, uint16_t{601});
  CHECK_EQUAL(of(stuck).flags(), 0);
  std::vector<uint16_t> railed = good;
  for (size_t i = 0; i < 9; ++i) railed[i * 50] = i % 2 == 0 ? 0 : 1023;
  CHECK_EQUAL(of(railed).flags(), 0);
  railed[799] = 1023;
  CHECK_EQUAL(of(railed).flags(), channel_quality::railed);
  CHECK_EQUAL(of({}).flags(), channel_quality::flat | channel_quality::stuck);
  std::vector<uint16_t> narrow = good;
  for (size_t i = 0; i < 800; ++i) narrow[i] = static_cast<uint16_t>(500 + i % 8);
  CHECK_EQUAL(of(narrow).flags(), channel_quality::flat);
}

TEST(whole_root_is_the_largest) {
  std::mt19937_64 chance(2);
  for (int i = 0; i < 5000; ++i) {
    const uint64_t value = chance() >> chance() % 63;
    const uint64_t root = whole_root(value);
    CHECK(root * root <= value);
    CHECK((root + 1) * (root + 1) > value || root == 0xFFFFFFFF);
  }
}
