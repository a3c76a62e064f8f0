/* Interrupt flags that are cleared by writing one, and fire when they are unmasked. */
#ifndef EMULATOR_FLAGS_H
#define EMULATOR_FLAGS_H

#include <stdint.h>

struct board;

/* simavr 1.6 clears all flags of a timer on any write to TIFRn, *sets* those of EIFR and PCIFR, and
 * never fires an interrupt whose flag rose before it was enabled. */
void flags_install(struct board *b);

/* The bits that the instruction at hand writes: SBI writes one bit only (data sheet 2593, section
 * 12.2.2), where simavr reads the register, sets the bit and writes all eight back. */
uint8_t flags_bits_written(const struct board *b, uint8_t value);

#endif
