// USART 0 as a serial port, 8 bits, no parity, one stop bit (reference App. B.13; data sheet chapter 17).
//
// Received bytes go into a ring by interrupt. While rows are taken that interrupt is off, since it would make
// a row late by its own length; the bytes are then taken by poll, which has to come every 2 ms (the hardware
// holds two).

#ifndef BOARDS_AVR_UART_H
#define BOARDS_AVR_UART_H

#include <stdint.h>

#include "drivers/serial_text.h"
#include "protocol/serial_port.h"

class uart : public serial_text, public serial_port {
 public:
  static constexpr uint8_t divisor_9600 = 25;  // UBRR for 9600 baud at 4 MHz: 9615, +0.16 %

  /// Turns receiver and transmitter on. `divisor` is written to UBRR0; low byte last.
  explicit uart(uint8_t divisor);

  /// Waits until the transmitter takes the character, 8 ms at most: 0, or -1 after that.
  int8_t putchar(char chout) override;
  /// 1 when a character waits.
  uint8_t check_for_char();
  /// Waits for a character, for ever if need be.
  char getchar();
  /// 0 when the transmitter can take a character.
  uint8_t transmitter_empty() const;

  bool put(uint8_t byte) override;
  bool get(uint8_t &byte) override;

  /// No receive interrupt while on.
  static void quiet(bool on);
  /// What the receive interrupt does.
  static void receive();
};

#endif
