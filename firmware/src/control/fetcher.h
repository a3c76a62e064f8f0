// Brings Slave 2's block into Slave 1's store over the radio, asking for what is missing until all of it is
// there.

#ifndef CONTROL_FETCHER_H
#define CONTROL_FETCHER_H

#include "drivers/radio_mail.h"
#include "protocol/block.h"
#include "units.h"

class fetcher {
 public:
  enum class outcome : uint8_t { idle, working, done, no_answer, refused, differs };

  fetcher(radio_mail &mail, block &into) : mail_(mail), block_(into) {}

  void start(moment now);
  void forget() { outcome_ = outcome::idle; }
  /// A BLOCK frame from Slave 2, or its refusal.
  void received(const frame &f, moment now);
  outcome poll(moment now);

 private:
  void ask(moment now);

  radio_mail &mail_;
  block &block_;
  outcome outcome_ = outcome::idle;
  bool asked_ = false;
  uint8_t seq_ = 0;
  uint8_t outstanding_ = 0;
  uint8_t rounds_ = 0;
  moment last_ask_ = 0;
  moment last_frame_ = 0;
};

/// The request for the frames of `mask`, from `first` on, of Slave 2's block.
frame get_from_slave_2(uint8_t first, uint32_t mask, uint8_t seq);

#endif
