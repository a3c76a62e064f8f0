// A serial port that sends a string without waiting (reference App. B.10). The Master's line to the laptop.

#ifndef BOARDS_AVR_NB_UART_H
#define BOARDS_AVR_NB_UART_H

#include "boards/avr/uart.h"

class nb_uart : public uart {
 public:
  explicit nb_uart(uint8_t divisor) : uart(divisor) {}

  /// Begins to send a string, which has to stay in place until run() says that it has gone.
  void puts_nb(const char *string_data2) { text_ = string_data2; }
  /// Sends what the transmitter takes. 0 while there is more to send.
  uint8_t run() {
    while (*text_ != 0 && put(static_cast<uint8_t>(*text_))) ++text_;
    return *text_ == 0 ? 1 : 0;
  }

 private:
  const char *text_ = "";
};

#endif
