#include "wire.h"

#include <stdio.h>
#include <stdlib.h>

#include "memory.h"

wire *wire_new(timeline *line, const char *name, bool rest)
{
    wire *w = memory_new(sizeof *w);
    w->line = line;
    w->rest = rest;
    snprintf(w->name, sizeof w->name, "%s", name);
    for (int i = 0; i < BOARDS_MAX; i++)
        w->level[i] = rest;
    return w;
}

bool wire_add_pin(wire *w, board *b, int port, int bit)
{
    if (b->pins.wires[port][bit] == w)
        return true;
    if (b->pins.wires[port][bit] || w->pins_count == WIRE_PINS)
        return false;
    for (int i = 0; i < w->pins_count; i++)
        w->between_boards |= w->pins[i].board != b;
    w->pins[w->pins_count].board = b;
    w->pins[w->pins_count].port = port;
    w->pins[w->pins_count++].bit = bit;
    pins_connect(b, port, bit, w);
    return true;
}

wire *wire_at(board *b, int port, int bit)
{
    if (!b->pins.wires[port][bit]) {
        char name[NAME_MAX_LENGTH];
        snprintf(name, sizeof name, "%.24s.%c%d", b->name, 'A' + port, bit);
        wire_add_pin(wire_new(b->line, name, false), b, port, bit);
    }
    return b->pins.wires[port][bit];
}

int wire_add_device(wire *w, const board *side, wire_listener listener, void *owner)
{
    if (w->devices_count == WIRE_DEVICES) {
        fprintf(stderr, "emulator: more than %d devices on wire %s\n", WIRE_DEVICES, w->name);
        exit(1);
    }
    int number = w->devices_count++;
    w->devices[number].side = side->index;
    w->devices[number].listener = listener;
    w->devices[number].owner = owner;
    return number;
}

/* The level that the pins and devices of one end give (all ends when `side` is negative). */
static bool resolve(wire *w, int side, bool *contention)
{
    bool low = false, high = false, pulled = false;
    for (int i = 0; i < w->pins_count; i++) {
        if (side >= 0 && w->pins[i].board->index != side)
            continue;
        pin_drive drive = pins_drive(w->pins[i].board, w->pins[i].port, w->pins[i].bit);
        low |= drive == PIN_LOW;
        high |= drive == PIN_HIGH;
        pulled |= drive == PIN_PULLED_UP;
    }
    for (int i = 0; i < w->devices_count; i++) {
        if (side >= 0 && w->devices[i].side != side)
            continue;
        low |= w->devices[i].drive == WIRE_LOW;
        high |= w->devices[i].drive == WIRE_HIGH;
    }
    *contention |= low && high;
    return low ? false : high || pulled || w->rest;
}

static void tell(wire *w, double time)
{
    for (int i = 0; i < w->pins_count; i++) {
        board *b = w->pins[i].board;
        pins_apply(b, w->pins[i].port, w->pins[i].bit, w->level[b->index], time);
    }
    for (int i = 0; i < w->devices_count; i++) {
        bool level = w->level[w->devices[i].side];
        if (w->settled && w->devices[i].told == level)
            continue;
        w->devices[i].told = level;
        if (w->devices[i].listener)
            w->devices[i].listener(w->devices[i].owner, level, time);
    }
    w->settled = true;
}

static void contention_of(wire *w, bool found, double time)
{
    if (found && !w->contended) {
        w->contentions++;
        report_warning(&w->line->report, time, w->name, "two outputs drive against each other");
    }
    w->contended = found;
}

static void update(wire *w, double time)
{
    bool changed = false, contention = false;
    bool common = w->cut ? false : resolve(w, -1, &contention);
    for (int side = 0; side < w->line->boards_count; side++) {
        bool level = w->cut ? resolve(w, side, &contention) : common;
        changed |= level != w->level[side];
        w->level[side] = level;
    }
    contention_of(w, contention, time);
    if (!changed && w->settled)
        return;
    w->edges += w->settled;
    if (w->between_boards && w->line->report.wires) {
        report_begin(&w->line->report, time, "wire");
        report_text(&w->line->report, "name", w->name);
        report_flag(&w->line->report, "level", w->level[w->pins[0].board->index]);
        report_end(&w->line->report);
    }
    tell(w, time);
}

void wire_pin_changed(wire *w, double time)
{
    /* The board that changes it is the furthest behind: the others are there or less than a cycle
     * short of it. */
    update(w, time);
}

void wire_set(wire *w, int device, wire_drive drive, double time)
{
    if (w->devices[device].drive == drive && w->settled)
        return;
    w->devices[device].drive = drive;
    update(w, time);
}

void wire_cut(wire *w, bool cut, double time)
{
    w->cut = cut;
    update(w, time);
}

void wire_settle(wire *w, double time)
{
    w->settled = false;
    update(w, time);
}

bool wire_level(const wire *w, const board *side)
{
    return w->level[side->index];
}

void wire_free(wire *w)
{
    free(w);
}
