// The laptop's side, in virtual time: asks until answered, collects blocks, acknowledges events.

#ifndef WORLD_LAPTOP_H
#define WORLD_LAPTOP_H

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "protocol/frame.h"
#include "world/modem_model.h"
#include "world/world.h"

using bytes = std::vector<uint8_t>;

/// A block as the laptop keeps it, its numbers read out.
struct kept_block {
  std::map<uint8_t, bytes> frames;
  uint32_t crc = 0;      // that HEAD says
  uint32_t own_crc = 0;  // that we compute
  uint8_t board = 0, run = 0, readings = 0, mode = 0, synch = 0, saturated = 0, verdict = 0;
  uint8_t flags[2] = {0, 0};
  uint16_t rows = 0, rate = 0, prescale = 0, cycles = 0, overruns = 0, trigger_row = 0;
  uint16_t wheel_delay = 0, chassis_delay = 0, lead = 0;
  uint32_t first_row = 0, elapsed = 0, mark_row = 0;
  int16_t difference = 0;
  std::vector<uint16_t> wheel, chassis;
};

class laptop {
 public:
  laptop(world &w, modem_model &line);

  /// The reply's payload; nothing when none came in `tries` times 1 s.
  std::optional<bytes> ask(uint8_t kind, const bytes &payload = {}, int tries = 20,
                           uint8_t to = address::slave_1);
  /// First byte of the reply, 255 when none came.
  uint8_t result_of(uint8_t kind, const bytes &payload = {});
  uint8_t config(uint16_t rate, uint8_t mode, uint8_t synch, uint8_t readings = 4, uint16_t pre = 200,
                 uint16_t threshold = 20);
  uint8_t state();

  /// Asks for frames until the block is there; nothing when 20 requests in a row brought none.
  std::optional<kept_block> get_block(uint8_t board);
  uint8_t done(const kept_block &block);
  /// Both blocks, from state 5 on; fewer when something failed.
  std::vector<kept_block> get_all();

  bool wait_for_event(const std::string &text, nanoseconds span);
  bool heard_event(const std::string &text) const;
  void type(const std::string &line) { line_.from_laptop(line); }

  std::vector<std::string> events;
  std::string raw;  // all bytes that came
  int requests = 0;
  bool silent = false;  // acknowledges nothing

 private:
  void take(uint8_t byte);
  void send(const frame &f);
  void frame_came(const frame &f);

  world &w_;
  modem_model &line_;
  bytes raw_frame_;
  std::deque<frame> replies_;
  std::deque<frame> blocks_;
  std::map<uint8_t, bool> seen_events_;
  uint8_t seq_ = 0;
};

#endif
