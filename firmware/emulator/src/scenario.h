/* The scenario file: which boards, what they are wired to, what happens when. */
#ifndef EMULATOR_SCENARIO_H
#define EMULATOR_SCENARIO_H

#include "text.h"
#include "world.h"

/* Puts the world together from a file; false with one sentence, file and line in `problem`. Paths
 * in it are relative to it. */
bool scenario_read(world *w, const char *path, char problem[TEXT_PROBLEM * 2]);

#endif
