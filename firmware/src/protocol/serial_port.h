// What a serial link needs from the hardware below: one byte each way, never waiting.

#ifndef PROTOCOL_SERIAL_PORT_H
#define PROTOCOL_SERIAL_PORT_H

#include <stdint.h>

class serial_port {
 public:
  /// Sends a byte now if the transmitter is empty and the other side allows it; false otherwise.
  virtual bool put(uint8_t byte) = 0;
  /// Takes a received byte; false when there is none.
  virtual bool get(uint8_t &byte) = 0;

 protected:
  ~serial_port() = default;
};

#endif
