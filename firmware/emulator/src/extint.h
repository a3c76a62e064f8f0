/* External interrupts INT0 to INT2 where simavr 1.6 has them wrong. */
#ifndef EMULATOR_EXTINT_H
#define EMULATOR_EXTINT_H

#include <stdint.h>

struct board;

typedef struct extint {
    uint8_t level; /* bit n: INTn is enabled and triggered by a low level */
} extint;

void extint_install(struct board *b);
void extint_after_reset(struct board *b);

/* Raises the interrupts whose pins are low; to be called between instructions while `level` is set.
 */
void extint_raise_levels(struct board *b);

#endif
