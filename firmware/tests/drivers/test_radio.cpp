// The radio driver, the mail and the exchange on modelled chips: loss, lost ACKs, dead chips, backpressure.

#include <cstring>

#include "check.h"
#include "drivers/exchange.h"
#include "drivers/radio_mail.h"
#include "world/board_model.h"

namespace {

/// Two boards with radio mail; `b` answers every request with its payload, turned round.
struct pair {
  world w;
  air space;
  board_model one;
  board_model two;
  radio_mail mail_1;
  radio_mail mail_2;
  exchange asks;
  std::vector<frame> at_1, at_2;
  bool answers = true;
  bool takes = true;
  frame answer_;
  bool answer_waits = false;

  explicit pair(uint32_t seed)
      : w(seed),
        space(w),
        one(w, space, 20),
        two(w, space, -20),
        mail_1(*one.radio),
        mail_2(*two.radio),
        asks(mail_1, 1) {
    one.as_this([&] { CHECK(one.radio->setup(1, one.clock())); });
    two.as_this([&] { CHECK(two.radio->setup(2, two.clock())); });
    one.run([this](moment now) {
      mail_1.poll(now);
      frame f;
      if (mail_1.receive(f) && !asks.received(f)) at_1.push_back(f);
      asks.poll(now);
    });
    two.run([this](moment now) {
      mail_2.poll(now);
      frame f;
      if (takes && mail_2.receive(f)) {
        at_2.push_back(f);
        if (answers) {
          answer_ = reply_to(f);
          answer_.size = f.size;
          for (uint8_t i = 0; i < f.size; ++i) answer_.payload[i] = static_cast<uint8_t>(~f.payload[i]);
          answer_waits = true;
        }
      }
      if (answer_waits && mail_2.ready()) {
        mail_2.send(answer_, 1, 3);
        answer_waits = false;
      }
    });
    w.run_for(10 * msec);
  }

  exchange::state wait_for_reply() {
    exchange::state s = exchange::state::waiting;
    const auto over = [&] {
      one.as_this([&] { s = asks.poll(one.clock()); });
      return s != exchange::state::waiting;
    };
    w.run_until_true(over, 3 * sec);
    return s;
  }

  frame note(uint8_t seq) {
    frame f;
    f.to = 2;
    f.from = 1;
    f.kind = 0x30;
    f.seq = seq;
    f.size = 26;
    for (uint8_t i = 0; i < 26; ++i) f.payload[i] = static_cast<uint8_t>(seq ^ i);
    return f;
  }
};

}  // namespace

TEST(radio_checks_its_registers) {
  world w(1);
  air space(w);
  board_model board(w, space, 0);
  board.as_this([&] { CHECK(board.radio->setup(1, 0)); });
  board.chip.dead = true;
  board.as_this([&] { CHECK(!board.radio->setup(1, 0)); });
}

TEST(radio_brings_every_frame_once_without_loss) {
  pair p(2);
  p.answers = false;
  for (uint8_t seq = 0; seq < 100; ++seq) {
    CHECK(p.w.run_until_true([&] { return p.mail_1.ready(); }, sec));
    p.one.as_this([&] { p.mail_1.send(p.note(seq), 2, 1); });
  }
  p.w.run_for(50 * msec);
  CHECK_EQUAL(p.at_2.size(), 100u);
  for (size_t i = 0; i < p.at_2.size(); ++i) {
    CHECK_EQUAL(p.at_2[i].seq, i);
    CHECK_EQUAL(p.at_2[i].payload[25], static_cast<uint8_t>(i ^ 25));
  }
  CHECK_EQUAL(p.mail_1.lost(), 0);
}

TEST(exchange_succeeds_at_every_loss_up_to_half) {
  for (const double loss : {0.0, 0.2, 0.35, 0.5}) {
    pair p(3);
    p.space.loss = loss;
    int answered = 0;
    for (int i = 0; i < 100; ++i) {
      const uint8_t data[2] = {static_cast<uint8_t>(i), 0x5A};
      p.one.as_this([&] { p.asks.ask(2, 0x30, data, 2, p.one.clock()); });
      const exchange::state s = p.wait_for_reply();
      if (s == exchange::state::answered && p.asks.reply().payload[0] == static_cast<uint8_t>(~i)) ++answered;
    }
    CHECK_EQUAL(answered, 100);
  }
}

TEST(exchange_does_not_need_the_radios_own_ack) {
  // Every ACK is lost: the chip reports MAX_RT each time, yet requests and replies arrive.
  pair p(4);
  p.space.ack_loss = 1.0;
  const uint8_t data[1] = {9};
  p.one.as_this([&] { p.asks.ask(2, 0x30, data, 1, p.one.clock()); });
  CHECK(p.w.run_until_true([&] { return p.asks.reply().size == 1 && p.asks.reply().payload[0] == 0xF6; },
                           2 * sec));
  CHECK(p.one.chip.count.max_rt > 0);
}

TEST(exchange_takes_no_late_reply_for_its_own) {
  pair p(9);
  p.answers = false;
  const uint8_t data[1] = {1};
  p.one.as_this([&] { p.asks.ask(2, 0x30, data, 1, p.one.clock()); });
  CHECK(p.w.run_until_true([&] { return !p.at_2.empty(); }, sec));
  const frame late = reply_to(p.at_2.back());
  p.one.as_this([&] { p.asks.ask(2, 0x30, data, 1, p.one.clock()); });
  CHECK(p.w.run_until_true([&] { return p.at_2.back().seq != late.seq; }, sec));
  CHECK(!p.asks.received(late));
  frame other_board = reply_to(p.at_2.back());
  other_board.from = 3;
  CHECK(!p.asks.received(other_board));
  CHECK(p.asks.received(reply_to(p.at_2.back())));
}

TEST(exchange_gives_up_on_a_silent_board) {
  pair p(5);
  p.two.chip.dead = true;
  p.one.as_this([&] { p.asks.ask(2, 0x30, nullptr, 0, p.one.clock()); });
  CHECK_EQUAL(p.wait_for_reply(), exchange::state::gave_up);
}

TEST(receiver_lingers_for_the_repeats_of_a_lost_ack) {
  // The first ACK is lost, the reply is ready at once: without the linger Slave 2 would leave receive mode,
  // the repeats would find nobody and the sender would report MAX_RT. With it the sender's packet is
  // acknowledged.
  int max_rt = 0;
  for (uint32_t seed = 10; seed < 40; ++seed) {
    pair p(seed);
    p.space.ack_loss = 1.0;
    const uint8_t data[1] = {1};
    p.one.as_this([&] { p.asks.ask(2, 0x30, data, 1, p.one.clock()); });
    p.w.run_until_true([&] { return p.two.chip.count.received == 1; }, sec);
    p.w.run_for(300 * us);  // the first ACK has gone, and was lost
    p.space.ack_loss = 0;
    p.w.run_for(20 * msec);
    max_rt += p.one.chip.count.max_rt;
    CHECK_EQUAL(p.two.chip.count.received, 1);
  }
  CHECK_EQUAL(max_rt, 0);
}

TEST(full_receiver_holds_the_sender_back) {
  pair p(6);
  p.answers = false;
  p.takes = false;  // nobody empties the mail
  for (uint8_t seq = 0; seq < 4; ++seq) {
    p.w.run_until_true([&] { return p.mail_1.ready(); }, sec);
    p.one.as_this([&] { p.mail_1.send(p.note(seq), 2, 1); });
  }
  p.w.run_until_true([&] { return p.mail_1.ready(); }, sec);
  p.one.as_this([&] { p.mail_1.send(p.note(4), 2, 200); });
  p.w.run_for(200 * msec);
  CHECK(!p.mail_1.ready());  // three in the chip and one in the driver: the fifth waits
  p.takes = true;
  CHECK(p.w.run_until_true([&] { return p.mail_1.ready(); }, sec));
  p.w.run_for(100 * msec);
  CHECK_EQUAL(p.at_2.size(), 5u);
}

TEST(damaged_packet_is_dropped_and_counted) {
  pair p(7);
  p.answers = false;
  uint8_t packet[32] = {};
  packet[0] = 40;  // a length that cannot be
  p.one.as_this([&] { p.one.radio->send(2, packet); });
  p.w.run_for(30 * msec);
  packet[0] = 6;
  packet[3] = 1;  // no CRC
  p.one.as_this([&] { p.one.radio->send(2, packet); });
  p.w.run_for(30 * msec);
  CHECK(p.at_2.empty());
  CHECK_EQUAL(p.mail_2.lost(), 2);
}

TEST(chip_that_lost_its_supply_is_found_out) {
  pair p(8);
  p.answers = false;
  p.two.chip.reset();
  p.w.run_for(400 * msec);
  CHECK_EQUAL(p.two.radio->restarts(), 1);
  p.one.as_this([&] { p.mail_1.send(p.note(1), 2, 2); });
  p.w.run_for(50 * msec);
  CHECK_EQUAL(p.at_2.size(), 1u);
}
