/* A scenario being read: what its statements have in common. */
#ifndef EMULATOR_READING_H
#define EMULATOR_READING_H

#include "text.h"
#include "world.h"

#define READING_PATH 1024

typedef struct reading {
    world *world;
    text text;        /* the statement at hand */
    const char *path; /* of the file */
    int depth;        /* of includes */
    char *problem;
} reading;

typedef struct place {
    board *board;
    int port, bit;
} place;

/* The keys that a statement takes. */
#define KEYS(...) (const char *const[]){__VA_ARGS__, NULL}

/* Each of these notes a problem, and returns false or NULL, when it cannot be had. */

/* A path of a scenario, relative to the scenario. */
bool reading_path(reading *r, const char *name, char path[READING_PATH]);

/* The word at place `i`, which must be there; `what` it should be. */
const char *reading_word(reading *r, int i, const char *what);

/* The board named, or the pin given, by the word at place `i`. */
board *reading_board(reading *r, int i);
bool reading_pin(reading *r, int i, place *p);

/* The wire at a pin such as `B3` given by a setting; NULL when it is absent and may be. */
wire *reading_wire(reading *r, board *b, const char *key, bool needed);

/* True while no problem has been noted. */
bool reading_well(const reading *r);

#endif
