#include "protocol/serial_line.h"

#include <string.h>

#include "protocol/cobs.h"

namespace {
constexpr moment pause = ms(20);  // after so long the receiver may have collected noise
}

void serial_line::send(const frame &f) {
  uint8_t body[max_body];
  const uint8_t size = frame_to_body(f, body);
  sent_ = filled_ = 0;
  if (quiet_) fill(0);  // ends whatever noise stands before us
  filled_ = static_cast<uint8_t>(filled_ + cobs_stuff(body, size, out_ + filled_));
  fill(0);
}

void serial_line::send_text(const char *text) {
  sent_ = filled_ = 0;
  while (*text != 0 && filled_ < longest_text) fill(static_cast<uint8_t>(*text++));
  fill('\r');
  fill('\n');
}

serial_line::arrival serial_line::poll(moment now) {
  while (sent_ < filled_ && port_.put(out_[sent_])) {
    ++sent_;
    last_sent_ = now;
    quiet_ = false;
  }
  if (sent_ == filled_ && passed(now, last_sent_, pause)) quiet_ = true;
  uint8_t byte;
  while (port_.get(byte)) {
    const arrival what = take(byte);
    if (what != arrival::nothing) return what;
  }
  return arrival::nothing;
}

serial_line::arrival serial_line::take(uint8_t byte) {
  const bool line_end = byte == '\r' || byte == '\n';
  if (line_end && after_text_) return arrival::nothing;  // the LF after a CR
  after_text_ = false;
  if (byte == 0) {
    const uint8_t size = overlong_ ? 0 : cobs_unstuff(raw_, raw_size_);
    const bool empty = raw_size_ == 0;
    raw_size_ = 0;
    overlong_ = false;
    if (size != 0 && frame_from_body(raw_, size, in_)) return arrival::a_frame;
    if (!empty && broken_ < 255) ++broken_;
    return arrival::nothing;
  }
  if (line_end && knows_ != nullptr && raw_size_ > 0 && !overlong_) {
    raw_[raw_size_] = 0;
    if (knows_(text())) {
      raw_size_ = 0;
      after_text_ = true;
      return arrival::a_text;
    }
  }
  if (raw_size_ < max_body + 1) {
    raw_[raw_size_++] = byte;
  } else {
    overlong_ = true;
  }
  return arrival::nothing;
}
