// One board's block: HEAD, TIMES, QUALITY, then the rows ten a frame (PROTOCOL.md, "Blocks").
//
// A board makes its own block from its store (start_own(), then step() until it is ready); Slave 1 can also
// take in Slave 2's, frame by frame, and hand it on byte by byte as it came.

#ifndef PROTOCOL_BLOCK_H
#define PROTOCOL_BLOCK_H

#include <stdint.h>

#include "protocol/crc.h"
#include "protocol/frame.h"
#include "sampling/array10bits.h"
#include "sampling/interval.h"
#include "sampling/quality.h"

constexpr uint8_t rows_a_frame = 10;
constexpr uint8_t row_frame_bytes = 25;
constexpr uint8_t head_frames = 3;
constexpr uint8_t most_frames = head_frames + 80;
constexpr uint16_t no_trigger_row = 0xFFFF;
constexpr int16_t not_measured = -32768;

/// What a board knows of its run beside the rows themselves.
struct run_facts {
  uint8_t run = 0;
  uint16_t rate = 0;
  interval every = {1, 40000};
  uint8_t readings = 4;
  uint8_t mode = 0;
  uint8_t synch = 0;
  uint16_t overruns = 0;
  uint8_t saturated = 0;
  uint16_t trigger_row = no_trigger_row;
  uint16_t wheel_delay = 0;  // CPU cycles
  uint16_t chassis_delay = 0;
  uint16_t lead = 0;  // ticks from start mark to row 0
  uint32_t first_row = 0;
  uint32_t elapsed = 0;  // ticks from start mark to end mark
  uint32_t mark_row = 0;
  int16_t difference = not_measured;

  /// Both delays, from the number of readings and the interrupt's latency.
  void set_delays();
};

class block {
 public:
  explicit block(array10bits &store) : store_(store) {}

  /// Nothing in it.
  void clear();

  /// Begins to make the own block of `board`: `rows` rows from the ring's slot `first_slot` on.
  void start_own(uint8_t board, const run_facts &facts, uint16_t rows, int16_t first_slot);
  /// Works on it for about 2 ms. True when the block is ready to be handed on.
  bool step();

  /// Begins to take in another board's block; rows go into the store from slot 0 on.
  void start_foreign(uint8_t board);
  /// Takes one frame. False when it does not belong.
  bool take(const frame &f);
  /// First frame, from `from` on, that has not come; the number of frames when all have (most_frames before
  /// HEAD came).
  uint8_t first_missing(uint8_t from) const;
  bool complete() const { return have(0) && first_missing(0) == frames(); }
  /// After complete(): begins to hold the frames against the CRC-32; step() then makes the block ready, or
  /// failed() tells.
  void start_check();
  bool failed() const { return failed_; }

  bool ready() const { return ready_; }
  uint8_t board() const { return board_; }
  uint16_t rows() const { return rows_; }
  /// Frames of the block; most_frames as long as HEAD has not come.
  uint8_t frames() const { return frames_; }
  uint32_t crc() const { return crc_; }
  verdict judged() const { return verdict_; }
  uint8_t flags(uint8_t channel) const { return flags_[channel]; }

  /// Payload of frame `number`; its size, 0 when there is no such frame.
  uint8_t payload(uint8_t number, uint8_t *out) const;
  /// A reading straight from the ring: channel 0 wheel, 1 chassis.
  uint16_t store_at(int16_t slot, uint8_t channel) const {
    return store_.get(static_cast<int16_t>(2 * slot + channel));
  }
  /// One reading of row `row` of the block.
  uint16_t reading(uint16_t row, uint8_t channel) const;

 private:
  void write_heads();
  void judge();
  void summed_up();
  void read_heads();
  bool have(uint8_t number) const { return (have_[number >> 3] >> (number & 7) & 1) != 0; }

  array10bits &store_;
  uint8_t board_ = 0;
  uint16_t rows_ = 0;
  int16_t first_slot_ = 0;
  uint8_t frames_ = 0;
  bool ready_ = false;
  bool foreign_ = false;
  bool failed_ = false;
  uint32_t crc_ = 0;
  verdict verdict_ = verdict::not_judged;
  uint8_t flags_[2] = {0, 0};

  enum class work : uint8_t { none, judging, summing };
  work work_ = work::none;
  uint16_t next_ = 0;  // row being judged, then frame being summed
  channel_quality quality_[2];
  run_facts facts_;
  crc32 sum_;

  uint8_t heads_[head_frames][max_payload];
  uint8_t head_sizes_[head_frames] = {0, 0, 0};
  uint8_t have_[(most_frames + 7) / 8];  // of a foreign block
};

#endif
