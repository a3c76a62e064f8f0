// Virtual time for several boards: a queue of events in order of nanoseconds, and seeded chance.

#ifndef WORLD_WORLD_H
#define WORLD_WORLD_H

#include <cstdint>
#include <functional>
#include <queue>
#include <random>
#include <vector>

using nanoseconds = int64_t;

constexpr nanoseconds us = 1000;
constexpr nanoseconds msec = 1000 * us;
constexpr nanoseconds sec = 1000 * msec;

class world {
 public:
  explicit world(uint32_t seed) : chance_(seed) {}

  nanoseconds now() const { return now_; }
  /// Runs `what` at `when`, or now when that is past.
  void at(nanoseconds when, std::function<void()> what);
  void run_until(nanoseconds when);
  void run_for(nanoseconds span) { run_until(now_ + span); }
  /// Runs until `done` holds, looked at every millisecond; false when `span` passes first.
  bool run_until_true(const std::function<bool()> &done, nanoseconds span);

  /// True with probability `p`.
  bool happens(double p) { return p > 0 && std::uniform_real_distribution<double>(0, 1)(chance_) < p; }
  nanoseconds between(nanoseconds low, nanoseconds high) {
    return std::uniform_int_distribution<nanoseconds>(low, high)(chance_);
  }

 private:
  struct entry {
    nanoseconds when;
    uint64_t order;
    std::function<void()> what;
    bool operator>(const entry &other) const {
      return when != other.when ? when > other.when : order > other.order;
    }
  };
  std::priority_queue<entry, std::vector<entry>, std::greater<entry>> queue_;
  nanoseconds now_ = 0;
  uint64_t order_ = 0;
  std::mt19937 chance_;
};

#endif
