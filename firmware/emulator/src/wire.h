/* A wire: pins of boards and of devices that are connected, with one level, unless it is cut. */
#ifndef EMULATOR_WIRE_H
#define EMULATOR_WIRE_H

#include <stdbool.h>

#include "board.h"

#define WIRE_PINS 8
#define WIRE_DEVICES 8

/* What a device does to a wire. */
typedef enum wire_drive { WIRE_FREE, WIRE_LOW, WIRE_HIGH } wire_drive;

/* Called with the new level whenever it changes. */
typedef void (*wire_listener)(void *owner, bool level, double time);

typedef struct wire {
    timeline *line;
    char name[NAME_MAX_LENGTH];
    bool rest; /* level when nobody drives it */
    bool cut;  /* each board has its own end, and no longer the other's */
    bool between_boards;
    struct {
        board *board;
        int port, bit;
    } pins[WIRE_PINS];
    int pins_count;
    struct {
        int side; /* index of the board it is mounted on */
        wire_drive drive;
        wire_listener listener; /* may be NULL */
        void *owner;
        bool told;
    } devices[WIRE_DEVICES];
    int devices_count;
    bool level[BOARDS_MAX]; /* at each board's end */
    bool settled;           /* levels have been told at least once */
    unsigned contentions;   /* times that two outputs were found against each other */
    bool contended;
    unsigned long edges;
} wire;

wire *wire_new(timeline *line, const char *name, bool rest);

/* The wire at a pin; one is made when there is none. */
wire *wire_at(board *b, int port, int bit);

/* Connects a pin; false when it is on another wire already or the wire is full. */
bool wire_add_pin(wire *w, board *b, int port, int bit);

/* Connects a device mounted on board `side`; returns its number on this wire. */
int wire_add_device(wire *w, const board *side, wire_listener listener, void *owner);

void wire_set(wire *w, int device, wire_drive drive, double time);

/* A pin of a board drives differently from `time` on. */
void wire_pin_changed(wire *w, double time);

void wire_cut(wire *w, bool cut, double time);

/* Tells everybody the levels as they are; to be called once when all is connected. */
void wire_settle(wire *w, double time);

/* Level at the end of the given board. */
bool wire_level(const wire *w, const board *side);

void wire_free(wire *w);

#endif
