// Numbers in a frame: little-endian, written and read in order.

#ifndef PROTOCOL_BYTES_H
#define PROTOCOL_BYTES_H

#include <stdint.h>

/// Appends numbers to a buffer; the caller knows that they fit.
class byte_writer {
 public:
  explicit byte_writer(uint8_t *start) : start_(start), at_(start) {}
  void u8(uint8_t value) { *at_++ = value; }
  void u16(uint16_t value) {
    u8(static_cast<uint8_t>(value));
    u8(static_cast<uint8_t>(value >> 8));
  }
  void u32(uint32_t value) {
    u16(static_cast<uint16_t>(value));
    u16(static_cast<uint16_t>(value >> 16));
  }
  void i16(int16_t value) { u16(static_cast<uint16_t>(value)); }
  uint8_t size() const { return static_cast<uint8_t>(at_ - start_); }

 private:
  uint8_t *start_;
  uint8_t *at_;
};

/// Reads numbers from a buffer; past its end every byte is zero and `short_of_data()` tells.
class byte_reader {
 public:
  byte_reader(const uint8_t *data, uint8_t size) : at_(data), left_(size) {}
  uint8_t u8() {
    if (left_ == 0) {
      missed_ = true;
      return 0;
    }
    --left_;
    return *at_++;
  }
  uint16_t u16() {
    const uint16_t low = u8();
    return static_cast<uint16_t>(low | static_cast<uint16_t>(u8()) << 8);
  }
  uint32_t u32() {
    const uint32_t low = u16();
    return low | static_cast<uint32_t>(u16()) << 16;
  }
  int16_t i16() { return static_cast<int16_t>(u16()); }
  bool short_of_data() const { return missed_; }

 private:
  const uint8_t *at_;
  uint8_t left_;
  bool missed_ = false;
};

#endif
