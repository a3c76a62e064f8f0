// Bits of a register, without the conversions to int that `|=` makes. With constant masks these are single
// instructions.

#ifndef BOARDS_AVR_BITS_H
#define BOARDS_AVR_BITS_H

#include <stdint.h>

/// Mask of bit `number`.
constexpr uint8_t bit(uint8_t number) { return static_cast<uint8_t>(1u << number); }

__attribute__((always_inline)) inline void set_bits(volatile uint8_t &reg, uint8_t mask) {
  reg = static_cast<uint8_t>(reg | mask);
}

__attribute__((always_inline)) inline void clear_bits(volatile uint8_t &reg, uint8_t mask) {
  reg = static_cast<uint8_t>(reg & static_cast<uint8_t>(~mask));
}

#endif
