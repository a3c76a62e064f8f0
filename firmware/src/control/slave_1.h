// The program of Slave 1, for both systems: it leads the runs, tells the driver by lights and serves the
// laptop.
//
// slave_1.cpp      what comes in and goes out in every state
// slave_1_run.cpp  from the trigger to the block: states 1 to 5
// slave_1_orders.cpp  what the laptop, a terminal and the button may ask

#ifndef CONTROL_SLAVE_1_H
#define CONTROL_SLAVE_1_H

#include "control/fetcher.h"
#include "control/lamp.h"
#include "control/modem_setup.h"
#include "control/push_button.h"
#include "control/rate_knob.h"
#include "control/settings.h"
#include "control/synch.h"
#include "control/text_dump.h"
#include "drivers/exchange.h"
#include "drivers/nrf24l01.h"
#include "drivers/radio_mail.h"
#include "protocol/block.h"
#include "protocol/packit_uart.h"
#include "protocol/serial_line.h"
#include "sampling/sampler.h"
#include "sampling/smart_trigger.h"

class slave_1 : public packit_owner {
 public:
  enum class state : uint8_t {
    standby = 0,
    synchronising = 1,
    armed = 2,
    taking = 3,
    closing = 4,
    waiting = 5,
    sending_own = 6,
    fetching = 7,
    sending_other = 8,
    starting = 9,
  };

  slave_1(serial_port &port, nrf24l01 &chip, array10bits &store, sampler &rows);

  void start(moment now);
  void poll(moment now);

  bool obey(const frame &request, frame &reply) override;
  result may_get(uint8_t board) override;
  uint8_t block_payload(uint8_t number, uint8_t *payload) override { return block_.payload(number, payload); }

  state now_in() const { return state_; }

 private:
  // slave_1.cpp
  void enter(state next, moment now);
  void tell(event_code code, uint8_t board, uint8_t detail = 0);
  void poll_radio(moment now);
  void poll_line(moment now);
  void poll_user(moment now);
  void show(moment now);
  void poll_transfer(moment now);

  // slave_1_run.cpp
  enum class closing_step : uint8_t { other_ends, marking, telling, own_block, other_block };
  result start_run(moment now);
  result trigger(moment now);
  void set_trigger(uint32_t row, moment now);
  result stop(moment now);
  void abort(event_code code, uint8_t board, moment now);
  void poll_run(moment now);
  void poll_synchronising(moment now);
  void poll_armed(moment now);
  void poll_taking(moment now);
  void poll_closing(moment now);
  void ask_close(moment now);
  void make_block(moment now);
  void run_done(moment now);

  // slave_1_orders.cpp
  result configure(const frame &request, frame &reply);
  result send_blocks(moment now);
  result done(const frame &request, moment now);
  result start_dump(bool by_line, moment now);
  result nap(const frame &request, moment now);
  void write_status(frame &reply) const;
  void obey_text(const char *text, moment now);
  bool by_line() const { return packit_.carrier() == &line_; }

  nrf24l01 &chip_;
  serial_line line_;
  radio_mail mail_;
  radio_carrier to_master_;
  packit_uart packit_;
  exchange exchange_;
  sampler &sampler_;
  synch synch_;
  smart_trigger smart_;
  block block_;
  fetcher fetcher_;
  text_dump dump_;
  modem_setup modem_;
  push_button button_;
  rate_knob knob_;

  state state_ = state::starting;
  moment entered_ = 0;
  moment now_ = 0;
  settings settings_;
  run_facts facts_;
  uint8_t run_ = 0;
  bool preparing_ = false;
  uint32_t looked_at_ = 0;  // rows the smart trigger has seen
  uint32_t trigger_row_ = no_row;
  bool finish_told_ = false;
  closing_step closing_ = closing_step::other_ends;
  uint8_t other_verdict_ = 2;
  uint8_t other_flags_ = 0;
  uint16_t other_overruns_ = 0;
  uint8_t saturated_[2] = {0, 0};
  moment nap_ = 0;  // how long the modem is to sleep, 0 not at all
  moment nap_asked_ = 0;
  moment knob_read_ = 0;
  uint8_t shown_rate_ = 255;
  bool shown_status_ = false;
  bool text_spoke_ = false;  // a terminal spoke last: events go out as lines
  char waiting_text_[serial_line::longest_text + 1];
};

#endif
