#include "boards/avr/avr_a2d.h"

#include <avr/io.h>
#include <util/delay.h>

#include "boards/avr/bits.h"
#include "boards/avr/converter.h"

void A2D_init_default() {
  ADMUX = converter::reference;
  ADCSRA = bit(ADEN) | converter::prescale;
}

int16_t A2D_read_once(uint8_t channel) {
  if (channel > 7) return -1;
  ADMUX = converter::reference | channel;
  ADCSRA = bit(ADEN) | bit(ADSC) | converter::prescale;
  for (uint8_t tries = 0; tries < 50; ++tries) {  // 25 ADC clocks of 8 us are 0.2 ms
    _delay_us(10);
    if ((ADCSRA & bit(ADSC)) == 0) return static_cast<int16_t>(ADC);
  }
  return -1;
}

int16_t A2D_read_oversampled(uint8_t channel, uint8_t samples) {
  if (samples < 1 || samples > 32) return -1;
  uint16_t sum = 0;
  for (uint8_t i = 0; i < samples; ++i) {
    const int16_t reading = A2D_read_once(channel);
    if (reading < 0) return -1;
    sum = static_cast<uint16_t>(sum + static_cast<uint16_t>(reading));
  }
  return static_cast<int16_t>((sum + samples / 2) / samples);
}

void A2D_off() { ADCSRA = bit(ADIF); }  // and forgets the last conversion's flag
