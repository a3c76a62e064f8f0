// The seam's AVR side. See hardware.h.

#include "boards/hardware.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/delay.h>

#include "boards/avr/avr_9xstream.h"
#include "boards/avr/avr_a2d.h"
#include "boards/avr/bits.h"
#include "boards/avr/converter.h"
#include "pins.h"

namespace {

volatile uint16_t stamp_count;
volatile bool stamp_fresh = false;

}  // namespace

// The radio's IRQ line fell: nothing comes before the timer is read.
ISR(INT1_vect) {
  stamp_count = TCNT1;
  stamp_fresh = true;
}

namespace hardware {

uint16_t timer() { return TCNT1; }

void timer_prescale(uint16_t prescale) {
  uint8_t select = bit(CS10);
  if (prescale == 8) select = bit(CS11);
  if (prescale == 64) select = bit(CS11) | bit(CS10);
  if (prescale == 256) select = bit(CS12);
  if (prescale == 1024) select = bit(CS12) | bit(CS10);
  TCCR1A = 0;
  TCCR1B = bit(ICNC1) | bit(ICES1) | select;  // normal mode; capture at rising edges that last a microsecond
}

void compare_afresh(uint16_t count) {
  OCR1A = count;
  TIFR1 = bit(OCF1A);
}

void compare_interrupt(bool on) {
  if (on) {
    TIFR1 = bit(OCF1A);
    set_bits(TIMSK1, bit(OCIE1A));
  } else {
    clear_bits(TIMSK1, bit(OCIE1A));
  }
}

moment clock() {
  static uint8_t last = 0;
  static moment sum = 0;
  const uint8_t count = TCNT0;
  sum += static_cast<uint8_t>(count - last);
  last = count;
  return sum;
}

uint8_t lock() {
  const uint8_t before = SREG;
  cli();
  return before;
}

void unlock(uint8_t before) { SREG = before; }

void converter_off() { converter::end(); }

int16_t knob() {
  A2D_init_default();
  const int16_t reading = A2D_read_oversampled(pins::adc_potentiometer, 4);
  A2D_off();
  return reading;
}

void capture_clear() { TIFR1 = bit(ICF1); }

bool captured(uint16_t &count) {
  if ((TIFR1 & bit(ICF1)) == 0) return false;
  const uint8_t before = lock();  // the two halves of ICR1 share a buffer with TCNT1's
  count = ICR1;
  unlock(before);
  TIFR1 = bit(ICF1);
  return true;
}

void wire_pulse() {
  set_bits(PORTD, bit(pins::synch_out));
  _delay_us(20);
  clear_bits(PORTD, bit(pins::synch_out));
}

void radio_enable(bool on) {
  if (on) {
    set_bits(PORTB, bit(pins::radio_ce));
  } else {
    clear_bits(PORTB, bit(pins::radio_ce));
  }
}

bool radio_irq() { return (PIND & bit(pins::radio_irq)) == 0; }

void stamp_on(bool on) {
  clear_bits(EIMSK, bit(INT1));
  EICRA = bit(ISC11);  // falling edge
  stamp_fresh = false;
  EIFR = bit(INTF1);
  if (on) set_bits(EIMSK, bit(INT1));
}

bool stamped(uint16_t &count) {
  const uint8_t before = lock();
  const bool fresh = stamp_fresh;
  stamp_fresh = false;
  count = stamp_count;
  unlock(before);
  return fresh;
}

bool button() { return (PIND & bit(pins::button)) == 0; }

void lights(uint8_t bar, bool status) {
  constexpr uint8_t bar_pins = ((1u << pins::bar_count) - 1) << pins::bar_first;
  const uint8_t lit =
      static_cast<uint8_t>((bar << pins::bar_first & bar_pins) | (status ? bit(pins::status_light) : 0));
  const uint8_t before = lock();  // the row mark is on this port
  PORTC = static_cast<uint8_t>((PORTC & ~(bar_pins | bit(pins::status_light))) | lit);
  unlock(before);
}

void modem_sleep(bool asleep) {
  if (asleep) {
    avr_9xstream::sleep();
  } else {
    avr_9xstream::wake_up();
  }
}

void serial_quiet(bool on) {
#ifdef SLAVE_1
  uart::quiet(on);
#else
  (void)on;  // Slave 2 has no serial line
#endif
}

}  // namespace hardware
