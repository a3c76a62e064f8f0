#include "protocol/packit_uart.h"

#include <string.h>

#include "protocol/bytes.h"

namespace {
constexpr moment event_pause = ms(2000);
}

void packit_uart::packit_clear() {
  mask_ = 0;
  if (repeats_ > 0) ++event_seq_;  // a HEARD for the event dropped must not count for the next
  event_count_ = 0;
  repeats_ = 0;
  reply_waits_ = false;
}

bool packit_uart::take_event(event &e) {
  if (event_count_ == 0) return false;
  e = events_[0];
  drop_event();
  return true;
}

void packit_uart::received(const frame &request, frame_carrier *carrier) {
  carrier_ = carrier;
  if (request.kind == kind::heard) {
    if (event_count_ > 0 && repeats_ > 0 && request.seq == event_seq_) drop_event();
    return;
  }
  if (request.kind == kind::get) {
    get(request);
    return;
  }
  answer(request);
}

void packit_uart::answer(const frame &request) {
  const bool again = have_reply_ && reply_.kind == (request.kind | kind::reply) &&
                     reply_.seq == request.seq && reply_.to == request.from;
  if (!again) {
    reply_ = reply_to(request);
    have_reply_ = owner_.obey(request, reply_);
  }
  reply_waits_ = have_reply_;
}

void packit_uart::get(const frame &request) {
  byte_reader in(request.payload, request.size);
  const uint8_t board = in.u8();
  const uint8_t first = in.u8();
  const uint32_t mask = in.u32();
  const result may = in.short_of_data() ? result::bad_value : owner_.may_get(board);
  mask_ = 0;
  if (may == result::done) {
    board_ = board;
    first_ = first;
    mask_ = mask;
    return;
  }
  reply_ = reply_to(request);
  reply_.payload[0] = static_cast<uint8_t>(may);
  reply_.size = 1;
  reply_waits_ = true;
  have_reply_ = false;  // a repeated GET is judged anew
}

void packit_uart::tell(const event &e) {
  if (event_count_ == queue_length) drop_event();
  events_[event_count_++] = e;
}

void packit_uart::drop_event() {
  memmove(events_, events_ + 1, sizeof(event) * (queue_length - 1));
  --event_count_;
  ++event_seq_;
  repeats_ = 0;
}

void packit_uart::poll(moment now) {
  if (carrier_ == nullptr || !carrier_->ready()) return;
  if (reply_waits_) {
    reply_waits_ = false;
    carrier_->send(reply_);
  } else if (event_count_ > 0 && (repeats_ == 0 || passed(now, last_event_, event_pause))) {
    send_event(now);
  } else if (mask_ != 0) {
    send_block_frame();
  }
}

void packit_uart::send_event(moment now) {
  if (repeats_ == most_repeats) {
    drop_event();
    return;
  }
  const event &e = events_[0];
  frame f;
  f.to = address::laptop;
  f.from = address_;
  f.kind = kind::event;
  f.seq = event_seq_;
  char text[longest_event_text + 2];
  const uint8_t length = event_text(e, text);
  byte_writer out(f.payload);
  out.u8(static_cast<uint8_t>(e.code));
  out.u8(e.board);
  out.u8(e.state);
  memcpy(f.payload + 3, text, length);
  f.size = static_cast<uint8_t>(3 + length);
  carrier_->send(f);
  ++repeats_;
  last_event_ = now;
}

void packit_uart::send_block_frame() {
  uint8_t k = 0;
  while ((mask_ >> k & 1) == 0) ++k;
  mask_ &= mask_ - 1;
  if (first_ + k > 255) return;
  frame f;
  f.to = address_ == address::slave_2 ? address::slave_1 : address::laptop;
  f.from = board_;
  f.kind = kind::block;
  f.seq = static_cast<uint8_t>(first_ + k);
  f.size = owner_.block_payload(f.seq, f.payload);
  if (f.size > 0) carrier_->send(f);
}
