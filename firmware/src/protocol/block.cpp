#include "protocol/block.h"

#include <string.h>

#include "protocol/bytes.h"
#include "sampling/sampler.h"

namespace {

constexpr uint8_t rows_a_step = 16;  // judged at once: about 2 ms
constexpr uint8_t head_size = 23;
constexpr uint8_t times_size = 20;
constexpr uint8_t quality_size = 19;
constexpr uint8_t crc_size = 4;

uint8_t frames_for(uint16_t rows) {
  return static_cast<uint8_t>(head_frames + (rows + rows_a_frame - 1) / rows_a_frame);
}

}  // namespace

void run_facts::set_delays() {
  wheel_delay = static_cast<uint16_t>(sampler::wheel_delay(readings) + hardware::row_latency);
  chassis_delay = static_cast<uint16_t>(sampler::chassis_delay(readings) + hardware::row_latency);
}

void block::clear() {
  ready_ = false;
  foreign_ = false;
  failed_ = false;
  work_ = work::none;
  rows_ = 0;
  frames_ = 0;
  board_ = 0;
  verdict_ = verdict::not_judged;
  flags_[0] = flags_[1] = 0;
}

void block::start_own(uint8_t board, const run_facts &facts, uint16_t rows, int16_t first_slot) {
  clear();
  board_ = board;
  facts_ = facts;
  rows_ = rows;
  first_slot_ = first_slot;
  frames_ = frames_for(rows);
  quality_[0] = quality_[1] = channel_quality();
  sum_ = crc32();
  next_ = 0;
  work_ = work::judging;
}

uint16_t block::reading(uint16_t row, uint8_t channel) const {
  int16_t slot = static_cast<int16_t>(first_slot_ + static_cast<int16_t>(row));
  if (slot >= ring_rows) slot = static_cast<int16_t>(slot - ring_rows);
  return store_.get(static_cast<int16_t>(slot * channels + channel));
}

bool block::step() {
  if (work_ == work::judging) {
    for (uint8_t n = 0; n < rows_a_step && next_ < rows_; ++n, ++next_) {
      quality_[0].add(reading(next_, 0));
      quality_[1].add(reading(next_, 1));
    }
    if (next_ == rows_) {
      judge();
      write_heads();
      next_ = 0;
      work_ = work::summing;
    }
  } else if (work_ == work::summing) {
    uint8_t bytes[max_payload];
    const uint8_t number = static_cast<uint8_t>(next_++);
    uint8_t size = payload(number, bytes);
    if (number == 0) size = static_cast<uint8_t>(size - crc_size);
    sum_.add(bytes, size);
    if (next_ == frames_) summed_up();
  }
  return ready_;
}

void block::summed_up() {
  work_ = work::none;
  if (foreign_) {
    ready_ = sum_.value() == crc_;
    failed_ = !ready_;
    return;
  }
  crc_ = sum_.value();
  byte_writer out(heads_[0] + head_size - crc_size);
  out.u32(crc_);
  ready_ = true;
}

void block::judge() {
  flags_[0] = quality_[0].flags();
  flags_[1] = quality_[1].flags();
  verdict_ = flags_[0] == 0 && flags_[1] == 0 ? verdict::good : verdict::poor;
}

void block::write_heads() {
  byte_writer head(heads_[0]);
  head.u8(board_);
  head.u8(facts_.run);
  head.u8(frames_);
  head.u16(rows_);
  head.u16(facts_.rate);
  head.u16(facts_.every.prescale);
  head.u16(facts_.every.cycles);
  head.u8(facts_.readings);
  head.u8(facts_.mode);
  head.u8(facts_.synch);
  head.u16(facts_.overruns);
  head.u8(facts_.saturated);
  head.u16(facts_.trigger_row);
  head.u32(0);  // the CRC-32 comes last
  head_sizes_[0] = head.size();

  byte_writer times(heads_[1]);
  times.u16(facts_.wheel_delay);
  times.u16(facts_.chassis_delay);
  times.u16(facts_.lead);
  times.u32(facts_.first_row);
  times.u32(facts_.elapsed);
  times.u32(facts_.mark_row);
  times.i16(facts_.difference);
  head_sizes_[1] = times.size();

  byte_writer quality(heads_[2]);
  for (const channel_quality &channel : quality_) {
    quality.u16(channel.lowest());
    quality.u16(channel.highest());
    quality.u16(channel.mean16());
    quality.u16(channel.sd16());
    quality.u8(channel.flags());
  }
  quality.u8(static_cast<uint8_t>(verdict_));
  head_sizes_[2] = quality.size();
}

uint8_t block::payload(uint8_t number, uint8_t *out) const {
  if (number >= frames_) return 0;
  if (number < head_frames) {
    memcpy(out, heads_[number], head_sizes_[number]);
    return head_sizes_[number];
  }
  memset(out, 0, row_frame_bytes);
  array10bits packed(out, rows_a_frame * channels);
  const uint16_t first = static_cast<uint16_t>((number - head_frames) * rows_a_frame);
  for (uint8_t i = 0; i < rows_a_frame && first + i < rows_; ++i) {
    const uint16_t row = static_cast<uint16_t>(first + i);
    packed.put(static_cast<int16_t>(2 * i), reading(row, 0));
    packed.put(static_cast<int16_t>(2 * i + 1), reading(row, 1));
  }
  return row_frame_bytes;
}

void block::start_foreign(uint8_t board) {
  clear();
  foreign_ = true;
  board_ = board;
  first_slot_ = 0;
  frames_ = most_frames;
  memset(have_, 0, sizeof have_);
}

bool block::take(const frame &f) {
  static const uint8_t sizes[head_frames] = {head_size, times_size, quality_size};
  const uint8_t number = f.seq;
  if (f.from != board_ || number >= frames_ || ready_) return false;
  if (number < head_frames) {
    if (f.size != sizes[number]) return false;
    if (number == 0) {
      const uint16_t rows = static_cast<uint16_t>(f.payload[3] | f.payload[4] << 8);
      if (rows > ring_rows) return false;
      rows_ = rows;
      frames_ = frames_for(rows);
    }
    memcpy(heads_[number], f.payload, f.size);
    head_sizes_[number] = f.size;
  } else {
    if (f.size != row_frame_bytes) return false;
    uint8_t bytes[row_frame_bytes];
    memcpy(bytes, f.payload, row_frame_bytes);
    const array10bits packed(bytes, rows_a_frame * channels);
    const int16_t first = static_cast<int16_t>((number - head_frames) * rows_a_frame * channels);
    for (uint8_t i = 0; i < rows_a_frame * channels; ++i) {
      store_.put(static_cast<int16_t>(first + i), packed.get(i));
    }
  }
  have_[number >> 3] = static_cast<uint8_t>(have_[number >> 3] | 1u << (number & 7));
  if (complete()) read_heads();
  return true;
}

uint8_t block::first_missing(uint8_t from) const {
  while (from < frames_ && have(from)) ++from;
  return from;
}

void block::read_heads() {
  byte_reader head(heads_[0] + head_size - crc_size, crc_size);
  crc_ = head.u32();
  flags_[0] = heads_[2][8];
  flags_[1] = heads_[2][17];
  verdict_ = static_cast<verdict>(heads_[2][18]);
}

void block::start_check() {
  sum_ = crc32();
  next_ = 0;
  work_ = work::summing;
}
