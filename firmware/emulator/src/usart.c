#include "usart.h"

#include "board.h"
#include "registers.h"

/* UCSR0A */
#define RXC 0x80
#define TXC 0x40
#define UDRE 0x20
#define FE 0x10
#define DOR 0x08
#define U2X 0x02
#define MPCM 0x01
/* UCSR0B */
#define RXCIE 0x80
#define UDRIE 0x20
#define RXEN 0x10
#define TXEN 0x08

static unsigned cycles_a_bit(const board *b)
{
    const uint8_t *data = b->avr->data;
    unsigned ubrr = data[REG_UBRR0L] | (data[REG_UBRR0H] & 0x0fu) << 8;
    return (data[REG_UCSR0A] & U2X ? 8 : 16) * (ubrr + 1);
}

double usart_bit(const board *b)
{
    return cycles_a_bit(b) / b->frequency;
}

/* Brings the level flags in line with the buffers. */
static void look(board *b)
{
    usart *u = &b->usart;
    uint8_t *a = &b->avr->data[REG_UCSR0A], control = b->avr->data[REG_UCSR0B];
    *a = (uint8_t)(*a & ~(RXC | UDRE | FE | DOR));
    if (u->count)
        *a |= RXC | u->errors[0];
    if (u->overrun)
        *a |= DOR;
    if (!u->full)
        *a |= UDRE;
    u->level = (*a & RXC && control & RXCIE) || (*a & UDRE && control & UDRIE);
    if (!(*a & RXC))
        u->on_receive->pending = 0;
    if (!(*a & UDRE))
        u->on_empty->pending = 0;
}

void usart_raise_levels(board *b)
{
    avr_t *avr = b->avr;
    if (!avr->sreg[S_I])
        return;
    uint8_t due = avr->data[REG_UCSR0A] & avr->data[REG_UCSR0B];
    if (due & RXC && !b->usart.on_receive->pending)
        avr_raise_interrupt(avr, b->usart.on_receive);
    if (due & UDRE && !b->usart.on_empty->pending)
        avr_raise_interrupt(avr, b->usart.on_empty);
}

static avr_cycle_count_t shifted(avr_t *avr, avr_cycle_count_t when, void *param)
{
    board *b = param;
    usart *u = &b->usart;
    u->total.sent++;
    if (u->end.hear) {
        /* The line hears in the middle of the stop bit, half a bit ago: close enough, and causal.
         */
        u->end.hear(u->end.owner, u->shifting, board_time_of(b, (double)when), usart_bit(b));
    }
    u->busy = u->full;
    if (u->full) {
        u->shifting = u->waiting;
        u->full = false;
        look(b);
        return when + SERIAL_BITS * cycles_a_bit(b);
    }
    avr_raise_interrupt(avr, u->on_sent);
    return 0;
}

static void write_data(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)address;
    board *b = param;
    usart *u = &b->usart;
    if (!(avr->data[REG_UCSR0B] & TXEN))
        return;
    if (!u->busy) {
        u->busy = true;
        u->shifting = value;
        avr_cycle_timer_register(avr, SERIAL_BITS * cycles_a_bit(b), shifted, b);
    } else if (!u->full) {
        u->full = true;
        u->waiting = value;
    } else {
        u->total.overwritten++; /* written while UDRE was low: the part ignores it */
    }
    look(b);
}

static uint8_t read_data(avr_t *avr, avr_io_addr_t address, void *param)
{
    (void)avr, (void)address;
    board *b = param;
    usart *u = &b->usart;
    uint8_t value = u->received[0];
    if (u->count == USART_RECEIVE_ROOM)
        u->full_until = b->now;
    if (u->count) {
        u->count--;
        for (int i = 0; i < u->count; i++) {
            u->received[i] = u->received[i + 1];
            u->errors[i] = u->errors[i + 1];
        }
    }
    u->overrun = false;
    look(b);
    return value;
}

void usart_hear(void *owner, uint8_t byte, double time, double bit)
{
    board *b = owner;
    usart *u = &b->usart;
    if (!(b->avr->data[REG_UCSR0B] & RXEN) || b->held_until > time)
        return;
    /* The third byte stays in the shift register until the next start bit (data sheet 2593, 17.7).
     */
    double started = time - (SERIAL_BITS - 0.5) * bit;
    if (u->count == USART_RECEIVE_ROOM || started < u->full_until) {
        u->overrun = true;
        u->total.overruns++;
    } else {
        bool understood = serial_agrees(usart_bit(b), bit);
        u->received[u->count] = understood ? byte : (uint8_t)(byte << 1 ^ 0x55);
        u->errors[u->count++] = understood ? 0 : FE;
        u->total.received++;
        u->total.framing += !understood;
    }
    look(b);
}

static uint8_t read_status(avr_t *avr, avr_io_addr_t address, void *param)
{
    (void)param;
    return avr->data[address];
}

static void write_status(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    avr->data[address] = (uint8_t)((avr->data[address] & ~(U2X | MPCM)) | (value & (U2X | MPCM)));
    if (value & TXC)
        avr_clear_interrupt(avr, b->usart.on_sent);
    look(b);
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    avr->data[address] = value;
    if (!(value & RXEN)) {
        b->usart.count = 0;
        b->usart.overrun = false;
    }
    look(b);
    board_unmask(b, b->usart.on_sent);
}

static void write_divisor(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    avr->data[address] = value;
}

void usart_install(board *b)
{
    b->usart.on_receive = board_vector(b, VECTOR_USART0_RX);
    b->usart.on_empty = board_vector(b, VECTOR_USART0_UDRE);
    b->usart.on_sent = board_vector(b, VECTOR_USART0_TX);
    board_on_write(b, REG_UDR0, write_data, b);
    board_on_read(b, REG_UDR0, read_data, b);
    board_on_write(b, REG_UCSR0A, write_status, b);
    board_on_read(b, REG_UCSR0A, read_status, b);
    board_on_write(b, REG_UCSR0B, write_control, b);
    board_on_write(b, REG_UBRR0L, write_divisor, b);
}

void usart_after_reset(board *b)
{
    usart *u = &b->usart;
    u->busy = u->full = u->overrun = u->level = false;
    u->count = 0;
    b->avr->data[REG_UCSR0A] = UDRE;
    b->avr->data[REG_UCSR0B] = 0; /* simavr leaves the transmitter on */
    b->avr->data[REG_UCSR0C] = 0x06;
}
