/* Reads TCNT1 as the very first thing in an interrupt, in CTC mode: the cycles since the match. */
#include "part.h"

ISR(TIMER1_COMPA_vect, ISR_NAKED)
{
    asm volatile("lds r24, %0\n\tsts %1, r24\n\treti\n" : : "n"(0x84), "n"(RESULTS));
}

int main(void)
{
    OCR1A = 999;
    TIMSK1 = _BV(OCIE1A);
    TCCR1B = _BV(WGM12) | _BV(CS10);
    sei();
    for (;;)
        ;
}
