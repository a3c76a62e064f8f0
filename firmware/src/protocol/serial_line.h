// Frames and lines of text over one serial port, never waiting: poll() moves what can be moved.
//
// Frames are stuffed by COBS and end in a zero. Lines of text come from a terminal: printable characters up
// to CR or LF. The two cannot be told apart byte by byte (a stuffed frame may hold any byte but zero), so a
// line counts as text only when the whole of it, from the last end of anything, is one that the owner's
// `knows` accepts.

#ifndef PROTOCOL_SERIAL_LINE_H
#define PROTOCOL_SERIAL_LINE_H

#include <stdint.h>

#include "protocol/frame_carrier.h"
#include "protocol/serial_port.h"
#include "units.h"

class serial_line : public frame_carrier {
 public:
  enum class arrival : uint8_t { nothing, a_frame, a_text };
  static constexpr uint8_t longest_text = 47;  // a line that is sent, without CR LF
  using recogniser = bool (*)(const char *text);

  /// `knows` says whether a received line of text is meant for us; null: no text.
  serial_line(serial_port &port, recogniser knows) : port_(port), knows_(knows) {}

  bool ready() const override { return sent_ == filled_; }
  void send(const frame &f) override;
  /// Sends a line and CR LF; longer ones are cut. Only when ready().
  void send_text(const char *text);
  /// Drops what waits to be sent.
  void clear() { sent_ = filled_ = 0; }

  /// Sends what the port takes, and reads until something is complete or nothing is left.
  arrival poll(moment now);
  /// The frame that poll() announced.
  const frame &received() const { return in_; }
  /// The line that poll() announced, until the next poll().
  const char *text() const { return reinterpret_cast<const char *>(raw_); }
  /// Frames whose bytes came but not whole; stays at its largest.
  uint8_t broken() const { return broken_; }

 private:
  arrival take(uint8_t byte);
  void fill(uint8_t byte) { out_[filled_++] = byte; }

  serial_port &port_;
  recogniser knows_;
  uint8_t raw_[max_body + 2];
  uint8_t raw_size_ = 0;
  bool overlong_ = false;
  bool after_text_ = false;
  uint8_t broken_ = 0;
  frame in_;
  uint8_t out_[longest_text + 3];
  uint8_t filled_ = 0;
  uint8_t sent_ = 0;
  moment last_sent_ = 0;
  bool quiet_ = true;
};

#endif
