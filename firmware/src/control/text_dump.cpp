#include "control/text_dump.h"

#include <string.h>

#include "boards/flash.h"
#include "control/fetcher.h"
#include "protocol/text_number.h"

namespace {

constexpr moment ask_again = ms(60);
constexpr uint8_t most_tries = 40;
constexpr uint16_t ns_a_cycle = 250;

/// `cycles` of the CPU as seconds with nine decimals.
char *put_seconds(char *out, uint16_t cycles) {
  out = put_flash(out, IN_FLASH("0."));
  return put_digits(out, static_cast<uint32_t>(cycles) * ns_a_cycle, 9);
}

/// Parts per million that `there` runs faster than `here`, with one decimal.
char *put_ppm(char *out, tick here, tick there) {
  const int64_t gained = static_cast<int32_t>(there - here);
  const int32_t tenths = here == 0 ? 0 : static_cast<int32_t>(gained * 10000000 / static_cast<int64_t>(here));
  const uint32_t size = static_cast<uint32_t>(tenths < 0 ? -tenths : tenths);
  if (tenths < 0) *out++ = '-';
  out = put_number(out, size / 10);
  *out++ = '.';
  return put_digits(out, size % 10, 1);
}

}  // namespace

void text_dump::start(const run_facts &facts, tick elapsed_there, moment now) {
  facts_ = &facts;
  elapsed_there_ = elapsed_there;
  busy_ = true;
  comment_ = 0;
  row_ = 0;
  have_ = false;
  tries_ = 0;
  asked_at_ = now;
}

bool text_dump::write_comment(uint8_t number, char *out) const {
  switch (number) {
    case 0:
      out = put_flash(out, IN_FLASH("# sample_rate = "));
      print_freq(facts_->every, out);
      return true;
    case 1:
    case 2:
      out = put_flash(
          out, number == 1 ? IN_FLASH("# delay front_chassis = ") : IN_FLASH("# delay rear_chassis = "));
      out = put_seconds(out, static_cast<uint16_t>(facts_->chassis_delay - facts_->wheel_delay));
      *put_flash(out, IN_FLASH(" s")) = 0;
      return true;
    case 3:
      if (elapsed_there_ == 0) return false;
      out = put_flash(out, IN_FLASH("# clock rear = "));
      out = put_ppm(out, facts_->elapsed, elapsed_there_);
      *put_flash(out, IN_FLASH(" ppm")) = 0;
      return true;
    default: return false;
  }
}

void text_dump::write_row(char *out) const {
  uint8_t bytes[row_frame_bytes];
  memcpy(bytes, rear_, sizeof bytes);
  const array10bits packed(bytes, rows_a_frame * 2);
  const int16_t at = static_cast<int16_t>(2 * (row_ - rear_first_));
  const uint16_t values[] = {own_.reading(row_, 0), own_.reading(row_, 1), packed.get(at),
                             packed.get(static_cast<int16_t>(at + 1))};
  out = put_number(out, row_ + 1u);
  for (const uint16_t value : values) {
    *out++ = ' ';
    out = put_number(out, value);
  }
  *out = 0;
}

void text_dump::received(const frame &f) {
  if (!busy_ || f.kind != kind::block || f.size != row_frame_bytes || f.seq < head_frames) return;
  const uint16_t first = static_cast<uint16_t>((f.seq - head_frames) * rows_a_frame);
  if (row_ < first || row_ >= first + rows_a_frame) return;
  memcpy(rear_, f.payload, row_frame_bytes);
  rear_first_ = first;
  have_ = true;
  tries_ = 0;
}

void text_dump::say(const char *flash_text) {
  char text[serial_line::longest_text + 1];
  *put_flash(text, flash_text) = 0;
  line_.send_text(text);
  busy_ = false;
}

void text_dump::poll(moment now) {
  if (!busy_ || !line_.ready()) return;
  char text[serial_line::longest_text + 1];
  if (write_comment(comment_, text)) {
    line_.send_text(text);
    ++comment_;
    return;
  }
  if (row_ == own_.rows()) {
    say(IN_FLASH("# end"));
    return;
  }
  if (have_ && row_ >= rear_first_ && row_ < rear_first_ + rows_a_frame) {
    write_row(text);
    line_.send_text(text);
    ++row_;
    return;
  }
  if (tries_ > 0 && !passed(now, asked_at_, ask_again)) return;
  if (tries_ == most_tries) {
    say(IN_FLASH("# Slave 2: no answer"));
    return;
  }
  if (!mail_.ready()) return;
  have_ = false;
  mail_.send(get_from_slave_2(static_cast<uint8_t>(head_frames + row_ / rows_a_frame), 1, ++seq_),
             address::slave_2, 2);
  ++tries_;
  asked_at_ = now;
}
