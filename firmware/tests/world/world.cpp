#include "world/world.h"

#include <algorithm>

void world::at(nanoseconds when, std::function<void()> what) {
  queue_.push({std::max(when, now_), order_++, std::move(what)});
}

void world::run_until(nanoseconds when) {
  while (!queue_.empty() && queue_.top().when <= when) {
    const entry next = queue_.top();
    queue_.pop();
    now_ = next.when;
    next.what();
  }
  now_ = std::max(now_, when);
}

bool world::run_until_true(const std::function<bool()> &done, nanoseconds span) {
  const nanoseconds end = now_ + span;
  while (!done()) {
    if (now_ >= end) return false;
    run_for(msec);
  }
  return true;
}
