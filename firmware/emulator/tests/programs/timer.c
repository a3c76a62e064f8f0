/* The count of timer 1: kept while stopped, preloaded while stopped, kept when the mode changes. */
#include "part.h"

int main(void)
{
    TCCR1B = _BV(CS10);
    _delay_us(250);
    TCCR1B = 0;
    result[0] = TCNT1;
    _delay_us(250);
    result[1] = TCNT1; /* the same */
    TCCR1B = _BV(CS10);
    result[2] = TCNT1; /* a little more */
    TCCR1B = 0;
    TCNT1 = 40000;
    result[3] = TCNT1; /* 40000 */
    TCCR1B = _BV(CS10);
    result[4] = TCNT1; /* a little more */
    TCNT1 = 20000;
    result[5] = TCNT1; /* 20000 and a little */
    TCCR1B = _BV(CS11);
    _delay_us(100);
    TCCR1B = 0;
    result[6] = TCNT1; /* 50 more */

    /* With prescale 64, the first tick after a write comes when the prescaler wraps. */
    GTCCR = _BV(PSRSYNC);
    TCCR1B = _BV(CS11) | _BV(CS10);
    _delay_loop_1(10); /* 30 cycles */
    TCNT1 = 7;
    uint8_t i = 0;
    while (TCNT1 == 7)
        i++;
    result[7] = i;
    TCNT1 = 7;
    i = 0;
    while (TCNT1 == 7)
        i++;
    result[8] = i; /* a whole period: more */
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
