#include "queue.h"

#include <stdlib.h>

#include "memory.h"

static int earlier(const queue_entry *a, const queue_entry *b)
{
    return a->time < b->time || (a->time == b->time && a->order < b->order);
}

static void exchange(queue *q, size_t i, size_t j)
{
    queue_entry kept = q->heap[i];
    q->heap[i] = q->heap[j];
    q->heap[j] = kept;
}

static void sift_up(queue *q, size_t i)
{
    while (i > 0 && earlier(&q->heap[i], &q->heap[(i - 1) / 2])) {
        exchange(q, i, (i - 1) / 2);
        i = (i - 1) / 2;
    }
}

static void sift_down(queue *q, size_t i)
{
    for (;;) {
        size_t first = i;
        for (size_t child = 2 * i + 1; child <= 2 * i + 2 && child < q->count; child++)
            if (earlier(&q->heap[child], &q->heap[first]))
                first = child;
        if (first == i)
            return;
        exchange(q, i, first);
        i = first;
    }
}

void queue_add(queue *q, double time, queue_call call, void *owner)
{
    if (q->count == q->capacity) {
        q->capacity = q->capacity ? 2 * q->capacity : 64;
        q->heap = memory_resize(q->heap, q->capacity * sizeof *q->heap);
    }
    q->heap[q->count] = (queue_entry){time, q->added++, call, owner};
    sift_up(q, q->count++);
}

size_t queue_cancel(queue *q, queue_call call, void *owner)
{
    size_t kept = 0;
    for (size_t i = 0; i < q->count; i++)
        if (q->heap[i].call != call || q->heap[i].owner != owner)
            q->heap[kept++] = q->heap[i];
    size_t gone = q->count - kept;
    q->count = kept;
    if (gone)
        for (size_t i = kept / 2 + 1; i-- > 0;)
            if (i < kept)
                sift_down(q, i);
    return gone;
}

void queue_run_next(queue *q)
{
    queue_entry next = q->heap[0];
    q->heap[0] = q->heap[--q->count];
    sift_down(q, 0);
    next.call(next.owner, next.time);
}

void queue_free(queue *q)
{
    free(q->heap);
    *q = (queue){0};
}
