// nRF24L01 chips and the air between them, from the product specification (2.0); it shares nothing with the
// driver.
//
// Per chip: registers, two FIFOs of three packets, the CE state machine with its settling times, Enhanced
// ShockBurst with ACK, ARC, ARD, packet identity and MAX_RT, plain packets without ACK. In the air: packets
// that overlap destroy each other, and each packet or ACK is lost with a given probability for each receiver.

#ifndef WORLD_AIR_H
#define WORLD_AIR_H

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "world/world.h"

class radio_chip;

class air {
 public:
  explicit air(world &w) : world_(w) {}
  double loss = 0;       // probability for a packet
  double ack_loss = -1;  // for an ACK; negative: as a packet

  struct packet {
    radio_chip *sender;
    std::array<uint8_t, 5> address;
    std::vector<uint8_t> data;
    uint8_t identity;
    bool ack;       // this is one
    bool enhanced;  // carries a packet control field
    uint8_t channel;
    nanoseconds begin;
    nanoseconds end;
    bool destroyed = false;
  };

  /// Puts a packet on the air for `duration`; receivers get it at its end.
  void transmit(packet p, nanoseconds duration);
  void join(radio_chip *chip) { chips_.push_back(chip); }

 private:
  world &world_;
  std::vector<radio_chip *> chips_;
  std::deque<packet> flying_;
};

class radio_chip {
 public:
  radio_chip(world &w, air &a);

  /// One SPI transfer: bytes in, bytes out in their place.
  void transfer(uint8_t *bytes, uint8_t size);
  void enable(bool ce);
  bool irq() const { return (status_ & 0x70 & ~(reg_[0] & 0x70)) != 0; }
  /// Called when IRQ becomes active.
  std::function<void()> on_irq;

  /// Loses power: everything as after power-on; `dead` chips answer zeros.
  void reset();
  bool dead = false;

  struct counts {
    int sent = 0, received = 0, acked = 0, max_rt = 0;
  };
  counts count;

 private:
  friend class air;
  enum class mode { down, starting, standby, rx_settling, rx, tx_settling, tx, awaiting_ack, acking };

  void write_register(uint8_t reg, const uint8_t *data, uint8_t size);
  uint8_t read_register(uint8_t reg, uint8_t index) const;
  uint8_t status() const;
  void raise(uint8_t bits);
  void think();
  void enter(mode m, nanoseconds span, std::function<void()> then);
  void enter(mode m) { enter(m, -1, {}); }
  void begin_packet();
  void packet_gone();
  void no_ack();
  void done_sending();
  void hear(const air::packet &p);
  nanoseconds duration(size_t bytes, bool enhanced) const;

  world &world_;
  air &air_;
  std::array<uint8_t, 32> reg_;
  std::array<uint8_t, 5> rx_0_, rx_1_, tx_;
  uint8_t status_ = 0;
  bool ce_ = false;
  mode mode_ = mode::down;
  uint64_t generation_ = 0;
  nanoseconds listening_since_ = 0;
  std::deque<std::vector<uint8_t>> out_, in_;
  uint8_t identity_ = 0;
  int tries_ = 0;
  int last_identity_ = -1;
  std::vector<uint8_t> last_data_;
};

#endif
