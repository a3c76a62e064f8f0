#include "capture.h"

#include <math.h>

#include <avr_ioport.h>
#include <avr_timer.h>

#include "board.h"
#include "registers.h"

/* The synchroniser and edge detector of ICP1 are those of T1 (data sheet 2593, 14.6.1), 2.5 to 3.5
 * cycles from the edge (15.1); the noise canceller asks for four equal samples on top (14.6.2). */
#define SYNCHRONISER 3
#define CANCELLER 4
#define TCCR1B_ICNC1 0x80
#define TCCR1B_ICES1 0x40

bool capture_is_pin(int port, int bit)
{
    return port == 3 && bit == 6;
}

static avr_cycle_count_t latch(avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct capture_edge *edge = param;
    board *b = edge->board;
    bool rising = avr->data[REG_TCCR1B] & TCCR1B_ICES1;
    bool cancelled = avr->data[REG_TCCR1B] & TCCR1B_ICNC1 && b->capture.level != edge->level;
    if (edge->level != rising || cancelled || b->timer1.simavr->mode.top == avr_timer_wgm_reg_icr)
        return 0;
    uint16_t count = timer1_count_at(b, when);
    avr->data[REG_ICR1L] = (uint8_t)count;
    avr->data[REG_ICR1H] = (uint8_t)(count >> 8);
    b->capture.captured++;
    avr_raise_interrupt(avr, board_vector(b, VECTOR_TIMER1_CAPT));
    return 0;
}

void capture_edge(board *b, bool level, double time)
{
    if (level == b->capture.level)
        return;
    b->capture.level = level;
    struct capture_edge *edge = &b->capture.edges[b->capture.next++ % CAPTURE_EDGES];
    *edge = (struct capture_edge){b, level};
    int delay = SYNCHRONISER + (b->avr->data[REG_TCCR1B] & TCCR1B_ICNC1 ? CANCELLER : 0);
    double ahead = floor(board_cycle_of(b, time)) + delay - (double)b->avr->cycle;
    avr_cycle_timer_register(b->avr, ahead > 0 ? (avr_cycle_count_t)ahead : 0, latch, edge);
}

void capture_install(board *b)
{
    b->capture.level = false;
}

void capture_after_reset(board *b)
{
    /* simavr latches the count at which it hears of the edge, up to an instruction late. */
    avr_unconnect_irq(
        avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 6),
        avr_io_getirq(b->avr, (uint32_t)AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_IN_ICP));
    b->capture.level = pins_level(b, 3, 6);
}
