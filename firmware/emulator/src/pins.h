/* The port pins of one board, and what simavr 1.6 gets wrong about inputs. */
#ifndef EMULATOR_PINS_H
#define EMULATOR_PINS_H

#include <stdbool.h>
#include <stdint.h>

struct board;
struct wire;

#define PORTS 4

/* A pin's drive as its wire sees it. */
typedef enum pin_drive { PIN_FLOATS, PIN_PULLED_UP, PIN_LOW, PIN_HIGH } pin_drive;

typedef struct pins {
    struct wire *wires[PORTS][8]; /* NULL: nothing is connected */
    uint8_t direction[PORTS], output[PORTS];
    uint8_t input[PORTS]; /* levels applied from outside */
    struct avr_ioport_t *port[PORTS]; /* simavr's */
    struct avr_irq_t *irq[PORTS][8];
    bool jtag; /* PC2 to PC5 belong to JTAG, as they do after reset with the factory's fuses */
    uint64_t jtag_asked; /* cycle of the first of the two writes that turn it off */
} pins;

void pins_install(struct board *b);
void pins_after_reset(struct board *b);

/* Drive of one pin; port 0 is A. */
pin_drive pins_drive(const struct board *b, int port, int bit);

/* Connects a pin to a wire that will tell its level by `pins_apply`. */
void pins_connect(struct board *b, int port, int bit, struct wire *wire);

/* The level that the rest of the world gives to a pin, from time `time` on. */
void pins_apply(struct board *b, int port, int bit, bool level, double time);

/* What the program would read, whoever drives it. */
bool pins_level(const struct board *b, int port, int bit);

#endif
