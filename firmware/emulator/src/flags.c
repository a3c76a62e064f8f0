#include "flags.h"

#include "board.h"
#include "registers.h"

#define SBI 0x9a00 /* 1001 1010 AAAA Abbb */

uint8_t flags_bits_written(const board *b, uint8_t value)
{
    const uint8_t *at = b->avr->flash + b->avr->pc;
    unsigned instruction = at[0] | (unsigned)at[1] << 8;
    return (instruction & 0xff00) == SBI ? (uint8_t)(1u << (instruction & 7)) : value;
}

static void clear_flags(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    uint8_t ones = flags_bits_written(param, value);
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *v = avr->interrupts.vector[i];
        if (v->raised.reg == address && ones >> v->raised.bit & 1)
            avr_clear_interrupt(avr, v);
    }
}

static void set_mask(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    avr->data[address] = value;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *v = avr->interrupts.vector[i];
        if (v->enable.reg == address)
            board_unmask(param, v);
    }
}

void flags_install(board *b)
{
    static const uint16_t flags[] = {REG_TIFR0, REG_TIFR1, REG_TIFR2, REG_EIFR, REG_PCIFR};
    static const uint16_t masks[] = {REG_TIMSK0, REG_TIMSK1, REG_TIMSK2, REG_PCICR};
    for (unsigned i = 0; i < sizeof flags / sizeof *flags; i++)
        board_on_write(b, flags[i], clear_flags, b);
    for (unsigned i = 0; i < sizeof masks / sizeof *masks; i++)
        board_on_write(b, masks[i], set_mask, b);
}
