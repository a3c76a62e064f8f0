/* Timer 1 runs free, compare match A moves on by 5000 each time, as the logger's rows do. */
#include "part.h"

ISR(TIMER1_COMPA_vect)
{
    OCR1A += 5000;
    PINC = 1;
}

int main(void)
{
    DDRC = 1;
    OCR1A = 5000;
    TIMSK1 = _BV(OCIE1A);
    TCCR1B = _BV(CS10);
    sei();
    set_sleep_mode(SLEEP_MODE_IDLE);
    for (;;)
        sleep_mode();
}
