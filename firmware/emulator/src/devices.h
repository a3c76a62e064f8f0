/* Statements of a scenario that mount devices; README.md has them in a table. */
#ifndef EMULATOR_DEVICES_H
#define EMULATOR_DEVICES_H

#include "reading.h"

bool device_radio(reading *r);
bool device_air(reading *r);
bool device_modem(reading *r);
bool device_channel(reading *r);
bool device_cable(reading *r);
bool device_button(reading *r);
bool device_lights(reading *r); /* light and bar */
bool device_input(reading *r);
bool device_knob(reading *r);

#endif
