#include "control/fetcher.h"

#include "protocol/bytes.h"

namespace {
constexpr uint8_t at_once = 16;     // frames asked for together
constexpr moment silence = ms(80);  // longer than the linger and the repeats of one frame
constexpr moment give_up = ms(2000);
constexpr uint8_t most_rounds = 3;  // whole blocks whose CRC-32 differed
}  // namespace

frame get_from_slave_2(uint8_t first, uint32_t mask, uint8_t seq) {
  frame f;
  f.to = address::slave_2;
  f.from = address::slave_1;
  f.kind = kind::get;
  f.seq = seq;
  byte_writer out(f.payload);
  out.u8(address::slave_2);
  out.u8(first);
  out.u32(mask);
  f.size = out.size();
  return f;
}

void fetcher::start(moment now) {
  block_.start_foreign(address::slave_2);
  outcome_ = outcome::working;
  asked_ = false;
  rounds_ = 0;
  last_frame_ = now;
}

void fetcher::received(const frame &f, moment now) {
  if (outcome_ != outcome::working) return;
  if (f.kind == (kind::get | kind::reply)) {
    outcome_ = outcome::refused;
    return;
  }
  const uint8_t missing = block_.first_missing(f.seq);
  if (!block_.take(f)) return;
  last_frame_ = now;
  if (missing == f.seq && outstanding_ > 0) --outstanding_;
  if (block_.complete()) block_.start_check();
}

fetcher::outcome fetcher::poll(moment now) {
  if (outcome_ != outcome::working) return outcome_;
  if (block_.complete()) {
    if (block_.step()) {
      outcome_ = outcome::done;
    } else if (block_.failed()) {
      if (++rounds_ == most_rounds) {
        outcome_ = outcome::differs;
      } else {
        block_.start_foreign(address::slave_2);
        asked_ = false;
      }
    }
    return outcome_;
  }
  if (passed(now, last_frame_, give_up)) {
    outcome_ = outcome::no_answer;
    return outcome_;
  }
  const bool quiet = passed(now, last_frame_, silence) && passed(now, last_ask_, silence);
  if (mail_.ready() && (!asked_ || outstanding_ == 0 || quiet)) ask(now);
  return outcome_;
}

void fetcher::ask(moment now) {
  const uint8_t first = block_.first_missing(0);
  uint32_t mask = 0;
  outstanding_ = 0;
  for (uint8_t k = 0; k < 32 && outstanding_ < at_once; ++k) {
    const uint8_t number = static_cast<uint8_t>(first + k);
    if (number >= block_.frames()) break;
    if (block_.first_missing(number) != number) continue;
    mask |= uint32_t{1} << k;
    ++outstanding_;
  }
  mail_.send(get_from_slave_2(first, mask, ++seq_), address::slave_2, 4);
  asked_ = true;
  last_ask_ = now;
}
