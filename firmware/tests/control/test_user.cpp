// Button, lamp and knob.

#include "check.h"
#include "control/lamp.h"
#include "control/push_button.h"
#include "control/rate_knob.h"
#include "sampling/interval.h"

using sign = push_button::sign;

TEST(button_press_counts_at_once_and_only_once) {
  std::mt19937 chance(1);
  for (const moment start : {moment{0}, moment{0xFFFFFF00}}) {  // and across the roll-over of the count
    push_button b;
    moment now = start;
    int pressed = 0;
    int held = 0;
    for (int press = 0; press < 50; ++press) {
      CHECK_EQUAL(b.poll(true, ++now), sign::pressed);
      for (int i = 0; i < 60; ++i)
        pressed += b.poll(chance() % 2 == 0, ++now) == sign::pressed ? 1 : 0;  // 15 ms of bounces
      for (int i = 0; i < 400; ++i) {
        const sign s = b.poll(true, ++now);
        pressed += s == sign::pressed ? 1 : 0;
        held += s == sign::held ? 1 : 0;
      }
      b.poll(false, ++now);
      for (int i = 0; i < 60; ++i) pressed += b.poll(chance() % 2 == 0, ++now) == sign::pressed ? 1 : 0;
      for (int i = 0; i < 400; ++i) pressed += b.poll(false, ++now) == sign::pressed ? 1 : 0;
    }
    CHECK_EQUAL(pressed, 0);
    CHECK_EQUAL(held, 0);
  }
}

TEST(button_held_for_two_seconds_is_said_once) {
  push_button b;
  moment now = 0;
  int held = 0;
  moment when = 0;
  for (; now < ms(5000); ++now) {
    if (b.poll(true, now) == sign::held) {
      ++held;
      when = now;
    }
  }
  CHECK_EQUAL(held, 1);
  CHECK(when >= ms(2000) && when <= ms(2000) + 1);
}

TEST(lamp_patterns_are_the_tables) {
  const auto lit_ms = [](lamp pattern, int span) {
    double lit = 0;
    for (moment t = 0; t < ms(static_cast<uint32_t>(span)); ++t) lit += lamp_lit(pattern, t) ? 0.256 : 0;
    return lit;
  };
  CHECK_EQUAL(lit_ms(lamp::off, 3000), 0.0);
  CHECK(std::abs(lit_ms(lamp::on, 3000) - 3000) < 1);
  CHECK(std::abs(lit_ms(lamp::short_long, 3000) - 1500) < 5);
  CHECK(std::abs(lit_ms(lamp::slow_flash, 3000) - 1500) < 5);
  CHECK(std::abs(lit_ms(lamp::fast_flash, 3000) - 1500) < 8);
  CHECK(lamp_lit(lamp::short_long, ms(100)));
  CHECK(!lamp_lit(lamp::short_long, ms(200)));
  CHECK(lamp_lit(lamp::short_long, ms(850)));
  CHECK(!lamp_lit(lamp::short_long, ms(1400)));
  CHECK(lamp_lit(lamp::fast_flash, ms(250)));
  CHECK(!lamp_lit(lamp::slow_flash, ms(750)));
}

TEST(knob_chooses_five_rates_without_flicker) {
  rate_knob k;
  for (int16_t reading = 0; reading < 1024; ++reading) {
    rate_knob fresh;
    CHECK_EQUAL(fresh.turn(reading), reading * 5 / 1024);
  }
  CHECK_EQUAL(k.turn(100), 0);
  // Around a border (204.8) noise of less than the hysteresis changes nothing once a choice is made.
  CHECK_EQUAL(k.turn(206), 0);
  CHECK_EQUAL(k.turn(212), 0);
  CHECK_EQUAL(k.turn(213), 1);
  CHECK_EQUAL(k.turn(203), 1);
  CHECK_EQUAL(k.turn(198), 1);
  CHECK_EQUAL(k.turn(196), 0);
  CHECK_EQUAL(k.turn(1023), 4);
  CHECK_EQUAL(k.turn(-1), 4);
  CHECK_EQUAL(k.turn(0), 0);
  CHECK_EQUAL(k.turn(820),
              3);  // near the border of 4, from below: not over it by the hysteresis, but well over 1 to 3
}
