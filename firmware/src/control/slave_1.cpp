#include "control/slave_1.h"

#include "boards/flash.h"
#include "protocol/text_number.h"
#include "sampling/interval.h"

namespace {

constexpr uint8_t attempts_to_master = 60;  // its queue empties at the pace of the serial line
constexpr moment knob_pause = ms(100);
constexpr moment nap_after = ms(500);  // the reply to NAP has to leave the modem first

bool is_order(const char *text) {
  return is_flash(text, IN_FLASH("start")) || is_flash(text, IN_FLASH("trigger")) ||
         is_flash(text, IN_FLASH("stop")) || is_flash(text, IN_FLASH("send")) ||
         is_flash(text, IN_FLASH("dump")) || is_flash(text, IN_FLASH("status")) ||
         begins_with_flash(text, IN_FLASH("rate "));
}

lamp lamp_for(slave_1::state s) {
  switch (s) {
    case slave_1::state::standby:
    case slave_1::state::starting: return lamp::off;
    case slave_1::state::waiting: return lamp::short_long;
    case slave_1::state::sending_own:
    case slave_1::state::sending_other: return lamp::slow_flash;
    case slave_1::state::fetching: return lamp::fast_flash;
    default: return lamp::on;
  }
}

}  // namespace

slave_1::slave_1(serial_port &port, nrf24l01 &chip, array10bits &store, sampler &rows)
    : chip_(chip),
      line_(port, is_order),
      mail_(chip),
      to_master_(mail_, address::master, attempts_to_master),
      packit_(&line_, address::slave_1, *this),
      exchange_(mail_, address::slave_1),
      sampler_(rows),
      synch_(exchange_, mail_, chip, rows),
      block_(store),
      fetcher_(mail_, block_),
      dump_(line_, mail_, block_),
      modem_(port) {
  waiting_text_[0] = 0;
}

void slave_1::start(moment now) {
  chip_.setup(address::slave_1, now);
  interval_setup(100);
  sampler_.set_period(interval_timer_cycles());
  interval_interrupt_on();
  if (hardware::button()) settings_.mode = 1;
  button_.poll(hardware::button(), now);  // a button held at the reset is no press
  knob_.turn(hardware::knob());
  modem_.start(now);
  enter(state::starting, now);
}

void slave_1::enter(state next, moment now) {
  state_ = next;
  entered_ = now;
}

void slave_1::tell(event_code code, uint8_t board, uint8_t detail) {
  packit_.tell({code, board, static_cast<uint8_t>(state_), detail});
}

void slave_1::poll(moment now) {
  now_ = now;
  mail_.poll(now);
  poll_radio(now);
  if (state_ == state::starting) {
    if (modem_.poll(now)) enter(state::standby, now);
  } else {
    poll_line(now);
    poll_user(now);
    poll_run(now);
    poll_transfer(now);
  }
  show(now);
}

void slave_1::poll_radio(moment now) {
  frame f;
  if (!mail_.receive(f) || f.to != address::slave_1) return;
  if (f.from == address::laptop) {
    packit_.received(f, &to_master_);
    return;
  }
  if (f.from != address::slave_2 || exchange_.received(f)) return;
  if (f.kind == kind::block || f.kind == (kind::get | kind::reply)) {
    fetcher_.received(f, now);
    dump_.received(f);
  } else if (f.kind == kind::alarm) {
    frame reply = reply_to(f);
    reply.payload[0] = static_cast<uint8_t>(result::done);
    reply.size = 1;
    if (mail_.ready()) mail_.send(reply, address::slave_2, 2);  // it asks again where we cannot
    const bool running = state_ >= state::synchronising && state_ <= state::closing;
    if (running) abort(event_code::saturated, address::slave_2, now);
  }
}

void slave_1::poll_line(moment now) {
  if (nap_ != 0 && passed(now, nap_asked_, nap_after)) {
    const bool asleep = !passed(now, nap_asked_ + nap_after, nap_);
    hardware::modem_sleep(asleep);
    if (!asleep) nap_ = 0;
    return;
  }
  switch (line_.poll(now)) {
    case serial_line::arrival::a_frame:
      if (line_.received().to == address::slave_1 && !line_.received().is_reply()) {
        text_spoke_ = false;
        packit_.received(line_.received(), &line_);
      }
      break;
    case serial_line::arrival::a_text:
      text_spoke_ = true;
      obey_text(line_.text(), now);
      break;
    case serial_line::arrival::nothing: break;
  }
  dump_.poll(now);
  if (dump_.busy()) return;  // no frames between its lines
  if (waiting_text_[0] != 0 && line_.ready()) {
    line_.send_text(waiting_text_);
    waiting_text_[0] = 0;
  }
  event e;
  if (text_spoke_ && line_.ready() && packit_.take_event(e)) {
    event_text(e, waiting_text_);
  } else {
    packit_.poll(now);
  }
}

void slave_1::poll_user(moment now) {
  if (state_ == state::standby && passed(now, knob_read_, knob_pause)) {
    knob_.turn(hardware::knob());
    knob_read_ = now;
  }
  const push_button::sign sign = button_.poll(hardware::button(), now);
  if (sign == push_button::sign::none) return;
  if (nap_ != 0) {
    nap_ = 0;
    hardware::modem_sleep(false);
  }
  if (sign == push_button::sign::held) {
    stop(now);
    return;
  }
  switch (state_) {
    case state::standby: start_run(now); break;
    case state::armed: trigger(now); break;
    case state::waiting: send_blocks(now); break;
    default: break;
  }
}

void slave_1::show(moment now) {
  const uint8_t lit = preset_number(settings_.rate_now(knob_.preset()));
  const bool status = lamp_lit(lamp_for(state_), now - entered_);
  if (lit == shown_rate_ && status == shown_status_) return;  // each call keeps interrupts off for a moment
  shown_rate_ = lit;
  shown_status_ = status;
  hardware::lights(static_cast<uint8_t>(1u << lit), status);
}

void slave_1::poll_transfer(moment now) {
  if (state_ != state::fetching) return;
  switch (fetcher_.poll(now)) {
    case fetcher::outcome::done: {
      uint8_t head[max_payload];
      block_.payload(0, head);
      if (head[1] != run_) {
        block_.clear();
        enter(state::standby, now);
        tell(event_code::run_lost, address::slave_2);
        break;
      }
      enter(state::sending_other, now);
      tell(event_code::block_ready, address::slave_2);
      break;
    }
    case fetcher::outcome::no_answer:
      fetcher_.start(now);  // Slave 2 keeps its block: as long as it takes, or until STOP
      if (passed(now, entered_, ms(10000))) {
        entered_ = now;
        tell(event_code::no_answer, address::slave_2);
      }
      break;
    case fetcher::outcome::refused:
    case fetcher::outcome::differs:
      block_.clear();
      enter(state::standby, now);
      tell(event_code::run_lost, address::slave_2);
      break;
    default: break;
  }
}
