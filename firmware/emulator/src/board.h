/* One ATmega644 with a crystal of its own: simavr's core and timers, with the parts of simavr 1.6
 * replaced or mended that are wrong (see README.md). */
#ifndef EMULATOR_BOARD_H
#define EMULATOR_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include <sim_avr.h>

#include "adc.h"
#include "capture.h"
#include "extint.h"
#include "pins.h"
#include "timeline.h"
#include "timer1.h"
#include "usart.h"

#define NAME_MAX_LENGTH 32

typedef struct board {
    timeline *line;
    avr_t *avr;
    char name[NAME_MAX_LENGTH];
    int index;

    double frequency;           /* of the crystal, in true hertz */
    double period;              /* s: its inverse */
    double origin;              /* s: the time at which the cycle counter was `origin_cycle` */
    avr_cycle_count_t origin_cycle;
    double now;                 /* s: time of the next instruction */
    double held_until;          /* s: in reset until then */

    uint16_t data_end;          /* first byte above .data and .bss */
    uint16_t stack_low;         /* lowest stack pointer seen */
    avr_cycle_count_t asleep;   /* cycles slept */
    unsigned resets;
    bool slept_deep;
    avr_run_t run;              /* simavr puts another one here when the watchdog bites */

    pins pins;
    extint extint;
    usart usart;
    adc adc;
    capture capture;
    timer1 timer1;
} board;

/* Adds a board to the time line. `frequency` is nominal (Hz), `ppm` its true deviation, `start` (s)
 * the end of its power-on reset. NULL and a sentence in `problem` when the file cannot be loaded.
 */
board *board_new(timeline *line, const char *name, const char *elf, double frequency, double ppm,
                 double start, const char **problem);

void board_free(board *b);

/* One instruction, or sleep up to `limit` (s); false when the program has crashed. */
bool board_step(board *b, double limit);

bool board_asleep(const board *b);

/* s: nothing that this board does can be seen before. */
double board_next_action(const board *b);

/* The reset pin, pulled for `hold` seconds. */
void board_reset(board *b, double hold);

/* Another crystal error from now on. */
void board_tune(board *b, double nominal, double ppm);

/* s: the time at which the cycle counter has the given value, and the other way round. */
double board_time_of(const board *b, double cycle);
double board_cycle_of(const board *b, double time);

/* Pulls simavr's vector of an interrupt out by its number, NULL when the part has none. */
avr_int_vector_t *board_vector(const board *b, uint8_t number);

/* simavr fails to fire an interrupt whose flag rose while it was masked: call after unmasking. */
void board_unmask(board *b, avr_int_vector_t *vector);

/* Replaces the write or read handler of a register (data-space address) and returns the old one. */
typedef struct write_handler {
    avr_io_write_t call;
    void *param;
} write_handler;
write_handler board_on_write(board *b, uint16_t address, avr_io_write_t call, void *param);
void board_on_read(board *b, uint16_t address, avr_io_read_t call, void *param);

#endif
