/* Counts the compare matches just after timer 1 has wrapped, with long instructions under way. */
#include "part.h"

static volatile uint16_t matches, wraps;

ISR(TIMER1_COMPA_vect)
{
    matches++;
}

ISR(TIMER1_OVF_vect)
{
    wraps++;
}

static __attribute__((noinline)) void nothing(void)
{
    asm volatile("");
}

int main(void)
{
    OCR1A = 0;
    TIMSK1 = _BV(OCIE1A) | _BV(TOIE1);
    TCCR1B = _BV(CS10);
    sei();
    while (wraps < 40)
        nothing();
    _delay_us(100);
    result[0] = matches;
    result[1] = wraps;
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
