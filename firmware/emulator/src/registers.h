/* Data-space addresses and bits of the ATmega644 (data sheet 2593, register summary). */
#ifndef EMULATOR_REGISTERS_H
#define EMULATOR_REGISTERS_H

enum {
    REG_PINA = 0x20, /* PINx, DDRx, PORTx follow each other for A to D */
    REG_TIFR0 = 0x35,
    REG_TIFR1 = 0x36,
    REG_TIFR2 = 0x37,
    REG_PCIFR = 0x3b,
    REG_EIFR = 0x3c,
    REG_EIMSK = 0x3d,
    REG_GTCCR = 0x43,
    REG_SMCR = 0x53,
    REG_MCUSR = 0x54,
    REG_MCUCR = 0x55,
    REG_SPL = 0x5d,
    REG_SPH = 0x5e,
    REG_PCICR = 0x68,
    REG_EICRA = 0x69,
    REG_TIMSK0 = 0x6e,
    REG_TIMSK1 = 0x6f,
    REG_TIMSK2 = 0x70,
    REG_ADCL = 0x78,
    REG_ADCH = 0x79,
    REG_ADCSRA = 0x7a,
    REG_ADCSRB = 0x7b,
    REG_ADMUX = 0x7c,
    REG_TCCR1A = 0x80,
    REG_TCCR1B = 0x81,
    REG_TCNT1L = 0x84,
    REG_TCNT1H = 0x85,
    REG_ICR1L = 0x86,
    REG_ICR1H = 0x87,
    REG_OCR1AL = 0x88,
    REG_OCR1AH = 0x89,
    REG_OCR1BL = 0x8a,
    REG_UCSR0A = 0xc0,
    REG_UCSR0B = 0xc1,
    REG_UCSR0C = 0xc2,
    REG_UBRR0L = 0xc4,
    REG_UBRR0H = 0xc5,
    REG_UDR0 = 0xc6,
};

/* Interrupt vector numbers (table 9-1). */
enum {
    VECTOR_INT0 = 1,
    VECTOR_TIMER1_CAPT = 12,
    VECTOR_TIMER1_COMPB = 14,
    VECTOR_TIMER1_OVF = 15,
    VECTOR_TIMER0_COMPA = 16,
    VECTOR_TIMER0_OVF = 18,
    VECTOR_USART0_RX = 20,
    VECTOR_USART0_UDRE = 21,
    VECTOR_USART0_TX = 22,
    VECTOR_ADC = 24,
};

#endif
