/* Sleeps; every edge of INT0 (PD2) toggles PC0. */
#include "part.h"

ISR(INT0_vect)
{
    PINC = 1;
}

int main(void)
{
    DDRC = 1;
    EICRA = _BV(ISC00);
    EIMSK = _BV(INT0);
    sei();
    set_sleep_mode(SLEEP_MODE_IDLE);
    for (;;)
        sleep_mode();
}
