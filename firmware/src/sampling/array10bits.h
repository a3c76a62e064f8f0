// Packed 10-bit store (reference App. B.8): four numbers in five bytes, 37 % less than 16-bit integers.
//
// Number i fills bits 10i to 10i + 9, bit 0 being the lowest of byte 0. The room is given from outside: there
// is no heap here. An interrupt may put one number while the program gets another, as long as they share no
// byte.

#ifndef SAMPLING_ARRAY10BITS_H
#define SAMPLING_ARRAY10BITS_H

#include <stdint.h>

class array10bits {
 public:
  /// Bytes needed for `size` numbers.
  static constexpr int16_t bytes_for(int16_t size) { return static_cast<int16_t>((size * 10L + 7) / 8); }
  static constexpr uint16_t out_of_range = 0x8000;

  /// A store of `new_size` numbers in `room`, which has bytes_for(new_size) bytes.
  array10bits(uint8_t *room, int16_t new_size) : room_(room), size_(new_size) {}

  /// The number at `index`, or 0x8000 when there is none.
  uint16_t get(int16_t index) const;
  /// Stores the low 10 bits of `data`; false when `index` is out of range.
  bool put(int16_t index, uint16_t data);
  /// One byte of the store; 0 when out of range.
  uint8_t get_data_byte(int16_t byte_number) const;
  int16_t size() const { return size_; }
  int16_t bytes() const { return bytes_for(size_); }

 private:
  uint8_t *room_;
  int16_t size_;
};

#endif
