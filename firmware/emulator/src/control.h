/* The control channel: commands on standard input, one JSON object a line in answer on `answers`.
 *
 *   run SECONDS    lets time pass, and ends early as soon as a byte reaches the laptop
 *   wait SECONDS   lets time pass to the end
 *   statistics     writes what was counted to the event log
 *   quit
 *   any action     see action.h; it happens at once
 *
 * The answer: {"t": seconds, "data": "hex of what the laptop heard", "running": true}, or
 * {"problem": "one sentence"}. So a test can play the laptop in virtual time, and repeats exactly.
 */
#ifndef EMULATOR_CONTROL_H
#define EMULATOR_CONTROL_H

#include <stdio.h>

#include "world.h"

/* Obeys until `quit` or the end of the input; the exit status of the program. */
int control_obey(world *w, FILE *commands, FILE *answers);

#endif
