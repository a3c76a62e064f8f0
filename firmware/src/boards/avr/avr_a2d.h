// The A/D converter for single readings (reference App. B.17; data sheet chapter 20). Rows have their own
// way: sampler.h.

#ifndef BOARDS_AVR_AVR_A2D_H
#define BOARDS_AVR_AVR_A2D_H

#include <stdint.h>

/// On, reference AVCC, 125 kHz.
void A2D_init_default();
/// One reading of `channel`, 0 to 7; -1 when the converter does not finish within 0.5 ms, or no such channel.
int16_t A2D_read_once(uint8_t channel);
/// The rounded mean of `samples` readings, 1 to 32; -1 for a time-out or bad numbers.
int16_t A2D_read_oversampled(uint8_t channel, uint8_t samples);
/// Off, to save power.
void A2D_off();

#endif
