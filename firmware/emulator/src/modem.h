/* A pair of 9XStream modems (X09-009) and the channel between them.
 *
 * Figures from the MaxStream 9XStream OEM module manual, version 2.8: 132 bytes of data buffer, CTS
 * high at 115 and low below 98 (page 11); for the 9600 baud module 2.0 ms before it keys up, 41.8
 * ms of header, 0.8 ms a byte, 1.6 ms of CRC (page 44). The receiver's light (page 45) stays on for
 * 36 bytes at most, which is taken as the longest packet: 36 bytes every 74.2 ms are 485 bytes a
 * second. */
#ifndef EMULATOR_MODEM_H
#define EMULATOR_MODEM_H

#include <stdbool.h>
#include <stdint.h>

#include "modem_command.h"
#include "serial.h"

#define MODEM_BUFFER 132
#define MODEM_CTS_HIGH 115
#define MODEM_CTS_LOW 98
#define MODEM_PACKET 36
#define MODEM_KEY_UP 2.0e-3
#define MODEM_HEADER 41.8e-3
#define MODEM_BYTE 0.8e-3
#define MODEM_CRC 1.6e-3
/* A listener waits so long after a packet before it sends itself: longer than the sender's key-up,
 * so that a continuous stream is not broken into (page 11: it "will not be transmitted until the
 * module no longer detects" the other). */
#define MODEM_GAP 4.0e-3
#define MODEM_WAKE 85e-3

/* What happens to a packet with a bit error: the manual says that CRC drops it (page 11). */
typedef enum modem_errors { MODEM_PASS_ERRORS, MODEM_DROP_ERRORS } modem_errors;

typedef struct modem_channel {
    timeline *line;
    chance chance;
    double error_rate; /* of a bit, on the air */
    double loss;       /* of a whole packet */
    modem_errors errors;
    bool blocked;
} modem_channel;

typedef enum modem_state { MODEM_IDLE, MODEM_KEYING, MODEM_HEADING, MODEM_SENDING } modem_state;

typedef struct modem {
    const char *name;
    modem_channel *channel;
    struct modem *other;
    serial_line out; /* DO */
    double bit;      /* s, of its serial side */

    uint8_t buffer[MODEM_BUFFER];
    int first, count;
    bool cts; /* true: high, do not send */
    void (*cts_changed)(void *owner, bool high, double time);
    void *owner;

    modem_state state;
    bool carrier, collided;
    double quiet_since; /* s: its own carrier ended */
    uint8_t packet[MODEM_PACKET];
    int packet_count;
    bool heard_from_start; /* the other one listened as the carrier came */

    modem_command command;
    bool asleep, sleep_pin;
    double awake_at; /* s */

    struct {
        unsigned long packets, lost, collided, bytes, spoilt, overflowed, asleep, misread;
    } total;
} modem;

void modem_channel_start(modem_channel *c, timeline *line);

/* Sets up one of the two; `out` hears its DO pin. */
void modem_start(modem *m, const char *name, modem_channel *c, modem *other, serial_end out);

/* A byte at DI: a `serial_end`. */
void modem_hear(void *modem, uint8_t byte, double time, double bit);

/* The SLEEP pin; it acts when SM is 1. */
void modem_sleep(modem *m, bool high, double time);

void modem_free(modem *m);

#endif
