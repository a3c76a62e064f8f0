#include "radio_rig.h"

#include <math.h>
#include <string.h>

void rig_start(rig *g, int count, uint64_t seed)
{
    memset(g, 0, sizeof *g);
    g->line.seed = seed;
    air_start(&g->air, &g->line);
    for (int i = 0; i < count; i++) {
        board *b = &g->boards[i];
        b->line = &g->line;
        b->index = i;
        b->now = INFINITY; /* no program: only calls make time pass */
        snprintf(b->name, sizeof b->name, "b%d", i);
        g->line.boards[g->line.boards_count++] = b;
        for (int pin = 0; pin < RADIO_PINS; pin++) {
            g->wires[i][pin] = wire_new(&g->line, "pin", false);
            if (pin != RADIO_MISO && pin != RADIO_IRQ)
                g->hands[i][pin] = wire_add_device(g->wires[i][pin], b, NULL, NULL);
        }
        g->radios[i] = radio_new(b, &g->air, g->wires[i]);
        for (int pin = 0; pin < RADIO_PINS; pin++)
            wire_settle(g->wires[i][pin], 0.0);
        wire_set(g->wires[i][RADIO_CSN], g->hands[i][RADIO_CSN], WIRE_HIGH, 0.0);
    }
}

void rig_finish(rig *g)
{
    for (int i = 0; i < g->line.boards_count; i++) {
        radio_free(g->radios[i]);
        for (int pin = 0; pin < RADIO_PINS; pin++)
            wire_free(g->wires[i][pin]);
    }
    queue_free(&g->line.calls);
}

void rig_set(rig *g, int i, int pin, bool level)
{
    wire_set(g->wires[i][pin], g->hands[i][pin], level ? WIRE_HIGH : WIRE_LOW, g->line.now);
}

bool rig_level(const rig *g, int i, int pin)
{
    return wire_level(g->wires[i][pin], &g->boards[i]);
}

/* One byte by SPI mode 0. */
static uint8_t byte(rig *g, int i, uint8_t out)
{
    uint8_t in = 0;
    for (int bit = 7; bit >= 0; bit--) {
        rig_set(g, i, RADIO_MOSI, out >> bit & 1);
        rig_set(g, i, RADIO_SCK, true);
        in = (uint8_t)(in << 1 | rig_level(g, i, RADIO_MISO));
        rig_set(g, i, RADIO_SCK, false);
    }
    return in;
}

uint8_t rig_command(rig *g, int i, uint8_t code, uint8_t *bytes, int count)
{
    rig_set(g, i, RADIO_CSN, false);
    uint8_t status = byte(g, i, code);
    for (int k = 0; k < count; k++)
        bytes[k] = byte(g, i, bytes[k]);
    rig_set(g, i, RADIO_CSN, true);
    return status;
}

void rig_put(rig *g, int i, uint8_t number, uint8_t value)
{
    rig_command(g, i, 0x20 | number, &value, 1);
}

uint8_t rig_get(rig *g, int i, uint8_t number)
{
    uint8_t value = 0;
    rig_command(g, i, number, &value, 1);
    return value;
}

void rig_address(rig *g, int i, uint8_t number, uint8_t lowest)
{
    uint8_t bytes[5] = {lowest, 0x56, 0x53, 0x41, 0xb5};
    rig_command(g, i, 0x20 | number, bytes, 5);
}

void rig_run(rig *g, double seconds)
{
    double end = g->line.now + seconds;
    CHECK(timeline_run(&g->line, end));
}

void rig_payload(rig *g, int i, uint8_t code, uint8_t first, int length)
{
    uint8_t bytes[32];
    for (int k = 0; k < length; k++)
        bytes[k] = (uint8_t)(first + k);
    rig_command(g, i, code, bytes, length);
}

void rig_link_up(rig *g)
{
    for (int i = 0; i < 2; i++) {
        rig_put(g, i, NRF_RF_CH, 76);
        rig_put(g, i, NRF_RF_SETUP, 0x06);
        rig_put(g, i, NRF_SETUP_RETR, 0x15);
        rig_put(g, i, NRF_RX_PW_P0 + 1, 32);
    }
    rig_address(g, 0, NRF_TX_ADDR, 0xc2);
    rig_address(g, 0, NRF_RX_ADDR_P0, 0xc2);
    rig_address(g, 1, NRF_RX_ADDR_P1, 0xc2);
    rig_put(g, 0, NRF_CONFIG, 0x0e);
    rig_put(g, 1, NRF_CONFIG, 0x0f);
    rig_run(g, 2e-3);
    rig_set(g, 1, RADIO_CE, true);
    rig_run(g, 200e-6);
}

void rig_pulse(rig *g, int i)
{
    rig_set(g, i, RADIO_CE, true);
    rig_run(g, 12e-6);
    rig_set(g, i, RADIO_CE, false);
}
