// 9XStream radio modem on USART 0: CTS before each byte, pin sleep (reference App. B.9; modem pins 1 and 2).

#ifndef BOARDS_AVR_AVR_9XSTREAM_H
#define BOARDS_AVR_AVR_9XSTREAM_H

#include "boards/avr/uart.h"

class avr_9xstream : public uart {
 public:
  /// Sets up the pins; the modem is awake. The settings themselves are sent by modem_setup, which does not
  /// wait.
  avr_9xstream();

  /// Pin sleep, about 25 uA; the modem neither sends nor hears.
  static void sleep();
  /// Awake again after 85 ms; CTS tells.
  static void wake_up();
  /// Waits for CTS, then for the transmitter: 0, or -1 after a time-out.
  int8_t putchar(char the_char) override;
  /// Time-outs so far; stays at 255.
  uint8_t timeouts() const { return timeouts_; }

  bool put(uint8_t byte) override { return clear_to_send() && uart::put(byte); }

 protected:
  static bool clear_to_send();
  /// True when CTS went low within 300 ms.
  bool wait_for_CTS();

 private:
  uint8_t timeouts_ = 0;
};

#endif
