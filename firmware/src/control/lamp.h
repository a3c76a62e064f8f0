// Status LED of System 2 (reference table 6.1).

#ifndef CONTROL_LAMP_H
#define CONTROL_LAMP_H

#include <stdint.h>

#include "units.h"

enum class lamp : uint8_t { off, on, short_long, slow_flash, fast_flash };

/// Whether the LED is lit `since` moments after the pattern began.
bool lamp_lit(lamp pattern, moment since);

#endif
