/* Sends every byte back plus one, by interrupt, asleep in between. */
#include "part.h"

ISR(USART0_RX_vect)
{
    UDR0 = UDR0 + 1;
}

int main(void)
{
    UBRR0L = 25;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    sei();
    set_sleep_mode(SLEEP_MODE_IDLE);
    for (;;)
        sleep_mode();
}
