/* Inputs with pull-ups that somebody holds low, while PORTD is written to. Counts its starts. */
#include "part.h"

static uint16_t starts __attribute__((section(".noinit")));

int main(void)
{
    result[20] = MCUSR;
    if (MCUSR & _BV(PORF))
        starts = 0;
    MCUSR = 0;
    result[21] = ++starts;
    PORTD = _BV(2) | _BV(4); /* pull-ups; PD2 is held low, nothing is on PD4 */
    DDRD = _BV(5);
    _delay_us(10);
    result[0] = PIND & (_BV(2) | _BV(4));
    PORTD |= _BV(5);
    result[1] = PIND & (_BV(2) | _BV(4) | _BV(5));
    PORTD &= ~_BV(5);
    result[2] = PIND & (_BV(2) | _BV(4) | _BV(5));

    result[5] = PINA & _BV(6); /* held high */

    DDRC = 0xff; /* PC2 to PC5 belong to JTAG still */
    PORTC = 0xff;
    _delay_us(10);
    result[3] = PINB & 3; /* PB0 is wired to PC3, PB1 to PC1 */
    MCUCR = _BV(JTD);
    MCUCR = _BV(JTD);
    _delay_us(10);
    result[4] = PINB & 3;
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
