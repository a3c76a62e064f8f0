/* Input capture of timer 1 at ICP1 (PD6), to the clock cycle. */
#ifndef EMULATOR_CAPTURE_H
#define EMULATOR_CAPTURE_H

#include <stdbool.h>

struct board;

#define CAPTURE_EDGES 8

typedef struct capture {
    bool level;
    struct capture_edge {
        struct board *board;
        bool level;
    } edges[CAPTURE_EDGES]; /* on their way through the synchroniser */
    unsigned next;
    unsigned long captured;
} capture;

bool capture_is_pin(int port, int bit);

void capture_install(struct board *b);
void capture_after_reset(struct board *b);

/* The pin has this level from `time` (s) on, which may lie less than one instruction back. */
void capture_edge(struct board *b, bool level, double time);

#endif
