#include "drivers/spi_bb_port.h"

namespace {
void set(volatile uint8_t *at, uint8_t mask) { *at = *at | mask; }
void clear(volatile uint8_t *at, uint8_t mask) { *at = static_cast<uint8_t>(*at & ~mask); }
}  // namespace

spi_bb_port::spi_bb_port(const volatile uint8_t *inpt, volatile uint8_t *outpt, volatile uint8_t *ddrpt,
                         uint8_t sck_msk, uint8_t mosi_msk, uint8_t miso_msk)
    : in_(inpt), out_(outpt), direction_(ddrpt), sck_(sck_msk), mosi_(mosi_msk), miso_(miso_msk) {
  clear(out_, static_cast<uint8_t>(sck_ | mosi_));
  set(direction_, static_cast<uint8_t>(sck_ | mosi_));
  clear(direction_, miso_);
}

bool spi_bb_port::add_slave(uint8_t ss_msk, uint8_t s_num) {
  if (s_num >= most_slaves) return false;
  select_[s_num] = ss_msk;
  set(out_, ss_msk);
  set(direction_, ss_msk);
  return true;
}

uint8_t spi_bb_port::transfer_bytes(uint8_t *bytes, uint8_t size, uint8_t slave_num) {
  if (slave_num >= most_slaves || select_[slave_num] == 0) return no_such_slave;
  clear(out_, select_[slave_num]);
  for (uint8_t i = 0; i < size; ++i) bytes[i] = transfer(bytes[i]);
  set(out_, select_[slave_num]);
  return 0;
}

uint8_t spi_bb_port::transfer(uint8_t byte) {
  // No interrupt writes this port, so the two levels of the clock can be prepared.
  volatile uint8_t *const out = out_;
  const volatile uint8_t *const in = in_;
  const uint8_t idle = static_cast<uint8_t>(*out & ~(sck_ | mosi_));
  const uint8_t sck = sck_;
  const uint8_t mosi = mosi_;
  const uint8_t miso = miso_;
  uint8_t received = 0;
  for (uint8_t bit = 0; bit < 8; ++bit) {
    uint8_t level = idle;
    if (byte & 0x80) level |= mosi;
    *out = level;
    *out = level | sck;  // the slave samples at the rising edge; we read after it
    byte = static_cast<uint8_t>(byte << 1);
    received = static_cast<uint8_t>(received << 1);
    if (*in & miso) received |= 1;
    *out = level;
  }
  *out = idle;
  return received;
}
