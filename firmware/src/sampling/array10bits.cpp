#include "sampling/array10bits.h"

namespace {
// Byte that holds the lowest bit of number `index`: five bytes for each four numbers.
int16_t first_byte(int16_t index) {
  const int16_t four = static_cast<int16_t>(index >> 2);
  return static_cast<int16_t>(four * 5 + (index & 3));
}
}  // namespace

uint16_t array10bits::get(int16_t index) const {
  if (index < 0 || index >= size_) return out_of_range;
  const uint8_t *at = room_ + first_byte(index);
  const uint8_t shift = static_cast<uint8_t>((index & 3) * 2);
  const uint16_t both = static_cast<uint16_t>(at[0] | at[1] << 8);
  return static_cast<uint16_t>(both >> shift & 0x03FF);
}

bool array10bits::put(int16_t index, uint16_t data) {
  if (index < 0 || index >= size_) return false;
  uint8_t *at = room_ + first_byte(index);
  const uint8_t shift = static_cast<uint8_t>((index & 3) * 2);
  const uint16_t mask = static_cast<uint16_t>(0x03FFu << shift);
  const uint16_t bits = static_cast<uint16_t>(static_cast<uint16_t>(data << shift) & mask);
  at[0] = static_cast<uint8_t>((at[0] & ~mask) | bits);
  at[1] = static_cast<uint8_t>((at[1] & ~(mask >> 8)) | bits >> 8);
  return true;
}

uint8_t array10bits::get_data_byte(int16_t byte_number) const {
  if (byte_number < 0 || byte_number >= bytes()) return 0;
  return room_[byte_number];
}
