// Frames over the radio: one at a time out, tried again where no ACK came; the body's CRC-16 checked on the
// way in.

#ifndef DRIVERS_RADIO_MAIL_H
#define DRIVERS_RADIO_MAIL_H

#include "drivers/nrf24l01.h"
#include "protocol/frame.h"
#include "protocol/frame_carrier.h"
#include "units.h"

class radio_mail {
 public:
  explicit radio_mail(nrf24l01 &radio) : radio_(radio) {}

  bool ready() const { return !full_ && radio_.idle(); }
  /// Hands a frame over for board `to`, tried at most `attempts` times (each with the chip's own repeats).
  void send(const frame &f, uint8_t to, uint8_t attempts);
  /// Gives up what waits to be sent, unless it is on the air.
  void drop();

  void poll(moment now);
  /// Takes a frame that came; false when none, or its length or CRC-16 is wrong.
  bool receive(frame &f);

  /// Packets that no attempt brought over, and those that came damaged; stays at 255.
  uint8_t lost() const { return lost_; }
  void forget_lost() { lost_ = 0; }

 private:
  void count_lost() {
    if (lost_ < 255) ++lost_;
  }

  nrf24l01 &radio_;
  uint8_t packet_[nrf24l01::MAX_PACKET_SIZE];
  uint8_t to_ = 0;
  uint8_t attempts_ = 0;
  bool full_ = false;
  uint8_t lost_ = 0;
};

/// The radio to one board as a way out for packit_uart.
class radio_carrier : public frame_carrier {
 public:
  radio_carrier(radio_mail &mail, uint8_t to, uint8_t attempts) : mail_(mail), to_(to), attempts_(attempts) {}
  bool ready() const override { return mail_.ready(); }
  void send(const frame &f) override { mail_.send(f, to_, attempts_); }

 private:
  radio_mail &mail_;
  uint8_t to_;
  uint8_t attempts_;
};

#endif
