// The packed store against a plain vector.

#include "check.h"
#include "sampling/array10bits.h"

TEST(array10bits_is_a_vector_of_numbers) {
  std::mt19937 chance(1);
  for (const int16_t size :
       {int16_t{1}, int16_t{2}, int16_t{3}, int16_t{4}, int16_t{5}, int16_t{20}, int16_t{1600}}) {
    std::vector<uint8_t> room(
        static_cast<size_t>(array10bits::bytes_for(size)));  // exactly: ASan watches its end
    array10bits packed(room.data(), size);
    std::vector<uint16_t> plain(static_cast<size_t>(size), 0);
    for (int i = 0; i < 5000; ++i) {
      const int16_t index = static_cast<int16_t>(chance() % static_cast<unsigned>(size));
      const uint16_t value = static_cast<uint16_t>(chance() % 1024);
      CHECK(packed.put(index, value));
      plain[static_cast<size_t>(index)] = value;
      const int16_t look = static_cast<int16_t>(chance() % static_cast<unsigned>(size));
      CHECK_EQUAL(packed.get(look), plain[static_cast<size_t>(look)]);
    }
    // The bytes are the numbers' bits in a row, the lowest first.
    for (int bit = 0; bit < 10 * size; ++bit) {
      const int in_byte = packed.get_data_byte(static_cast<int16_t>(bit / 8)) >> bit % 8 & 1;
      CHECK_EQUAL(in_byte, plain[static_cast<size_t>(bit / 10)] >> bit % 10 & 1);
    }
    CHECK_EQUAL(packed.size(), size);
    CHECK_EQUAL(packed.bytes(), (10 * size + 7) / 8);
  }
}

TEST(array10bits_says_what_is_out_of_range) {
  std::vector<uint8_t> room(25);
  array10bits packed(room.data(), 20);
  for (const int16_t index : {int16_t{-1}, int16_t{20}, int16_t{32767}, int16_t{-32768}}) {
    CHECK_EQUAL(packed.get(index), 0x8000);
    CHECK(!packed.put(index, 5));
  }
  CHECK_EQUAL(packed.get_data_byte(-1), 0);
  CHECK_EQUAL(packed.get_data_byte(25), 0);
  CHECK(packed.put(0, 0xFFFF));  // only ten bits are kept
  CHECK_EQUAL(packed.get(0), 1023);
  CHECK_EQUAL(packed.get(1), 0);
}

TEST(array10bits_of_a_board_takes_2000_bytes) { CHECK_EQUAL(array10bits::bytes_for(1600), 2000); }
