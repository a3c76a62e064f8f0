// The loop buffer: smart trigger, button, TRIGGER; rows from before the trigger are kept.

#include "check.h"
#include "system/motion.h"

namespace {

/// A car at rest until `start` seconds, then shaking.
void rest_then_shake(logger &l, double start) {
  const auto sensor = [start](int board) {
    return [board, start](int channel, double t) {
      return t < start ? 560.0 + channel * 40 : motion(board, channel, t);
    };
  };
  l.front.sensor = sensor(0);
  l.rear.sensor = sensor(1);
}

}  // namespace

TEST(loop_waits_for_the_shake_and_keeps_what_came_before) {
  logger l(11, link::cable, 30, -20);
  const double shake = 9.0;
  rest_then_shake(l, shake);
  CHECK_EQUAL(l.pc.config(400, 1, 0, 4, 300, 20), 0);
  CHECK_EQUAL(l.pc.result_of(kind::start), 0);
  CHECK(l.wait_for_state(slave_1::state::armed, sec));
  CHECK(l.front.status);
  CHECK(l.wait_for_state(slave_1::state::waiting, 20 * sec));
  CHECK(l.pc.heard_event("Slave 1: triggered"));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  if (blocks.size() < 2) return;
  const kept_block &b = blocks[0];
  CHECK_EQUAL(b.rows, 800);
  CHECK_EQUAL(b.trigger_row, 300);
  CHECK_EQUAL(blocks[1].first_row, b.first_row);
  CHECK_EQUAL(blocks[1].trigger_row, 300);
  // The shake begins a few rows before the trigger row, inside the block, on both boards.
  for (const kept_block &each : blocks) {
    unsigned first = 0;
    while (first < 800 && each.wheel[first] == 560) ++first;
    CHECK(first > 200);
    CHECK(first < 300);
  }
  const double when = static_cast<double>(l.front.row_times.at(b.first_row + b.trigger_row)) * 1e-9;
  CHECK(when > shake);
  CHECK(when < shake + 0.2);
}

TEST(loop_triggers_by_the_button_without_delay) {
  logger l(12, link::cable);
  rest_then_shake(l, 1000);
  l.front.sensor = [](int channel, double t) {
    return 560 + 40 * channel + 8 * std::sin(40 * t);
  };  // below the threshold
  CHECK_EQUAL(l.pc.config(800, 1, 1, 4, 100, 20), 0);
  l.press();
  CHECK(l.wait_for_state(slave_1::state::armed, sec));
  l.w.run_for(3 * sec);
  CHECK_EQUAL(l.one->now_in(), slave_1::state::armed);
  const nanoseconds pressed = l.w.now();
  l.press();
  CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
  const auto b = l.pc.get_block(address::slave_1);
  CHECK(b.has_value());
  CHECK_EQUAL(b->trigger_row, 100);
  const nanoseconds trigger = l.front.row_times.at(b->first_row + b->trigger_row);
  CHECK(std::abs(trigger - pressed) < 5 * msec);
}

TEST(loop_triggered_early_keeps_fewer_rows) {
  logger l(13, link::cable);
  set_motion(l);
  CHECK_EQUAL(l.pc.config(400, 1, 1, 4, 600, 500), 0);
  CHECK_EQUAL(l.pc.result_of(kind::start), 0);
  CHECK(l.wait_for_state(slave_1::state::armed, sec));
  l.w.run_for(100 * msec);
  CHECK_EQUAL(l.pc.result_of(kind::trigger), 0);
  CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  if (blocks.size() < 2) return;
  CHECK_EQUAL(blocks[0].first_row, 0u);
  CHECK_EQUAL(blocks[0].rows, blocks[0].trigger_row + 200);
  CHECK_EQUAL(blocks[1].rows, blocks[0].rows);
  CHECK_EQUAL(blocks[0].frames.size(), 3u + (blocks[0].rows + 9u) / 10u);
}

TEST(loop_survives_a_lossy_radio) {
  for (uint32_t seed = 20; seed < 23; ++seed) {
    logger l(seed, link::cable, -50, 50);
    rest_then_shake(l, 7);
    l.space.loss = 0.2;
    CHECK_EQUAL(l.pc.config(800, 1, 0, 4, 600), 0);
    CHECK_EQUAL(l.pc.result_of(kind::start), 0);
    CHECK(l.wait_for_state(slave_1::state::waiting, 20 * sec));
    const auto blocks = l.pc.get_all();
    CHECK_EQUAL(blocks.size(), 2u);
    if (blocks.size() == 2) CHECK_EQUAL(blocks[0].rows, 800);
  }
}

TEST(loop_forgets_what_was_at_the_rail_before_the_trigger) {
  logger l(14, link::cable);
  const auto sensor = [](int board) {
    return [board](int channel, double t) { return t > 5 && t < 6 ? 1023.0 : motion(board, channel, t); };
  };
  l.front.sensor = sensor(0);
  l.rear.sensor = sensor(1);
  CHECK_EQUAL(l.pc.config(800, 1, 1, 4, 100, 511), 0);
  CHECK_EQUAL(l.pc.result_of(kind::start), 0);
  CHECK(l.wait_for_state(slave_1::state::armed, sec));
  l.w.run_until(8 * sec);
  CHECK_EQUAL(l.one->now_in(), slave_1::state::armed);
  CHECK_EQUAL(l.pc.result_of(kind::trigger), 0);
  CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  for (const kept_block &b : blocks) CHECK_EQUAL(b.saturated, 0);
}
