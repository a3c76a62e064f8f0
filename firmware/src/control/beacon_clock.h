// One instant on two clocks, from packets that both boards have timed.
//
// Each beacon heard gives a pair of ticks. The pair with the median difference is taken: it is a real event,
// and a stamp that another interrupt made late (by some 15 us) cannot move it. With two or more beacons heard
// there is an answer.

#ifndef CONTROL_BEACON_CLOCK_H
#define CONTROL_BEACON_CLOCK_H

#include <stdint.h>

#include "units.h"

constexpr uint8_t beacon_count = 5;

struct common_instant {
  tick here = 0;
  tick there = 0;
};

class beacon_clock {
 public:
  void clear() { sent_ = 0; }
  /// Beacon `number`, 0 to 4, left here at `at`.
  void sent(uint8_t number, tick at);
  /// Picks the median of the beacons that were sent and heard. False with fewer than two.
  bool pick(uint8_t heard, const tick *there, common_instant &instant) const;

 private:
  uint8_t sent_ = 0;  // bit mask
  tick at_[beacon_count];
};

/// How much later than `start.there + (mark - start.here)` the instant `mark` of our clock comes on the other
/// clock, whose rate follows from the two instants; in its ticks, rounded. `mark` lies near `start`.
int16_t late_there(common_instant start, common_instant end, tick mark);

#endif
