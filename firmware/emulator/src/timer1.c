#include "timer1.h"

#include <string.h>

#include "board.h"
#include "registers.h"

#define TCCR1A_COM 0xf0
#define TCCR1B_CLOCK_AND_MODE 0x1f
#define TCCR1A_MODE 0x03
#define GTCCR_PSRSYNC 0x01

/* The same functions for every board. */
static write_handler simavr_control, simavr_count, simavr_compare;

static bool runs(const board *b)
{
    return b->timer1.simavr->tov_cycles > 0;
}

uint16_t timer1_count_at(const board *b, avr_cycle_count_t cycle)
{
    const avr_timer_t *t = b->timer1.simavr;
    if (!runs(b))
        return b->timer1.stopped_at;
    /* An overflow that is due between two instructions has not been handled yet. */
    avr_cycle_count_t since = (cycle - t->tov_base) % t->tov_cycles;
    return (uint16_t)(since / t->cs_div_value);
}

/* simavr arms the compare units of a new turn only when the overflow has been handled, up to an
 * instruction late: a match within the first cycles of a turn (or of a write to OCR1x) is missed.
 * So each match is raised from here as well, at the same cycle, where a second time does nothing.
 */
static avr_cycle_count_t match(avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct timer1_compare *unit = param;
    avr_timer_t *t = unit->board->timer1.simavr;
    if (!runs(unit->board))
        return 0;
    avr_raise_interrupt(avr, &t->comp[unit->unit].interrupt);
    return when + t->tov_cycles;
}

static void arm(board *b)
{
    const avr_timer_t *t = b->timer1.simavr;
    for (int i = 0; i < 2; i++) {
        struct timer1_compare *unit = &b->timer1.compare[i];
        avr_cycle_timer_cancel(b->avr, match, unit);
        uint16_t at = (uint16_t)(b->avr->data[t->comp[i].r_ocr] |
                                 b->avr->data[t->comp[i].r_ocrh] << 8);
        if (!runs(b) || at > t->tov_top)
            continue;
        /* The flag comes with the tick that follows the equal count. */
        uint64_t match_at = (uint64_t)t->cs_div_value * (at + 1u);
        uint64_t since = (b->avr->cycle - t->tov_base) % t->tov_cycles;
        uint64_t ahead = (match_at + t->tov_cycles - since - 1) % t->tov_cycles + 1;
        avr_cycle_timer_register(b->avr, ahead, match, unit);
    }
}

/* Sets the count of the running timer. The prescaler is not set back (data sheet 2593, 15.1): the
 * first tick comes when it wraps, not a whole period later as in simavr, which also rounds. */
static void set_count(board *b, uint16_t count)
{
    avr_t *avr = b->avr;
    avr_timer_t *t = b->timer1.simavr;
    avr_cycle_count_t now = avr->cycle;
    avr_cycle_count_t phase = (now - b->timer1.prescaler) % t->cs_div_value;
    if (count >= t->tov_top) /* simavr starts from zero then */
        count = 0;
    uint64_t simavr_thinks = t->tov_top ? count * t->tov_cycles / t->tov_top : 0;
    avr->data[REG_TCNT1L] = (uint8_t)count;
    avr->data[REG_TCNT1H] = (uint8_t)(count >> 8);
    avr->cycle = now - phase + simavr_thinks - (uint64_t)count * t->cs_div_value;
    simavr_count.call(avr, REG_TCNT1L, (uint8_t)count, t);
    avr->cycle = now;
    arm(b);
}

static void beyond(board *b, uint16_t count)
{
    uint16_t top = (uint16_t)(b->avr->data[REG_OCR1AL] | b->avr->data[REG_OCR1AH] << 8);
    if (b->timer1.simavr->wgm_op_mode_kind != avr_timer_wgm_ctc || count <= top ||
        b->timer1.warned_beyond)
        return;
    b->timer1.warned_beyond = true;
    report_warning(&b->line->report, b->now, b->name,
                   "TCNT1 is above OCR1A: the part counts on to 65535 and misses the match");
}

static void write_count(avr_t *avr, avr_io_addr_t address, uint8_t low, void *param)
{
    board *b = param;
    (void)address;
    uint16_t count = (uint16_t)(low | avr->data[REG_TCNT1H] << 8);
    if (runs(b)) {
        beyond(b, count);
        set_count(b, count);
    } else {
        b->timer1.stopped_at = count; /* simavr forgets what is written to a stopped timer */
    }
}

static uint8_t read_count(avr_t *avr, avr_io_addr_t address, void *param)
{
    uint16_t count = timer1_count_at(param, avr->cycle);
    avr->data[REG_TCNT1H] = (uint8_t)(count >> 8);
    return avr->data[address] = (uint8_t)count;
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    uint16_t count = timer1_count_at(b, avr->cycle);
    uint8_t relevant = address == REG_TCCR1A ? TCCR1A_MODE : TCCR1B_CLOCK_AND_MODE;
    bool changes = (avr->data[address] ^ value) & relevant;
    if (address == REG_TCCR1A && value & TCCR1A_COM && !b->timer1.warned_outputs) {
        b->timer1.warned_outputs = true;
        report_warning(&b->line->report, b->now, b->name, "OC1A and OC1B are not emulated");
    }
    simavr_control.call(avr, address, value, b->timer1.simavr);
    if (!changes)
        return;
    if (runs(b))
        set_count(b, count); /* simavr starts again from zero */
    else
        b->timer1.stopped_at = count; /* and reads as zero while stopped */
    arm(b);
}

static void write_compare(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    int unit = address == REG_OCR1AL ? AVR_TIMER_COMPA : AVR_TIMER_COMPB;
    simavr_compare.call(avr, address, value, &b->timer1.simavr->comp[unit]);
    arm(b);
    if (runs(b))
        beyond(b, timer1_count_at(b, avr->cycle));
}

static void write_prescaler(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    avr->data[address] = value & 0x80; /* PSRSYNC clears itself unless TSM holds it */
    if (value & GTCCR_PSRSYNC) {
        uint16_t count = timer1_count_at(b, avr->cycle);
        b->timer1.prescaler = avr->cycle;
        if (runs(b))
            set_count(b, count);
    }
}

void timer1_install(board *b)
{
    for (avr_io_t *io = b->avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1')
            b->timer1.simavr = (avr_timer_t *)io;
    board_on_write(b, REG_TCCR1A, write_control, b);
    simavr_control = board_on_write(b, REG_TCCR1B, write_control, b);
    simavr_count = board_on_write(b, REG_TCNT1L, write_count, b);
    simavr_compare = board_on_write(b, REG_OCR1AL, write_compare, b);
    board_on_write(b, REG_OCR1BL, write_compare, b);
    for (int i = 0; i < 2; i++)
        b->timer1.compare[i] = (struct timer1_compare){b, i};
    board_on_read(b, REG_TCNT1L, read_count, b);
    board_on_write(b, REG_GTCCR, write_prescaler, b);
}

void timer1_after_reset(board *b)
{
    avr_timer_t *t = b->timer1.simavr;
    t->tov_cycles = 0; /* simavr does not stop the clock */
    t->cs_div_value = 0;
    b->timer1.stopped_at = 0;
    b->timer1.prescaler = b->avr->cycle;
}
