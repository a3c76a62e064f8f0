#include "protocol/text_number.h"

#include "boards/flash.h"

char *put_digits(char *out, uint32_t value, uint8_t digits) {
  for (uint8_t i = digits; i > 0; --i) {
    out[i - 1] = static_cast<char>('0' + value % 10);
    value /= 10;
  }
  return out + digits;
}

char *put_number(char *out, uint32_t value) {
  uint8_t digits = 1;
  for (uint32_t rest = value; rest >= 10; rest /= 10) ++digits;
  return put_digits(out, value, digits);
}

char *put_signed(char *out, int32_t value) {
  if (value >= 0) return put_number(out, static_cast<uint32_t>(value));
  *out++ = '-';
  return put_number(out, 0u - static_cast<uint32_t>(value));
}

char *put_hex(char *out, uint32_t value, uint8_t digits) {
  for (uint8_t i = digits; i > 0; --i, value >>= 4) {
    const uint8_t nibble = value & 0x0F;
    out[i - 1] = static_cast<char>(nibble < 10 ? '0' + nibble : 'A' + nibble - 10);
  }
  return out + digits;
}

char *put_binary(char *out, uint32_t value, uint8_t digits) {
  for (uint8_t i = digits; i > 0; --i, value >>= 1) out[i - 1] = static_cast<char>('0' + (value & 1));
  return out + digits;
}

char *put_flash(char *out, const char *flash_text) {
  for (char c = flash_char(flash_text); c != 0; c = flash_char(++flash_text)) *out++ = c;
  return out;
}

bool begins_with_flash(const char *text, const char *flash_text) {
  for (char c = flash_char(flash_text); c != 0; c = flash_char(++flash_text)) {
    if (*text++ != c) return false;
  }
  return true;
}

bool is_flash(const char *text, const char *flash_text) {
  while (*text != 0 && *text == flash_char(flash_text)) {
    ++text;
    ++flash_text;
  }
  return *text == flash_char(flash_text);
}
