#include "protocol/crc.h"

uint16_t crc16(const uint8_t *data, uint8_t size) {
  uint16_t crc = 0xFFFF;
  for (uint8_t i = 0; i < size; ++i) {
    crc = static_cast<uint16_t>(crc ^ static_cast<uint16_t>(data[i]) << 8);
    for (uint8_t bit = 0; bit < 8; ++bit) {
      const bool high = (crc & 0x8000) != 0;
      crc = static_cast<uint16_t>(crc << 1);
      if (high) crc ^= 0x1021;
    }
  }
  return crc;
}

void crc32::add(uint8_t byte) {
  state_ ^= byte;
  for (uint8_t bit = 0; bit < 8; ++bit) {
    const bool low = (state_ & 1) != 0;
    state_ >>= 1;
    if (low) state_ ^= 0xEDB88320;
  }
}

void crc32::add(const uint8_t *data, uint8_t size) {
  for (uint8_t i = 0; i < size; ++i) add(data[i]);
}
