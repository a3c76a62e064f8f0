#include "pins.h"

#include <string.h>

#include <avr_ioport.h>

#include "board.h"
#include "flags.h"
#include "registers.h"
#include "wire.h"

/* Registers of a port lie together: PINx, DDRx, PORTx. */
static uint16_t pin_register(int port)
{
    return (uint16_t)(REG_PINA + 3 * port);
}

static avr_ioport_t *port_of(const board *b, int port)
{
    for (avr_io_t *io = b->avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "port") && ((avr_ioport_t *)io)->name == 'A' + port)
            return (avr_ioport_t *)io;
    return NULL;
}

#define JTAG_PORT 2
#define JTAG_PINS 0x3c
#define MCUCR_JTD 0x80

pin_drive pins_drive(const board *b, int port, int bit)
{
    if (b->pins.jtag && port == JTAG_PORT && JTAG_PINS >> bit & 1)
        return PIN_FLOATS;
    bool high = b->pins.output[port] >> bit & 1;
    if (b->pins.direction[port] >> bit & 1)
        return high ? PIN_HIGH : PIN_LOW;
    return high ? PIN_PULLED_UP : PIN_FLOATS;
}

bool pins_level(const board *b, int port, int bit)
{
    const uint8_t *r = &b->avr->data[pin_register(port)];
    return ((r[0] & ~r[1]) | (r[2] & r[1])) >> bit & 1;
}

static void set_input(board *b, int port, int bit, bool level)
{
    uint8_t mask = (uint8_t)(1u << bit);
    avr_raise_irq(b->pins.irq[port][bit], level);
    /* After a reset PINx is all zero while the IRQ remembers the old level and is not raised again.
     */
    uint8_t *pin = &b->avr->data[pin_register(port)];
    *pin = (uint8_t)(level ? *pin | mask : *pin & ~mask);
}

void pins_apply(board *b, int port, int bit, bool level, double time)
{
    uint8_t mask = (uint8_t)(1u << bit);
    uint8_t *input = &b->pins.input[port];
    *input = (uint8_t)(level ? *input | mask : *input & ~mask);
    /* With its pull-up on, any write to PORTx raises a pin in simavr, whoever holds it low: unless
     * it is told that the outside pulls to the level that is there. */
    avr_ioport_t *io = b->pins.port[port];
    io->external.pull_mask |= mask;
    io->external.pull_value = level ? io->external.pull_value | mask
                                    : io->external.pull_value & (uint8_t)~mask;
    if (!(b->pins.direction[port] & mask))
        set_input(b, port, bit, level);
    if (capture_is_pin(port, bit))
        capture_edge(b, pins_level(b, port, bit), time);
}

void pins_connect(board *b, int port, int bit, wire *wire)
{
    b->pins.wires[port][bit] = wire;
}

/* Takes over what the program has written, and tells the wires. */
static void look(board *b, int port)
{
    uint8_t direction = b->avr->data[pin_register(port) + 1];
    uint8_t output = b->avr->data[pin_register(port) + 2];
    uint8_t changed = (uint8_t)((direction ^ b->pins.direction[port]) |
                                (output ^ b->pins.output[port]));
    b->pins.direction[port] = direction;
    b->pins.output[port] = output;
    /* The pin moves as the instruction ends. */
    double time = board_time_of(b, (double)b->avr->cycle + 1.0);
    for (int bit = 0; bit < 8; bit++) {
        if (!(changed >> bit & 1))
            continue;
        if (b->pins.wires[port][bit])
            wire_pin_changed(b->pins.wires[port][bit], time);
        else if (!(direction >> bit & 1))
            set_input(b, port, bit, output >> bit & 1); /* nothing but its own pull-up */
        if (capture_is_pin(port, bit) && direction >> bit & 1)
            capture_edge(b, output >> bit & 1, time);
    }
}

/* simavr's own handlers, the same functions for every board. */
static struct {
    avr_io_write_t pin, direction, output;
} simavr_write;

static void write_port(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    int port = (address - REG_PINA) / 3;
    avr_ioport_t *io = b->pins.port[port];
    switch ((address - REG_PINA) % 3) {
    case 0: /* ones written to PINx toggle PORTx */
        simavr_write.pin(avr, address, flags_bits_written(b, value), io);
        break;
    case 1:
        simavr_write.direction(avr, address, value, io);
        break;
    default:
        simavr_write.output(avr, address, value, io);
    }
    look(b, port);
}

/* JTD takes effect when it is written twice within four cycles (data sheet 2593, 23.8.1). */
static void write_mcucr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    avr->data[address] = value;
    bool second = avr->cycle - b->pins.jtag_asked <= 4;
    b->pins.jtag_asked = avr->cycle;
    bool jtag = !(value & MCUCR_JTD);
    if (!second || jtag == b->pins.jtag)
        return;
    b->pins.jtag = jtag;
    for (int bit = 0; bit < 8; bit++)
        if (JTAG_PINS >> bit & 1 && b->pins.wires[JTAG_PORT][bit])
            wire_pin_changed(b->pins.wires[JTAG_PORT][bit],
                             board_time_of(b, (double)avr->cycle + 1.0));
}

void pins_install(board *b)
{
    board_on_write(b, REG_MCUCR, write_mcucr, b);
    for (int port = 0; port < PORTS; port++) {
        uint16_t at = pin_register(port);
        b->pins.port[port] = port_of(b, port);
        for (int bit = 0; bit < 8; bit++)
            b->pins.irq[port][bit] =
                avr_io_getirq(b->avr, (uint32_t)AVR_IOCTL_IOPORT_GETIRQ('A' + port), bit);
        simavr_write.pin = board_on_write(b, at, write_port, b).call;
        simavr_write.direction = board_on_write(b, at + 1, write_port, b).call;
        simavr_write.output = board_on_write(b, at + 2, write_port, b).call;
    }
}

void pins_after_reset(board *b)
{
    b->pins.jtag = true;
    b->pins.jtag_asked = 0;
    for (int port = 0; port < PORTS; port++) {
        look(b, port);
        for (int bit = 0; bit < 8; bit++)
            set_input(b, port, bit, b->pins.input[port] >> bit & 1);
    }
}
