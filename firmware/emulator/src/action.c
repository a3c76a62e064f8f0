#include "action.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"

#define BYTES_MAX 512

struct action {
    world *world;
    action *older;
    void (*happen)(action *a, double time);
    void *object; /* what it happens to */
    double value, duration;
    bool flag;
    uint8_t bytes[BYTES_MAX];
    size_t bytes_count;
};

/* ---- what happens ---- */

static void release(void *owner, double time)
{
    button_move(owner, false, time);
}

static void press(action *a, double time)
{
    button_move(a->object, true, time);
    queue_add(&a->world->line.calls, time + a->duration, release, a->object);
}

static void cut(action *a, double time)
{
    wire_cut(a->object, a->flag, time);
    report_begin(&a->world->line.report, time, "cable");
    report_text(&a->world->line.report, "wire", ((wire *)a->object)->name);
    report_flag(&a->world->line.report, "cut", a->flag);
    report_end(&a->world->line.report);
}

static void reset(action *a, double time)
{
    (void)time;
    board_reset(a->object, a->duration);
}

static void turn(action *a, double time)
{
    (void)time;
    knob_turn(a->object, a->value);
}

static void set_number(action *a, double time)
{
    (void)time;
    *(double *)a->object = a->value;
}

static void set_flag(action *a, double time)
{
    (void)time;
    *(bool *)a->object = a->flag;
}

static void tune(action *a, double time)
{
    (void)time;
    board *b = a->object;
    board_tune(b, a->world->clock[b->index], a->value);
}

static void send(action *a, double time)
{
    laptop_send(&a->world->laptop, a->bytes, a->bytes_count, time);
}

/* ---- how it is read ---- */

/* Reads the words from number `at` on, of which there is one at least. */
typedef bool (*reader)(action *a, text *t, int at);

static bool missing(text *t, const char *what, const char *name)
{
    return text_fail(t, "there is no %s \"%s\" in this scenario", what, name);
}

static bool for_time(action *a, text *t, int at, double otherwise)
{
    a->duration = otherwise;
    if (at == t->count)
        return true;
    int used = strcmp(t->words[at], "for") == 0
                   ? text_quantity_at(t, at + 1, 's', &a->duration)
                   : 0;
    if (!used || a->duration < 0)
        return text_fail(t, "after the name comes nothing or a time: for 0.1 s");
    if (at + 1 + used < t->count)
        return text_fail(t, "\"%s\" is too much", t->words[at + 1 + used]);
    return true;
}

static bool read_press(action *a, text *t, int at)
{
    a->happen = press;
    a->object = world_button(a->world, t->words[at]);
    return a->object ? for_time(a, t, at + 1, 0.1) : missing(t, "button", t->words[at]);
}

static bool read_cut(action *a, text *t, int at)
{
    a->happen = cut;
    a->flag = true;
    a->object = world_wire(a->world, t->words[at]);
    return a->object ? true : missing(t, "wire", t->words[at]);
}

static bool read_mend(action *a, text *t, int at)
{
    bool good = read_cut(a, t, at);
    a->flag = false;
    return good;
}

static bool read_reset(action *a, text *t, int at)
{
    a->happen = reset;
    a->object = world_board(a->world, t->words[at]);
    return a->object ? for_time(a, t, at + 1, 1e-3) : missing(t, "board", t->words[at]);
}

static bool read_turn(action *a, text *t, int at)
{
    a->happen = turn;
    a->object = world_knob(a->world, t->words[at]);
    if (!a->object)
        return missing(t, "knob", t->words[at]);
    if (t->count != at + 2 || !text_quantity(t->words[at + 1], '%', &a->value) || a->value < 0 ||
        a->value > 1)
        return text_fail(t, "a knob turns to a share between 0 and 1");
    return true;
}

static bool read_apply(action *a, text *t, int at)
{
    board *b;
    int port, bit;
    a->happen = set_number;
    if (!world_pin(a->world, t->words[at], &b, &port, &bit) || port != 0)
        return text_fail(t, "\"%s\" is no converter's pin such as slave_1.A0", t->words[at]);
    analog *input = world_input(a->world, b, bit);
    if (!input || input->count)
        return text_fail(t, "%s has a recording and takes no voltage", t->words[at]);
    a->object = &input->level;
    if (t->count != at + 2 || !text_quantity(t->words[at + 1], 'V', &a->value))
        return text_fail(t, "a voltage is to be applied: apply %s 1.5V", t->words[at]);
    return true;
}

static bool read_tune(action *a, text *t, int at)
{
    a->happen = tune;
    a->object = world_board(a->world, t->words[at]);
    if (!a->object)
        return missing(t, "board", t->words[at]);
    if (t->count != at + 2 || !text_quantity(t->words[at + 1], 'p', &a->value))
        return text_fail(t, "a crystal is tuned in ppm: tune %s 40", t->words[at]);
    return true;
}

static bool read_block(action *a, text *t, int at)
{
    a->happen = set_flag;
    a->flag = true;
    if (strcmp(t->words[at], "air") == 0)
        a->object = &a->world->air.blocked;
    else if (strcmp(t->words[at], "channel") == 0)
        a->object = &a->world->channel.blocked;
    else
        return text_fail(t, "air or channel can be blocked or opened, not \"%s\"", t->words[at]);
    return true;
}

static bool read_open(action *a, text *t, int at)
{
    bool good = read_block(a, t, at);
    a->flag = false;
    return good;
}

static bool read_set(action *a, text *t, int at)
{
    world *w = a->world;
    const struct {
        const char *what, *which;
        char kind;
        double *where, most;
    } numbers[] = {
        {"air", "loss", '%', &w->air.loss, 1.0},
        {"air", "jitter", 's', &w->air.jitter, 1e-3},
        {"channel", "loss", '%', &w->channel.loss, 1.0},
        {"channel", "ber", '%', &w->channel.error_rate, 0.5},
    };
    a->happen = set_number;
    for (size_t i = 0; t->count == at + 3 && i < sizeof numbers / sizeof *numbers; i++) {
        if (strcmp(t->words[at], numbers[i].what) != 0 ||
            strcmp(t->words[at + 1], numbers[i].which) != 0)
            continue;
        a->object = numbers[i].where;
        if (!text_quantity(t->words[at + 2], numbers[i].kind, &a->value) || a->value < 0 ||
            a->value > numbers[i].most)
            return text_fail(t, "\"%s\" is not between 0 and %g", t->words[at + 2],
                             numbers[i].most);
        return true;
    }
    return text_fail(t, "set takes: air loss, air jitter, channel loss, channel ber, and a value");
}

static bool read_send(action *a, text *t, int at)
{
    a->happen = send;
    for (int i = 0; at + i < t->count; i++) {
        const char *digits = t->words[at + i];
        size_t length = strlen(digits);
        if (length % 2 || a->bytes_count + length / 2 > BYTES_MAX)
            return text_fail(t, "send takes at most %d bytes in pairs of hexadecimal digits",
                             BYTES_MAX);
        for (size_t k = 0; k < length; k += 2) {
            char pair[3] = {digits[k], digits[k + 1], '\0'};
            if (!isxdigit((unsigned char)pair[0]) || !isxdigit((unsigned char)pair[1]))
                return text_fail(t, "\"%s\" is not hexadecimal", pair);
            a->bytes[a->bytes_count++] = (uint8_t)strtoul(pair, NULL, 16);
        }
    }
    return true;
}

action *action_read(world *w, text *t, int from)
{
    static const struct {
        const char *verb;
        reader read;
    } verbs[] = {
        {"press", read_press}, {"cut", read_cut},     {"mend", read_mend},
        {"reset", read_reset}, {"turn", read_turn},   {"apply", read_apply},
        {"tune", read_tune},   {"block", read_block}, {"open", read_open},
        {"set", read_set},     {"send", read_send},
    };
    const char *verb = t->count > from ? t->words[from] : "";
    for (size_t i = 0; i < sizeof verbs / sizeof *verbs; i++) {
        if (strcmp(verb, verbs[i].verb) != 0)
            continue;
        if (t->count < from + 2) {
            text_fail(t, "%s what?", verb);
            return NULL;
        }
        action *a = memory_new(sizeof *a);
        a->world = w;
        a->older = w->actions;
        w->actions = a;
        return verbs[i].read(a, t, from + 1) ? a : NULL;
    }
    text_fail(t, "\"%s\" is not something that can happen; these can: press, cut, mend, reset, "
                 "turn, apply, tune, block, open, set, send", verb);
    return NULL;
}

static void happen(void *owner, double time)
{
    action *a = owner;
    a->happen(a, time);
}

void action_schedule(action *a, double time)
{
    queue_add(&a->world->line.calls, time, happen, a);
}

void action_do(action *a)
{
    a->happen(a, a->world->line.now);
    a->world->actions = a->older; /* it is the newest */
    free(a);
}

void action_free_all(world *w)
{
    while (w->actions) {
        action *a = w->actions;
        w->actions = a->older;
        free(a);
    }
}
