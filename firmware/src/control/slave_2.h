// The program of Slave 2: it takes rows when told and hands them over; Slave 1 asks, it answers.

#ifndef CONTROL_SLAVE_2_H
#define CONTROL_SLAVE_2_H

#include "control/synch_follower.h"
#include "drivers/exchange.h"
#include "drivers/nrf24l01.h"
#include "drivers/radio_mail.h"
#include "protocol/block.h"
#include "protocol/packit_uart.h"
#include "sampling/sampler.h"

class slave_2 : public packit_owner {
 public:
  enum class state : uint8_t { standby = 0, synchronising = 1, taking = 3, closing = 4, ready = 5 };

  slave_2(nrf24l01 &chip, array10bits &store, sampler &rows);

  void start(moment now);
  void poll(moment now);

  bool obey(const frame &request, frame &reply) override;
  result may_get(uint8_t board) override;
  uint8_t block_payload(uint8_t number, uint8_t *payload) override { return block_.payload(number, payload); }

  state now_in() const { return state_; }

 private:
  result prepare(const frame &request);
  result finish(const frame &request);
  result close(const frame &request);
  void report(frame &reply) const;
  void halt();
  void poll_run(moment now);

  nrf24l01 &chip_;
  radio_mail mail_;
  radio_carrier to_slave_1_;
  packit_uart packit_;
  exchange exchange_;
  sampler &sampler_;
  synch_follower follower_;
  block block_;
  state state_ = state::standby;
  run_facts facts_;
  uint32_t trigger_row_ = no_row;
  bool alarmed_ = false;
  moment now_ = 0;
};

#endif
