/* Everything that a scenario has put together. */
#ifndef EMULATOR_WORLD_H
#define EMULATOR_WORLD_H

#include "air.h"
#include "analog.h"
#include "board.h"
#include "laptop.h"
#include "modem.h"
#include "panel.h"
#include "radio.h"
#include "timeline.h"
#include "wire.h"

#define WORLD_WIRES 64
#define WORLD_BUTTONS 4
#define WORLD_LIGHTS 16
#define WORLD_INPUTS 24
#define WORLD_ACTIONS 256

#define NOMINAL_CLOCK 4e6 /* Hz */

typedef struct world {
    timeline line;
    double duration; /* s; infinity without one */
    double speed;    /* virtual seconds a second; 0: as fast as possible */

    double clock[BOARDS_MAX]; /* Hz, nominal, by board */

    wire *wires[WORLD_WIRES]; /* those with a name */
    int wires_count;

    air air;
    radio *radios[BOARDS_MAX]; /* by board */

    modem_channel channel;
    modem modems[2]; /* the vehicle's and the laptop's */
    board *modem_board;
    wire *modem_cts;
    int modem_cts_device;

    laptop laptop;

    button buttons[WORLD_BUTTONS];
    int buttons_count;
    lights lights[WORLD_LIGHTS];
    int lights_count;
    struct {
        analog *input;
        board *board;
        int channel;
    } inputs[WORLD_INPUTS];
    int inputs_count;
    knob knobs[WORLD_BUTTONS];
    int knobs_count;

    struct action *actions; /* newest first */
} world;

void world_start(world *w);

board *world_board(const world *w, const char *name);
wire *world_wire(const world *w, const char *name);
button *world_button(world *w, const char *name);
knob *world_knob(world *w, const char *name);

/* The input at a converter's pin; one is made when there is none. NULL when there are too many. */
analog *world_input(world *w, board *b, int channel);

/* Splits `board.B3` into board, port (0 is A) and bit; false when there is no such pin. */
bool world_pin(const world *w, const char *text, board **b, int *port, int *bit);

/* Connects the vehicle's modem to USART0 of a board; the wires may be NULL. */
void world_mount_modem(world *w, board *b, wire *cts, wire *sleep);

/* Connects the laptop to USART0 of a board by a cable. */
void world_mount_cable(world *w, board *b, double baud, double error_rate);

/* To be called once when all is put together, before time starts. */
void world_settle(world *w);

/* Writes what was counted, one line a device. */
void world_statistics(world *w);

void world_free(world *w);

#endif
