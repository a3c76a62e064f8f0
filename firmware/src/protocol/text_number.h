// Numbers and fixed words as text. Each put_ function writes at `out`, without a closing zero, and returns
// the place after it.

#ifndef PROTOCOL_TEXT_NUMBER_H
#define PROTOCOL_TEXT_NUMBER_H

#include <stdint.h>

/// Decimal, without leading zeros.
char *put_number(char *out, uint32_t value);
/// Decimal with a sign where negative.
char *put_signed(char *out, int32_t value);
/// The last `digits` decimal digits, with leading zeros.
char *put_digits(char *out, uint32_t value, uint8_t digits);
/// Upper-case hexadecimal, `digits` of them.
char *put_hex(char *out, uint32_t value, uint8_t digits);
/// Binary, `digits` of them.
char *put_binary(char *out, uint32_t value, uint8_t digits);
/// Copies a text that lies in flash (IN_FLASH).
char *put_flash(char *out, const char *flash_text);
/// Whether `text` is, or begins with, a text that lies in flash.
bool is_flash(const char *text, const char *flash_text);
bool begins_with_flash(const char *text, const char *flash_text);

#endif
