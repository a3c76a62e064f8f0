// The serial link between Slave 1 (or the Master) and the laptop: a plain cable, or two 9XStream modems.
//
// Both: 9600 baud, 10 bits a byte. As modems: 132 bytes of buffer with CTS (high from 115, low below 98
// bytes), 480 bytes a second in the air, half duplex with 35 ms to turn round, bit errors, command mode by
// `+++` with 1 s of silence on each side, pin sleep.

#ifndef WORLD_MODEM_MODEL_H
#define WORLD_MODEM_MODEL_H

#include <deque>
#include <functional>
#include <string>

#include "protocol/serial_port.h"
#include "world/board_model.h"
#include "world/world.h"

class modem_model : public serial_port {
 public:
  modem_model(world &w, bool is_modem);

  double bit_errors = 0;  // probability of a wrong bit, both ways
  bool cut = false;       // nothing gets through
  const bool *asleep = nullptr;

  /// Bytes for the laptop, when they come.
  std::function<void(uint8_t)> to_laptop = [](uint8_t) {};
  /// From the laptop.
  void from_laptop(const std::string &bytes);

  bool put(uint8_t byte) override;
  bool get(uint8_t &byte) override;

  bool clear_to_send() const { return !(is_modem_ && (cts_high_ || sleeping())); }
  std::string commands;  // texts that came in command mode
  long lost = 0;         // bytes that found the buffer full

 private:
  bool sleeping() const { return asleep != nullptr && *asleep; }
  void byte_arrives(uint8_t byte);
  void to_air(uint8_t byte);
  void look_for_command(uint8_t byte);
  void to_board(uint8_t byte);
  uint8_t through_air(uint8_t byte);
  void pump();

  world &w_;
  bool is_modem_;
  nanoseconds transmitter_free_ = 0;
  bool cts_high_ = false;
  std::deque<uint8_t> down_;  // from the board, in the modem's buffer
  std::deque<uint8_t> up_;    // from the laptop
  std::deque<uint8_t> received_;
  bool pumping_ = false;
  int direction_ = 0;  // whose bytes were last in the air
  nanoseconds last_byte_ = -10 * sec;
  int pluses_ = 0;
  uint64_t plus_generation_ = 0;
  bool command_mode_ = false;
  std::string line_;
};

#endif
