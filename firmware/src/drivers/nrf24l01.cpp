#include "drivers/nrf24l01.h"

#include <string.h>

#include "boards/hardware.h"
#include "drivers/nrf24l01_registers.h"

namespace {

constexpr uint8_t one_mbit_full_power = 0x07;  // RF_SETUP: 1 Mbit/s, 0 dBm, LNA gain
constexpr uint8_t five_bytes = 0x03;           // SETUP_AW
constexpr uint8_t pipe_0 = 0x01, pipe_1 = 0x02;
constexpr uint8_t checked_on = nrf::en_crc | nrf::crco | nrf::pwr_up;  // CRC of 2 bytes
constexpr moment silence = ms(20);  // more than all repeats take: the chip is not answering
constexpr moment look_pause = ms(250);
constexpr uint8_t address_size = 5;

void address_of(uint8_t board, uint8_t *bytes) {
  static const uint8_t common[address_size] = {0xC0, 0x56, 0x53, 0x41, 0xB5};
  memcpy(bytes, common, address_size);
  bytes[0] = static_cast<uint8_t>(bytes[0] + board);
}

}  // namespace

uint8_t nrf24l01::command(uint8_t code) {
  bus_.transfer_bytes(&code, 1, slave_);
  return code;  // the chip answers every command with STATUS
}

uint8_t nrf24l01::write(uint8_t reg, uint8_t value) {
  uint8_t bytes[2] = {static_cast<uint8_t>(nrf::w_register | reg), value};
  bus_.transfer_bytes(bytes, 2, slave_);
  return bytes[0];
}

uint8_t nrf24l01::read(uint8_t reg) {
  uint8_t bytes[2] = {static_cast<uint8_t>(nrf::r_register | reg), 0};
  bus_.transfer_bytes(bytes, 2, slave_);
  return bytes[1];
}

void nrf24l01::write_address(uint8_t reg, uint8_t board) {
  uint8_t bytes[1 + address_size] = {static_cast<uint8_t>(nrf::w_register | reg)};
  address_of(board, bytes + 1);
  bus_.transfer_bytes(bytes, sizeof bytes, slave_);
}

bool nrf24l01::address_reads(uint8_t reg, uint8_t board) {
  uint8_t bytes[1 + address_size] = {static_cast<uint8_t>(nrf::r_register | reg)};
  bus_.transfer_bytes(bytes, sizeof bytes, slave_);
  uint8_t wanted[address_size];
  address_of(board, wanted);
  return memcmp(bytes + 1, wanted, address_size) == 0;
}

bool nrf24l01::setup(uint8_t board, moment now) {
  struct setting {
    uint8_t reg;
    uint8_t value;
  };
  const setting settings[] = {
      {nrf::config, nrf::en_crc | nrf::crco},  // power down while we write
      {nrf::en_aa, pipe_0 | pipe_1},
      {nrf::en_rxaddr, pipe_1},
      {nrf::setup_aw, five_bytes},
      {nrf::setup_retr, retry_delay | retries},
      {nrf::rf_ch, channel},
      {nrf::rf_setup, one_mbit_full_power},
      {nrf::rx_pw_p0, MAX_PACKET_SIZE},
      {nrf::rx_pw_p1, MAX_PACKET_SIZE},
  };
  hardware::radio_enable(false);
  own_ = board;
  plain_ = false;
  addressed_ = 0xFF;
  bool good = true;
  for (const setting &s : settings) {
    write(s.reg, s.value);
    good = read(s.reg) == s.value && good;
  }
  write_address(nrf::rx_addr_p1, board);
  good = address_reads(nrf::rx_addr_p1, board) && good;
  command(nrf::flush_tx);
  command(nrf::flush_rx);
  write(nrf::status, nrf::rx_dr | nrf::tx_ds | nrf::max_rt);
  write(nrf::config, checked_on | nrf::prim_rx);
  state_ = state::starting;
  since_ = now;
  return good;
}

void nrf24l01::listen() {
  hardware::radio_enable(false);
  write(nrf::en_rxaddr, pipe_1);
  write(nrf::config, checked_on | nrf::prim_rx);
  hardware::radio_enable(true);
  state_ = state::receiving;
  more_ = true;  // a packet that came while we turned round
}

void nrf24l01::plain(bool on) {
  if (plain_ == on) return;
  plain_ = on;
  heard_ = false;
  hardware::radio_enable(false);
  write(nrf::en_aa, on ? 0 : pipe_0 | pipe_1);
  write(nrf::setup_retr, on ? 0 : retry_delay | retries);
  if (state_ == state::receiving) hardware::radio_enable(true);
}

void nrf24l01::send(uint8_t to, const uint8_t *packet) {
  to_ = to;
  outgoing_ = packet;
  outcome_ = outcome::none;
}

nrf24l01::outcome nrf24l01::result() {
  const outcome what = outcome_;
  outcome_ = outcome::none;
  return what;
}

void nrf24l01::take(uint8_t *packet) {
  memcpy(packet, inbox_, MAX_PACKET_SIZE);
  inbox_full_ = false;
}

void nrf24l01::begin_sending(moment now) {
  hardware::radio_enable(false);
  if (addressed_ != to_) {
    write_address(nrf::tx_addr, to_);
    write_address(nrf::rx_addr_p0, to_);  // the ACK comes to the address that was called
    addressed_ = to_;
  }
  write(nrf::en_rxaddr, pipe_0 | pipe_1);
  write(nrf::config, checked_on);
  uint8_t bytes[1 + MAX_PACKET_SIZE] = {nrf::w_tx_payload};
  memcpy(bytes + 1, outgoing_, MAX_PACKET_SIZE);
  bus_.transfer_bytes(bytes, sizeof bytes, slave_);
  hardware::radio_enable(true);  // stays high until the outcome: more than the 10 us needed
  state_ = state::sending;
  since_ = now;
}

void nrf24l01::end_sending(outcome what) {
  hardware::radio_enable(false);
  if (what != outcome::acknowledged) command(nrf::flush_tx);
  write(nrf::status, nrf::tx_ds | nrf::max_rt);
  outgoing_ = nullptr;
  outcome_ = what;
  listen();
}

void nrf24l01::start_again(moment now) {
  if (outgoing_ != nullptr) outcome_ = outcome::unanswered;
  outgoing_ = nullptr;
  if (restarts_ < 255) ++restarts_;
  setup(own_, now);
}

void nrf24l01::poll(moment now) {
  switch (state_) {
    case state::starting:
      if (passed(now, since_, start_up)) listen();
      return;
    case state::receiving:
      if (passed(now, last_look_, look_pause)) {
        last_look_ = now;
        if (read(nrf::rf_ch) != channel) {
          start_again(now);
          return;
        }
      }
      poll_receiver(now);
      if (heard_ && passed(now, last_heard_, linger)) heard_ = false;
      if (outgoing_ != nullptr && !heard_ && (!more_ || inbox_full_)) begin_sending(now);
      return;
    case state::sending:
      if (hardware::radio_irq()) {
        const uint8_t status = command(nrf::nop);
        if (status & nrf::tx_ds) {
          end_sending(outcome::acknowledged);
        } else if (status & nrf::max_rt) {
          end_sending(outcome::unanswered);
        }
      } else if (passed(now, since_, silence)) {
        start_again(now);
      }
      return;
  }
}

void nrf24l01::poll_receiver(moment now) {
  if (inbox_full_ || (!more_ && !hardware::radio_irq())) return;
  const uint8_t status = command(nrf::nop);
  if ((status & nrf::rx_pipe) == nrf::rx_pipe) {
    // A packet may come between this look and the clearing: look once more after clearing.
    more_ = (status & nrf::rx_dr) != 0;
    if (more_) write(nrf::status, nrf::rx_dr);
    return;
  }
  uint8_t bytes[1 + MAX_PACKET_SIZE] = {nrf::r_rx_payload};
  bus_.transfer_bytes(bytes, sizeof bytes, slave_);
  memcpy(inbox_, bytes + 1, MAX_PACKET_SIZE);
  inbox_full_ = true;
  write(nrf::status, nrf::rx_dr);
  more_ = true;  // look again: another may have come before the flag was cleared
  last_heard_ = now;
  heard_ = !plain_;
}
