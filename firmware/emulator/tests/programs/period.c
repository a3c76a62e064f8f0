/* Toggles PC0 at every compare match: OCR1A 4999 with prescale 1; prescale 8 when PA0 is high. */
#include "part.h"

ISR(TIMER1_COMPA_vect)
{
    PINC = 1;
}

int main(void)
{
    DDRC = 1;
    OCR1A = 4999;
    TIMSK1 = _BV(OCIE1A);
    TCCR1B = _BV(WGM12) | (PINA & 1 ? _BV(CS11) : _BV(CS10));
    sei();
    set_sleep_mode(SLEEP_MODE_IDLE);
    for (;;)
        sleep_mode();
}
