/* The analogue-to-digital converter, instead of simavr's.
 *
 * simavr 1.6 takes the voltage when ADCL is read, scales it by 1023, starts a conversion at once
 * instead of at the next edge of the ADC clock, and triggers by nothing but itself. */
#ifndef EMULATOR_ADC_H
#define EMULATOR_ADC_H

#include <stdbool.h>
#include <stdint.h>

struct board;

/* Voltage at a pin of port A at a time. */
typedef double (*adc_source)(void *owner, double time);

typedef struct adc {
    struct {
        adc_source voltage; /* NULL: the pin floats, and reads as 0 V */
        void *owner;
    } inputs[8];
    double supply; /* V: AVCC, and AREF */

    uint64_t prescaler; /* cycle at which the ADC clock has a rising edge, and so every `div` */
    bool first;         /* the next conversion warms up */
    bool running;
    uint16_t pending;   /* result on its way */
    double sampled;     /* s: when it was held */
    uint8_t mux;        /* ADMUX as locked by this conversion */
    bool locked;        /* ADCL has been read, ADCH not yet */
    int trigger;        /* vector number of the trigger in use, 0 for none */

    unsigned long conversions, lost; /* `lost`: results dropped because ADCH was not read */
} adc;

void adc_install(struct board *b);
void adc_after_reset(struct board *b);

#endif
