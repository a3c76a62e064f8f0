/* The converter: single conversions of A0, then free running from A1, then by compare match B. */
#include "part.h"

static uint16_t convert(void)
{
    ADCSRA |= _BV(ADSC);
    while (ADCSRA & _BV(ADSC))
        ;
    return ADC;
}

int main(void)
{
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | 5; /* 125 kHz */
    result[0] = convert();
    result[1] = convert();
    result[2] = convert();
    ADCSRA |= _BV(ADIF);
    result[3] = ADCSRA & _BV(ADIF); /* cleared by writing one */

    ADMUX = _BV(REFS0) | 1;
    ADCSRA = 0;
    ADCSRB = 0;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADATE) | 5;
    for (uint8_t i = 0; i < 4; i++) {
        while (!(ADCSRA & _BV(ADIF)))
            ;
        ADCSRA |= _BV(ADIF);
        result[4 + i] = ADC;
    }
    ADCSRA = 0;

    ADMUX = _BV(REFS0);
    ADCSRB = _BV(ADTS2) | _BV(ADTS0); /* timer 1 compare match B */
    ADCSRA = _BV(ADEN) | 5;
    convert(); /* the long first one */
    OCR1A = 3999;
    OCR1B = 1000;
    ADCSRA = _BV(ADEN) | _BV(ADATE) | _BV(ADIF) | 5;
    TCCR1B = _BV(WGM12) | _BV(CS10);
    for (uint8_t i = 0; i < 3; i++) {
        while (!(ADCSRA & _BV(ADIF)))
            ;
        ADCSRA |= _BV(ADIF);
        TIFR1 = _BV(OCF1B); /* or there is no further edge */
        result[8 + i] = ADC;
    }
    while (!(ADCSRA & _BV(ADIF)))
        ;
    ADCSRA |= _BV(ADIF);
    _delay_ms(3); /* the flag stays set: nothing more */
    result[11] = ADCSRA & _BV(ADIF);

    ADCSRA = 0;
    ADMUX = _BV(REFS0) | _BV(ADLAR);
    ADCSRA = _BV(ADEN) | 5;
    convert();
    result[12] = ADC;
    ADMUX = _BV(REFS1) | _BV(REFS0); /* 2.56 V */
    result[13] = convert();
    ADMUX = _BV(REFS0) | 0x1e; /* the bandgap */
    result[14] = convert();

    ADMUX = _BV(REFS0);
    convert();
    uint8_t low = ADCL; /* locks the pair until ADCH is read */
    ADMUX = _BV(REFS0) | 1;
    ADCSRA |= _BV(ADSC);
    while (ADCSRA & _BV(ADSC))
        ;
    result[15] = low | ADCH << 8;
    result[RESULTS_COUNT - 1] = 1;
    for (;;)
        ;
}
