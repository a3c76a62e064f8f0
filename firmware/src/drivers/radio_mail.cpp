#include "drivers/radio_mail.h"

#include <string.h>

void radio_mail::send(const frame &f, uint8_t to, uint8_t attempts) {
  memset(packet_, 0, sizeof packet_);
  packet_[0] = frame_to_body(f, packet_ + 1);
  to_ = to;
  attempts_ = attempts;
  full_ = true;
  radio_.send(to_, packet_);
}

void radio_mail::drop() { attempts_ = 1; }

void radio_mail::poll(moment now) {
  radio_.poll(now);
  switch (radio_.result()) {
    case nrf24l01::outcome::none: return;
    case nrf24l01::outcome::acknowledged: full_ = false; return;
    case nrf24l01::outcome::unanswered: break;
  }
  if (attempts_ > 1) {
    --attempts_;
    radio_.send(to_, packet_);
  } else {
    full_ = false;
    count_lost();
  }
}

bool radio_mail::receive(frame &f) {
  if (!radio_.waiting()) return false;
  uint8_t packet[nrf24l01::MAX_PACKET_SIZE];
  radio_.take(packet);
  if (packet[0] < sizeof packet && frame_from_body(packet + 1, packet[0], f)) return true;
  count_lost();
  return false;
}
