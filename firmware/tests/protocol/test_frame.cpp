// Frames against the golden list of PROTOCOL.md, which another program has computed.

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

#include "check.h"
#include "protocol/block.h"
#include "protocol/bytes.h"
#include "protocol/cobs.h"
#include "protocol/crc.h"
#include "protocol/frame.h"

namespace {

using bytes = std::vector<uint8_t>;

struct golden {
  std::string name;
  bytes body, line, packet;
};

bytes from_hex(const std::string &text) {
  bytes data;
  for (size_t i = 0; i + 1 < text.size(); i += 2) {
    data.push_back(static_cast<uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return data;
}

std::string trimmed(const std::string &text) {
  const size_t first = text.find_first_not_of(' ');
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(' ') - first + 1);
}

std::vector<golden> golden_frames() {
  const char *path = std::getenv("PROTOCOL");
  std::ifstream file(path != nullptr ? path : "PROTOCOL.md");
  std::vector<golden> list;
  std::string line;
  bool inside = false;
  while (std::getline(file, line)) {
    if (line == "```golden") {
      inside = true;
    } else if (inside && line == "```") {
      break;
    } else if (inside) {
      std::istringstream cells(line);
      std::string name, body, on_line, packet;
      std::getline(cells, name, '|');
      std::getline(cells, body, '|');
      std::getline(cells, on_line, '|');
      std::getline(cells, packet, '|');
      list.push_back(
          {trimmed(name), from_hex(trimmed(body)), from_hex(trimmed(on_line)), from_hex(trimmed(packet))});
    }
  }
  return list;
}

frame made(uint8_t to, uint8_t from, uint8_t kind, uint8_t seq, const bytes &payload = {}) {
  frame f;
  f.to = to;
  f.from = from;
  f.kind = kind;
  f.seq = seq;
  f.size = static_cast<uint8_t>(payload.size());
  std::copy(payload.begin(), payload.end(), f.payload);
  return f;
}

bytes body_of(const frame &f) {
  bytes body(max_body);
  body.resize(frame_to_body(f, body.data()));
  return body;
}

}  // namespace

TEST(golden_frames_decode_and_encode) {
  const auto list = golden_frames();
  CHECK(list.size() >= 15);
  for (const golden &g : list) {
    frame f;
    CHECK(frame_from_body(g.body.data(), static_cast<uint8_t>(g.body.size()), f));
    CHECK(body_of(f) == g.body);
    bytes stuffed(g.body.size() + 2, 0);
    cobs_stuff(g.body.data(), static_cast<uint8_t>(g.body.size()), stuffed.data());
    CHECK(stuffed == g.line);
    bytes packet(32, 0);
    packet[0] = static_cast<uint8_t>(g.body.size());
    std::copy(g.body.begin(), g.body.end(), packet.begin() + 1);
    CHECK(packet == g.packet);
  }
}

TEST(golden_frames_are_what_the_names_say) {
  const auto list = golden_frames();
  const auto is = [&](const std::string &name, const frame &f) {
    for (const golden &g : list) {
      if (g.name == name) {
        CHECK(g.body == body_of(f));
        return;
      }
    }
    CHECK(false);
  };
  is("HELLO", made(address::slave_1, address::laptop, kind::hello, 1));
  is("CONFIG 800 Hz", made(1, 0, kind::config, 2, {0x20, 0x03, 0, 0, 4, 200, 0, 20, 0}));
  is("GET 16 of board 1", made(1, 0, kind::get, 4, {1, 0, 0xFF, 0xFF, 0, 0}));
  is("DONE refused", made(0, 1, kind::done | kind::reply, 5, {static_cast<uint8_t>(result::differs)}));
  is("ARM check", made(2, 1, kind::arm, 9, {2}));
  is("HEARD", made(1, 0, kind::heard, 7));
}

TEST(golden_block_is_taken_in_with_its_crc) {
  // HEAD of the list says 83 frames of 800 rows; its CRC belongs to a block whose only ROWS frame is the
  // listed one.
  crc32 sum;
  uint32_t said = 0;
  for (const golden &g : golden_frames()) {
    if (g.name != "HEAD" && g.name != "TIMES" && g.name != "QUALITY" && g.name != "ROWS") continue;
    const size_t payload = g.body.size() - 5;
    const size_t summed = g.name == "HEAD" ? payload - 4 : payload;
    sum.add(g.body.data() + 3, static_cast<uint8_t>(summed));
    if (g.name == "HEAD") said = byte_reader(g.body.data() + 3 + summed, 4).u32();
    if (g.name == "ROWS") {
      bytes rows(g.body.begin() + 3, g.body.end() - 2);
      const array10bits values(rows.data(), 20);
      const int expected[] = {570, 641, 569, 641, 0, 1023, 1,  1022, 512, 511,
                              600, 650, 3,   5,   7, 11,   13, 17,   19,  23};
      for (int16_t i = 0; i < 20; ++i) CHECK_EQUAL(values.get(i), expected[i]);
    }
  }
  CHECK_EQUAL(sum.value(), said);
}

TEST(frames_of_wrong_length_or_crc_are_refused) {
  std::mt19937 chance(6);
  frame f;
  for (uint8_t size = 0; size < 40; ++size) {
    bytes body(40, 0);
    const uint8_t checked = size >= 2 ? static_cast<uint8_t>(size - 2) : uint8_t{0};
    const uint16_t crc = crc16(body.data(), checked);
    body[checked] = static_cast<uint8_t>(crc);
    body[checked + 1u] = static_cast<uint8_t>(crc >> 8);
    CHECK_EQUAL(frame_from_body(body.data(), size, f), size >= 5 && size <= 31);
  }
  const bytes good = body_of(made(1, 0, 0x22, 3, {1, 2, 3, 4}));
  for (size_t bit = 0; bit < good.size() * 8; ++bit) {
    bytes bad = good;
    bad[bit / 8] = static_cast<uint8_t>(bad[bit / 8] ^ 1u << bit % 8);
    CHECK(!frame_from_body(bad.data(), static_cast<uint8_t>(bad.size()), f));
  }
}
