// The sampler on a made-up timer: rows, the time line across its roll-over, the ring, early ends.

#include <cmath>

#include "check.h"
#include "sampling/interval.h"
#include "world/board_model.h"

namespace {

struct bench {
  world w{1};
  air space{w};
  board_model board{w, space, 0};
  bench(uint16_t prescale, uint16_t cycles) {
    board.as_this([&] {
      hardware::timer_prescale(prescale);
      board.rows->set_period(cycles);
      hardware::compare_interrupt(true);
    });
  }
  tick now() {
    tick t = 0;
    board.as_this([&] { t = board.rows->now(); });
    return t;
  }
  bool begin(tick first, uint8_t readings, uint32_t end) {
    bool ok = false;
    board.as_this([&] { ok = board.rows->begin(first, readings, end); });
    return ok;
  }
};

}  // namespace

TEST(sampler_time_runs_on_across_the_timers_roll_over) {
  bench b(1, 40000);
  b.w.run_for(10 * msec);
  const tick start = b.now();
  const nanoseconds from = b.w.now();
  for (int i = 0; i < 3000; ++i) {
    b.w.run_for(b.w.between(us, 20 * msec));
    const tick expected = static_cast<tick>((b.w.now() - from) / 250);
    CHECK(std::abs(static_cast<int32_t>(b.now() - start - expected)) <= 1);
  }
  // A count from the past 65535 ticks gets its tick back.
  uint16_t count = 0;
  b.board.as_this([&] { count = hardware::timer(); });
  const tick then = b.now();
  b.w.run_for(16 * msec);
  tick found = 0;
  b.board.as_this([&] { found = b.board.rows->when(count); });
  CHECK_EQUAL(found, then);
}

TEST(sampler_rows_come_at_their_ticks) {
  bench b(1, 5000);
  b.w.run_for(50 * msec);
  const tick first = b.now() + 16000;
  const nanoseconds expected = b.w.now() + 16000 * 250;
  CHECK(b.begin(first, 4, 100));
  b.w.run_for(sec);
  CHECK_EQUAL(b.board.row_times.size(), 100u);
  for (size_t k = 0; k < b.board.row_times.size(); ++k) {
    const nanoseconds off = b.board.row_times[k] - expected - static_cast<nanoseconds>(k) * 1250 * us;
    CHECK(std::abs(off) <= 500);
  }
  CHECK_EQUAL(b.board.rows->stored(), 100u);
  CHECK_EQUAL(b.board.rows->kept(), 100);
  CHECK(!b.board.rows->taking());
  CHECK_EQUAL(b.board.rows->overruns(), 0);
}

TEST(sampler_refuses_a_start_in_the_past) {
  bench b(8, 10000);
  b.w.run_for(50 * msec);
  CHECK(!b.begin(b.now() - 5, 4, 10));
  CHECK(!b.begin(b.now() + 5, 4, 10));
  CHECK(!b.board.rows->taking());
  CHECK(b.begin(b.now() + 2000, 4, 10));
}

TEST(sampler_keeps_the_last_rows_of_a_ring) {
  bench b(1, 5000);
  b.board.sensor = [](int channel, double t) { return std::fmod(t * 800, 1000) + channel; };
  CHECK(b.begin(b.now() + 16000, 1, no_row));
  b.w.run_for(2 * sec);
  CHECK(b.board.rows->taking());
  b.board.as_this([&] { b.board.rows->finish(2000); });
  b.w.run_for(sec);
  CHECK(!b.board.rows->taking());
  CHECK_EQUAL(b.board.rows->stored(), 2000u);
  CHECK_EQUAL(b.board.rows->kept(), 800);
  CHECK_EQUAL(b.board.rows->first_kept(), 1200u);
  for (uint32_t row = 1200; row < 2000; ++row) {
    const auto &hold = b.board.holds[2 * row];
    const int16_t slot = sampler::slot(row);
    const int expected =
        static_cast<int>(std::floor(std::fmod(static_cast<double>(hold.second) * 8e-7, 1000)));
    CHECK_EQUAL(b.board.store.get(static_cast<int16_t>(2 * slot)), expected);
  }
}

TEST(sampler_told_too_late_ends_at_once) {
  bench b(1, 5000);
  CHECK(b.begin(b.now() + 16000, 4, no_row));
  b.w.run_for(500 * msec);
  b.board.as_this([&] { b.board.rows->finish(100); });
  const uint32_t begun = b.board.rows->begun();
  b.w.run_for(100 * msec);
  CHECK_EQUAL(b.board.rows->stored(), begun);
  CHECK(begun > 100);
}

TEST(sampler_cancelled_stops_in_the_middle_of_a_row) {
  bench b(1, 5000);
  CHECK(b.begin(b.now() + 16000, 4, 800));
  b.w.run_for(100 * msec + 400 * us);
  b.board.as_this([&] { b.board.rows->cancel(); });
  const size_t holds = b.board.holds.size();
  b.w.run_for(100 * msec);
  CHECK_EQUAL(b.board.holds.size(), holds);
  CHECK(!b.board.rows->taking());
}

TEST(sampler_says_which_readings_fit) {
  CHECK(sampler::fits(4, 5000));
  CHECK(!sampler::fits(8, 5000));
  CHECK(sampler::fits(8, 10000));
  CHECK(!sampler::fits(16, 10000));
  CHECK(sampler::fits(32, 40000));
  CHECK_EQUAL(sampler::busy_cycles(4), 3712u);
}
