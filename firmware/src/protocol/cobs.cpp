#include "protocol/cobs.h"

uint8_t cobs_stuff(const uint8_t *data, uint8_t size, uint8_t *out) {
  uint8_t *code = out;  // where the distance to the next zero will stand
  uint8_t distance = 1;
  for (uint8_t i = 0; i < size; ++i) {
    if (data[i] != 0) {
      code[distance++] = data[i];
      continue;
    }
    *code = distance;
    code += distance;
    distance = 1;
  }
  *code = distance;
  return static_cast<uint8_t>(size + 1);
}

uint8_t cobs_unstuff(uint8_t *data, uint8_t size) {
  if (size < 2) return 0;
  uint8_t next = data[0];  // position of the next code
  if (next == 0) return 0;
  for (uint8_t i = 1; i < size; ++i) {
    uint8_t byte = data[i];
    if (byte == 0) return 0;
    if (i == next) {
      const uint16_t after = static_cast<uint16_t>(next + byte);
      if (after > size) return 0;
      next = static_cast<uint8_t>(after);
      byte = 0;
    }
    data[i - 1] = byte;
  }
  return next == size ? static_cast<uint8_t>(size - 1) : 0;
}
