/* For the small programs by which the emulated part is tested: where they leave their results. */
#ifndef PART_H
#define PART_H

#include <stdint.h>

#define RESULTS 0x0e00
#define RESULTS_COUNT 64

#ifdef __AVR__
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/delay.h>

#define result ((volatile uint16_t *)RESULTS)
#endif

#endif
