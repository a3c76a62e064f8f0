// Sends the 9XStream modem its settings after a reset: command mode, pin sleep (ATSM 1), 9600 baud (ATBD 3).
//
// Source: 9XStream product manual, command mode: `+++` with 1 s of silence on each side, answered by "OK" and
// CR, as every command is. The reference's constructor does this with delay loops; here poll() does it and
// nothing waits.

#ifndef CONTROL_MODEM_SETUP_H
#define CONTROL_MODEM_SETUP_H

#include <stdint.h>

#include "protocol/serial_port.h"
#include "units.h"

class modem_setup {
 public:
  static constexpr moment guard = ms(1100);
  static constexpr moment give_up = ms(3000);

  explicit modem_setup(serial_port &port) : port_(port) {}

  void start(moment now);
  /// True when it is over, well or not.
  bool poll(moment now);
  /// Whether the modem confirmed everything.
  bool confirmed() const { return confirmed_; }

 private:
  bool answer_came();

  serial_port &port_;
  uint8_t step_ = 0;   // 0: silence before "+++"; then one for each text sent
  uint8_t sent_ = 0;   // characters of the step's text that went out
  uint8_t heard_ = 0;  // characters of "OK\r" that came
  bool over_ = true;
  bool confirmed_ = false;
  moment began_ = 0;
};

#endif
