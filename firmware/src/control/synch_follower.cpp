#include "control/synch_follower.h"

namespace {
constexpr moment window =
    ms(45);  // longer than the settling and the beacons of synch.cpp, shorter than its window
constexpr tick near_ticks = 30000;
}  // namespace

void synch_follower::prepare(uint16_t prescale, uint16_t cycles, uint8_t readings, uint32_t end_row) {
  forget();
  lead_ = static_cast<uint16_t>(lead_cycles / prescale);
  cycles_ = cycles;
  readings_ = readings;
  end_row_ = end_row;
  shift_ = 0;
}

void synch_follower::forget() {
  if (ear_ == ear::open) {
    chip_.plain(false);
    hardware::stamp_on(false);
  }
  ear_ = ear::closed;
  armed_ = 0;
  captured_ = 0;
  begin_waits_ = false;
}

void synch_follower::arm(uint8_t number) {
  hardware::capture_clear();
  armed_ = number;
}

void synch_follower::capture(tick at) {
  const uint8_t number = armed_;
  armed_ = 0;
  captured_at_ = at;
  captured_ = number;
  if (number == pulse::reset) {
    origin_ = at;
  } else if (number == pulse::trigger) {
    start_mark_ = at;
    origin_ = at;
    begin_rows();
  } else if (number == pulse::end) {
    set_end_mark(at);
  }
}

void synch_follower::begin_rows() {
  begin_waits_ = false;
  captured_ = sampler_.begin(start_mark_ + lead_, readings_, end_row_) ? pulse::trigger : 0;
}

void synch_follower::set_end_mark(tick at) {
  end_mark_ = at;
  uint32_t row = sampler_.begun() - 1;
  tick began = start_mark_ + lead_ + static_cast<tick>(row * cycles_);
  while (before(at, began)) {  // rows that began between the mark and now
    --row;
    began -= cycles_;
  }
  mark_row_ = row;
}

void synch_follower::write_time(uint8_t number, byte_writer &out) const {
  const bool there = captured_ == number;
  out.u8(number);
  out.u8(there ? 1 : 0);
  out.u32(there ? captured_at_ - origin_ : 0);
  out.u32(sampler_.begun());
}

void synch_follower::listen(moment now) {
  heard_ = 0;
  for (tick &at : heard_at_) at = 0;
  ear_ = ear::opening;
  opened_ = now;
}

void synch_follower::beacon(uint8_t number) {
  uint16_t count;
  if (number >= beacon_count || ear_ != ear::open || !hardware::stamped(count)) return;
  heard_ = static_cast<uint8_t>(heard_ | 1u << number);
  heard_at_[number] = sampler_.when(count);
}

void synch_follower::write_beacons(byte_writer &out) const {
  out.u8(heard_);
  for (const tick at : heard_at_) out.u32(at);
}

bool synch_follower::begin_at(tick mark) {
  if (before(mark, sampler_.now())) return false;
  start_mark_ = mark;
  origin_ = mark;
  captured_ = 0;
  begin_waits_ = true;
  return true;
}

void synch_follower::close(tick end_mark, int16_t shift) {
  shift_ = shift;
  if (end_mark != 0) set_end_mark(end_mark);
}

void synch_follower::poll(moment now) {
  uint16_t count;
  if (armed_ != 0 && hardware::captured(count)) capture(sampler_.when(count));
  if (begin_waits_ &&
      static_cast<int32_t>(start_mark_ + lead_ - sampler_.now()) < static_cast<int32_t>(near_ticks)) {
    begin_rows();
  }
  if (ear_ == ear::opening && mail_.ready()) {  // the reply to LISTEN has gone
    chip_.plain(true);
    hardware::stamp_on(true);
    ear_ = ear::open;
    opened_ = now;
  } else if (ear_ == ear::open && passed(now, opened_, window)) {
    chip_.plain(false);
    hardware::stamp_on(false);
    ear_ = ear::closed;
  }
}
