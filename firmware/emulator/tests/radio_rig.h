/* Two or three nRF24L01 without boards' programs: their pins are moved by the test. */
#ifndef RADIO_RIG_H
#define RADIO_RIG_H

#include "check.h"

typedef struct rig {
    timeline line;
    air air;
    board boards[3];
    wire *wires[3][RADIO_PINS];
    int hands[3][RADIO_PINS]; /* the test's own drivers */
    radio *radios[3];
} rig;

void rig_start(rig *g, int count, uint64_t seed);
void rig_finish(rig *g);

/* Lets calls happen for so many seconds; no program runs. */
void rig_run(rig *g, double seconds);

/* Moves a pin of radio `i`, or looks at one. */
void rig_set(rig *g, int i, int pin, bool level);
bool rig_level(const rig *g, int i, int pin);

/* A command by SPI with its bytes, which are replaced by the answer; returns the status. */
uint8_t rig_command(rig *g, int i, uint8_t code, uint8_t *bytes, int count);

/* A register of one byte, and an address of the logger's pattern. */
void rig_put(rig *g, int i, uint8_t number, uint8_t value);
uint8_t rig_get(rig *g, int i, uint8_t number);
void rig_address(rig *g, int i, uint8_t number, uint8_t lowest);

/* Writes a payload that counts from `first` by the given command. */
void rig_payload(rig *g, int i, uint8_t code, uint8_t first, int length);

/* Radio 0 sends to radio 1, which listens on pipe 1: 1 Mbit/s, 2 bytes of CRC, 500 us, 5 repeats. */
void rig_link_up(rig *g);

/* CE high for 12 us. */
void rig_pulse(rig *g, int i);

#endif
