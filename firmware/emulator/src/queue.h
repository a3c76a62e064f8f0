/* Calls that are due at given times, in order of time. */
#ifndef EMULATOR_QUEUE_H
#define EMULATOR_QUEUE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Called when it is due; `time` is the time asked for, in seconds. */
typedef void (*queue_call)(void *owner, double time);

typedef struct queue_entry {
    double time;
    uint64_t order; /* calls due at the same time run in the order in which they were added */
    queue_call call;
    void *owner;
} queue_entry;

/* A binary heap; all zero is an empty queue. */
typedef struct queue {
    queue_entry *heap;
    size_t count, capacity;
    uint64_t added;
} queue;

void queue_add(queue *q, double time, queue_call call, void *owner);

/* Takes away every call of this kind for this owner; returns how many there were. */
size_t queue_cancel(queue *q, queue_call call, void *owner);

/* Time of the next call in seconds, or infinity. */
static inline double queue_next_time(const queue *q)
{
    return q->count ? q->heap[0].time : INFINITY;
}

/* Runs the next call; the queue must not be empty. */
void queue_run_next(queue *q);

void queue_free(queue *q);

#endif
