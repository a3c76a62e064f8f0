#include "boards/avr/uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/delay.h>

#include "boards/avr/bits.h"

namespace {

constexpr uint8_t ring_size = 64;  // a power of two: 64 ms of bytes
volatile uint8_t ring[ring_size];
volatile uint8_t put_at = 0;    // by the interrupt, or by poll when that is off
volatile uint8_t taken_at = 0;  // by the program

}  // namespace

uart::uart(uint8_t divisor) {
  UBRR0H = 0;
  UBRR0L = divisor;  // last: this write starts the baud rate generator
  UCSR0A = 0;
  UCSR0C = bit(UCSZ01) | bit(UCSZ00);
  UCSR0B = bit(RXEN0) | bit(TXEN0) | bit(RXCIE0);
}

void uart::receive() {
  const uint8_t byte = UDR0;
  const uint8_t next = static_cast<uint8_t>((put_at + 1) & (ring_size - 1));
  if (next == taken_at) return;  // full: the frame's CRC will tell
  ring[put_at] = byte;
  put_at = next;
}

ISR(USART0_RX_vect) { uart::receive(); }

void uart::quiet(bool on) {
  if (on) {
    clear_bits(UCSR0B, bit(RXCIE0));
  } else {
    set_bits(UCSR0B, bit(RXCIE0));
  }
}

uint8_t uart::check_for_char() {
  const bool polled = (UCSR0B & bit(RXCIE0)) == 0;
  while (polled && (UCSR0A & bit(RXC0))) receive();
  return put_at != taken_at ? 1 : 0;
}

bool uart::get(uint8_t &byte) {
  if (check_for_char() == 0) return false;
  byte = ring[taken_at];
  taken_at = static_cast<uint8_t>((taken_at + 1) & (ring_size - 1));
  return true;
}

char uart::getchar() {
  uint8_t byte = 0;
  while (!get(byte)) {
  }
  return static_cast<char>(byte);
}

uint8_t uart::transmitter_empty() const { return (UCSR0A & bit(UDRE0)) ? 0 : 1; }

bool uart::put(uint8_t byte) {
  if (transmitter_empty() != 0) return false;
  UDR0 = byte;
  return true;
}

int8_t uart::putchar(char chout) {
  for (uint16_t tries = 0; tries < 800; ++tries) {
    if (put(static_cast<uint8_t>(chout))) return 0;
    _delay_us(10);
  }
  return -1;
}
