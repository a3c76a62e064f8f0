// Whole runs: rates, synchronisation in three ways, drift, both systems, and what the blocks say about time.

#include <algorithm>

#include "check.h"
#include "system/motion.h"

namespace {

/// Largest difference, in microseconds, between when Slave 2's rows were and when the blocks say they were,
/// on Slave 1's clock.
double worst_row_error(const logger &l, const kept_block &b1, const kept_block &b2, double ppm_1) {
  double worst = 0;
  const size_t n = std::min({l.front.row_times.size(), l.rear.row_times.size(), size_t{b1.rows}});
  for (unsigned k = 0; k < n; ++k) {
    const double said = (row_time(b2, b1, k) - row_time(b1, b1, k)) / (1 + ppm_1 * 1e-6);
    const double was = static_cast<double>(l.rear.row_times[k] - l.front.row_times[k]) * 1e-9;
    worst = std::max(worst, std::abs(said - was) * 1e6);
  }
  return worst;
}

/// The readings against the mean of what the sensor showed at the four holds of each.
int wrong_readings(const board_model &board, int number, const kept_block &b) {
  int wrong = 0;
  for (unsigned row = 0; row < b.rows; ++row) {
    for (int channel = 0; channel < 2; ++channel) {
      double sum = 0;
      for (int k = 0; k < b.readings; ++k) {
        const auto &hold =
            board.holds.at(row * 2 * b.readings + static_cast<unsigned>(channel * b.readings + k));
        if (hold.first != channel) ++wrong;
        sum += std::floor(motion(number, channel, static_cast<double>(hold.second) * 1e-9));
      }
      const int mean = static_cast<int>(std::floor(sum / b.readings + 0.5));
      if (mean != (channel == 0 ? b.wheel : b.chassis).at(row)) ++wrong;
    }
  }
  return wrong;
}

}  // namespace

TEST(run_at_each_rate_with_drift) {
  const uint16_t rates[] = {50, 100, 200, 400, 800};
  for (const uint16_t rate : rates) {
    logger l(rate, link::cable, 50, -50);
    set_motion(l);
    CHECK_EQUAL(l.pc.config(rate, 0, 0), 0);
    CHECK(l.take_run(20 * sec));
    const auto blocks = l.pc.get_all();
    CHECK_EQUAL(blocks.size(), 2u);
    if (blocks.size() < 2) continue;
    const kept_block &b1 = blocks[0];
    const kept_block &b2 = blocks[1];
    CHECK_EQUAL(b1.rows, 800);
    CHECK_EQUAL(b2.rows, 800);
    CHECK_EQUAL(b1.overruns + b2.overruns, 0);
    CHECK_EQUAL(b1.crc, b1.own_crc);
    CHECK_EQUAL(b2.crc, b2.own_crc);
    CHECK_EQUAL(b1.cycles * b1.prescale, 4000000 / rate);
    CHECK_EQUAL(wrong_readings(l.front, 0, b1), 0);
    CHECK_EQUAL(wrong_readings(l.rear, 1, b2), 0);
    // Rows of both boards begin together, and drift apart as the crystals do (100 ppm), which the end mark
    // tells.
    const double apart = static_cast<double>(l.rear.row_times[0] - l.front.row_times[0]) / us;
    const double tick_us = 0.25 * b1.prescale;
    CHECK(std::abs(apart) <= 2 * tick_us + 0.4);  // two captures; 4 ms of lead at 100 ppm
    const double drift = (static_cast<double>(b2.elapsed) / b1.elapsed - 1) * 1e6;
    CHECK(std::abs(drift + 100) < 2);
    CHECK(worst_row_error(l, b1, b2, 50) < 3 * tick_us);
    CHECK_EQUAL(b1.verdict, 0);
    CHECK_EQUAL(b2.run, b1.run);
  }
}

TEST(run_by_the_short_form_is_faster) {
  nanoseconds took[2];
  for (const uint8_t method : {uint8_t{0}, uint8_t{1}}) {
    logger l(7, link::cable, -30, 20);
    set_motion(l);
    CHECK_EQUAL(l.pc.config(400, 0, method), 0);
    l.pc.silent = true;
    l.front.button_down = true;
    const nanoseconds pressed = l.w.now();
    CHECK(l.wait_for_state(slave_1::state::taking, sec));
    l.front.button_down = false;
    took[method] = l.front.row_times.empty() ? l.w.now() - pressed : l.front.row_times[0] - pressed;
    CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
    l.pc.silent = false;
    const auto blocks = l.pc.get_all();
    CHECK_EQUAL(blocks.size(), 2u);
    if (blocks.size() < 2) continue;
    CHECK_EQUAL(blocks[0].difference == -32768, method == 1);
    CHECK(worst_row_error(l, blocks[0], blocks[1], -30) < 1.0);
  }
  CHECK(took[1] < took[0]);
  CHECK(took[1] < 100 * msec);
}

TEST(run_by_radio_needs_no_wire) {
  for (uint32_t seed = 1; seed <= 3; ++seed) {
    logger l(seed, link::cable, 50, -50);
    l.cut_wire();
    l.front.wire.clear();
    l.space.loss = 0.2;
    set_motion(l);
    CHECK_EQUAL(l.pc.config(800, 0, 2), 0);
    CHECK(l.take_run(10 * sec));
    const auto blocks = l.pc.get_all();
    CHECK_EQUAL(blocks.size(), 2u);
    if (blocks.size() < 2) continue;
    CHECK_EQUAL(blocks[0].synch, 2);
    CHECK_EQUAL(blocks[0].difference, -32768);
    CHECK(worst_row_error(l, blocks[0], blocks[1], 50) < 1.5);
    CHECK(std::abs(static_cast<int>(blocks[0].mark_row) - static_cast<int>(blocks[1].mark_row)) <= 1);
  }
}

TEST(run_in_system_1_through_the_master) {
  logger l(3, link::through_master, 20, -20);
  l.space.loss = 0.1;
  set_motion(l);
  const auto hello = l.pc.ask(kind::hello, {}, 20, address::master);
  CHECK(hello.has_value() && hello->at(1) == address::master);
  CHECK_EQUAL(l.pc.config(200, 0, 0), 0);
  CHECK(l.take_run(10 * sec));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  CHECK(l.pc.wait_for_event("Slave 1: all sent", 5 * sec));
  if (blocks.size() == 2) CHECK_EQUAL(wrong_readings(l.rear, 1, blocks[1]), 0);
}

TEST(run_time_of_the_check_pulse_is_said) {
  logger l(5, link::cable, 100, -100);
  set_motion(l);
  CHECK_EQUAL(l.pc.config(800, 0, 0), 0);
  CHECK(l.take_run(10 * sec));
  const auto b = l.pc.get_block(address::slave_1);
  CHECK(b.has_value());
  // Between reset and check pulse pass some tens of ms: at 200 ppm a few us, never nothing and never a ms.
  CHECK(b->difference < 0);
  CHECK(b->difference > -200);
}

TEST(run_with_other_numbers_of_readings) {
  for (const uint8_t readings : {uint8_t{1}, uint8_t{2}, uint8_t{16}}) {
    logger l(readings, link::cable);
    set_motion(l);
    CHECK_EQUAL(l.pc.config(200, 0, 1, readings), 0);
    CHECK(l.take_run(10 * sec));
    const auto blocks = l.pc.get_all();
    CHECK_EQUAL(blocks.size(), 2u);
    if (blocks.empty()) continue;
    const kept_block &b = blocks[0];
    CHECK_EQUAL(b.readings, readings);
    CHECK_EQUAL(wrong_readings(l.front, 0, b), 0);
    // The delays that the block states are the mean holds.
    double mean[2] = {0, 0};
    for (unsigned k = 0; k < 2u * readings; ++k) {
      mean[l.front.holds[k].first] +=
          static_cast<double>(l.front.holds[k].second - l.front.row_times[0]) / readings;
    }
    CHECK(std::abs(mean[0] / 250 + hardware::row_latency - b.wheel_delay) < 1);
    CHECK(std::abs(mean[1] / 250 + hardware::row_latency - b.chassis_delay) < 1);
  }
}

TEST(overruns_are_counted_and_said) {
  logger l(9, link::cable);
  set_motion(l);
  CHECK_EQUAL(l.pc.config(800, 0, 1), 0);
  CHECK_EQUAL(l.pc.result_of(kind::start), 0);
  CHECK(l.wait_for_state(slave_1::state::taking, sec));
  // From now on Slave 2's row interrupt comes 0.4 ms late and back: every change makes one row overlap the
  // next.
  for (int i = 0; i < 10; ++i) {
    l.rear.interrupt_late = 400 * us;
    l.w.run_for(7 * msec);
    l.rear.interrupt_late = 0;
    l.w.run_for(7 * msec);
  }
  CHECK(l.wait_for_state(slave_1::state::waiting, 5 * sec));
  const auto blocks = l.pc.get_all();
  CHECK_EQUAL(blocks.size(), 2u);
  if (blocks.size() < 2) return;
  CHECK_EQUAL(blocks[0].overruns, 0);
  CHECK(blocks[1].overruns >= 5);
  CHECK_EQUAL(blocks[1].rows, 800);
  CHECK(l.pc.wait_for_event("Slave 2: overruns", 5 * sec));
}
