/* Keeps what ICP1 captures, rising edges; PA0 high turns the noise canceller on, PA1 falling edges.
 * PD5 is an output that stays low unless PA2 goes high. */
#include "part.h"

static volatile uint8_t count;

ISR(TIMER1_CAPT_vect)
{
    if (count < RESULTS_COUNT - 1)
        result[++count] = ICR1;
    result[0] = count;
}

int main(void)
{
    result[0] = 0;
    DDRD = _BV(5);
    TCCR1B = _BV(CS10) | (PINA & 1 ? _BV(ICNC1) : 0) | (PINA & 2 ? 0 : _BV(ICES1));
    TIMSK1 = _BV(ICIE1);
    sei();
    for (;;) {
        if (PINA & 4)
            PORTD |= _BV(5);
        else
            PORTD &= ~_BV(5);
    }
}
