// Events that Slave 1 tells the laptop, and their texts (PROTOCOL.md, "Events").

#ifndef PROTOCOL_MESSAGES_H
#define PROTOCOL_MESSAGES_H

#include <stdint.h>

enum class event_code : uint8_t {
  run_started = 1,
  triggered = 2,
  run_done = 3,
  saturated = 4,
  no_answer = 5,
  no_pulse = 6,
  block_ready = 7,
  stopped = 8,
  poor_signal = 9,
  all_sent = 10,
  overruns = 11,
  run_lost = 12,
};

/// One event. `detail` is used by poor_signal: the lowest set bit names the flaw, bits 0 to 2 the wheel's
/// flags, bits 3 to 5 the chassis's (quality.h).
struct event {
  event_code code;
  uint8_t board;
  uint8_t state;
  uint8_t detail;
};

constexpr uint8_t longest_event_text = 23;

/// Writes the text with a closing zero (24 bytes at most) and returns its length.
uint8_t event_text(const event &e, char *out);

#endif
