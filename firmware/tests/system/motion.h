// What the sensors of the tests see: different motion in each of the four channels, known at every instant.

#ifndef SYSTEM_MOTION_H
#define SYSTEM_MOTION_H

#include <cmath>

#include "world/logger.h"

/// Counts of a channel (board 0 or 1) at `t` seconds: two tones around mid range.
inline double motion(int board, int channel, double t) {
  const double f = 1.7 + 0.9 * board + 0.5 * channel;
  return 540 + 40 * channel + 150 * std::sin(2 * M_PI * f * t + board) +
         60 * std::sin(2 * M_PI * 9.3 * t + channel);
}

inline void set_motion(logger &l) {
  l.front.sensor = [](int channel, double t) { return motion(0, channel, t); };
  l.rear.sensor = [](int channel, double t) { return motion(1, channel, t); };
}

#endif
