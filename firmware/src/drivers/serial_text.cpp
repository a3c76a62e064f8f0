#include "drivers/serial_text.h"

#include "protocol/text_number.h"

void serial_text::puts(const char *text) {
  while (*text != 0) putchar(*text++);
}

void serial_text::write_bin(uint8_t number) {
  char text[9];
  *put_binary(text, number, 8) = 0;
  puts(text);
}

void serial_text::write_bin(uint16_t number) {
  char text[17];
  *put_binary(text, number, 16) = 0;
  puts(text);
}

void serial_text::write_hex(uint8_t number) {
  char text[3];
  *put_hex(text, number, 2) = 0;
  puts(text);
}

void serial_text::write_hex(uint16_t number) {
  char text[5];
  *put_hex(text, number, 4) = 0;
  puts(text);
}

void serial_text::write_hex(uint32_t number) {
  char text[9];
  *put_hex(text, number, 8) = 0;
  puts(text);
}

void serial_text::write(uint32_t number) {
  char text[11];
  *put_number(text, number) = 0;
  puts(text);
}

void serial_text::write(int32_t number) {
  char text[12];
  *put_signed(text, number) = 0;
  puts(text);
}

void serial_text::write(uint8_t number) { write(static_cast<uint32_t>(number)); }
void serial_text::write(uint16_t number) { write(static_cast<uint32_t>(number)); }
void serial_text::write(int8_t number) { write(static_cast<int32_t>(number)); }
void serial_text::write(int16_t number) { write(static_cast<int32_t>(number)); }
