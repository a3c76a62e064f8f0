#include "protocol/frame.h"

#include <string.h>

#include "protocol/crc.h"

frame reply_to(const frame &request) {
  frame f;
  f.to = request.from;
  f.from = request.to;
  f.kind = request.kind | kind::reply;
  f.seq = request.seq;
  return f;
}

uint8_t frame_to_body(const frame &f, uint8_t *body) {
  body[0] = static_cast<uint8_t>(f.to << 4 | (f.from & 0x0F));
  body[1] = f.kind;
  body[2] = f.seq;
  memcpy(body + 3, f.payload, f.size);
  const uint8_t checked = static_cast<uint8_t>(3 + f.size);
  const uint16_t crc = crc16(body, checked);
  body[checked] = static_cast<uint8_t>(crc);
  body[checked + 1] = static_cast<uint8_t>(crc >> 8);
  return static_cast<uint8_t>(checked + 2);
}

bool frame_from_body(const uint8_t *body, uint8_t size, frame &f) {
  if (size < min_body || size > max_body) return false;
  const uint8_t checked = static_cast<uint8_t>(size - 2);
  const uint16_t said = static_cast<uint16_t>(body[checked] | body[checked + 1] << 8);
  if (crc16(body, checked) != said) return false;
  f.to = static_cast<uint8_t>(body[0] >> 4);
  f.from = body[0] & 0x0F;
  f.kind = body[1];
  f.seq = body[2];
  f.size = static_cast<uint8_t>(checked - 3);
  memcpy(f.payload, body + 3, f.size);
  return true;
}
