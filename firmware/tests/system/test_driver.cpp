// Button, lights, knob, terminal and modem: what people touch.

#include <sstream>

#include "check.h"
#include "system/motion.h"

namespace {

/// Longest and shortest lit times of the status LED since `from`, in ms.
std::vector<int> lit_times(const logger &l, nanoseconds from) {
  std::vector<int> times;
  for (size_t i = 0; i + 1 < l.front.status_changes.size(); ++i) {
    const auto &[when, lit] = l.front.status_changes[i];
    if (lit && when >= from)
      times.push_back(static_cast<int>((l.front.status_changes[i + 1].first - when) / msec));
  }
  return times;
}

}  // namespace

TEST(button_takes_a_run_and_sends_it) {
  logger l(61, link::cable);
  set_motion(l);
  l.front.knob = 700;  // the fourth part: 400 Hz
  l.w.run_for(300 * msec);
  CHECK_EQUAL(l.front.bar, 1 << 3);
  CHECK(!l.front.status);
  l.press();
  CHECK(l.front.status);
  CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
  const nanoseconds waiting = l.w.now();
  l.w.run_for(3 * sec);
  for (const int t : lit_times(l, waiting + msec)) CHECK(std::abs(t - 150) < 5 || std::abs(t - 600) < 5);
  CHECK(lit_times(l, waiting).size() >= 3);
  l.press();
  CHECK_EQUAL(l.one->now_in(), slave_1::state::sending_own);
  const nanoseconds sending = l.w.now();
  l.w.run_for(3 * sec);
  for (const int t : lit_times(l, sending)) CHECK(std::abs(t - 500) < 5);
  const auto b = l.pc.get_block(1);
  CHECK(b.has_value());
  CHECK_EQUAL(b->rate, 400);
  l.space.loss = 0.6;  // so that the fetching takes time
  const nanoseconds fetching = l.w.now();
  CHECK_EQUAL(l.pc.done(*b), 0);
  CHECK(l.wait_for_state(slave_1::state::sending_other, 60 * sec));
  const nanoseconds fetched = l.w.now();
  for (const int t : lit_times(l, fetching + sec)) CHECK(std::abs(t - 100) < 5 || l.w.now() < fetched + 0);
  const auto b2 = l.pc.get_block(2);
  CHECK(b2.has_value());
  CHECK_EQUAL(l.pc.done(*b2), 0);
  CHECK(l.wait_for_state(slave_1::state::standby, sec));
  l.w.run_for(100 * msec);
  CHECK(!l.front.status);
}

TEST(button_held_goes_back_to_standby) {
  logger l(62, link::cable);
  set_motion(l);
  CHECK_EQUAL(l.pc.config(50, 0, 0), 0);
  l.press();
  CHECK(l.wait_for_state(slave_1::state::taking, sec));
  l.press(2200 * msec);
  CHECK_EQUAL(l.one->now_in(), slave_1::state::standby);
  CHECK(l.pc.wait_for_event("Slave 1: stopped", 5 * sec));
  CHECK(l.w.run_until_true([&] { return l.two->now_in() == slave_2::state::standby; }, 3 * sec));
}

TEST(button_held_at_the_reset_chooses_the_loop) {
  logger l(63, link::cable);
  l.front.button_down = true;
  l.reset_slave_1();
  l.w.run_for(100 * msec);
  l.front.button_down = false;
  CHECK(l.wait_for_state(slave_1::state::standby, 5 * sec));
  l.w.run_for(200 * msec);
  CHECK_EQUAL(l.one->now_in(), slave_1::state::standby);
  l.press();
  CHECK(l.wait_for_state(slave_1::state::armed, sec));
}

TEST(modem_is_set_up_and_sleeps_when_told) {
  logger l(64, link::modem);
  CHECK_EQUAL(l.line.commands, std::string("ATSM1;ATBD3;ATCN;"));
  const auto hello = l.pc.ask(kind::hello);
  CHECK(hello.has_value() && hello->at(6) == 1);
  CHECK_EQUAL(l.pc.result_of(kind::nap, {3, 0}), 0);
  l.w.run_for(sec);
  CHECK(l.front.modem_asleep);
  l.w.run_for(3500 * msec);
  CHECK(!l.front.modem_asleep);
  CHECK_EQUAL(l.pc.state(), 0);
  CHECK_EQUAL(l.pc.result_of(kind::nap, {200, 0}), 0);
  l.w.run_for(sec);
  CHECK(l.front.modem_asleep);
  l.press();
  CHECK(!l.front.modem_asleep);
}

TEST(text_dump_has_four_channels_in_rows) {
  logger l(65, link::cable, 30, -20);
  set_motion(l);
  l.space.loss = 0.2;
  CHECK_EQUAL(l.pc.config(400, 0, 0), 0);
  CHECK(l.take_run(10 * sec));
  l.w.run_for(6 * sec);  // events are acknowledged by then
  l.pc.raw.clear();
  l.pc.type("dump\r");
  CHECK(l.w.run_until_true([&] { return l.pc.raw.find("# end\r\n") != std::string::npos; }, 60 * sec));
  const std::string text = l.pc.raw.substr(0, l.pc.raw.find("# end"));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  if (blocks.size() < 2) return;
  std::istringstream in(text);
  std::string line;
  std::vector<std::string> comments;
  unsigned row = 0;
  int wrong = 0;
  while (std::getline(in, line)) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line[0] < '0') {
      comments.push_back(line);
      continue;
    }
    std::ostringstream expected;
    expected << row + 1 << ' ' << blocks[0].wheel[row] << ' ' << blocks[0].chassis[row] << ' '
             << blocks[1].wheel[row] << ' ' << blocks[1].chassis[row];
    if (line != expected.str()) ++wrong;
    ++row;
  }
  CHECK_EQUAL(row, 800u);
  CHECK_EQUAL(wrong, 0);
  CHECK_EQUAL(comments.size(), 4u);
  comments.resize(4);
  CHECK_EQUAL(comments.at(0), std::string("# sample_rate = 400.000 Hz"));
  CHECK_EQUAL(comments.at(1), std::string("# delay front_chassis = 0.000416000 s"));
  CHECK(comments.at(3).rfind("# clock rear = -50.", 0) == 0 ||
        comments.at(3).rfind("# clock rear = -49.", 0) == 0);
}

TEST(terminal_leads_a_run) {
  logger l(66, link::cable);
  set_motion(l);
  const auto type = [&](const std::string &line, const std::string &answer) {
    l.pc.raw.clear();
    l.pc.type(line);
    CHECK(l.w.run_until_true([&] { return l.pc.raw.find(answer) != std::string::npos; }, 3 * sec));
  };
  type("rate 200\r\n", "ok\r\n");
  type("status\n", "state 0, 200.000 Hz\r\n");
  type("rate 300\r", "bad value\r\n");
  type("dump\r", "not in this state\r\n");
  type("start\r\n", "ok\r\n");
  CHECK(l.wait_for_state(slave_1::state::waiting, 10 * sec));
  type("send\r", "ok\r\n");
  type("stop\r", "ok\r\n");
  CHECK_EQUAL(l.one->now_in(), slave_1::state::standby);
}

TEST(orders_out_of_place_are_refused) {
  logger l(67, link::cable);
  CHECK_EQUAL(l.pc.result_of(kind::trigger), 1);
  CHECK_EQUAL(l.pc.result_of(kind::send), 1);
  CHECK_EQUAL(l.pc.result_of(kind::dump), 1);
  CHECK_EQUAL(l.pc.result_of(0x1F), 2);
  CHECK_EQUAL(l.pc.config(300, 0, 0), 2);
  CHECK_EQUAL(l.pc.config(800, 0, 0, 8), 2);  // 8 readings do not fit into 1.25 ms
  CHECK_EQUAL(l.pc.config(800, 2, 0), 2);
  CHECK_EQUAL(l.pc.config(800, 0, 3), 2);
  CHECK_EQUAL(l.pc.config(800, 0, 0, 3), 2);
  CHECK_EQUAL(l.pc.config(800, 1, 0, 4, 601), 2);
  CHECK_EQUAL(l.pc.result_of(kind::config, {1, 2}), 2);
  CHECK_EQUAL(l.pc.result_of(kind::done, {1}), 2);
}
