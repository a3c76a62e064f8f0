// What a chip on a serial peripheral interface needs from its port.

#ifndef DRIVERS_SPI_BUS_H
#define DRIVERS_SPI_BUS_H

#include <stdint.h>

class spi_bus {
 public:
  /// Sends `size` bytes to the slave and puts what comes back in their place. Zero for success.
  virtual uint8_t transfer_bytes(uint8_t *bytes, uint8_t size, uint8_t slave_num) = 0;

 protected:
  ~spi_bus() = default;
};

#endif
