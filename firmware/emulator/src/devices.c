#include "devices.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define DEFAULT_BOUNCE 1e-3 /* s */

bool device_radio(reading *r)
{
    static const char *const names[RADIO_PINS] = {"ce", "csn", "sck", "mosi", "miso", "irq"};
    board *b = reading_board(r, 1);
    if (!b || !text_only(&r->text, KEYS("ce", "csn", "sck", "mosi", "miso", "irq")))
        return false;
    if (r->world->radios[b->index])
        return text_fail(&r->text, "board \"%s\" has a radio already", b->name);
    wire *pins[RADIO_PINS];
    for (int i = 0; i < RADIO_PINS; i++)
        pins[i] = reading_wire(r, b, names[i], i != RADIO_IRQ);
    if (reading_well(r))
        r->world->radios[b->index] = radio_new(b, &r->world->air, pins);
    return reading_well(r);
}

bool device_air(reading *r)
{
    return text_only(&r->text, KEYS("loss", "jitter")) &&
           text_get(&r->text, "loss", '%', 0, 1, &r->world->air.loss) &&
           text_get(&r->text, "jitter", 's', 0, 1e-3, &r->world->air.jitter);
}

bool device_modem(reading *r)
{
    board *b = reading_board(r, 1);
    if (!b || !text_only(&r->text, KEYS("cts", "sleep")))
        return false;
    if (r->world->laptop.connected)
        return text_fail(&r->text, "the laptop is connected already");
    wire *cts = reading_wire(r, b, "cts", false), *sleep = reading_wire(r, b, "sleep", false);
    if (reading_well(r))
        world_mount_modem(r->world, b, cts, sleep);
    return reading_well(r);
}

bool device_channel(reading *r)
{
    const char *errors = text_setting(&r->text, "errors");
    modem_channel *c = &r->world->channel;
    if (errors && strcmp(errors, "pass") != 0 && strcmp(errors, "drop") != 0)
        return text_fail(&r->text, "errors=%s is neither pass nor drop", errors);
    c->errors = errors && errors[0] == 'd' ? MODEM_DROP_ERRORS : MODEM_PASS_ERRORS;
    return text_only(&r->text, KEYS("ber", "loss", "errors")) &&
           text_get(&r->text, "ber", '%', 0, 0.5, &c->error_rate) &&
           text_get(&r->text, "loss", '%', 0, 1, &c->loss);
}

bool device_cable(reading *r)
{
    double baud = 9600, error_rate = 0;
    board *b = reading_board(r, 1);
    if (!b || !text_only(&r->text, KEYS("baud", "ber")) ||
        !text_get(&r->text, "baud", '1', 300, 115200, &baud) ||
        !text_get(&r->text, "ber", '%', 0, 0.5, &error_rate))
        return false;
    if (r->world->laptop.connected)
        return text_fail(&r->text, "the laptop is connected already");
    world_mount_cable(r->world, b, baud, error_rate);
    return true;
}

bool device_button(reading *r)
{
    world *w = r->world;
    const char *name = reading_word(r, 1, "a name"), *active = text_setting(&r->text, "active");
    double bounce = DEFAULT_BOUNCE;
    place p;
    if (!name || !reading_pin(r, 2, &p) || !text_only(&r->text, KEYS("bounce", "active")) ||
        !text_get(&r->text, "bounce", 's', 0, 0.1, &bounce))
        return false;
    if (active && strcmp(active, "low") != 0 && strcmp(active, "high") != 0)
        return text_fail(&r->text, "active=%s is neither low nor high", active);
    if (world_button(w, name) || w->buttons_count == WORLD_BUTTONS)
        return text_fail(&r->text, "there is a button \"%s\" already, or there are too many", name);
    button *b = &w->buttons[w->buttons_count++];
    snprintf(b->name, sizeof b->name, "%s", name);
    b->bounce = bounce;
    b->active_high = active && active[0] == 'h';
    b->chance = chance_stream(w->line.seed, name);
    button_mount(b, wire_at(p.board, p.port, p.bit), p.board);
    return true;
}

bool device_lights(reading *r)
{
    world *w = r->world;
    const char *name = reading_word(r, 1, "a name");
    int count = text_plain(&r->text, 2);
    bool bar = strcmp(r->text.words[0], "bar") == 0;
    if (!name || !text_only(&r->text, (const char *const[]){NULL}))
        return false;
    if (count < 1 || count > (bar ? BAR_LIGHTS : 1))
        return text_fail(&r->text, bar ? "a bar has one to eight pins" : "a light has one pin");
    if (w->lights_count == WORLD_LIGHTS)
        return text_fail(&r->text, "there are too many lights");
    lights *l = &w->lights[w->lights_count++];
    snprintf(l->name, sizeof l->name, "%s", name);
    l->bar = bar;
    for (int i = 0; i < count; i++) {
        place p;
        if (!reading_pin(r, 2 + i, &p))
            return false;
        lights_mount(l, wire_at(p.board, p.port, p.bit), p.board);
    }
    return true;
}

static analog *input_at(reading *r, int i, place *p)
{
    if (!reading_pin(r, i, p))
        return NULL;
    if (p->port != 0) {
        text_fail(&r->text, "%s is no input of the converter; those are A0 to A7",
                  r->text.words[i]);
        return NULL;
    }
    analog *input = world_input(r->world, p->board, p->bit);
    if (!input)
        text_fail(&r->text, "there are too many inputs");
    return input;
}

static bool read_recording(reading *r, analog *input, const char *file, double supply)
{
    const char *column = text_setting(&r->text, "column");
    char path[READING_PATH], problem[200];
    unsigned at;
    if (!column)
        return text_fail(&r->text, "file= needs column=, the name of a column");
    if (!reading_path(r, file, path))
        return false;
    if (analog_read(input, path, column, supply, problem, &at))
        return true;
    return at ? text_fail(&r->text, "%s:%u: %s", path, at, problem)
              : text_fail(&r->text, "%s: %s", path, problem);
}

bool device_input(reading *r)
{
    place p;
    analog *input = input_at(r, 1, &p);
    if (!input || !text_only(&r->text, KEYS("volts", "counts", "file", "column", "start", "noise")))
        return false;
    double supply = p.board->adc.supply, counts = NAN;
    if (!text_get(&r->text, "volts", 'V', -10, 10, &input->level) ||
        !text_get(&r->text, "counts", '1', -1024, 2048, &counts) ||
        !text_get(&r->text, "start", 's', 0, 1e6, &input->start) ||
        !text_get(&r->text, "noise", 'V', 0, 10, &input->noise))
        return false;
    if (isfinite(counts)) /* the middle of the step */
        input->level = (counts + 0.5) * supply / 1024.0;
    const char *file = text_setting(&r->text, "file");
    return !file || read_recording(r, input, file, supply);
}

bool device_knob(reading *r)
{
    world *w = r->world;
    const char *name = reading_word(r, 1, "a name");
    double position = 0.5;
    place p;
    analog *input = name ? input_at(r, 2, &p) : NULL;
    if (!input || !text_only(&r->text, KEYS("position")) ||
        !text_get(&r->text, "position", '%', 0, 1, &position))
        return false;
    if (world_knob(w, name) || w->knobs_count == WORLD_BUTTONS)
        return text_fail(&r->text, "there is a knob \"%s\" already, or there are too many", name);
    knob *k = &w->knobs[w->knobs_count++];
    snprintf(k->name, sizeof k->name, "%s", name);
    k->input = input;
    k->supply = p.board->adc.supply;
    knob_turn(k, position);
    return true;
}
