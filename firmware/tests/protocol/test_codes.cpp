// CRCs, COBS, numbers in frames and as text, against other ways to compute them.

#include <cstdio>
#include <cstring>

#include "check.h"
#include "protocol/bytes.h"
#include "protocol/cobs.h"
#include "protocol/crc.h"
#include "protocol/text_number.h"

namespace {

std::vector<uint8_t> random_bytes(std::mt19937 &chance, size_t size, int zero_in) {
  std::vector<uint8_t> data(size);
  for (uint8_t &byte : data)
    byte = chance() % static_cast<unsigned>(zero_in) == 0 ? 0 : static_cast<uint8_t>(chance());
  return data;
}

/// CRC-16 as the remainder of a long division of the message's bits, the first 16 inverted, by x^16 + x^12 +
/// x^5 + 1.
uint16_t divided(const std::vector<uint8_t> &data) {
  std::vector<int> bits;
  for (const uint8_t byte : data) {
    for (int bit = 7; bit >= 0; --bit) bits.push_back(byte >> bit & 1);
  }
  bits.resize(bits.size() + 16, 0);
  for (size_t i = 0; i < 16; ++i) bits[i] ^= 1;
  for (size_t i = 0; i + 16 < bits.size(); ++i) {
    if (bits[i] == 0) continue;
    for (const size_t power : {size_t{0}, size_t{4}, size_t{11}, size_t{16}}) bits[i + power] ^= 1;
  }
  uint16_t rest = 0;
  for (size_t i = bits.size() - 16; i < bits.size(); ++i) rest = static_cast<uint16_t>(rest << 1 | bits[i]);
  return rest;
}

}  // namespace

TEST(crc16_is_a_remainder) {
  const char *digits = "123456789";
  CHECK_EQUAL(crc16(reinterpret_cast<const uint8_t *>(digits), 9), 0x29B1);
  std::mt19937 chance(1);
  for (int i = 0; i < 200; ++i) {
    const auto data = random_bytes(chance, 2 + chance() % 29, 5);
    CHECK_EQUAL(crc16(data.data(), static_cast<uint8_t>(data.size())), divided(data));
  }
}

TEST(crc16_sees_every_three_wrong_bits) {
  // Its Hamming distance is 4 up to 32751 bits; here all triples of a frame of 12 bytes and its CRC.
  std::mt19937 chance(2);
  auto data = random_bytes(chance, 12, 5);
  const uint16_t crc = crc16(data.data(), 12);
  data.push_back(static_cast<uint8_t>(crc >> 8));
  data.push_back(static_cast<uint8_t>(crc));
  const size_t bits = data.size() * 8;
  int missed = 0;
  const auto flip = [&](size_t bit) {
    data[bit / 8] = static_cast<uint8_t>(data[bit / 8] ^ 0x80u >> bit % 8);
  };
  for (size_t a = 0; a < bits; a += 3) {
    for (size_t b = a + 1; b < bits; b += 2) {
      for (size_t c = b + 1; c < bits; ++c) {
        flip(a), flip(b), flip(c);
        if (crc16(data.data(), 14) == 0) ++missed;
        flip(a), flip(b), flip(c);
      }
    }
  }
  CHECK_EQUAL(crc16(data.data(), 14), 0);
  CHECK_EQUAL(missed, 0);
}

TEST(crc32_is_zlibs) {
  crc32 sum;
  sum.add(reinterpret_cast<const uint8_t *>("123456789"), 9);
  CHECK_EQUAL(sum.value(), 0xCBF43926u);
  CHECK_EQUAL(crc32().value(), 0u);
  crc32 zeros;
  for (int i = 0; i < 4; ++i) zeros.add(0);
  CHECK_EQUAL(zeros.value(), 0x2144DF1Cu);
}

TEST(cobs_gives_back_what_it_got) {
  std::mt19937 chance(3);
  for (int i = 0; i < 3000; ++i) {
    const auto data = random_bytes(chance, 1 + chance() % 60, 1 + static_cast<int>(chance() % 9));
    std::vector<uint8_t> stuffed(data.size() + 1);
    const uint8_t size = cobs_stuff(data.data(), static_cast<uint8_t>(data.size()), stuffed.data());
    CHECK_EQUAL(size, data.size() + 1);
    CHECK(std::memchr(stuffed.data(), 0, size) == nullptr);
    const uint8_t back = cobs_unstuff(stuffed.data(), size);
    CHECK_EQUAL(back, data.size());
    CHECK(std::memcmp(stuffed.data(), data.data(), back) == 0);
  }
}

TEST(cobs_refuses_what_cannot_be) {
  std::mt19937 chance(4);
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    auto noise = random_bytes(chance, 1 + chance() % 40, 300);
    const size_t given = noise.size();
    const uint8_t size =
        cobs_unstuff(noise.data(), static_cast<uint8_t>(given));  // must stay inside: ASan watches
    CHECK(size < given);
    if (size > 0) ++accepted;
  }
  CHECK(accepted < 20000 / 4);
  uint8_t past[] = {5, 1, 1};
  CHECK_EQUAL(cobs_unstuff(past, 3), 0);
  uint8_t zero_inside[] = {3, 0, 1};
  CHECK_EQUAL(cobs_unstuff(zero_inside, 3), 0);
  uint8_t alone[] = {1};
  CHECK_EQUAL(cobs_unstuff(alone, 1), 0);
}

TEST(numbers_in_frames_come_back) {
  uint8_t data[16];
  byte_writer out(data);
  out.u8(0xFE);
  out.u16(0xBEEF);
  out.u32(0xDEADBEEF);
  out.i16(-32768);
  CHECK_EQUAL(out.size(), 9);
  CHECK_EQUAL(data[1], 0xEF);
  byte_reader in(data, 9);
  CHECK_EQUAL(in.u8(), 0xFE);
  CHECK_EQUAL(in.u16(), 0xBEEF);
  CHECK_EQUAL(in.u32(), 0xDEADBEEFu);
  CHECK_EQUAL(in.i16(), -32768);
  CHECK(!in.short_of_data());
  CHECK_EQUAL(in.u16(), 0);
  CHECK(in.short_of_data());
}

TEST(numbers_as_text_are_printfs) {
  std::mt19937 chance(5);
  for (int i = 0; i < 2000; ++i) {
    const uint32_t value = static_cast<uint32_t>(chance()) >> chance() % 32;
    char ours[40];
    char theirs[40];
    *put_number(ours, value) = 0;
    std::snprintf(theirs, sizeof theirs, "%u", value);
    CHECK_EQUAL(std::string(ours), std::string(theirs));
    *put_signed(ours, static_cast<int32_t>(value)) = 0;
    std::snprintf(theirs, sizeof theirs, "%d", static_cast<int32_t>(value));
    CHECK_EQUAL(std::string(ours), std::string(theirs));
    *put_hex(ours, value, 8) = 0;
    std::snprintf(theirs, sizeof theirs, "%08X", value);
    CHECK_EQUAL(std::string(ours), std::string(theirs));
    *put_digits(ours, value, 3) = 0;
    std::snprintf(theirs, sizeof theirs, "%03u", value % 1000);
    CHECK_EQUAL(std::string(ours), std::string(theirs));
  }
  char text[9];
  *put_binary(text, 0xA5, 8) = 0;
  CHECK_EQUAL(std::string(text), std::string("10100101"));
  char least[12];
  *put_signed(least, -2147483647 - 1) = 0;
  CHECK_EQUAL(std::string(least), std::string("-2147483648"));
}
