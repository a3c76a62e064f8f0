#include "boards/avr/avr_9xstream.h"

#include <avr/io.h>
#include <util/delay.h>

#include "boards/avr/bits.h"
#include "pins.h"

avr_9xstream::avr_9xstream() : uart(divisor_9600) {
  clear_bits(DDRD, bit(pins::modem_cts));
  set_bits(PORTD, bit(pins::modem_cts));  // without a modem CTS reads high: never send
  clear_bits(PORTD, bit(pins::modem_sleep));
  set_bits(DDRD, bit(pins::modem_sleep));
}

void avr_9xstream::sleep() { set_bits(PORTD, bit(pins::modem_sleep)); }

void avr_9xstream::wake_up() { clear_bits(PORTD, bit(pins::modem_sleep)); }

bool avr_9xstream::clear_to_send() { return (PIND & bit(pins::modem_cts)) == 0; }

bool avr_9xstream::wait_for_CTS() {
  for (uint16_t tries = 0; tries < 3000; ++tries) {
    if (clear_to_send()) return true;
    _delay_us(100);
  }
  if (timeouts_ < 255) ++timeouts_;
  return false;
}

int8_t avr_9xstream::putchar(char the_char) { return wait_for_CTS() ? uart::putchar(the_char) : int8_t{-1}; }
