#include "control/slave_2.h"

#include "protocol/bytes.h"
#include "sampling/interval.h"

namespace {
constexpr uint8_t attempts = 4;
}

slave_2::slave_2(nrf24l01 &chip, array10bits &store, sampler &rows)
    : chip_(chip),
      mail_(chip),
      to_slave_1_(mail_, address::slave_1, attempts),
      packit_(&to_slave_1_, address::slave_2, *this),
      exchange_(mail_, address::slave_2),
      sampler_(rows),
      follower_(mail_, chip, rows),
      block_(store) {}

void slave_2::start(moment now) {
  chip_.setup(address::slave_2, now);
  interval_setup(100);
  sampler_.set_period(interval_timer_cycles());
  interval_interrupt_on();
}

void slave_2::poll(moment now) {
  now_ = now;
  mail_.poll(now);
  frame f;
  if (mail_.receive(f) && f.to == address::slave_2 && f.from == address::slave_1) {
    if (f.kind == kind::beacon) {
      follower_.beacon(f.seq);
    } else if (!exchange_.received(f) && !f.is_reply()) {
      packit_.received(f, &to_slave_1_);
    }
  }
  packit_.poll(now);
  follower_.poll(now);  // after packit: a reply to LISTEN has to be on its way before the ear opens
  poll_run(now);
}

void slave_2::poll_run(moment now) {
  if (state_ == state::synchronising && sampler_.taking()) state_ = state::taking;
  if (state_ == state::taking) {
    const bool counts = facts_.mode == 0 || trigger_row_ != no_row;
    if (counts && sampler_.saturated() >= saturation_limit && !alarmed_) {
      alarmed_ = true;
      facts_.saturated = sampler_.saturated();
      sampler_.cancel();
      const uint8_t code = static_cast<uint8_t>(event_code::saturated);
      exchange_.ask(address::slave_1, kind::alarm, &code, 1, now);
    }
    if (!alarmed_ && !sampler_.taking()) state_ = state::closing;
  }
  if (alarmed_ && exchange_.poll(now) != exchange::state::waiting) halt();
  if (state_ == state::closing && block_.step()) state_ = state::ready;
  if (state_ != state::taking && state_ != state::synchronising) hardware::serial_quiet(false);
}

void slave_2::halt() {
  sampler_.cancel();
  follower_.forget();
  block_.clear();
  exchange_.forget();
  alarmed_ = false;
  trigger_row_ = no_row;
  state_ = state::standby;
}

bool slave_2::obey(const frame &request, frame &reply) {
  byte_reader in(request.payload, request.size);
  byte_writer out(reply.payload);
  result said = result::done;
  switch (request.kind) {
    case kind::prepare: said = prepare(request); break;
    case kind::arm: {
      const uint8_t number = in.u8();
      follower_.arm(number);
      out.u8(number);
      reply.size = out.size();
      return true;
    }
    case kind::time:
      follower_.write_time(in.u8(), out);
      reply.size = out.size();
      return true;
    case kind::listen:
      follower_.listen(now_);
      out.u8(in.u8());
      reply.size = out.size();
      return true;
    case kind::beacons:
      follower_.write_beacons(out);
      reply.size = out.size();
      return true;
    case kind::begin: said = follower_.begin_at(in.u32()) ? result::done : result::not_now; break;
    case kind::finish: said = finish(request); break;
    case kind::close: said = close(request); break;
    case kind::report: report(reply); return true;
    case kind::halt: halt(); break;
    default: said = result::bad_value; break;
  }
  out.u8(static_cast<uint8_t>(said));
  reply.size = out.size();
  return true;
}

result slave_2::prepare(const frame &request) {
  byte_reader in(request.payload, request.size);
  run_facts facts;
  facts.run = in.u8();
  facts.rate = in.u16();
  facts.mode = in.u8();
  facts.synch = in.u8();
  facts.readings = in.u8();
  const interval every = interval_for(facts.rate);
  if (in.short_of_data() || every.prescale == 0 || !sampler::fits(facts.readings, every.cpu_cycles())) {
    return result::bad_value;
  }
  halt();
  facts.every = every;
  facts_ = facts;
  interval_setup(facts.rate);
  sampler_.set_period(every.cycles);
  const uint32_t end = facts.mode == 0 ? static_cast<uint32_t>(ring_rows) : no_row;
  follower_.prepare(every.prescale, every.cycles, facts.readings, end);
  hardware::serial_quiet(true);
  state_ = state::synchronising;
  return result::done;
}

result slave_2::finish(const frame &request) {
  byte_reader in(request.payload, request.size);
  const uint32_t end = in.u32();
  const uint32_t trigger = in.u32();
  if (in.short_of_data()) return result::bad_value;
  if (state_ != state::taking) return result::not_now;
  sampler_.forget_saturated();
  sampler_.finish(end);
  trigger_row_ = trigger;
  return result::done;
}

result slave_2::close(const frame &request) {
  byte_reader in(request.payload, request.size);
  facts_.difference = in.i16();
  const tick end_mark = in.u32();
  const int16_t shift = in.i16();
  if (in.short_of_data()) return result::bad_value;
  if (state_ != state::closing) return result::not_now;
  follower_.close(end_mark, shift);
  facts_.overruns = sampler_.overruns();
  facts_.saturated = sampler_.saturated();
  facts_.set_delays();
  facts_.lead = follower_.lead();
  facts_.first_row = sampler_.first_kept();
  facts_.elapsed = follower_.elapsed();
  facts_.mark_row = follower_.mark_row();
  facts_.trigger_row = no_trigger_row;
  if (trigger_row_ != no_row && trigger_row_ - facts_.first_row < sampler_.kept()) {
    facts_.trigger_row = static_cast<uint16_t>(trigger_row_ - facts_.first_row);
  }
  block_.start_own(address::slave_2, facts_, sampler_.kept(), sampler::slot(facts_.first_row));
  return result::done;
}

void slave_2::report(frame &reply) const {
  byte_writer out(reply.payload);
  out.u8(static_cast<uint8_t>(state_));
  out.u8(facts_.run);
  out.u16(sampler_.kept());
  out.u16(sampler_.overruns());
  out.u8(alarmed_ ? facts_.saturated : sampler_.saturated());
  out.u8(static_cast<uint8_t>(block_.judged()));
  out.u8(block_.flags(0));
  out.u8(block_.flags(1));
  out.u8(follower_.last_captured());
  reply.size = out.size();
}

result slave_2::may_get(uint8_t board) {
  if (board != address::slave_2) return result::bad_value;
  return state_ == state::ready ? result::done : result::not_now;
}
