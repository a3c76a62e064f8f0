/* USART0 at 9615 baud: sends 20 bytes as fast as UDRE allows, then looks at what has come. */
#include "part.h"

static volatile uint8_t next;

ISR(USART0_UDRE_vect)
{
    UDR0 = next++;
    if (next == 20)
        UCSR0B &= ~_BV(UDRIE0);
}

int main(void)
{
    UBRR0H = 0;
    UBRR0L = 25;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(UDRIE0);
    sei();
    while (!(UCSR0A & _BV(TXC0)))
        ;
    result[0] = UCSR0A;
    UCSR0A = _BV(TXC0);
    result[1] = UCSR0A & _BV(TXC0);

    /* Six bytes have come meanwhile: two wait in the buffer and one in the shift register. */
    result[2] = UCSR0A & (_BV(RXC0) | _BV(DOR0));
    uint8_t count = 0;
    while (UCSR0A & _BV(RXC0))
        result[4 + count++] = UDR0;
    result[3] = count;
    result[10] = UCSR0A & _BV(DOR0);

    /* UDRE comes back at once, as the first byte moves on to the shift register. */
    UDR0 = 0xaa;
    asm volatile("nop\n\tnop");
    result[11] = UCSR0A & _BV(UDRE0);
    UDR0 = 0xbb;
    asm volatile("nop\n\tnop");
    result[12] = UCSR0A & _BV(UDRE0);
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
