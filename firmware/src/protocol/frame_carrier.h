// A way out for frames: the serial line, or the radio to one board.

#ifndef PROTOCOL_FRAME_CARRIER_H
#define PROTOCOL_FRAME_CARRIER_H

#include "protocol/frame.h"

class frame_carrier {
 public:
  /// True when a frame can be handed over.
  virtual bool ready() const = 0;
  /// Takes the frame; only when ready(). It may still be lost on the way.
  virtual void send(const frame &f) = 0;

 protected:
  ~frame_carrier() = default;
};

#endif
