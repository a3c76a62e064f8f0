// The reliable link to another board or the laptop (reference App. B.11, "not tested or operational" there).
//
// Requests come in and are answered once: a repeated request gets the same reply again. Blocks go out frame
// by frame as a job: the other side asks with GET for the frames that it lacks, which acknowledges the rest;
// what is lost on the way is asked for again. Nothing is stored here for resending, since the owner can make
// any frame of its block at any time. Events are repeated until HEARD. Every frame has its own CRC-16, a
// block a CRC-32. Departure from the reference: it sent "command and data jobs" one way, with a checksum
// nobody answered.

#ifndef PROTOCOL_PACKIT_UART_H
#define PROTOCOL_PACKIT_UART_H

#include "protocol/frame.h"
#include "protocol/frame_carrier.h"
#include "protocol/messages.h"
#include "units.h"

/// What the link asks of the program that owns it.
class packit_owner {
 public:
  /// Carries out a request and fills the reply's payload. False: no reply is to be sent.
  virtual bool obey(const frame &request, frame &reply) = 0;
  /// Whether frames of that board's block can be sent now.
  virtual result may_get(uint8_t board) = 0;
  /// Writes the payload of frame `number` of the block that may_get() allowed; returns its size, 0: no such
  /// frame.
  virtual uint8_t block_payload(uint8_t number, uint8_t *payload) = 0;

 protected:
  ~packit_owner() = default;
};

class packit_uart {
 public:
  /// `carrier` is the first way out, `dev_addr` the own address (PROTOCOL.md).
  packit_uart(frame_carrier *carrier, uint8_t dev_addr, packit_owner &owner)
      : carrier_(carrier), address_(dev_addr), owner_(owner) {}

  /// Clears all jobs: frames asked for, events and a reply that waits.
  void packit_clear();

  /// A request from the other side, which came over `carrier`; answers go the same way from now on.
  void received(const frame &request, frame_carrier *carrier);

  /// Queues an event for the laptop. The oldest is dropped when four wait.
  void tell(const event &e);

  /// Takes the oldest event out of the queue, to be told in another way.
  bool take_event(event &e);

  /// Sends what is due: a reply first, then an event, then frames of a block.
  void poll(moment now);

  /// True while frames of a block wait to be sent.
  bool sending() const { return mask_ != 0; }
  frame_carrier *carrier() const { return carrier_; }

  static constexpr uint8_t queue_length = 4;
  static constexpr uint8_t most_repeats = 30;

 private:
  void answer(const frame &request);
  void get(const frame &request);
  void send_event(moment now);
  void send_block_frame();
  void drop_event();

  frame_carrier *carrier_;
  uint8_t address_;
  packit_owner &owner_;

  frame reply_;  // to the last request, kept for its repeats
  bool have_reply_ = false;
  bool reply_waits_ = false;

  uint8_t board_ = 0;  // the job: frames first + k of this board's block, for each set bit k
  uint8_t first_ = 0;
  uint32_t mask_ = 0;

  event events_[queue_length];
  uint8_t event_count_ = 0;
  uint8_t event_seq_ = 0;
  uint8_t repeats_ = 0;
  moment last_event_ = 0;
};

#endif
