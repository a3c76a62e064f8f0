#include "control/modem_setup.h"

namespace {
const char *const texts[] = {"+++", "ATSM1\r", "ATBD3\r", "ATCN\r"};
constexpr uint8_t text_count = 4;
const char ok[] = "OK\r";
}  // namespace

void modem_setup::start(moment now) {
  step_ = 0;
  sent_ = 0;
  heard_ = 0;
  over_ = false;
  confirmed_ = false;
  began_ = now;
}

bool modem_setup::answer_came() {
  uint8_t byte;
  while (port_.get(byte)) {
    heard_ = byte == static_cast<uint8_t>(ok[heard_]) ? static_cast<uint8_t>(heard_ + 1) : 0;
    if (ok[heard_] == 0) {
      heard_ = 0;
      return true;
    }
  }
  return false;
}

bool modem_setup::poll(moment now) {
  if (over_) return true;
  if (passed(now, began_, give_up)) {
    over_ = true;
    return true;
  }
  if (step_ == 0) {
    answer_came();  // drops what comes
    if (passed(now, began_, guard)) step_ = 1;
    return false;
  }
  const char *text = texts[step_ - 1];
  if (text[sent_] != 0) {
    if (port_.put(static_cast<uint8_t>(text[sent_]))) ++sent_;
    return false;
  }
  if (!answer_came()) return false;
  sent_ = 0;
  if (step_++ < text_count) return false;
  over_ = true;
  confirmed_ = true;
  return true;
}
