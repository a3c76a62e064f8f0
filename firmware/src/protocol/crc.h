// The two checks of PROTOCOL.md. Both go bit by bit: a table would cost RAM, and there is time.

#ifndef PROTOCOL_CRC_H
#define PROTOCOL_CRC_H

#include <stdint.h>

/// CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, not reflected) of `size` bytes.
uint16_t crc16(const uint8_t *data, uint8_t size);

/// CRC-32 of IEEE 802.3, as zlib computes it; bytes are added as they come.
class crc32 {
 public:
  void add(uint8_t byte);
  void add(const uint8_t *data, uint8_t size);
  uint32_t value() const { return ~state_; }

 private:
  uint32_t state_ = 0xFFFFFFFF;
};

#endif
