/* The laptop at the end of the link: a pseudo-terminal, or the control channel.
 *
 * Nothing is dropped: when the reader of the pseudo-terminal is behind, virtual time waits for it;
 * when the modem says that it is full, the writer waits. */
#ifndef EMULATOR_LAPTOP_H
#define EMULATOR_LAPTOP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "serial.h"

typedef struct laptop_bytes {
    uint8_t *bytes;
    size_t first, count, capacity;
} laptop_bytes;

typedef struct laptop {
    timeline *line;
    bool connected;       /* to a modem or a cable */
    bool by_control;      /* bytes come and go over the control channel */
    int master, slave;    /* of the pseudo-terminal; -1 without one */
    char path[64];
    serial_line out;      /* what the laptop sends */
    laptop_bytes waiting; /* from the host, not yet on the line */
    laptop_bytes heard;   /* for the control channel */
    bool hold;            /* the modem's CTS is high */
    bool stop_on_data;    /* `timeline_run` ends as bytes come */
    unsigned long received, sent;
} laptop;

void laptop_start(laptop *l, timeline *line, double baud, serial_end out);

/* Opens a pseudo-terminal in raw mode; false when the system has none. */
bool laptop_open_terminal(laptop *l);

/* Waits until somebody has opened the pseudo-terminal, or `quit` becomes true. */
void laptop_wait_until_opened(laptop *l, volatile const int *quit);

/* Waits until what was written has been read: closing the pseudo-terminal would throw it away. */
void laptop_drain(laptop *l, volatile const int *quit);

/* A byte for the laptop: a `serial_end`. */
void laptop_hear(void *laptop, uint8_t byte, double time, double bit);

/* Bytes that the laptop is to send. */
void laptop_send(laptop *l, const uint8_t *bytes, size_t count, double time);

/* Takes what was written into the pseudo-terminal. */
void laptop_poll(laptop *l, double time);

/* CTS of the laptop's modem. */
void laptop_hold(void *laptop, bool high, double time);

/* Ends a wait for the reader of the pseudo-terminal. */
extern volatile int laptop_quit;

void laptop_free(laptop *l);

#endif
