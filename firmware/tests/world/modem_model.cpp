#include "world/modem_model.h"

namespace {
constexpr nanoseconds byte_time = 1041667;   // ten bits at 9600 baud
constexpr nanoseconds air_time = sec / 480;  // a byte in the air
constexpr nanoseconds turn_round = 35 * msec;
constexpr nanoseconds guard = sec;
constexpr size_t buffer = 132, cts_off = 115, cts_on = 98;
}  // namespace

modem_model::modem_model(world &w, bool is_modem) : w_(w), is_modem_(is_modem) {}

bool modem_model::put(uint8_t byte) {
  // UDR and the shift register: a byte may wait for the one before it.
  if (!clear_to_send() || transmitter_free_ > w_.now() + byte_time) return false;
  transmitter_free_ = std::max(transmitter_free_, w_.now()) + byte_time;
  w_.at(transmitter_free_, [this, byte] { byte_arrives(byte); });
  return true;
}

bool modem_model::get(uint8_t &byte) {
  if (received_.empty()) return false;
  byte = received_.front();
  received_.pop_front();
  return true;
}

void modem_model::to_board(uint8_t byte) { received_.push_back(byte); }

uint8_t modem_model::through_air(uint8_t byte) {
  for (int bit = 0; bit < 8; ++bit) {
    if (w_.happens(bit_errors)) byte = static_cast<uint8_t>(byte ^ 1u << bit);
  }
  return byte;
}

void modem_model::byte_arrives(uint8_t byte) {
  if (!is_modem_) {
    if (!cut) to_laptop(through_air(byte));
    return;
  }
  if (sleeping()) return;
  look_for_command(byte);
}

void modem_model::look_for_command(uint8_t byte) {
  const bool quiet_before = w_.now() - last_byte_ >= guard;
  last_byte_ = w_.now();
  ++plus_generation_;
  if (command_mode_) {
    if (byte != '\r') {
      line_ += static_cast<char>(byte);
      return;
    }
    commands += line_ + ";";
    if (line_ == "ATCN") command_mode_ = false;
    line_.clear();
    for (const char c : {'O', 'K', '\r'}) to_board(static_cast<uint8_t>(c));
    return;
  }
  pluses_ = byte == '+' && (pluses_ > 0 || quiet_before) ? pluses_ + 1 : 0;
  if (pluses_ == 3) {
    w_.at(w_.now() + guard, [this, mine = plus_generation_] {
      if (mine != plus_generation_) return;
      command_mode_ = true;
      for (const char c : {'O', 'K', '\r'}) to_board(static_cast<uint8_t>(c));
    });
  }
  to_air(byte);
}

void modem_model::to_air(uint8_t byte) {
  if (down_.size() >= buffer) {
    ++lost;
    return;
  }
  down_.push_back(byte);
  if (down_.size() >= cts_off) cts_high_ = true;
  pump();
}

void modem_model::from_laptop(const std::string &bytes) {
  nanoseconds when = w_.now();
  for (const char c : bytes) {
    when += byte_time;
    w_.at(when, [this, c] {
      if (cut) return;
      if (!is_modem_) {
        to_board(through_air(static_cast<uint8_t>(c)));
        return;
      }
      up_.push_back(static_cast<uint8_t>(c));
      pump();
    });
  }
}

/// Moves one byte through the air after another; a change of direction costs time.
void modem_model::pump() {
  if (pumping_ || (down_.empty() && up_.empty())) return;
  pumping_ = true;
  const bool go_on = direction_ == 1 ? !down_.empty() : up_.empty();
  const int direction = go_on ? 1 : 2;
  const nanoseconds span = air_time + (direction == direction_ ? 0 : turn_round);
  direction_ = direction;
  w_.at(w_.now() + span, [this, direction] {
    pumping_ = false;
    std::deque<uint8_t> &from = direction == 1 ? down_ : up_;
    const uint8_t byte = through_air(from.front());
    from.pop_front();
    if (down_.size() < cts_on) cts_high_ = false;
    if (direction == 1) {
      if (!cut) to_laptop(byte);
    } else if (!cut && !sleeping()) {
      to_board(byte);
    }
    pump();
  });
}
