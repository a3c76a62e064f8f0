#include "radio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"

/* Product specification 2.0, tables 13 and 16, in seconds. */
#define START_UP 1.5e-3
#define CE_PULSE 10e-6

int radio_address_width(const radio *r)
{
    int setting = r->registers[NRF_SETUP_AW] & 3;
    return setting ? setting + 2 : 5;
}

uint8_t radio_status(const radio *r)
{
    uint8_t pipe = r->rx_count ? r->rx[0].pipe : 7;
    return (uint8_t)((r->registers[NRF_STATUS] & NRF_INTERRUPTS) | pipe << 1 |
                     (r->tx_count == RADIO_FIFO));
}

void radio_update_irq(radio *r, double time)
{
    uint8_t masked = r->registers[NRF_CONFIG] & NRF_INTERRUPTS; /* same places in both registers */
    bool active = r->registers[NRF_STATUS] & NRF_INTERRUPTS & ~masked;
    if (r->pins[RADIO_IRQ].wire)
        wire_set(r->pins[RADIO_IRQ].wire, r->pins[RADIO_IRQ].device,
                 active ? WIRE_LOW : WIRE_HIGH, time);
}

void radio_flag(radio *r, uint8_t bits, double time)
{
    r->registers[NRF_STATUS] |= bits;
    radio_update_irq(r, time);
}

void radio_drop_tx(radio *r, int index)
{
    r->tx_count--;
    for (int i = index; i < r->tx_count; i++)
        r->tx[i] = r->tx[i + 1];
}

void radio_flush_tx(radio *r)
{
    r->tx_count = 0;
    r->reuse = false;
    r->ack_pending = false;
}

/* ---- states ---- */

void radio_enter(radio *r, radio_state state)
{
    r->state = state;
    r->listening = INFINITY;
}

/* Where the chip goes when it has nothing under way. */
void radio_standby(radio *r, double time)
{
    radio_enter(r, RADIO_STANDBY);
    if (!r->ce)
        return;
    if (r->registers[NRF_CONFIG] & NRF_PRIM_RX)
        radio_listen(r, time);
    else if (r->tx_count && !(r->registers[NRF_STATUS] & NRF_MAX_RT))
        radio_send(r, time);
}

static void started(void *owner, double time)
{
    radio *r = owner;
    if (r->state == RADIO_STARTING)
        radio_standby(r, time);
}

static void power_down(radio *r)
{
    queue_cancel(&r->air->line->calls, started, r);
    radio_cancel(r);
    radio_enter(r, RADIO_POWER_DOWN);
}

void radio_power_changed(radio *r, double time)
{
    bool up = r->registers[NRF_CONFIG] & NRF_PWR_UP;
    bool receiver = r->registers[NRF_CONFIG] & NRF_PRIM_RX;
    if (!up) {
        if (r->state != RADIO_POWER_DOWN)
            power_down(r);
        return;
    }
    switch (r->state) {
    case RADIO_POWER_DOWN:
        radio_enter(r, RADIO_STARTING);
        queue_add(&r->air->line->calls, time + START_UP, started, r);
        break;
    case RADIO_STANDBY:
        if (r->ce)
            radio_standby(r, time);
        break;
    case RADIO_SETTLING_RX:
    case RADIO_RECEIVING:
    case RADIO_SETTLING_ACK:
        if (!r->ce || !receiver) {
            radio_cancel(r);
            radio_standby(r, time);
        }
        break;
    case RADIO_SETTLING_TX:
        if (!r->ce && r->retries == 0 && time - r->ce_rose < CE_PULSE) {
            r->total.short_ce++;
            report_warning(&r->air->line->report, time, r->board->name,
                           "radio CE was high for less than 10 us: nothing is sent");
            radio_cancel(r);
            radio_enter(r, RADIO_STANDBY);
        }
        break;
    default:
        break; /* a packet under way is finished, with its repeats */
    }
}

/* ---- mounting ---- */

static void on_ce(void *owner, bool level, double time)
{
    radio *r = owner;
    if (level && !r->ce)
        r->ce_rose = time;
    r->ce = level;
    radio_power_changed(r, time);
}

static void on_csn(void *owner, bool level, double time)
{
    radio_spi_select(owner, level, time);
}

static void on_sck(void *owner, bool level, double time)
{
    radio_spi_clock(owner, level, time);
}

static void on_mosi(void *owner, bool level, double time)
{
    (void)time;
    ((radio *)owner)->mosi = level;
}

static void power_on(radio *r)
{
    /* Reset values, register map table 24. */
    static const uint8_t reset[] = {0x08, 0x3f, 0x03, 0x03, 0x03, 0x02, 0x0f, 0x0e,
                                    0x00, 0x00, 0x00, 0x00, 0xc3, 0xc4, 0xc5, 0xc6};
    memcpy(r->registers, reset, sizeof reset);
    memset(r->address_0, 0xe7, 5);
    memset(r->address_1, 0xc2, 5);
    memset(r->address_tx, 0xe7, 5);
}

radio *radio_new(board *b, air *medium, wire *const pins[RADIO_PINS])
{
    static const wire_listener listeners[RADIO_PINS] = {on_ce, on_csn, on_sck, on_mosi, NULL, NULL};
    radio *r = memory_new(sizeof *r);
    r->board = b;
    r->air = medium;
    char name[NAME_MAX_LENGTH + 8] = "radio ";
    strcat(name, b->name);
    r->chance = chance_stream(b->line->seed, name);
    power_on(r);
    radio_enter(r, RADIO_POWER_DOWN);
    for (int i = 0; i < RADIO_PINS; i++) {
        r->pins[i].wire = pins[i];
        if (pins[i])
            r->pins[i].device = wire_add_device(pins[i], b, listeners[i], r);
    }
    r->csn = true;
    medium->radios[medium->radios_count++] = r;
    radio_update_irq(r, 0.0);
    return r;
}

void radio_free(radio *r)
{
    free(r);
}
