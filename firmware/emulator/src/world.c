#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "action.h"
#include "memory.h"

void world_start(world *w)
{
    *w = (world){.duration = INFINITY, .speed = 1.0};
    w->laptop.master = w->laptop.slave = -1;
    air_start(&w->air, &w->line);
    modem_channel_start(&w->channel, &w->line);
}

board *world_board(const world *w, const char *name)
{
    for (int i = 0; i < w->line.boards_count; i++)
        if (strcmp(w->line.boards[i]->name, name) == 0)
            return w->line.boards[i];
    return NULL;
}

wire *world_wire(const world *w, const char *name)
{
    for (int i = 0; i < w->wires_count; i++)
        if (strcmp(w->wires[i]->name, name) == 0)
            return w->wires[i];
    return NULL;
}

button *world_button(world *w, const char *name)
{
    for (int i = 0; i < w->buttons_count; i++)
        if (strcmp(w->buttons[i].name, name) == 0)
            return &w->buttons[i];
    return NULL;
}

knob *world_knob(world *w, const char *name)
{
    for (int i = 0; i < w->knobs_count; i++)
        if (strcmp(w->knobs[i].name, name) == 0)
            return &w->knobs[i];
    return NULL;
}

analog *world_input(world *w, board *b, int channel)
{
    for (int i = 0; i < w->inputs_count; i++)
        if (w->inputs[i].board == b && w->inputs[i].channel == channel)
            return w->inputs[i].input;
    if (w->inputs_count == WORLD_INPUTS)
        return NULL;
    analog *input = memory_new(sizeof *input);
    char name[NAME_MAX_LENGTH + 8];
    snprintf(name, sizeof name, "input %s.%d", b->name, channel);
    input->chance = chance_stream(w->line.seed, name);
    w->inputs[w->inputs_count].input = input;
    w->inputs[w->inputs_count].board = b;
    w->inputs[w->inputs_count++].channel = channel;
    b->adc.inputs[channel].voltage = analog_at;
    b->adc.inputs[channel].owner = input;
    return input;
}

bool world_pin(const world *w, const char *text, board **b, int *port, int *bit)
{
    char name[NAME_MAX_LENGTH];
    const char *dot = strrchr(text, '.');
    if (!dot || (size_t)(dot - text) >= sizeof name || strlen(dot) != 3)
        return false;
    memcpy(name, text, (size_t)(dot - text));
    name[dot - text] = '\0';
    *b = world_board(w, name);
    *port = dot[1] - 'A';
    *bit = dot[2] - '0';
    return *b && *port >= 0 && *port < PORTS && *bit >= 0 && *bit < 8;
}

static void drive_cts(void *owner, bool high, double time)
{
    world *w = owner;
    if (w->modem_cts)
        wire_set(w->modem_cts, w->modem_cts_device, high ? WIRE_HIGH : WIRE_LOW, time);
}

static void sleep_pin(void *owner, bool high, double time)
{
    modem_sleep(owner, high, time);
}

void world_mount_modem(world *w, board *b, wire *cts, wire *sleep)
{
    modem *vehicle = &w->modems[0], *base = &w->modems[1];
    modem_start(vehicle, "vehicle", &w->channel, base, (serial_end){usart_hear, b});
    modem_start(base, "laptop", &w->channel, vehicle, (serial_end){laptop_hear, &w->laptop});
    w->modem_board = b;
    w->modem_cts = cts;
    if (cts)
        w->modem_cts_device = wire_add_device(cts, b, NULL, w);
    vehicle->cts_changed = drive_cts;
    vehicle->owner = w;
    drive_cts(w, false, 0.0);
    if (sleep)
        wire_add_device(sleep, b, sleep_pin, vehicle);
    b->usart.end = (serial_end){modem_hear, vehicle};
    laptop_start(&w->laptop, &w->line, 1.0 / base->bit, (serial_end){modem_hear, base});
    base->cts_changed = laptop_hold;
    base->owner = &w->laptop;
}

/* The board's own sender has no line of its own on which bits could be spoilt. */
static void hear_spoilt(void *owner, uint8_t byte, double time, double bit)
{
    world *w = owner;
    serial_line *cable = &w->laptop.out;
    laptop_hear(&w->laptop,
                serial_spoil(byte, cable->error_rate, &cable->chance, &cable->spoilt), time, bit);
}

void world_mount_cable(world *w, board *b, double baud, double error_rate)
{
    laptop_start(&w->laptop, &w->line, baud, (serial_end){usart_hear, b});
    w->laptop.out.error_rate = error_rate;
    w->laptop.out.chance = chance_stream(w->line.seed, "cable");
    b->usart.end = (serial_end){hear_spoilt, w};
}

void world_settle(world *w)
{
    for (int i = 0; i < w->line.boards_count; i++) {
        board *b = w->line.boards[i];
        for (int port = 0; port < PORTS; port++)
            for (int bit = 0; bit < 8; bit++)
                if (b->pins.wires[port][bit])
                    wire_settle(b->pins.wires[port][bit], w->line.now);
        b->capture.level = pins_level(b, 3, 6);
    }
}

void world_free(world *w)
{
    wire *seen[BOARDS_MAX * PORTS * 8];
    int count = 0;
    for (int i = 0; i < w->line.boards_count; i++)
        for (int port = 0; port < PORTS; port++)
            for (int bit = 0; bit < 8; bit++) {
                wire *one = w->line.boards[i]->pins.wires[port][bit];
                bool known = !one;
                for (int k = 0; k < count && !known; k++)
                    known = seen[k] == one;
                if (!known)
                    seen[count++] = one;
            }
    for (int i = 0; i < w->wires_count; i++)
        if (w->wires[i]->pins_count == 0) /* of a scenario that was wrong */
            wire_free(w->wires[i]);
    for (int i = 0; i < count; i++)
        wire_free(seen[i]);
    for (int i = 0; i < BOARDS_MAX; i++)
        radio_free(w->radios[i]);
    for (int i = 0; i < w->inputs_count; i++) {
        analog_free(w->inputs[i].input);
        free(w->inputs[i].input);
    }
    modem_free(&w->modems[0]);
    modem_free(&w->modems[1]);
    laptop_free(&w->laptop);
    action_free_all(w);
    timeline_free(&w->line);
}
