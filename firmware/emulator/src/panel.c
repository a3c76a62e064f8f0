#include "panel.h"

#include <string.h>

#define BOUNCES 6

static void contact(button *b, bool closed, double time)
{
    wire_drive closes = b->active_high ? WIRE_HIGH : WIRE_LOW;
    wire_set(b->wire, b->device, closed ? closes : WIRE_FREE, time);
}

static void bounce(void *owner, double time)
{
    button *b = owner;
    if (time >= b->settled)
        contact(b, b->pressed, time);
    else
        contact(b, chance_bits(&b->chance) & 1, time);
}

void button_move(button *b, bool pressed, double time)
{
    b->pressed = pressed;
    queue_cancel(&b->line->calls, bounce, b);
    report_begin(&b->line->report, time, "button");
    report_text(&b->line->report, "name", b->name);
    report_flag(&b->line->report, "pressed", pressed);
    report_end(&b->line->report);
    contact(b, pressed, time);
    b->settled = time + b->bounce;
    if (b->bounce <= 0.0)
        return;
    for (int i = 0; i < BOUNCES; i++)
        queue_add(&b->line->calls, time + b->bounce * chance_uniform(&b->chance), bounce, b);
    queue_add(&b->line->calls, b->settled, bounce, b);
}

void button_mount(button *b, wire *w, const board *side)
{
    b->wire = w;
    b->line = side->line;
    b->device = wire_add_device(w, side, NULL, b);
    w->rest |= !b->active_high; /* with a pull-up of its own, or the pin's */
}

static void changed(void *owner, bool level, double time)
{
    struct light *one = owner;
    lights *l = one->lights;
    if (level == l->lit[one->index])
        return;
    l->lit[one->index] = level;
    l->changes++;
    report *r = &l->line->report;
    report_begin(r, time, "light");
    report_text(r, "name", l->name);
    if (l->bar) {
        char pattern[BAR_LIGHTS + 1] = "";
        for (int i = 0; i < l->count; i++)
            strcat(pattern, l->lit[i] ? "1" : "0");
        report_text(r, "lit", pattern);
    } else {
        report_flag(r, "lit", level);
    }
    report_end(r);
}

void lights_mount(lights *l, wire *w, const board *side)
{
    l->line = side->line;
    struct light *one = &l->each[l->count];
    *one = (struct light){l, l->count++};
    wire_add_device(w, side, changed, one);
}

void knob_turn(knob *k, double position)
{
    k->input->level = position * k->supply;
}
