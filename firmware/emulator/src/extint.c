#include "extint.h"

#include <avr_extint.h>
#include <avr_ioport.h>

#include "board.h"
#include "registers.h"

/* Table 11-1 and section 1 of data sheet 2593: PD2, PD3 and PB2. */
static const struct {
    uint16_t pin_register;
    uint8_t bit;
} lines[] = {{REG_PINA + 9, 2}, {REG_PINA + 9, 3}, {REG_PINA + 3, 2}};

static bool by_level(const board *b, int line)
{
    return (b->avr->data[REG_EICRA] >> 2 * line & 3) == 0;
}

static void look(board *b)
{
    b->extint.level = 0;
    for (int i = 0; i < 3; i++)
        if (b->avr->data[REG_EIMSK] >> i & 1 && by_level(b, i))
            b->extint.level |= (uint8_t)(1u << i);
}

static void write_mask(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    avr->data[address] = value;
    for (uint8_t i = 0; i < 3; i++)
        if (!by_level(b, i)) /* a level is not remembered while masked */
            board_unmask(b, board_vector(b, VECTOR_INT0 + i));
    look(b);
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    avr->data[address] = value;
    look(param);
}

void extint_raise_levels(board *b)
{
    if (!b->avr->sreg[S_I])
        return;
    for (uint8_t i = 0; i < 3; i++)
        if (b->extint.level >> i & 1 &&
            !(b->avr->data[lines[i].pin_register] >> lines[i].bit & 1)) {
            avr_int_vector_t *v = board_vector(b, VECTOR_INT0 + i);
            if (!v->pending)
                avr_raise_interrupt(b->avr, v);
        }
}

void extint_install(board *b)
{
    board_on_write(b, REG_EIMSK, write_mask, b);
    board_on_write(b, REG_EICRA, write_control, b);
}

void extint_after_reset(board *b)
{
    avr_t *avr = b->avr;
    /* simavr looks at the port every cycle while a level-triggered pin is low, which all three are
     * after reset, enabled or not: four times slower, and it fires while masked. Ours instead. */
    for (uint8_t i = 0; i < 3; i++)
        avr_extint_set_strict_lvl_trig(avr, i, 0);
    /* simavr has INT2 of this family on PB3. */
    avr_irq_t *int2 = avr_io_getirq(avr, AVR_IOCTL_EXTINT_GETIRQ(), EXTINT_IRQ_OUT_INT2);
    avr_unconnect_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 3), int2);
    avr_connect_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 2), int2);
    b->extint.level = 0;
}
