// The whole logger in virtual time: Slave 1 and Slave 2, with the Master (System 1) or a modem (System 2),
// and a laptop.

#ifndef WORLD_LOGGER_H
#define WORLD_LOGGER_H

#include <memory>

#include "control/master.h"
#include "control/slave_1.h"
#include "control/slave_2.h"
#include "world/air.h"
#include "world/board_model.h"
#include "world/laptop.h"
#include "world/modem_model.h"
#include "world/world.h"

enum class link { modem, cable, through_master };

class logger {
 public:
  /// `ppm` of the crystals of Slave 1 and 2. Runs until Slave 1 is in standby.
  explicit logger(uint32_t seed, link how = link::cable, double ppm_1 = 0, double ppm_2 = 0);

  void reset_slave_1();
  void reset_slave_2();
  void cut_wire() { front.wire = {&front}; }
  void press(nanoseconds span = 200 * msec);
  bool wait_for_state(slave_1::state s, nanoseconds span);
  /// START, then until waiting; false when that does not come.
  bool take_run(nanoseconds span);

  world w;
  air space;
  board_model front;
  board_model rear;
  board_model bridge;
  modem_model line;
  modem_model nothing;  // Slave 1's serial port in System 1: no modem, CTS high
  std::unique_ptr<slave_1> one;
  std::unique_ptr<slave_2> two;
  std::unique_ptr<master> three;
  laptop pc;

 private:
  link link_;
};

/// Time of row `n` of a block on Slave 1's clock in seconds after the start mark, by the two blocks alone
/// (PROTOCOL.md, "Time").
double row_time(const kept_block &b, const kept_block &first, unsigned n);

#endif
