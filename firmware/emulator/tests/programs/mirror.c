/* Copies PD6 to PC6 as fast as it can. */
#include "part.h"

int main(void)
{
    DDRC = _BV(6);
    for (;;)
        PORTC = PIND;
}
