// The bit-banged port: with MISO tied to MOSI the bytes come back; the clock and the select lines are
// watched.

#include "check.h"
#include "drivers/spi_bb_port.h"

namespace {
constexpr uint8_t csn = 0x02, sck = 0x04, wire = 0x08;
}

TEST(spi_bytes_go_round_a_loop) {
  // One register for input and output, one mask for MOSI and MISO: what is written is read.
  volatile uint8_t port = 0x81;  // other pins of the port, not ours
  volatile uint8_t direction = 0;
  spi_bb_port spi(&port, &port, &direction, sck, wire, wire);
  CHECK(spi.add_slave(csn, 0));
  CHECK((port & csn) != 0);
  for (int first = 0; first < 256; ++first) {
    uint8_t data[3] = {static_cast<uint8_t>(first), static_cast<uint8_t>(first * 7), 0x55};
    CHECK_EQUAL(spi.transfer_bytes(data, 3, 0), 0);
    CHECK_EQUAL(data[0], first);
    CHECK_EQUAL(data[1], static_cast<uint8_t>(first * 7));
    CHECK_EQUAL(data[2], 0x55);
    CHECK_EQUAL(port & (csn | sck | wire), csn);  // at rest
    CHECK_EQUAL(port & 0x81, 0x81);
  }
  CHECK_EQUAL(direction & (csn | sck), csn | sck);
}

TEST(spi_without_that_slave_transfers_nothing) {
  volatile uint8_t in = 0xFF, out = 0, direction = 0;
  spi_bb_port spi(&in, &out, &direction, sck, wire, 0x10);
  CHECK_EQUAL(direction & 0x10, 0);
  uint8_t data[1] = {7};
  CHECK(spi.transfer_bytes(data, 1, 0) != 0);
  CHECK(!spi.add_slave(csn, 2));
  CHECK(spi.transfer_bytes(data, 1, 9) != 0);
  CHECK_EQUAL(data[0], 7);
  CHECK(spi.add_slave(csn, 1));
  CHECK_EQUAL(spi.transfer_bytes(data, 1, 1), 0);
  CHECK_EQUAL(data[0], 0xFF);  // MISO high all the time
}
