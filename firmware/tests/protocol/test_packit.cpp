// The reliable link: one answer a request, jobs of frames, events until HEARD.

#include <set>

#include "check.h"
#include "protocol/bytes.h"
#include "protocol/packit_uart.h"

namespace {

struct collector : frame_carrier {
  std::vector<frame> sent;
  bool open = true;
  bool ready() const override { return open; }
  void send(const frame &f) override { sent.push_back(f); }
};

struct counting_owner : packit_owner {
  int obeyed = 0;
  result may = result::done;
  bool answers = true;
  bool obey(const frame &, frame &reply) override {
    reply.payload[0] = static_cast<uint8_t>(++obeyed);
    reply.size = 1;
    return answers;
  }
  result may_get(uint8_t) override { return may; }
  uint8_t block_payload(uint8_t number, uint8_t *payload) override {
    payload[0] = number;
    return number < 40 ? 1 : 0;
  }
};

struct setup {
  collector out;
  counting_owner owner;
  packit_uart link{&out, address::slave_1, owner};
  void request(uint8_t kind, uint8_t seq) {
    frame f;
    f.to = address::slave_1;
    f.kind = kind;
    f.seq = seq;
    link.received(f, &out);
  }
  void get(uint8_t first, uint32_t mask) {
    frame f;
    f.to = address::slave_1;
    f.kind = kind::get;
    byte_writer w(f.payload);
    w.u8(1);
    w.u8(first);
    w.u32(mask);
    f.size = w.size();
    link.received(f, &out);
  }
  void drain(moment now = 0) {
    for (int i = 0; i < 60; ++i) link.poll(now);
  }
};

}  // namespace

TEST(packit_obeys_a_repeated_request_once) {
  setup s;
  for (int i = 0; i < 4; ++i) {
    s.request(kind::start, 9);
    s.drain();
  }
  CHECK_EQUAL(s.owner.obeyed, 1);
  CHECK_EQUAL(s.out.sent.size(), 4u);
  for (const frame &f : s.out.sent) {
    CHECK_EQUAL(f.kind, kind::start | kind::reply);
    CHECK_EQUAL(f.seq, 9);
    CHECK_EQUAL(f.payload[0], 1);
    CHECK_EQUAL(f.to, address::laptop);
  }
  s.request(kind::start, 10);
  s.request(kind::stop, 10);
  CHECK_EQUAL(s.owner.obeyed, 3);
}

TEST(packit_sends_the_frames_of_the_mask) {
  setup s;
  s.get(5, 0x80000005);
  s.drain();
  CHECK_EQUAL(s.out.sent.size(), 3u);
  std::set<int> seqs;
  for (const frame &f : s.out.sent) seqs.insert(f.seq);
  CHECK(seqs == std::set<int>({5, 7, 36}));
  s.out.sent.clear();
  s.get(30, 0xFFFFFFFF);  // frames 40 and on do not exist
  s.drain();
  CHECK_EQUAL(s.out.sent.size(), 10u);
  s.out.sent.clear();
  s.get(250, 0xFFFFFFFF);  // past the last number: nothing, and no wrap to frame 0
  s.drain();
  CHECK_EQUAL(s.out.sent.size(), 0u);
  CHECK(!s.link.sending());
}

TEST(packit_refuses_and_replaces_jobs) {
  setup s;
  s.get(0, 0xFFFF);
  s.link.poll(0);
  s.get(20, 1);  // replaces
  s.drain();
  CHECK_EQUAL(s.out.sent.size(), 2u);
  s.owner.may = result::not_now;
  s.out.sent.clear();
  s.get(0, 1);
  s.drain();
  CHECK_EQUAL(s.out.sent.size(), 1u);
  CHECK_EQUAL(s.out.sent[0].kind, kind::get | kind::reply);
  CHECK_EQUAL(s.out.sent[0].payload[0], 1);
  s.owner.may = result::done;
  s.get(0, 0xFF);
  s.link.packit_clear();
  s.out.sent.clear();
  s.drain();
  CHECK(s.out.sent.empty());
}

TEST(packit_repeats_events_until_heard) {
  setup s;
  s.link.tell({event_code::saturated, 2, 3, 0});
  s.link.tell({event_code::stopped, 1, 0, 0});
  moment now = 0;
  for (int i = 0; i < 5; ++i) {
    s.drain(now);
    now += ms(2001);
  }
  CHECK_EQUAL(s.out.sent.size(), 5u);
  const uint8_t seq = s.out.sent[0].seq;
  for (const frame &f : s.out.sent) CHECK_EQUAL(f.seq, seq);
  const std::string text(s.out.sent[0].payload + 3, s.out.sent[0].payload + s.out.sent[0].size);
  CHECK_EQUAL(text, std::string("Slave 2: saturated"));
  s.request(kind::heard, static_cast<uint8_t>(seq + 1));  // of something else
  s.out.sent.clear();
  s.drain(now);
  CHECK_EQUAL(s.out.sent.size(), 1u);
  s.request(kind::heard, seq);
  s.out.sent.clear();
  s.drain(now);
  CHECK_EQUAL(s.out.sent.size(), 1u);
  CHECK_EQUAL(s.out.sent[0].payload[0], static_cast<int>(event_code::stopped));
  for (int i = 0; i < 100; ++i) s.drain(now += ms(2001));
  CHECK_EQUAL(s.out.sent.size(), static_cast<size_t>(packit_uart::most_repeats));
}

TEST(packit_heard_of_a_cleared_event_does_not_count_for_the_next) {
  setup s;
  s.link.tell({event_code::run_started, 1, 3, 0});
  s.drain();
  const uint8_t seq = s.out.sent.at(0).seq;
  s.link.packit_clear();
  s.link.tell({event_code::saturated, 1, 0, 0});
  s.drain();
  s.request(kind::heard, seq);
  s.out.sent.clear();
  s.drain(ms(2500));
  CHECK_EQUAL(s.out.sent.size(), 1u);
  CHECK_EQUAL(s.out.sent[0].payload[0], static_cast<int>(event_code::saturated));
}

TEST(packit_keeps_the_newest_four_events) {
  setup s;
  for (uint8_t state = 0; state < 7; ++state) s.link.tell({event_code::stopped, 1, state, 0});
  event e;
  for (uint8_t state = 3; state < 7; ++state) {
    CHECK(s.link.take_event(e));
    CHECK_EQUAL(e.state, state);
  }
  CHECK(!s.link.take_event(e));
}

TEST(event_texts_fit_their_frame) {
  for (int code = 1; code <= 12; ++code) {
    for (int detail = 1; detail < 64; ++detail) {
      char text[64] = {};
      const uint8_t length =
          event_text({static_cast<event_code>(code), 2, 0, static_cast<uint8_t>(detail)}, text);
      CHECK(length <= longest_event_text);
      CHECK_EQUAL(std::string(text).size(), length);
      CHECK_EQUAL(std::string(text).substr(0, 9), std::string("Slave 2: "));
    }
  }
}
