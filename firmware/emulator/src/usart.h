/* USART0 in asynchronous mode, instead of simavr's.
 *
 * simavr 1.6 counts a parity bit that 8N1 does not have (11 bits a byte), queues 64 received bytes
 * where the part holds two and one in the shift register, and raises UDRE only when the shift
 * register is empty too. */
#ifndef EMULATOR_USART_H
#define EMULATOR_USART_H

#include <stdbool.h>
#include <stdint.h>

#include "serial.h"

struct board;

#define USART_RECEIVE_ROOM 3 /* two bytes of buffer and the shift register */

typedef struct usart {
    struct avr_int_vector_t *on_receive, *on_empty, *on_sent; /* simavr's vectors */
    serial_end end;  /* who hears TXD; none when `end.hear` is NULL */
    bool level;      /* an interrupt that is a level may be due: UDRE or RXC */

    uint8_t shifting, waiting;
    bool busy, full;

    uint8_t received[USART_RECEIVE_ROOM], errors[USART_RECEIVE_ROOM];
    int count;
    double full_until; /* s: when the receiver last had no room */
    bool overrun;

    struct {
        unsigned long sent, received, overruns, framing, overwritten;
    } total;
} usart;

void usart_install(struct board *b);
void usart_after_reset(struct board *b);

/* Raises RXC or UDRE where it is due; to be called between instructions while `level` is set. */
void usart_raise_levels(struct board *b);

/* A byte at RXD, to be given as a `serial_end` with the board as owner. */
void usart_hear(void *board, uint8_t byte, double time, double bit);

/* Bit time in seconds of the board's true clock, from UBRR0 and U2X0. */
double usart_bit(const struct board *b);

#endif
