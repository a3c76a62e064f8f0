#include "serial.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"

bool serial_agrees(double mine, double theirs)
{
    return fabs(theirs / mine - 1.0) * (SERIAL_BITS - 0.5) < 0.5;
}

uint8_t serial_spoil(uint8_t byte, double error_rate, chance *c, unsigned long *spoilt)
{
    uint8_t flips = 0;
    if (error_rate > 0.0)
        for (int bit = 0; bit < 8; bit++)
            flips |= (uint8_t)(chance_happens(c, error_rate) << bit);
    *spoilt += flips != 0;
    return byte ^ flips;
}

void serial_start(serial_line *s, timeline *line, double baud, serial_end end)
{
    s->line = line;
    s->bit = 1.0 / baud;
    s->end = end;
}

static void sent(void *owner, double time);

static void next(serial_line *s, double time)
{
    s->busy = s->count > 0;
    if (s->busy)
        queue_add(&s->line->calls, time + (SERIAL_BITS - 0.5) * s->bit, sent, s);
    else if (s->emptied)
        s->emptied(s->emptied_owner, time);
}

static void gone(void *owner, double time)
{
    next(owner, time);
}

static void sent(void *owner, double time)
{
    serial_line *s = owner;
    uint8_t byte = s->bytes[s->first++];
    if (--s->count == 0)
        s->first = 0;
    s->sent++;
    queue_add(&s->line->calls, time + 0.5 * s->bit, gone, s);
    byte = serial_spoil(byte, s->error_rate, &s->chance, &s->spoilt);
    s->end.hear(s->end.owner, byte, time, s->bit);
}

void serial_send(serial_line *s, uint8_t byte, double time)
{
    if (s->first + s->count == s->capacity) {
        if (s->first > s->capacity / 2) {
            memmove(s->bytes, s->bytes + s->first, s->count);
            s->first = 0;
        } else {
            s->capacity = s->capacity ? 2 * s->capacity : 256;
            s->bytes = memory_resize(s->bytes, s->capacity);
        }
    }
    s->bytes[s->first + s->count++] = byte;
    if (!s->busy)
        next(s, time);
}

void serial_free(serial_line *s)
{
    free(s->bytes);
    s->bytes = NULL;
}
