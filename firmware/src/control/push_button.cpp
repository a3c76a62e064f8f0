#include "control/push_button.h"

push_button::sign push_button::poll(bool down, moment now) {
  if (!settled_) {
    settled_ = passed(now, edge_, bounces);
    if (!settled_) return sign::none;
  }
  if (down != down_) {
    down_ = down;
    settled_ = false;
    said_held_ = false;
    edge_ = now;
    return down ? sign::pressed : sign::none;
  }
  if (down_ && !said_held_ && passed(now, edge_, hold)) {
    said_held_ = true;
    return sign::held;
  }
  return sign::none;
}
