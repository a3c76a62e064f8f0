// The program of the Master (System 1): frames from the laptop go to Slave 1, frames from Slave 1 to the
// laptop.
//
// It does not open them. Towards the laptop there is a queue, since the radio is thirty times faster than the
// line; when it is full the radio's packets stay in the chip, which then sends no ACK, and Slave 1 waits.

#ifndef CONTROL_MASTER_H
#define CONTROL_MASTER_H

#include "drivers/nrf24l01.h"
#include "drivers/radio_mail.h"
#include "protocol/packit_uart.h"
#include "protocol/serial_line.h"

class master : public packit_owner {
 public:
  static constexpr uint8_t queue_length = 16;

  master(serial_port &port, nrf24l01 &chip);

  void start(moment now);
  void poll(moment now);

  bool obey(const frame &request, frame &reply) override;
  result may_get(uint8_t) override { return result::bad_value; }
  uint8_t block_payload(uint8_t, uint8_t *) override { return 0; }

 private:
  serial_line line_;
  nrf24l01 &chip_;
  radio_mail mail_;
  packit_uart packit_;
  frame queue_[queue_length];
  uint8_t first_ = 0;
  uint8_t count_ = 0;
  frame up_;  // the next frame for Slave 1
  bool up_waits_ = false;
};

#endif
