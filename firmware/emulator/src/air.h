/* The 2.4 GHz band that the nRF24L01 radios share. */
#ifndef EMULATOR_AIR_H
#define EMULATOR_AIR_H

#include <stdbool.h>
#include <stdint.h>

#include "chance.h"
#include "timeline.h"

#define AIR_RADIOS BOARDS_MAX
#define AIR_FLIGHTS 8

struct radio;

typedef struct air_packet {
    uint8_t channel, address[5], address_width, crc_bytes, rate_mbit;
    bool enhanced; /* with the packet control field */
    bool is_ack, no_ack;
    uint8_t pid, length, payload[32];
} air_packet;

typedef struct air {
    timeline *line;
    chance chance;
    double loss;   /* probability that a packet does not arrive at one listener */
    double jitter; /* s: a receiver knows the end of a packet up to so much late (uniform) */
    bool blocked;  /* nothing gets through */
    struct radio *radios[AIR_RADIOS];
    int radios_count;
    struct air_flight {
        struct air *air;
        struct radio *sender;
        air_packet packet;
        double begin, end;
        bool in_use, collided;
    } flights[AIR_FLIGHTS];
    struct {
        unsigned long packets, lost, collided, delivered;
    } total;
} air;

void air_start(air *a, timeline *line);

/* Time on the air in seconds: preamble, address, control field of 9 bits, payload, CRC. */
double air_duration(const air_packet *p);

/* Puts a packet on the air at `time`; `radio_sent` is called at its end. */
void air_send(air *a, struct radio *sender, const air_packet *p, double time);

/* True while another radio than `listener` is sending on the channel. */
bool air_busy(const air *a, const struct radio *listener, uint8_t channel);

/* s: since when it has been busy; infinity when it is not. */
double air_busy_since(const air *a, const struct radio *listener, uint8_t channel);

#endif
