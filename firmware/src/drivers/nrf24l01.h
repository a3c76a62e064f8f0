// nRF24L01 radio: packets of 32 bytes, acknowledged and repeated by the chip (Enhanced ShockBurst), never
// waiting.
//
// The chip rests in receive mode. A packet to be sent waits until the board has listened for `linger` since
// it last heard anything: the sender of that may have missed our ACK and still be repeating, and a chip that
// has left receive mode would let it fail. Registers are written and read back at set-up ("checked"). A chip
// that stays silent for 20 ms, or whose channel register has changed (it lost its supply), is set up again.

#ifndef DRIVERS_NRF24L01_H
#define DRIVERS_NRF24L01_H

#include <stdint.h>

#include "drivers/spi_bus.h"
#include "units.h"

class nrf24l01 {
 public:
  static constexpr uint8_t MAX_PACKET_SIZE = 32;
  static constexpr uint8_t channel = 76;        // 2.476 GHz, above most of the wireless LAN channels
  static constexpr uint8_t retries = 5;         // ARC
  static constexpr uint8_t retry_delay = 0x10;  // ARD: 500 us from the end of a packet to the next try
  static constexpr moment linger = ms(6);
  static constexpr moment start_up =
      ms(2);  // 1.5 ms from power down to standby (product specification 6.1.7)

  enum class outcome : uint8_t { none, acknowledged, unanswered };

  nrf24l01(spi_bus &bus, uint8_t slave_num) : bus_(bus), slave_(slave_num) {}

  /// Writes and checks all settings, powers up and, after start_up, listens. `board` gives the own address.
  /// True when every register read back as written.
  bool setup(uint8_t board, moment now);

  /// Sends `packet` to a board when linger allows; it must stay in place until the outcome. Only when idle().
  void send(uint8_t to, const uint8_t *packet);
  bool idle() const { return outgoing_ == nullptr && state_ != state::starting; }
  /// Outcome of the last send(), once.
  outcome result();

  /// True when a packet has come; take() then copies it.
  bool waiting() const { return inbox_full_; }
  void take(uint8_t *packet);

  /// Without ACK and repeats, and without linger, for packets whose instant matters. Both sides have to
  /// change.
  void plain(bool on);

  void poll(moment now);

  /// Times the chip had to be set up again.
  uint8_t restarts() const { return restarts_; }

 private:
  enum class state : uint8_t { starting, receiving, sending };

  uint8_t command(uint8_t code);
  uint8_t write(uint8_t reg, uint8_t value);
  uint8_t read(uint8_t reg);
  void write_address(uint8_t reg, uint8_t board);
  bool address_reads(uint8_t reg, uint8_t board);
  void listen();
  void begin_sending(moment now);
  void end_sending(outcome what);
  void poll_receiver(moment now);
  void start_again(moment now);

  spi_bus &bus_;
  uint8_t slave_;
  uint8_t own_ = 0;
  state state_ = state::starting;
  moment since_ = 0;       // of the state
  moment last_heard_ = 0;  // last packet
  moment last_look_ = 0;   // at the channel register
  bool heard_ = false;     // within linger
  bool plain_ = false;
  bool more_ = false;  // the receive FIFO may hold another packet
  const uint8_t *outgoing_ = nullptr;
  uint8_t to_ = 0;
  uint8_t addressed_ = 0xFF;  // board that TX_ADDR and RX_ADDR_P0 name
  outcome outcome_ = outcome::none;
  uint8_t restarts_ = 0;
  bool inbox_full_ = false;
  uint8_t inbox_[MAX_PACKET_SIZE];
};

#endif
