/* What the driver sees and touches: push button, lights, knob. */
#ifndef EMULATOR_PANEL_H
#define EMULATOR_PANEL_H

#include "chance.h"
#include "analog.h"
#include "wire.h"

#define BAR_LIGHTS 8

/* Connects its pin to ground (or the supply) while it is pressed. */
typedef struct button {
    char name[NAME_MAX_LENGTH];
    wire *wire;
    int device;
    timeline *line;
    bool active_high;
    bool pressed;
    double bounce; /* s: contacts open and close again for so long */
    double settled; /* s: when the present bouncing ends */
    chance chance;
} button;

void button_mount(button *b, wire *w, const board *side);
void button_move(button *b, bool pressed, double time);

/* A light or a row of lights, lit when its pin is high. */
typedef struct lights {
    char name[NAME_MAX_LENGTH];
    timeline *line;
    bool bar;
    int count;
    bool lit[BAR_LIGHTS];
    struct light {
        struct lights *lights;
        int index;
    } each[BAR_LIGHTS];
    unsigned long changes;
} lights;

void lights_mount(lights *l, wire *w, const board *side);

/* A potentiometer across the supply. */
typedef struct knob {
    char name[NAME_MAX_LENGTH];
    analog *input;
    double supply; /* V */
} knob;

void knob_turn(knob *k, double position);

#endif
