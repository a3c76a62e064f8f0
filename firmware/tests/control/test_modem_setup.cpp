// The modem's set-up, with and without a modem, and with noise instead of answers.

#include "check.h"
#include "control/modem_setup.h"
#include "world/modem_model.h"

namespace {
/// Runs the set-up to its end; returns how long it took.
nanoseconds set_up(world &w, modem_setup &setup) {
  const auto now = [&] { return static_cast<moment>(w.now() / 256000); };
  const nanoseconds from = w.now();
  setup.start(now());
  while (!setup.poll(now())) w.run_for(msec);
  return w.now() - from;
}
}  // namespace

TEST(modem_confirms_its_settings) {
  world w(1);
  modem_model modem(w, true);
  modem_setup setup(modem);
  const nanoseconds took = set_up(w, setup);
  CHECK(setup.confirmed());
  CHECK_EQUAL(modem.commands, std::string("ATSM1;ATBD3;ATCN;"));
  CHECK(took < 2600 * msec);
}

TEST(modem_that_is_not_there_does_not_stop_the_board) {
  world w(2);
  modem_model cable(w, false);
  modem_setup setup(cable);
  std::string sent;
  cable.to_laptop = [&](uint8_t byte) { sent += static_cast<char>(byte); };
  const nanoseconds took = set_up(w, setup);
  CHECK(!setup.confirmed());
  CHECK(took <= 3001 * msec);
  CHECK_EQUAL(sent, std::string("+++"));
}

TEST(modem_setup_does_not_take_noise_for_an_answer) {
  world w(3);
  modem_model cable(w, false);
  modem_setup setup(cable);
  for (int i = 0; i < 30; ++i) w.at(i * 100 * msec, [&] { cable.from_laptop("KO\rOOKxO\r"); });
  set_up(w, setup);
  CHECK(!setup.confirmed());
}
