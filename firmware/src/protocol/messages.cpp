#include "protocol/messages.h"

#include "boards/flash.h"
#include "protocol/text_number.h"

namespace {

const char *words(const event &e) {
  switch (e.code) {
    case event_code::run_started: return IN_FLASH("run started");
    case event_code::triggered: return IN_FLASH("triggered");
    case event_code::run_done: return IN_FLASH("run done");
    case event_code::saturated: return IN_FLASH("saturated");
    case event_code::no_answer: return IN_FLASH("no answer");
    case event_code::no_pulse: return IN_FLASH("no pulse");
    case event_code::block_ready: return IN_FLASH("block ready");
    case event_code::stopped: return IN_FLASH("stopped");
    case event_code::all_sent: return IN_FLASH("all sent");
    case event_code::overruns: return IN_FLASH("overruns");
    case event_code::run_lost: return IN_FLASH("run lost");
    case event_code::poor_signal: break;
  }
  if (e.detail & 0x01) return IN_FLASH("wheel flat");
  if (e.detail & 0x02) return IN_FLASH("wheel stuck");
  if (e.detail & 0x04) return IN_FLASH("wheel railed");
  if (e.detail & 0x08) return IN_FLASH("chassis flat");
  if (e.detail & 0x10) return IN_FLASH("chassis stuck");
  return IN_FLASH("chassis railed");
}

}  // namespace

uint8_t event_text(const event &e, char *out) {
  char *at = put_flash(out, IN_FLASH("Slave "));
  at = put_number(at, e.board);
  at = put_flash(at, IN_FLASH(": "));
  at = put_flash(at, words(e));  // the longest has 14 characters
  *at = 0;
  return static_cast<uint8_t>(at - out);
}
