// A block made on one side and taken in on the other.

#include <algorithm>

#include "check.h"
#include "protocol/block.h"
#include "sampling/sampler.h"

namespace {

struct stored {
  std::vector<uint8_t> room = std::vector<uint8_t>(ring_bytes);
  array10bits store{room.data(), ring_rows * channels};
};

void fill(stored &s, uint32_t seed) {
  std::mt19937 chance(seed);
  for (int16_t i = 0; i < s.store.size(); ++i) s.store.put(i, static_cast<uint16_t>(chance() % 1024));
}

frame frame_of(const block &b, uint8_t number) {
  frame f;
  f.kind = kind::block;
  f.from = b.board();
  f.seq = number;
  f.size = b.payload(number, f.payload);
  return f;
}

void make(block &b, uint16_t rows, int16_t slot) {
  run_facts facts;
  facts.run = 7;
  facts.rate = 400;
  b.start_own(2, facts, rows, slot);
  for (int i = 0; i < 1000 && !b.step(); ++i) {
  }
}

}  // namespace

TEST(block_goes_over_frame_by_frame) {
  for (const uint16_t rows :
       {uint16_t{800}, uint16_t{799}, uint16_t{201}, uint16_t{10}, uint16_t{1}, uint16_t{0}}) {
    stored from;
    stored to;
    fill(from, rows);
    block own(from.store);
    const int16_t slot = 795;  // the ring's end lies inside
    make(own, rows, slot);
    CHECK(own.ready());
    CHECK_EQUAL(own.frames(), 3 + (rows + 9) / 10);
    CHECK_EQUAL(own.payload(own.frames(), std::vector<uint8_t>(max_payload).data()), 0);
    block other(to.store);
    other.start_foreign(2);
    std::vector<uint8_t> order;
    for (uint8_t n = 0; n < own.frames(); ++n) order.push_back(n);
    std::shuffle(order.begin(), order.end(), std::mt19937(3));
    order.push_back(0);
    for (const uint8_t n : order) {
      other.take(frame_of(own, n));
    }
    CHECK(other.complete());
    other.start_check();
    while (!other.step() && !other.failed()) {
    }
    CHECK(other.ready());
    CHECK_EQUAL(other.crc(), own.crc());
    for (uint16_t row = 0; row < rows; ++row) {
      for (const uint8_t channel : {uint8_t{0}, uint8_t{1}}) {
        CHECK_EQUAL(other.reading(row, channel),
                    from.store.get(static_cast<int16_t>((slot + row) % 800 * 2 + channel)));
      }
    }
    // And it is handed on byte by byte.
    for (uint8_t n = 0; n < own.frames(); ++n) {
      const frame a = frame_of(own, n);
      const frame b = frame_of(other, n);
      CHECK(std::equal(a.payload, a.payload + a.size, b.payload, b.payload + b.size));
    }
  }
}

TEST(block_with_a_wrong_bit_fails_its_check) {
  for (const uint8_t bad : {uint8_t{0}, uint8_t{1}, uint8_t{2}, uint8_t{40}, uint8_t{82}}) {
    stored from;
    stored to;
    fill(from, 5);
    block own(from.store);
    make(own, 800, 0);
    block other(to.store);
    other.start_foreign(2);
    for (uint8_t n = 0; n < own.frames(); ++n) {
      frame f = frame_of(own, n);
      if (n == bad) f.payload[1] ^= 0x10;
      CHECK(other.take(f));
    }
    other.start_check();
    while (!other.step() && !other.failed()) {
    }
    CHECK(other.failed());
    CHECK(!other.ready());
  }
}

TEST(block_refuses_frames_that_do_not_belong) {
  stored from;
  stored to;
  fill(from, 6);
  block own(from.store);
  make(own, 50, 0);
  block other(to.store);
  other.start_foreign(2);
  frame f = frame_of(own, 3);
  f.from = 1;
  CHECK(!other.take(f));
  f = frame_of(own, 3);
  f.size = 24;
  CHECK(!other.take(f));
  CHECK(other.take(frame_of(own, 0)));
  f = frame_of(own, 3);
  f.seq = 9;  // the block has 8 frames
  CHECK(!other.take(f));
  CHECK_EQUAL(other.first_missing(0), 1);
  CHECK(other.take(frame_of(own, 1)));
  CHECK_EQUAL(other.first_missing(0), 2);
  f = frame_of(own, 0);
  f.payload[3] = 0xFF;  // too many rows
  f.payload[4] = 0xFF;
  CHECK(!other.take(f));
}
