#include "control/beacon_clock.h"

void beacon_clock::sent(uint8_t number, tick at) {
  sent_ = static_cast<uint8_t>(sent_ | 1u << number);
  at_[number] = at;
}

bool beacon_clock::pick(uint8_t heard, const tick *there, common_instant &instant) const {
  const uint8_t common = sent_ & heard;
  uint8_t order[beacon_count];  // numbers of the common ones, by ascending difference
  uint8_t count = 0;
  for (uint8_t n = 0; n < beacon_count; ++n) {
    if ((common >> n & 1) == 0) continue;
    uint8_t place = count++;
    const tick difference = there[n] - at_[n];
    while (place > 0 && before(difference, there[order[place - 1]] - at_[order[place - 1]])) {
      order[place] = order[place - 1];
      --place;
    }
    order[place] = n;
  }
  if (count < 2) return false;
  const uint8_t median = order[(count - 1) / 2];
  instant.here = at_[median];
  instant.there = there[median];
  return true;
}

int16_t late_there(common_instant start, common_instant end, tick mark) {
  const int64_t here = static_cast<int64_t>(end.here - start.here);
  const int32_t gained = static_cast<int32_t>((end.there - start.there) - (end.here - start.here));
  const int64_t twice = 2 * static_cast<int64_t>(static_cast<int32_t>(mark - start.here)) * gained;
  if (here <= 0) return 0;
  return static_cast<int16_t>((twice >= 0 ? twice + here : twice - here) / (2 * here));
}
