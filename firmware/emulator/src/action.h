/* What happens to the logger from outside, at a time of the scenario or by the control channel:
 *
 *   press NAME [for TIME]       a button; 0.1 s without a time
 *   cut WIRE, mend WIRE         a wire between boards
 *   reset BOARD [for TIME]      the reset pin; 1 ms without a time
 *   turn KNOB SHARE             a potentiometer, 0 to 1
 *   apply BOARD.A0 VOLTS        a voltage at a converter's pin
 *   tune BOARD PPM              another crystal error
 *   block air|channel, open air|channel
 *   set air loss|jitter VALUE, set channel loss|ber VALUE
 *   send HEX                    bytes from the laptop
 */
#ifndef EMULATOR_ACTION_H
#define EMULATOR_ACTION_H

#include "text.h"
#include "world.h"

typedef struct action action;

/* Reads the words from number `from` on; NULL with a problem in `t`. Belongs to the world. */
action *action_read(world *w, text *t, int from);

/* Lets it happen at `time` (s); not before the present. */
void action_schedule(action *a, double time);

/* Lets it happen now; to be called with the newest, which is gone then. */
void action_do(action *a);

void action_free_all(world *w);

#endif
