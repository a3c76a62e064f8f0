/* Interrupt flags: write-one-to-clear, SBI on them, unmasking after they rose. */
#include "part.h"

static volatile uint8_t compare_a, compare_b, pin;

ISR(TIMER1_COMPA_vect)
{
    compare_a++;
}

ISR(TIMER1_COMPB_vect)
{
    compare_b++;
}

ISR(INT0_vect)
{
    pin++;
}

ISR(INT2_vect)
{
    pin += 10;
}

static void both_flags(void)
{
    TCCR1B = 0;
    TCNT1 = 0;
    TIFR1 = 0xff;
    TCCR1B = _BV(CS10);
    while ((TIFR1 & (_BV(OCF1A) | _BV(OCF1B))) != (_BV(OCF1A) | _BV(OCF1B)))
        ;
    TCCR1B = 0;
}

int main(void)
{
    OCR1A = 100;
    OCR1B = 120;
    both_flags();
    TIFR1 = _BV(OCF1A);
    result[0] = TIFR1 & (_BV(OCF1A) | _BV(OCF1B)); /* B alone */
    both_flags();
    asm volatile("sbi %0, %1" : : "I"(_SFR_IO_ADDR(TIFR1)), "I"(OCF1A));
    result[1] = TIFR1 & (_BV(OCF1A) | _BV(OCF1B)); /* B alone */
    both_flags();
    TIFR1 = 0;
    result[2] = TIFR1 & (_BV(OCF1A) | _BV(OCF1B)); /* both */

    sei();
    TIMSK1 = _BV(OCIE1A) | _BV(OCIE1B); /* the flags rose while masked */
    _delay_us(20);
    result[3] = compare_a;
    result[4] = compare_b;
    TIMSK1 = 0;
    result[5] = TIFR1 & (_BV(OCF1A) | _BV(OCF1B)); /* none */

    EICRA = _BV(ISC01); /* INT0, falling edge, from PD2 which is tied to PB0 */
    DDRB = 1;
    PORTB = 1;
    _delay_us(20);
    EIFR = 0xff;
    PORTB = 0;
    _delay_us(20);
    result[6] = EIFR & _BV(INTF0); /* raised */
    EIFR = _BV(INTF0);
    result[7] = EIFR & _BV(INTF0); /* cleared */
    PORTB = 1;
    _delay_us(20);
    PORTB = 0;
    _delay_us(20);
    EIMSK = _BV(INT0);
    _delay_us(20);
    result[8] = pin; /* once */
    EIMSK = 0;
    EICRA = 0; /* level */
    EIMSK = _BV(INT0);
    _delay_us(50);
    EIMSK = 0;
    result[9] = pin > 3; /* again and again while it is low */
    PORTB = 1;
    _delay_us(20);
    pin = 0;
    EIMSK = _BV(INT0);
    _delay_us(50);
    result[10] = pin; /* not when it is high, whatever happened before */

    EIMSK = 0;
    pin = 0;
    DDRB |= _BV(1); /* INT2 is PB2, which is tied to PB1 */
    PORTB |= _BV(1);
    EICRA = _BV(ISC21);
    EIFR = 0xff;
    EIMSK = _BV(INT2);
    PORTB &= ~_BV(1);
    _delay_us(20);
    result[13] = pin;
    EIMSK = 0;

    PORTC = 0x0f;
    asm volatile("sbi %0, %1" : : "I"(_SFR_IO_ADDR(PINC)), "I"(0));
    result[11] = PORTC; /* 0x0e */
    PINC = 0x03;
    result[12] = PORTC; /* 0x0d */
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
