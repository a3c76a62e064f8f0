// Text out through a serial port, one character at a time: the write functions that the reference's serial
// classes share.

#ifndef DRIVERS_SERIAL_TEXT_H
#define DRIVERS_SERIAL_TEXT_H

#include <stdint.h>

class serial_text {
 public:
  /// One character; 0 when it went out, -1 after a time-out.
  virtual int8_t putchar(char character) = 0;

  void puts(const char *text);
  void write_bin(uint8_t number);
  void write_hex(uint8_t number);
  void write(uint8_t number);
  void write(int8_t number);
  void write_bin(uint16_t number);
  void write_hex(uint16_t number);
  void write(uint16_t number);
  void write(int16_t number);
  void write_hex(uint32_t number);
  void write(uint32_t number);
  void write(int32_t number);

 protected:
  ~serial_text() = default;
};

#endif
