#include "control/synch.h"

#include "protocol/block.h"
#include "protocol/bytes.h"

namespace {

constexpr moment capture_wait = ms(5);
constexpr moment settle = ms(8);  // Slave 2 has to leave the acknowledged mode first
constexpr moment beacon_pause = ms(5);
constexpr moment window = ms(60);          // after that Slave 2 acknowledges again
constexpr uint32_t ahead_cycles = 240000;  // 60 ms from the plan to the start by radio
constexpr tick near_ticks = 30000;         // sampler::begin() wants less than 65536
constexpr uint8_t most_tries = 40;
constexpr uint8_t most_asked = 8;  // times, about 15 ms apart

/// Signed difference as a 16-bit number, at its end where it does not fit.
int16_t narrow(int32_t value) {
  if (value > 32767) return 32767;
  if (value < -32767) return -32767;
  return static_cast<int16_t>(value);
}

}  // namespace

void synch::start(synch_method method, uint16_t prescale, uint16_t cycles, uint8_t readings, uint32_t end_row,
                  moment now) {
  method_ = method;
  prescale_ = prescale;
  cycles_ = cycles;
  readings_ = readings;
  end_row_ = end_row;
  at_end_ = false;
  fell_back_ = false;
  difference_ = not_measured;
  shift_ = 0;
  end_mark_there_ = 0;
  tries_ = 0;
  outcome_ = outcome::working;
  if (method == synch_method::by_radio) {
    listen(now);
  } else {
    arm(method == synch_method::six_steps ? pulse::reset : pulse::trigger, now);
  }
}

void synch::mark_end(moment now) {
  at_end_ = true;
  tries_ = 0;
  outcome_ = outcome::working;
  if (method_ == synch_method::by_radio) {
    listen(now);
  } else {
    arm(pulse::end, now);
  }
}

void synch::forget() {
  if (step_ == step::settling || step_ == step::beaconing) {
    chip_.plain(false);
    hardware::stamp_on(false);
  }
  step_ = step::idle;
  outcome_ = outcome::idle;
}

void synch::fail(event_code code, uint8_t board) {
  forget();
  failure_ = code;
  failed_board_ = board;
  outcome_ = outcome::failed;
}

bool synch::answered(exchange::state state) {
  if (state == exchange::state::gave_up) fail(event_code::no_answer, address::slave_2);
  return state == exchange::state::answered;
}

/// A pulse did not come through. Before the run that is the end of it; after it there are rows to be saved,
/// by radio.
void synch::fail_wire(uint8_t board, moment now) {
  fail(event_code::no_pulse, board);
  if (!at_end_) return;
  fell_back_ = true;
  outcome_ = outcome::working;
  listen(now);
}

synch::outcome synch::poll(moment now) {
  if (outcome_ != outcome::working) return outcome_;
  switch (step_) {
    case step::idle: break;
    case step::arming:
      if (answered(exchange_.poll(now))) {
        hardware::capture_clear();
        hardware::wire_pulse();
        step_ = step::capturing;
        since_ = now;
      }
      break;
    case step::capturing: poll_capture(now); break;
    case step::asking:
      if (answered(exchange_.poll(now))) poll_time(now);
      break;
    case step::listening:
      if (answered(exchange_.poll(now))) {
        step_ = step::settling;
        since_ = now;
      }
      break;
    case step::settling:
      if (passed(now, since_, settle) && mail_.ready()) {
        chip_.plain(true);
        hardware::stamp_on(true);
        beacons_.clear();
        number_ = 0;
        step_ = step::beaconing;
      }
      break;
    case step::beaconing: poll_beacons(now); break;
    case step::fetching:
      if (answered(exchange_.poll(now))) poll_fetched(now);
      break;
    case step::beginning: poll_beginning(now); break;
    case step::nearing:
      if (static_cast<int32_t>(start_mark_ + lead() - sampler_.now()) < static_cast<int32_t>(near_ticks))
        begin_rows(now);
      break;
  }
  return outcome_;
}

// --- by wire
// ---------------------------------------------------------------------------------------------------------

void synch::arm(uint8_t number, moment now) {
  number_ = number;
  step_ = step::arming;
  exchange_.ask(address::slave_2, kind::arm, &number_, 1, now);
}

void synch::ask_time(uint8_t number, moment now) {
  number_ = number;
  asked_ = 0;
  ask_again(now);
}

void synch::ask_again(moment now) {
  step_ = step::asking;
  exchange_.ask(address::slave_2, kind::time, &number_, 1, now);
}

void synch::poll_capture(moment now) {
  uint16_t count;
  if (!hardware::captured(count)) {
    if (passed(now, since_, capture_wait)) fail_wire(address::slave_1, now);
    return;
  }
  const tick at = sampler_.when(count);
  switch (number_) {
    case pulse::reset:
      origin_ = at;
      arm(pulse::check, now);
      break;
    case pulse::check:
      checked_ = at - origin_;
      ask_time(pulse::check, now);
      break;
    case pulse::trigger:
      start_mark_ = at;
      begin_rows(now);
      break;
    default:
      set_end_mark(at);
      ask_time(pulse::end, now);
      break;
  }
}

void synch::begin_rows(moment now) {
  if (sampler_.begin(start_mark_ + lead(), readings_, end_row_)) {
    ask_time(pulse::trigger, now);
  } else {
    fail(event_code::run_lost, address::slave_1);
  }
}

void synch::set_end_mark(tick at) {
  end_mark_ = at;
  uint32_t row = sampler_.begun() - 1;
  tick began = start_mark_ + lead() + static_cast<tick>(row * cycles_);
  while (before(at, began)) {  // rows that began between the mark and now
    --row;
    began -= cycles_;
  }
  mark_row_ = row;
}

void synch::poll_time(moment now) {
  byte_reader in(exchange_.reply().payload, exchange_.reply().size);
  const uint8_t number = in.u8();
  const bool captured = in.u8() != 0;
  const tick ticks = in.u32();
  if (in.short_of_data() || number != number_ || !captured) {
    if (++asked_ < most_asked) {  // it may not have come round to look at its capture yet
      ask_again(now);
    } else {
      fail_wire(address::slave_2, now);
    }
    return;
  }
  if (number == pulse::check) {
    difference_ = narrow(static_cast<int32_t>(ticks - checked_));
    arm(pulse::trigger, now);
    return;
  }
  if (number == pulse::end) elapsed_there_ = ticks;
  step_ = step::idle;
  outcome_ = outcome::done;
}

// --- by radio
// --------------------------------------------------------------------------------------------------------

void synch::listen(moment now) {
  static const uint8_t count = beacon_count;
  if (++tries_ > most_tries) {
    fail(event_code::no_answer, address::slave_2);
    return;
  }
  step_ = step::listening;
  exchange_.ask(address::slave_2, kind::listen, &count, 1, now);
}

void synch::poll_beacons(moment now) {
  uint16_t count;
  if (number_ > 0 && hardware::stamped(count))
    beacons_.sent(static_cast<uint8_t>(number_ - 1), sampler_.when(count));
  if (!mail_.ready()) return;
  if (number_ < beacon_count) {
    if (number_ > 0 && !passed(now, since_, beacon_pause)) return;
    frame f;
    f.to = address::slave_2;
    f.from = address::slave_1;
    f.kind = kind::beacon;
    f.seq = number_;
    f.payload[0] = number_;
    f.size = 1;
    mail_.send(f, address::slave_2, 1);
    since_ = now;
    ++number_;
    return;
  }
  if (passed(now, since_, window)) {
    chip_.plain(false);
    hardware::stamp_on(false);
    step_ = step::fetching;
    exchange_.ask(address::slave_2, kind::beacons, now);
  }
}

void synch::poll_fetched(moment now) {
  byte_reader in(exchange_.reply().payload, exchange_.reply().size);
  const uint8_t heard = in.u8();
  tick there[beacon_count];
  for (tick &ticks : there) ticks = in.u32();
  common_instant instant;
  if (in.short_of_data() || !beacons_.pick(heard, there, instant)) {
    listen(now);
    return;
  }
  if (!at_end_) {
    first_ = instant;
    begin_by_radio(now);
    return;
  }
  set_end_mark(instant.here);
  end_mark_there_ = instant.there;
  if (method_ == synch_method::by_radio) {
    shift_ = late_there(first_, instant, start_mark_);
    elapsed_there_ = end_mark_there_ - start_there_ - static_cast<tick>(static_cast<int32_t>(shift_));
  } else {
    elapsed_there_ = 0;  // the start mark was the wire's: Slave 2 alone has it
  }
  step_ = step::idle;
  outcome_ = outcome::done;
}

void synch::begin_by_radio(moment now) {
  start_mark_ = sampler_.now() + ahead_cycles / prescale_;
  start_there_ = first_.there + (start_mark_ - first_.here);
  uint8_t payload[4];
  byte_writer out(payload);
  out.u32(start_there_);
  step_ = step::beginning;
  exchange_.ask(address::slave_2, kind::begin, payload, sizeof payload, now);
}

void synch::poll_beginning(moment now) {
  const exchange::state state = exchange_.poll(now);
  const bool too_late = before(start_mark_, sampler_.now());
  if (state == exchange::state::waiting && !too_late) return;
  const bool agreed = state == exchange::state::answered &&
                      exchange_.reply().payload[0] == static_cast<uint8_t>(result::done) && !too_late;
  if (agreed) {
    step_ = step::nearing;
  } else if (++tries_ > most_tries) {
    fail(event_code::no_answer, address::slave_2);
  } else {
    begin_by_radio(now);
  }
}
