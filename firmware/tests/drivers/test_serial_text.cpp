// The write functions of the serial classes.

#include "check.h"
#include "drivers/serial_text.h"

TEST(serial_text_writes_numbers) {
  struct page : serial_text {
    std::string text;
    int8_t putchar(char c) override {
      text += c;
      return 0;
    }
  } out;
  const auto wrote = [&](auto call) {
    out.text.clear();
    call();
    return out.text;
  };
  CHECK_EQUAL(wrote([&] { out.write(uint8_t{200}); }), std::string("200"));
  CHECK_EQUAL(wrote([&] { out.write(int8_t{-100}); }), std::string("-100"));
  CHECK_EQUAL(wrote([&] { out.write(uint16_t{65535}); }), std::string("65535"));
  CHECK_EQUAL(wrote([&] { out.write(int16_t{-32768}); }), std::string("-32768"));
  CHECK_EQUAL(wrote([&] { out.write(uint32_t{4294967295u}); }), std::string("4294967295"));
  CHECK_EQUAL(wrote([&] { out.write(int32_t{-2147483647 - 1}); }), std::string("-2147483648"));
  CHECK_EQUAL(wrote([&] { out.write_hex(uint8_t{0x0A}); }), std::string("0A"));
  CHECK_EQUAL(wrote([&] { out.write_hex(uint16_t{0xBEEF}); }), std::string("BEEF"));
  CHECK_EQUAL(wrote([&] { out.write_hex(uint32_t{0x00C0FFEE}); }), std::string("00C0FFEE"));
  CHECK_EQUAL(wrote([&] { out.write_bin(uint8_t{5}); }), std::string("00000101"));
  CHECK_EQUAL(wrote([&] { out.write_bin(uint16_t{0x8001}); }), std::string("1000000000000001"));
  CHECK_EQUAL(wrote([&] { out.puts("ASV\r\n"); }), std::string("ASV\r\n"));
}
