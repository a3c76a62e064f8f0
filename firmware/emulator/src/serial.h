/* One direction of an asynchronous serial line, 8N1. */
#ifndef EMULATOR_SERIAL_H
#define EMULATOR_SERIAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "chance.h"
#include "timeline.h"

#define SERIAL_BITS 10 /* start, eight, stop */

/* Who hears a byte. Called in the middle of its stop bit; `bit` is the sender's bit time (s). */
typedef struct serial_end {
    void (*hear)(void *owner, uint8_t byte, double time, double bit);
    void *owner;
} serial_end;

/* True when a receiver with bit time `mine` reads what a sender with `theirs` sends: by the last
 * sampling point, 9.5 bits on, they must not be half a bit apart. */
bool serial_agrees(double mine, double theirs);

/* A sender: bytes wait in line and go out back to back. */
typedef struct serial_line {
    timeline *line;
    serial_end end;
    double bit;          /* s */
    uint8_t *bytes;      /* waiting, the one on the wire first */
    size_t first, count, capacity;
    bool busy;
    double error_rate;   /* probability that a bit arrives inverted */
    chance chance;
    unsigned long sent, spoilt;
    void (*emptied)(void *owner, double time); /* the last byte has gone; may be NULL */
    void *emptied_owner;
} serial_line;

void serial_start(serial_line *s, timeline *line, double baud, serial_end end);
void serial_send(serial_line *s, uint8_t byte, double time);
void serial_free(serial_line *s);

/* Inverts each bit with the given probability; adds the number of bytes hit to `spoilt`. */
uint8_t serial_spoil(uint8_t byte, double error_rate, chance *c, unsigned long *spoilt);

#endif
