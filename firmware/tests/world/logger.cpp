#include "world/logger.h"

logger::logger(uint32_t seed, link how, double ppm_1, double ppm_2)
    : w(seed),
      space(w),
      front(w, space, ppm_1),
      rear(w, space, ppm_2),
      bridge(w, space, 10),
      line(w, how == link::modem),
      nothing(w, false),
      pc(w, line),
      link_(how) {
  front.wire = {&front, &rear};
  line.asleep = &front.modem_asleep;
  reset_slave_2();
  if (how == link::through_master) {
    three = std::make_unique<master>(line, *bridge.radio);
    bridge.as_this([&] { three->start(bridge.clock()); });
    bridge.run([this](moment now) { three->poll(now); });
  }
  reset_slave_1();
  wait_for_state(slave_1::state::standby, 5 * sec);
}

void logger::reset_slave_1() {
  front.reset();
  serial_port &port = link_ == link::through_master ? nothing : line;
  one = std::make_unique<slave_1>(port, *front.radio, front.store, *front.rows);
  front.as_this([&] { one->start(front.clock()); });
  front.run([this](moment now) { one->poll(now); });
}

void logger::reset_slave_2() {
  rear.reset();
  two = std::make_unique<slave_2>(*rear.radio, rear.store, *rear.rows);
  rear.as_this([&] { two->start(rear.clock()); });
  rear.run([this](moment now) { two->poll(now); });
}

void logger::press(nanoseconds span) {
  front.button_down = true;
  w.run_for(span);
  front.button_down = false;
  w.run_for(50 * msec);
}

bool logger::wait_for_state(slave_1::state s, nanoseconds span) {
  return w.run_until_true([&] { return one->now_in() == s; }, span);
}

bool logger::take_run(nanoseconds span) {
  return pc.result_of(kind::start) == 0 && wait_for_state(slave_1::state::waiting, span);
}

double row_time(const kept_block &b, const kept_block &first, unsigned n) {
  const double own = b.lead + static_cast<double>(b.first_row + n) * b.cycles;
  return own * b.prescale / cpu_hz * first.elapsed / b.elapsed;
}
