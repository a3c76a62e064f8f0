/* The common time of all boards and devices, in seconds from power-on.
 *
 * The board that is furthest behind executes one instruction, or sleeps no further than the point
 * at which anything else could happen. A queued call runs once every board has reached its time. So
 * causes come before effects, whatever the crystals do. */
#ifndef EMULATOR_TIMELINE_H
#define EMULATOR_TIMELINE_H

#include <stdbool.h>
#include <stdint.h>

#include "queue.h"
#include "report.h"

#define BOARDS_MAX 4

struct board;

typedef struct timeline {
    queue calls;
    report report;
    uint64_t seed;
    struct board *boards[BOARDS_MAX];
    int boards_count;
    double now;  /* every board and call has reached it */
    bool stop;   /* set by a device to end `timeline_run` at once */
} timeline;

/* For numbers that are never NaN, and without a call of the library in the innermost loop. */
static inline double earlier_of(double a, double b)
{
    return a < b ? a : b;
}

static inline double later_of(double a, double b)
{
    return a > b ? a : b;
}

/* Runs until `until` (s), a `stop`, or the end of a program; false when a board crashed. */
bool timeline_run(timeline *line, double until);

void timeline_free(timeline *line);

#endif
