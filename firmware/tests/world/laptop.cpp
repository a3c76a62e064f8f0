#include "world/laptop.h"

#include <algorithm>

#include "protocol/bytes.h"
#include "protocol/cobs.h"
#include "protocol/crc.h"

namespace {

uint32_t number(const bytes &data, size_t at, size_t size) {
  uint32_t value = 0;
  for (size_t i = 0; i < size; ++i) value |= static_cast<uint32_t>(data.at(at + i)) << 8 * i;
  return value;
}

void read_out(kept_block &b) {
  const bytes &head = b.frames.at(0);
  b.board = head.at(0);
  b.run = head.at(1);
  b.rows = static_cast<uint16_t>(number(head, 3, 2));
  b.rate = static_cast<uint16_t>(number(head, 5, 2));
  b.prescale = static_cast<uint16_t>(number(head, 7, 2));
  b.cycles = static_cast<uint16_t>(number(head, 9, 2));
  b.readings = head.at(11);
  b.mode = head.at(12);
  b.synch = head.at(13);
  b.overruns = static_cast<uint16_t>(number(head, 14, 2));
  b.saturated = head.at(16);
  b.trigger_row = static_cast<uint16_t>(number(head, 17, 2));
  b.crc = number(head, 19, 4);
  const bytes &times = b.frames.at(1);
  b.wheel_delay = static_cast<uint16_t>(number(times, 0, 2));
  b.chassis_delay = static_cast<uint16_t>(number(times, 2, 2));
  b.lead = static_cast<uint16_t>(number(times, 4, 2));
  b.first_row = number(times, 6, 4);
  b.elapsed = number(times, 10, 4);
  b.mark_row = number(times, 14, 4);
  b.difference = static_cast<int16_t>(number(times, 18, 2));
  const bytes &quality = b.frames.at(2);
  b.flags[0] = quality.at(8);
  b.flags[1] = quality.at(17);
  b.verdict = quality.at(18);
  for (uint16_t row = 0; row < b.rows; ++row) {
    const bytes &data = b.frames.at(static_cast<uint8_t>(3 + row / 10));
    for (int channel = 0; channel < 2; ++channel) {
      uint16_t value = 0;  // bit by bit, unlike the firmware
      for (int bit = 0; bit < 10; ++bit) {
        const int place = 10 * (2 * (row % 10) + channel) + bit;
        if (data.at(static_cast<size_t>(place / 8)) >> place % 8 & 1)
          value = static_cast<uint16_t>(value | 1u << bit);
      }
      (channel == 0 ? b.wheel : b.chassis).push_back(value);
    }
  }
  crc32 sum;
  for (const auto &[seq, payload] : b.frames) {
    const size_t size = payload.size() - (seq == 0 ? 4 : 0);
    for (size_t i = 0; i < size; ++i) sum.add(payload[i]);
  }
  b.own_crc = sum.value();
}

}  // namespace

laptop::laptop(world &w, modem_model &line) : w_(w), line_(line) {
  line.to_laptop = [this](uint8_t byte) { take(byte); };
}

void laptop::take(uint8_t byte) {
  raw += static_cast<char>(byte);
  if (byte != 0) {
    raw_frame_.push_back(byte);
    return;
  }
  if (!raw_frame_.empty() && raw_frame_.size() < 200) {
    const uint8_t size = cobs_unstuff(raw_frame_.data(), static_cast<uint8_t>(raw_frame_.size()));
    frame f;
    if (size > 0 && frame_from_body(raw_frame_.data(), size, f)) frame_came(f);
  }
  raw_frame_.clear();
}

void laptop::frame_came(const frame &f) {
  if (f.kind == kind::event) {
    if (!seen_events_[f.seq]) events.emplace_back(f.payload + 3, f.payload + f.size);
    seen_events_[f.seq] = true;
    seen_events_[static_cast<uint8_t>(f.seq + 100)] = false;  // the number will come again
    if (silent) return;
    frame heard;
    heard.to = f.from;
    heard.kind = kind::heard;
    heard.seq = f.seq;
    send(heard);
  } else if (f.kind == kind::block) {
    blocks_.push_back(f);
  } else {
    replies_.push_back(f);
  }
}

void laptop::send(const frame &f) {
  uint8_t body[max_body];
  const uint8_t size = frame_to_body(f, body);
  uint8_t stuffed[max_body + 1];
  const uint8_t length = cobs_stuff(body, size, stuffed);
  std::string out(1, '\0');
  out.append(reinterpret_cast<const char *>(stuffed), length);
  out.push_back('\0');
  line_.from_laptop(out);
}

std::optional<bytes> laptop::ask(uint8_t kind, const bytes &payload, int tries, uint8_t to) {
  frame f;
  f.to = to;
  f.kind = kind;
  f.seq = ++seq_;
  f.size = static_cast<uint8_t>(payload.size());
  std::copy(payload.begin(), payload.end(), f.payload);
  for (int i = 0; i < tries; ++i) {
    send(f);
    ++requests;
    const nanoseconds end = w_.now() + sec;
    while (w_.now() < end) {
      w_.run_for(msec);
      while (!replies_.empty()) {
        const frame reply = replies_.front();
        replies_.pop_front();
        if (reply.kind == (kind | ::kind::reply) && reply.seq == f.seq) {
          return bytes(reply.payload, reply.payload + reply.size);
        }
      }
    }
  }
  return std::nullopt;
}

uint8_t laptop::result_of(uint8_t kind, const bytes &payload) {
  const std::optional<bytes> reply = ask(kind, payload);
  return reply && !reply->empty() ? reply->front() : 255;
}

uint8_t laptop::config(uint16_t rate, uint8_t mode, uint8_t synch, uint8_t readings, uint16_t pre,
                       uint16_t threshold) {
  const auto low = [](uint16_t v) { return static_cast<uint8_t>(v); };
  const auto high = [](uint16_t v) { return static_cast<uint8_t>(v >> 8); };
  return result_of(kind::config, {low(rate), high(rate), mode, synch, readings, low(pre), high(pre),
                                  low(threshold), high(threshold)});
}

uint8_t laptop::state() {
  const std::optional<bytes> reply = ask(kind::status);
  return reply ? reply->at(0) : 255;
}

std::optional<kept_block> laptop::get_block(uint8_t board) {
  kept_block b;
  size_t frames = 83;
  int fruitless = 0;
  while (b.frames.size() < frames) {
    frame f;
    f.to = address::slave_1;
    f.kind = kind::get;
    f.seq = ++seq_;
    uint8_t first = 0;
    while (b.frames.count(first) != 0) ++first;
    uint32_t mask = 0;
    size_t wanted = 0;
    for (uint8_t k = 0; k < 32 && first + k < static_cast<int>(frames) && wanted < 16; ++k) {
      if (b.frames.count(static_cast<uint8_t>(first + k)) != 0) continue;
      mask |= uint32_t{1} << k;
      ++wanted;
    }
    byte_writer out(f.payload);
    out.u8(board);
    out.u8(first);
    out.u32(mask);
    f.size = out.size();
    replies_.clear();
    send(f);
    ++requests;
    const size_t before = b.frames.size();
    nanoseconds last = w_.now();
    while (w_.now() - last < 600 * msec && b.frames.size() - before < wanted) {
      w_.run_for(msec);
      while (!blocks_.empty()) {
        const frame got = blocks_.front();
        blocks_.pop_front();
        last = w_.now();
        if (got.from == board) b.frames[got.seq] = bytes(got.payload, got.payload + got.size);
      }
      for (const frame &reply : replies_) {
        if (reply.kind == (kind::get | kind::reply) && reply.seq == f.seq) return std::nullopt;
      }
    }
    if (b.frames.count(0) != 0) frames = b.frames.at(0).at(2);
    fruitless = b.frames.size() == before ? fruitless + 1 : 0;
    if (fruitless == 20) return std::nullopt;
  }
  read_out(b);
  return b;
}

uint8_t laptop::done(const kept_block &block) {
  bytes payload = {block.board};
  for (int i = 0; i < 4; ++i) payload.push_back(static_cast<uint8_t>(block.own_crc >> 8 * i));
  return result_of(kind::done, payload);
}

std::vector<kept_block> laptop::get_all() {
  std::vector<kept_block> blocks;
  for (const uint8_t board : {address::slave_1, address::slave_2}) {
    const uint8_t ready = board == address::slave_1 ? 5 : 8;
    bool there = false;
    for (int i = 0; i < 60 && !there; ++i) {
      const uint8_t now = state();
      there = now == ready || (board == address::slave_1 && now == 6);
      if (!there) w_.run_for(200 * msec);
    }
    if (!there) return blocks;
    const std::optional<kept_block> b = get_block(board);
    if (!b || done(*b) != 0) return blocks;
    blocks.push_back(*b);
  }
  return blocks;
}

bool laptop::heard_event(const std::string &text) const {
  return std::find(events.begin(), events.end(), text) != events.end();
}

bool laptop::wait_for_event(const std::string &text, nanoseconds span) {
  return w_.run_until_true([&] { return heard_event(text); }, span);
}
