// A frame and its body on every link: address, kind, seq, payload, CRC-16. PROTOCOL.md lists the kinds.

#ifndef PROTOCOL_FRAME_H
#define PROTOCOL_FRAME_H

#include <stdint.h>

constexpr uint8_t max_payload = 26;
constexpr uint8_t min_body = 5;
constexpr uint8_t max_body = min_body + max_payload;  // 31: one radio packet holds it with its length

namespace address {
constexpr uint8_t laptop = 0, slave_1 = 1, slave_2 = 2, master = 3;
}

namespace kind {
// Laptop to Slave 1.
constexpr uint8_t hello = 0x01, config = 0x02, start = 0x03, trigger = 0x04, stop = 0x05, send = 0x06,
                  get = 0x07, done = 0x08, status = 0x09, dump = 0x0A, nap = 0x0B, heard = 0x0C;
// Slave 1 to Slave 2, and ALARM the other way.
constexpr uint8_t prepare = 0x20, arm = 0x21, time = 0x22, listen = 0x23, beacon = 0x24, beacons = 0x25,
                  begin = 0x26, finish = 0x27, report = 0x28, halt = 0x29, alarm = 0x2A, close = 0x2B;
// Unasked.
constexpr uint8_t block = 0x40, event = 0x41;
constexpr uint8_t reply = 0x80;  // a reply's kind is its request's with this bit
}  // namespace kind

/// What a reply says of its request.
enum class result : uint8_t { done = 0, not_now = 1, bad_value = 2, differs = 3, no_answer = 4, busy = 5 };

struct frame {
  uint8_t to = 0;
  uint8_t from = 0;
  uint8_t kind = 0;
  uint8_t seq = 0;
  uint8_t size = 0;  // of the payload
  uint8_t payload[max_payload];

  bool is_reply() const { return (kind & ::kind::reply) != 0; }
};

/// Empty reply to `request`: addresses turned round, bit 7 of the kind set, same seq.
frame reply_to(const frame &request);

/// Writes the body with its CRC-16 into `body` (max_body bytes). Returns its length, 5 to 31.
uint8_t frame_to_body(const frame &f, uint8_t *body);

/// Reads a body. False when its length is not 5 to 31 or the CRC-16 does not fit.
bool frame_from_body(const uint8_t *body, uint8_t size, frame &f);

#endif
