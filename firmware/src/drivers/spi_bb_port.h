// Bit-banged SPI, mode 0, most significant bit first (reference App. B.12).
//
// Registers and masks come from outside, so that several ports may live on one chip and none needs the
// hardware SPI that the programmer uses.

#ifndef DRIVERS_SPI_BB_PORT_H
#define DRIVERS_SPI_BB_PORT_H

#include <stdint.h>

#include "drivers/spi_bus.h"

class spi_bb_port : public spi_bus {
 public:
  static constexpr uint8_t most_slaves = 2;
  static constexpr uint8_t no_such_slave = 1;

  /// Input, output and data direction registers of one port, as &PINB, &PORTB, &DDRB, and its pins' masks.
  /// Sets SCK and MOSI to output, low; MISO to input.
  spi_bb_port(const volatile uint8_t *inpt, volatile uint8_t *outpt, volatile uint8_t *ddrpt, uint8_t sck_msk,
              uint8_t mosi_msk, uint8_t miso_msk);

  /// A slave whose chip select is on the same port; it becomes an output, high. False when `s_num` is too
  /// large.
  bool add_slave(uint8_t ss_msk, uint8_t s_num);

  /// Zero, or no_such_slave; then nothing is transferred.
  uint8_t transfer_bytes(uint8_t *bytes, uint8_t size, uint8_t slave_num) override;

 private:
  uint8_t transfer(uint8_t byte);

  const volatile uint8_t *in_;
  volatile uint8_t *out_;
  volatile uint8_t *direction_;
  uint8_t sck_;
  uint8_t mosi_;
  uint8_t miso_;
  uint8_t select_[most_slaves] = {0, 0};
};

#endif
