#include "drivers/exchange.h"

#include <string.h>

void exchange::ask(uint8_t to, uint8_t kind, const uint8_t *payload, uint8_t size, moment now) {
  if (seq_ == 0) seq_ = static_cast<uint8_t>(now);  // not the same numbers after every reset
  request_.to = to;
  request_.from = own_;
  request_.kind = kind;
  request_.seq = ++seq_;
  request_.size = size;
  if (size > 0) memcpy(request_.payload, payload, size);
  state_ = state::waiting;
  sent_ = false;
  began_ = now;
}

bool exchange::received(const frame &f) {
  const bool wanted = state_ == state::waiting && sent_ && f.from == request_.to && f.seq == request_.seq &&
                      f.kind == (request_.kind | kind::reply);
  if (!wanted) return false;
  reply_ = f;
  state_ = state::answered;
  return true;
}

exchange::state exchange::poll(moment now) {
  if (state_ != state::waiting) return state_;
  if (passed(now, began_, patience_)) {
    state_ = state::gave_up;
  } else if ((!sent_ || passed(now, last_, repeat_after)) && mail_.ready()) {
    mail_.send(request_, request_.to, 1);
    sent_ = true;
    last_ = now;
  }
  return state_;
}
