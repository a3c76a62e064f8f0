// What the laptop, a terminal and the button may ask of Slave 1.

#include <stdlib.h>

#include "boards/flash.h"
#include "control/slave_1.h"
#include "protocol/bytes.h"
#include "protocol/text_number.h"
#include "sampling/interval.h"

namespace {

constexpr uint8_t protocol_version = 1;

const char *words(result r) {
  switch (r) {
    case result::done: return IN_FLASH("ok");
    case result::not_now: return IN_FLASH("not in this state");
    case result::bad_value: return IN_FLASH("bad value");
    case result::differs: return IN_FLASH("CRC differs");
    case result::no_answer: return IN_FLASH("no answer");
    case result::busy: break;
  }
  return IN_FLASH("busy");
}

}  // namespace

bool slave_1::obey(const frame &request, frame &reply) {
  byte_writer out(reply.payload);
  result said = result::bad_value;
  switch (request.kind) {
    case kind::hello:
      out.u8(protocol_version);
      out.u8(address::slave_1);
      out.u8(static_cast<uint8_t>(state_));
      out.u16(hardware::ram_never_used());
      out.u8(run_);
      out.u8(modem_.confirmed() ? 1 : 0);
      reply.size = out.size();
      return true;
    case kind::status: write_status(reply); return true;
    case kind::config: {
      said = configure(request, reply);
      const interval every = interval_for(settings_.rate_now(knob_.preset()));
      out.u8(static_cast<uint8_t>(said));
      out.u16(every.prescale);
      out.u16(every.cycles);
      reply.size = out.size();
      return true;
    }
    case kind::start: said = start_run(now_); break;
    case kind::trigger: said = trigger(now_); break;
    case kind::stop: said = stop(now_); break;
    case kind::send: said = send_blocks(now_); break;
    case kind::done: said = done(request, now_); break;
    case kind::dump: said = start_dump(by_line(), now_); break;
    case kind::nap: said = nap(request, now_); break;
    default: break;
  }
  out.u8(static_cast<uint8_t>(said));
  reply.size = out.size();
  return true;
}

result slave_1::configure(const frame &request, frame &) {
  if (state_ != state::standby) return result::not_now;
  return read_settings(request, knob_.preset(), settings_);
}

result slave_1::send_blocks(moment now) {
  if (state_ != state::waiting) return result::not_now;
  enter(state::sending_own, now);
  tell(event_code::block_ready, address::slave_1);
  return result::done;
}

result slave_1::may_get(uint8_t board) {
  if (dump_.busy()) return result::busy;
  if (board == address::slave_1 && state_ == state::waiting) send_blocks(now_);
  const bool own = board == address::slave_1 && state_ == state::sending_own;
  const bool other = board == address::slave_2 && state_ == state::sending_other;
  return own || other ? result::done : result::not_now;
}

result slave_1::done(const frame &request, moment now) {
  byte_reader in(request.payload, request.size);
  const uint8_t board = in.u8();
  const uint32_t crc = in.u32();
  if (in.short_of_data()) return result::bad_value;
  if (may_get(board) != result::done) return result::not_now;
  if (crc != block_.crc()) return result::differs;
  if (board == address::slave_1) {
    enter(state::fetching, now);
    fetcher_.start(now);
  } else {
    block_.clear();
    enter(state::standby, now);
    tell(event_code::all_sent, address::slave_1);
  }
  return result::done;
}

result slave_1::start_dump(bool by_line, moment now) {
  const bool have_own = state_ == state::waiting || state_ == state::sending_own;
  if (!have_own || !by_line || dump_.busy()) return result::not_now;
  dump_.start(facts_, synch_.elapsed_there(), now);
  return result::done;
}

result slave_1::nap(const frame &request, moment now) {
  byte_reader in(request.payload, request.size);
  const uint16_t seconds = in.u16();
  if (in.short_of_data() || seconds == 0) return result::bad_value;
  if (state_ != state::standby || !by_line()) return result::not_now;
  nap_ = seconds * ms(1000);
  nap_asked_ = now;
  return result::done;
}

void slave_1::write_status(frame &reply) const {
  const uint16_t rate = settings_.rate_now(knob_.preset());
  const interval every = interval_for(rate);
  byte_writer out(reply.payload);
  out.u8(static_cast<uint8_t>(state_));
  out.u16(rate);
  out.u16(every.prescale);
  out.u16(every.cycles);
  out.u16(sampler_.kept());
  out.u16(sampler_.overruns());
  out.u8(state_ == state::taking ? sampler_.saturated() : saturated_[0]);
  out.u8(saturated_[1]);
  out.u8(static_cast<uint8_t>(block_.judged()));
  out.u8(other_verdict_);
  out.u8(mail_.lost());
  reply.size = out.size();
}

void slave_1::obey_text(const char *text, moment now) {
  result said = result::bad_value;
  if (is_flash(text, IN_FLASH("start"))) said = start_run(now);
  if (is_flash(text, IN_FLASH("trigger"))) said = trigger(now);
  if (is_flash(text, IN_FLASH("stop"))) said = stop(now);
  if (is_flash(text, IN_FLASH("send"))) said = send_blocks(now);
  if (is_flash(text, IN_FLASH("dump"))) said = start_dump(true, now);
  if (begins_with_flash(text, IN_FLASH("rate "))) {
    const long rate = atol(text + 5);
    const bool preset = rate > 0 && rate < 1000 && preset_number(static_cast<uint16_t>(rate)) < preset_count;
    if (preset && state_ == state::standby) {
      settings_.rate = static_cast<uint16_t>(rate);
      said = result::done;
    }
  }
  if (is_flash(text, IN_FLASH("status"))) {
    char *out = put_flash(waiting_text_, IN_FLASH("state "));
    out = put_number(out, static_cast<uint8_t>(state_));
    out = put_flash(out, IN_FLASH(", "));
    print_freq(interval_for(settings_.rate_now(knob_.preset())), out);
    return;
  }
  if (dump_.busy()) return;  // its lines are the answer
  *put_flash(waiting_text_, words(said)) = 0;
}
