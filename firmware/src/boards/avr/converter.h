// What a row does with the A/D converter and Timer 1, for the sampler's interrupts.

#ifndef BOARDS_AVR_CONVERTER_H
#define BOARDS_AVR_CONVERTER_H

#include <avr/io.h>

#include "boards/avr/bits.h"
#include "pins.h"

struct converter {
  static constexpr uint8_t prescale = bit(ADPS2) | bit(ADPS0);  // 1/32: 125 kHz
  static constexpr uint8_t reference = bit(REFS0);              // AVCC
  static constexpr uint8_t armed = bit(ADATE) | bit(ADIE) | prescale;

  /// Off and on again: the prescaler starts from zero (data sheet 20.4), so that the hold comes at the same
  /// time after the row's start in every row. Free running: ADTS is 0 since the reset.
  static void begin() {
    ADMUX = reference | pins::adc_wheel;
    ADCSRA = bit(ADIF) | armed;  // a conversion of before, as the knob's, must not count for this row
    ADCSRA = bit(ADEN) | bit(ADSC) | armed;
    set_bits(PORTC, bit(pins::row_mark));
  }

  /// The conversion after the one that runs is the chassis channel's (data sheet 20.5).
  static void chassis_next() { ADMUX = reference | pins::adc_chassis; }

  /// The conversion that runs is the last: no other begins after it.
  static void last_one() { ADCSRA = bit(ADEN) | bit(ADIE) | prescale; }

  /// Off; a conversion that has just finished is forgotten.
  static void end() {
    ADCSRA = bit(ADIF) | prescale;
    clear_bits(PORTC, bit(pins::row_mark));
  }

  /// The next row's match.
  static void compare_at(uint16_t count) { OCR1A = count; }
};

#endif
