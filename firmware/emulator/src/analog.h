/* Voltages at the inputs of a converter: constant, a potentiometer, or a recording. */
#ifndef EMULATOR_ANALOG_H
#define EMULATOR_ANALOG_H

#include <stddef.h>

#include "chance.h"

typedef struct analog {
    double level;     /* V, while there is no table, or before and after it the nearest row */
    double *times;    /* s from `start`, ascending */
    double *values;   /* V */
    size_t count;
    size_t hint;      /* row before the last time asked for */
    double start;     /* s: time of the table's zero */
    double noise;     /* V rms, white from sample to sample */
    chance chance;
} analog;

/* Voltage at a time (s), linear between rows; an `adc_source`. */
double analog_at(void *analog, double time);

/* Reads one column of a comma-separated file: rows of numbers below a header such as `time
 * [s],front_wheel [counts]`, lines that start with # left out. Units: s or ms; V, mV or counts
 * (1/1024 of `supply`). False with a sentence in `problem`, and the line or 0 in `at`. */
bool analog_read(analog *s, const char *path, const char *column, double supply,
                 char problem[200], unsigned *at);

void analog_free(analog *s);

#endif
