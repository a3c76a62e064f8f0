#include "adc.h"

#include <math.h>

#include "board.h"
#include "registers.h"

/* ADCSRA */
#define ADEN 0x80
#define ADSC 0x40
#define ADATE 0x20
#define ADIF 0x10
/* ADMUX */
#define ADLAR 0x20
#define MUX 0x1f
#define MUX_BANDGAP 0x1e
#define MUX_GROUND 0x1f

/* Data sheet 2593, section 20.4, in ADC clocks. */
#define NORMAL_LENGTH 13.0
#define NORMAL_SAMPLE 1.5
#define FIRST_LENGTH 25.0
#define FIRST_SAMPLE 13.5
#define TRIGGERED_LENGTH 13.5
#define TRIGGERED_SAMPLE 2.0
#define TRIGGER_DELAY 3 /* CPU cycles */

/* Trigger sources by ADTS, table 20-6; 0 is free running, 1 the comparator (not emulated). */
static const int triggers[8] = {0, -1, VECTOR_INT0, VECTOR_TIMER0_COMPA, VECTOR_TIMER0_OVF,
                                VECTOR_TIMER1_COMPB, VECTOR_TIMER1_OVF, VECTOR_TIMER1_CAPT};

static unsigned divisor(const board *b)
{
    unsigned exponent = b->avr->data[REG_ADCSRA] & 7;
    return 1u << (exponent ? exponent : 1);
}

static double reference(const board *b)
{
    switch (b->avr->data[REG_ADMUX] >> 6) {
    case 2:
        return 1.1;
    case 3:
        return 2.56;
    default:
        return b->adc.supply;
    }
}

static double voltage(board *b, double time)
{
    uint8_t mux = b->adc.mux & MUX;
    if (mux == MUX_BANDGAP)
        return 1.1;
    if (mux == MUX_GROUND || (mux < 8 && !b->adc.inputs[mux].voltage))
        return 0.0;
    if (mux < 8)
        return b->adc.inputs[mux].voltage(b->adc.inputs[mux].owner, time);
    report_warning(&b->line->report, time, b->name, "differential channels are not emulated");
    return 0.0;
}

static void quantise(board *b, double time)
{
    double count = floor(voltage(b, time) / reference(b) * 1024.0);
    b->adc.pending = count <= 0.0 ? 0 : count >= 1023.0 ? 1023 : (uint16_t)count;
    b->adc.sampled = time;
}

/* Only of conversions that come to their end: a program may turn the converter off before. */
static void log_conversion(board *b, avr_cycle_count_t when)
{
    report *r = &b->line->report;
    if (!r->adc)
        return;
    report_begin(r, board_time_of(b, (double)when), "adc");
    report_text(r, "board", b->name);
    report_number(r, "sampled", b->adc.sampled);
    report_count(r, "channel", b->adc.mux & MUX);
    report_count(r, "count", b->adc.pending);
    report_end(r);
}

static avr_cycle_count_t done(avr_t *avr, avr_cycle_count_t when, void *param);

/* Starts a conversion at the given cycle, which may lie ahead. */
static void convert(board *b, avr_cycle_count_t at, double length, double sample)
{
    unsigned div = divisor(b);
    b->adc.running = true;
    b->adc.first = false;
    b->adc.mux = b->avr->data[REG_ADMUX];
    quantise(b, board_time_of(b, (double)at + sample * div));
    avr_cycle_count_t end = at + (avr_cycle_count_t)(length * div);
    avr_cycle_timer_register(b->avr, end > b->avr->cycle ? end - b->avr->cycle : 0, done, b);
}

static avr_cycle_count_t start(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    board *b = param;
    if (b->adc.first)
        convert(b, when, FIRST_LENGTH, FIRST_SAMPLE);
    else
        convert(b, when, NORMAL_LENGTH, NORMAL_SAMPLE);
    return 0;
}

static avr_cycle_count_t done(avr_t *avr, avr_cycle_count_t when, void *param)
{
    board *b = param;
    b->adc.running = false;
    b->adc.conversions++;
    log_conversion(b, when);
    if (b->adc.locked) {
        b->adc.lost++;
    } else {
        uint16_t value = avr->data[REG_ADMUX] & ADLAR ? (uint16_t)(b->adc.pending << 6)
                                                      : b->adc.pending;
        avr->data[REG_ADCL] = (uint8_t)value;
        avr->data[REG_ADCH] = (uint8_t)(value >> 8);
    }
    if (avr->data[REG_ADCSRA] & ADATE && triggers[avr->data[REG_ADCSRB] & 7] == 0)
        convert(b, when, NORMAL_LENGTH, NORMAL_SAMPLE); /* free running: no gap */
    else
        avr->data[REG_ADCSRA] &= (uint8_t)~ADSC;
    avr_raise_interrupt(avr, board_vector(b, VECTOR_ADC));
    return 0;
}

/* The edge of a trigger's interrupt flag, masked or not. */
static void triggered(struct avr_irq_t *irq, uint32_t raised, void *param)
{
    board *b = param;
    avr_t *avr = b->avr;
    bool rose = raised && !irq->value; /* a flag that was not cleared has no edge */
    if (!rose || !(avr->data[REG_ADCSRA] & ADEN) || !(avr->data[REG_ADCSRA] & ADATE) ||
        (int)(irq->irq / 256) != triggers[avr->data[REG_ADCSRB] & 7] || b->adc.running)
        return;
    b->adc.prescaler = avr->cycle + TRIGGER_DELAY; /* the trigger resets the prescaler */
    avr->data[REG_ADCSRA] |= ADSC;
    convert(b, b->adc.prescaler, b->adc.first ? FIRST_LENGTH : TRIGGERED_LENGTH,
            b->adc.first ? FIRST_SAMPLE : TRIGGERED_SAMPLE);
}

static void turn_on(board *b)
{
    b->adc.prescaler = b->avr->cycle;
    b->adc.first = true;
}

static void turn_off(board *b)
{
    avr_cycle_timer_cancel(b->avr, start, b);
    avr_cycle_timer_cancel(b->avr, done, b);
    b->adc.running = false;
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    board *b = param;
    uint8_t before = avr->data[address];
    bool clears = value & ADIF;
    bool asks = value & ADSC && !(before & ADSC) && value & ADEN;
    avr->data[address] = (uint8_t)((value & ~(ADIF | ADSC)) | (before & ADIF));
    if (clears) /* cleared by writing one, and kept by writing zero */
        avr_clear_interrupt(avr, board_vector(b, VECTOR_ADC));
    if (!(value & ADEN)) {
        turn_off(b);
        return;
    }
    if (!(before & ADEN))
        turn_on(b);
    if (before & ADSC || asks)
        avr->data[address] |= ADSC; /* cannot be taken back */
    if (asks && !b->adc.running) {
        avr_cycle_count_t div = divisor(b), since = avr->cycle - b->adc.prescaler;
        avr_cycle_timer_register(avr, (div - since % div) % div, start, b);
    }
    board_unmask(b, board_vector(b, VECTOR_ADC));
}

static uint8_t read_low(avr_t *avr, avr_io_addr_t address, void *param)
{
    ((board *)param)->adc.locked = true;
    return avr->data[address];
}

static uint8_t read_high(avr_t *avr, avr_io_addr_t address, void *param)
{
    ((board *)param)->adc.locked = false;
    return avr->data[address];
}

static void write_plain(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param)
{
    (void)param;
    avr->data[address] = value;
}

void adc_install(board *b)
{
    board_on_write(b, REG_ADCSRA, write_control, b);
    board_on_write(b, REG_ADCSRB, write_plain, b);
    board_on_read(b, REG_ADCL, read_low, b);
    board_on_read(b, REG_ADCH, read_high, b);
    for (int i = 2; i < 8; i++)
        avr_irq_register_notify(
            avr_get_interrupt_irq(b->avr, (uint8_t)triggers[i]) + AVR_INT_IRQ_PENDING, triggered,
            b);
}

void adc_after_reset(board *b)
{
    b->adc.running = b->adc.locked = b->adc.first = false;
}
