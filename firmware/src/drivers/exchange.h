// A request to another board, repeated until its reply comes: the "checked, repeated transfer" between
// boards.
//
// Whether the radio's own ACK came does not matter: the request may have arrived though its ACK was lost.
// Only the reply counts, and the other side answers a repeated request from memory (packit_uart).

#ifndef DRIVERS_EXCHANGE_H
#define DRIVERS_EXCHANGE_H

#include "drivers/radio_mail.h"
#include "protocol/frame.h"
#include "units.h"

class exchange {
 public:
  enum class state : uint8_t { idle, waiting, answered, gave_up };

  exchange(radio_mail &mail, uint8_t own) : mail_(mail), own_(own) {}

  /// Starts; `payload` of `size` bytes is copied. What ran before is forgotten.
  void ask(uint8_t to, uint8_t kind, const uint8_t *payload, uint8_t size, moment now);
  void ask(uint8_t to, uint8_t kind, moment now) { ask(to, kind, nullptr, 0, now); }
  void forget() { state_ = state::idle; }

  /// Offers a frame that came. True when it is the reply waited for.
  bool received(const frame &f);
  state poll(moment now);
  /// The reply, after `answered`.
  const frame &reply() const { return reply_; }

  static constexpr moment repeat_after = ms(25);  // there (6 tries), linger, back (6 tries), transfers
  static constexpr moment soon = ms(1500);        // while a start can be tried again
  static constexpr moment late = ms(15000);       // when a run is at stake

  /// How long the next requests are repeated before they are given up.
  void set_patience(moment patience) { patience_ = patience; }

 private:
  radio_mail &mail_;
  uint8_t own_;
  state state_ = state::idle;
  frame request_;
  frame reply_;
  uint8_t seq_ = 0;
  bool sent_ = false;
  moment began_ = 0;
  moment last_ = 0;
  moment patience_ = soon;
};

#endif
