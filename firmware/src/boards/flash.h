// Text that stays in flash. On the AVR constant data would otherwise be copied to RAM at the start; elsewhere
// this is plain text.

#ifndef BOARDS_FLASH_H
#define BOARDS_FLASH_H

#ifdef __AVR__
#include <avr/pgmspace.h>
#define IN_FLASH(text) PSTR(text)
inline char flash_char(const char *at) { return static_cast<char>(pgm_read_byte(at)); }
#else
#define IN_FLASH(text) (text)
inline char flash_char(const char *at) { return *at; }
#endif

#endif
