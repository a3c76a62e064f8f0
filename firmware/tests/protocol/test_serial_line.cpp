// Frames and text over a serial port: noise, cut frames, text between frames.

#include <cstring>
#include <deque>

#include "check.h"
#include "protocol/serial_line.h"

namespace {

/// Two ends of a cable; the sending side takes a byte only every other time.
struct loop_port : serial_port {
  std::deque<uint8_t> bytes;
  bool busy = false;
  bool put(uint8_t byte) override {
    busy = !busy;
    if (busy) return false;
    bytes.push_back(byte);
    return true;
  }
  bool get(uint8_t &byte) override {
    if (bytes.empty()) return false;
    byte = bytes.front();
    bytes.pop_front();
    return true;
  }
  void add(const std::string &text) { bytes.insert(bytes.end(), text.begin(), text.end()); }
};

bool is_dump(const char *text) { return std::strcmp(text, "dump") == 0; }

frame some(uint8_t seq, uint8_t size) {
  frame f;
  f.to = 1;
  f.kind = 0x0A;  // a line feed, so that frames hold what text ends in
  f.seq = seq;
  f.size = size;
  for (uint8_t i = 0; i < size; ++i) f.payload[i] = static_cast<uint8_t>(seq * 37 + i * 11);
  return f;
}

bool same(const frame &a, const frame &b) {
  return a.to == b.to && a.from == b.from && a.kind == b.kind && a.seq == b.seq && a.size == b.size &&
         std::memcmp(a.payload, b.payload, a.size) == 0;
}

}  // namespace

TEST(line_carries_frames_of_every_size) {
  loop_port port;
  serial_line line(port, is_dump);
  for (int i = 0; i < 256; ++i) {
    const frame f = some(static_cast<uint8_t>(i), static_cast<uint8_t>(i % 27));
    line.send(f);
    int came = 0;
    for (int turn = 0; turn < 200; ++turn) {
      if (line.poll(static_cast<moment>(i)) == serial_line::arrival::a_frame) {
        ++came;
        CHECK(same(line.received(), f));
      }
    }
    CHECK_EQUAL(came, 1);
  }
  CHECK_EQUAL(line.broken(), 0);
}

TEST(line_finds_frames_again_after_noise) {
  std::mt19937 chance(7);
  loop_port port;
  serial_line line(port, is_dump);
  int came = 0;
  moment now = 0;
  for (int i = 0; i < 300; ++i) {
    for (auto n = chance() % 80; n > 0; --n) port.bytes.push_back(static_cast<uint8_t>(chance()));
    now += ms(100);  // a pause: the sender closes the noise with a zero of its own
    line.poll(now);
    line.send(some(static_cast<uint8_t>(i), 20));
    for (int turn = 0; turn < 200; ++turn) {
      if (line.poll(now) == serial_line::arrival::a_frame &&
          same(line.received(), some(static_cast<uint8_t>(i), 20)))
        ++came;
    }
  }
  CHECK_EQUAL(came, 300);
  CHECK(line.broken() > 0);
}

TEST(line_tells_text_from_frames) {
  loop_port port;
  serial_line line(port, is_dump);
  moment now = ms(1000);
  port.add("dump\r\n");
  CHECK_EQUAL(line.poll(now), serial_line::arrival::a_text);
  CHECK_EQUAL(std::string(line.text()), std::string("dump"));
  line.poll(now);
  line.send(some(5, 9));
  int came = 0;
  for (int turn = 0; turn < 200; ++turn) came += line.poll(now) == serial_line::arrival::a_frame ? 1 : 0;
  CHECK_EQUAL(came, 1);
  port.add("dump\n");
  CHECK_EQUAL(line.poll(now), serial_line::arrival::a_text);
  port.add("jump\r");
  CHECK_EQUAL(line.poll(now), serial_line::arrival::nothing);
  port.add(std::string(1, '\0'));  // the jump was noise
  CHECK_EQUAL(line.poll(now), serial_line::arrival::nothing);
  port.add("dump\r");
  CHECK_EQUAL(line.poll(now), serial_line::arrival::a_text);
}

TEST(line_survives_endless_noise) {
  std::mt19937 chance(8);
  loop_port port;
  serial_line line(port, is_dump);
  for (int i = 0; i < 50000; ++i) port.bytes.push_back(static_cast<uint8_t>(chance() % 255 + 1));
  CHECK_EQUAL(line.poll(0), serial_line::arrival::nothing);
  CHECK(port.bytes.empty());
}

TEST(line_sends_text_cut_to_its_buffer) {
  struct out_port : serial_port {
    std::string sent;
    bool put(uint8_t byte) override {
      sent += static_cast<char>(byte);
      return true;
    }
    bool get(uint8_t &) override { return false; }
  } port;
  serial_line line(port, nullptr);
  line.send_text("hello");
  line.poll(0);
  CHECK_EQUAL(port.sent, std::string("hello\r\n"));
  port.sent.clear();
  line.send_text(std::string(100, 'x').c_str());
  line.poll(0);
  CHECK_EQUAL(port.sent, std::string(serial_line::longest_text, 'x') + "\r\n");
}
