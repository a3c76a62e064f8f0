// From the trigger to the block: states 1 to 5 of Slave 1.

#include "control/slave_1.h"
#include "protocol/bytes.h"
#include "sampling/interval.h"

namespace {
constexpr moment closing_limit = ms(40000);  // Slave 2 answers, but its block does not get ready
}

result slave_1::start_run(moment now) {
  if (state_ != state::standby) return result::not_now;
  const uint16_t rate = settings_.rate_now(knob_.preset());
  facts_ = run_facts();
  facts_.run = ++run_;
  facts_.rate = rate;
  facts_.every = interval_for(rate);
  facts_.readings = settings_.readings;
  while (!sampler::fits(facts_.readings, facts_.every.cpu_cycles())) {  // the knob was turned up
    facts_.readings = static_cast<uint8_t>(facts_.readings >> 1);
  }
  facts_.mode = settings_.mode;
  facts_.synch = static_cast<uint8_t>(settings_.synch);
  interval_setup(rate);
  sampler_.set_period(facts_.every.cycles);
  block_.clear();
  fetcher_.forget();
  mail_.forget_lost();
  trigger_row_ = no_row;
  saturated_[0] = saturated_[1] = 0;
  other_verdict_ = static_cast<uint8_t>(verdict::not_judged);
  uint8_t payload[7];
  byte_writer out(payload);
  out.u8(facts_.run);
  out.u16(facts_.rate);
  out.u8(facts_.mode);
  out.u8(facts_.synch);
  out.u8(facts_.readings);
  exchange_.set_patience(exchange::soon);
  exchange_.ask(address::slave_2, kind::prepare, payload, out.size(), now);
  preparing_ = true;
  enter(state::synchronising, now);
  return result::done;
}

void slave_1::abort(event_code code, uint8_t board, moment now) {
  if (code == event_code::saturated) saturated_[board - 1] = saturation_limit;
  sampler_.cancel();
  synch_.forget();
  fetcher_.forget();
  dump_.forget();
  block_.clear();
  hardware::serial_quiet(false);
  packit_.packit_clear();
  exchange_.set_patience(exchange::soon);
  exchange_.ask(address::slave_2, kind::halt, now);
  enter(state::standby, now);
  tell(code, board);
}

result slave_1::stop(moment now) {
  if (state_ == state::starting) return result::not_now;
  if (state_ != state::standby) abort(event_code::stopped, address::slave_1, now);
  return result::done;
}

void slave_1::poll_run(moment now) {
  switch (state_) {
    case state::synchronising: poll_synchronising(now); break;
    case state::armed: poll_armed(now); break;
    case state::taking: poll_taking(now); break;
    case state::closing: poll_closing(now); break;
    default: exchange_.poll(now); break;  // HALT on its way
  }
}

void slave_1::poll_synchronising(moment now) {
  if (preparing_) {
    const exchange::state asked = exchange_.poll(now);
    if (asked == exchange::state::gave_up) abort(event_code::no_answer, address::slave_2, now);
    if (asked != exchange::state::answered) return;
    if (exchange_.reply().payload[0] != static_cast<uint8_t>(result::done)) {
      abort(event_code::run_lost, address::slave_2, now);
      return;
    }
    preparing_ = false;
    hardware::serial_quiet(true);
    const uint32_t end = facts_.mode == 0 ? static_cast<uint32_t>(ring_rows) : no_row;
    synch_.start(settings_.synch, facts_.every.prescale, facts_.every.cycles, facts_.readings, end, now);
  }
  switch (synch_.poll(now)) {
    case synch::outcome::done:
      facts_.difference = synch_.difference();
      facts_.lead = synch_.lead();
      looked_at_ = 0;
      finish_told_ = true;
      smart_.start(settings_.threshold);
      enter(facts_.mode == 0 ? state::taking : state::armed, now);
      tell(event_code::run_started, address::slave_1);
      break;
    case synch::outcome::failed: abort(synch_.failure(), synch_.failed_board(), now); break;
    default: break;
  }
}

void slave_1::poll_armed(moment now) {
  const uint32_t stored = sampler_.stored();
  if (stored - looked_at_ > ring_rows - 100) looked_at_ = stored;  // the ring is about to overtake us
  for (uint8_t n = 0; n < 4 && looked_at_ < stored; ++n) {
    const int16_t slot = sampler::slot(looked_at_);
    if (smart_.add(block_.store_at(slot, 0))) {
      set_trigger(looked_at_, now);
      return;
    }
    ++looked_at_;
  }
}

result slave_1::trigger(moment now) {
  if (state_ != state::armed) return result::not_now;
  const uint32_t stored = sampler_.stored();
  set_trigger(stored > 0 ? stored - 1 : 0, now);
  return result::done;
}

void slave_1::set_trigger(uint32_t row, moment now) {
  trigger_row_ = row;
  const uint32_t end = row + static_cast<uint32_t>(ring_rows - settings_.pre);
  sampler_.forget_saturated();
  sampler_.finish(end);
  uint8_t payload[8];
  byte_writer out(payload);
  out.u32(end);
  out.u32(row);
  exchange_.set_patience(exchange::late);
  exchange_.ask(address::slave_2, kind::finish, payload, sizeof payload, now);
  finish_told_ = false;
  enter(state::taking, now);
  tell(event_code::triggered, address::slave_1);
}

void slave_1::poll_taking(moment now) {
  if (sampler_.saturated() >= saturation_limit) {
    abort(event_code::saturated, address::slave_1, now);
    return;
  }
  if (!finish_told_) {
    const exchange::state asked = exchange_.poll(now);
    if (asked == exchange::state::gave_up) abort(event_code::no_answer, address::slave_2, now);
    if (asked != exchange::state::answered) return;
    finish_told_ = true;
  }
  if (sampler_.taking()) return;
  hardware::serial_quiet(false);
  closing_ = closing_step::other_ends;
  exchange_.set_patience(exchange::late);
  exchange_.ask(address::slave_2, kind::report, now);
  enter(state::closing, now);
}

void slave_1::poll_closing(moment now) {
  if (passed(now, entered_, closing_limit)) {
    abort(event_code::no_answer, address::slave_2, now);
    return;
  }
  if (closing_ == closing_step::own_block) {
    if (!block_.step()) return;
    closing_ = closing_step::other_block;
    exchange_.ask(address::slave_2, kind::report, now);
    return;
  }
  if (closing_ == closing_step::marking) {
    const synch::outcome marked = synch_.poll(now);
    if (marked == synch::outcome::failed) abort(synch_.failure(), synch_.failed_board(), now);
    if (marked == synch::outcome::done) ask_close(now);
    return;
  }
  const exchange::state asked = exchange_.poll(now);
  if (asked == exchange::state::gave_up) abort(event_code::no_answer, address::slave_2, now);
  if (asked != exchange::state::answered) return;
  const frame &reply = exchange_.reply();
  if (closing_ == closing_step::telling) {
    make_block(now);
    return;
  }
  byte_reader in(reply.payload, reply.size);
  const uint8_t other = in.u8();
  const bool same_run = in.u8() == facts_.run;
  in.u16();
  other_overruns_ = in.u16();
  saturated_[1] = in.u8();
  other_verdict_ = in.u8();
  other_flags_ = in.u8();
  other_flags_ = static_cast<uint8_t>(other_flags_ | in.u8() << 3);
  if (!same_run || other == 0) {
    // Its alarm may have told us already; what it says of saturation decides the message.
    const bool full = same_run && saturated_[1] >= saturation_limit;
    abort(full ? event_code::saturated : event_code::run_lost, address::slave_2, now);
  } else if (closing_ == closing_step::other_ends && other == static_cast<uint8_t>(state::closing)) {
    closing_ = closing_step::marking;
    synch_.mark_end(now);
  } else if (closing_ == closing_step::other_block && other == static_cast<uint8_t>(state::waiting)) {
    run_done(now);
  } else {
    exchange_.ask(address::slave_2, kind::report, now);  // not yet: ask again
  }
}

void slave_1::ask_close(moment now) {
  uint8_t payload[8];
  byte_writer out(payload);
  out.i16(synch_.difference());
  out.u32(synch_.end_mark_there());
  out.i16(synch_.shift());
  exchange_.ask(address::slave_2, kind::close, payload, sizeof payload, now);
  closing_ = closing_step::telling;
}

void slave_1::make_block(moment now) {
  (void)now;
  facts_.overruns = sampler_.overruns();
  facts_.saturated = saturated_[0] = sampler_.saturated();
  facts_.set_delays();
  facts_.first_row = sampler_.first_kept();
  facts_.elapsed = synch_.elapsed();
  facts_.mark_row = synch_.mark_row();
  if (trigger_row_ != no_row && trigger_row_ - facts_.first_row < sampler_.kept()) {
    facts_.trigger_row = static_cast<uint16_t>(trigger_row_ - facts_.first_row);
  }
  block_.start_own(address::slave_1, facts_, sampler_.kept(), sampler::slot(facts_.first_row));
  closing_ = closing_step::own_block;
}

void slave_1::run_done(moment now) {
  enter(state::waiting, now);
  tell(event_code::run_done, address::slave_1);
  if (synch_.fell_back()) tell(synch_.failure(), synch_.failed_board());
  if (block_.judged() == verdict::poor) {
    tell(event_code::poor_signal, address::slave_1,
         static_cast<uint8_t>(block_.flags(0) | block_.flags(1) << 3));
  }
  if (other_verdict_ == static_cast<uint8_t>(verdict::poor)) {
    tell(event_code::poor_signal, address::slave_2, other_flags_);
  }
  if (facts_.overruns > 0) tell(event_code::overruns, address::slave_1);
  if (other_overruns_ > 0) tell(event_code::overruns, address::slave_2);
}
