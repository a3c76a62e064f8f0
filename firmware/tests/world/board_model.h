// One board as the portable program sees it: timers, converter, wire, radio, button and lights, on its own
// crystal.
//
// The program's poll() runs every 0.1 to 1.5 ms, as long as a pass takes on the chip; interrupts come in
// between, at their own times. `hardware::` functions act on the board whose code is running.

#ifndef WORLD_BOARD_MODEL_H
#define WORLD_BOARD_MODEL_H

#include <functional>
#include <optional>
#include <vector>

#include "drivers/nrf24l01.h"
#include "sampling/sampler.h"
#include "world/air.h"
#include "world/world.h"

class board_model;

/// SPI to the board's radio chip.
class chip_bus : public spi_bus {
 public:
  explicit chip_bus(radio_chip &chip) : chip_(chip) {}
  uint8_t transfer_bytes(uint8_t *bytes, uint8_t size, uint8_t slave_num) override;

 private:
  radio_chip &chip_;
};

class board_model {
 public:
  board_model(world &w, air &a, double ppm);

  /// Fresh memory and driver objects, as after a reset; the radio chip keeps its power.
  void reset();
  /// Starts the program: `poll` runs again and again until power_off() or reset().
  void run(std::function<void(moment)> poll);
  void power_off();
  /// Runs `what` as code of this board.
  void as_this(const std::function<void()> &what);

  /// Counts of a sensor, 0 to 1023, at a time in seconds; channel 0 wheel, 1 chassis.
  std::function<double(int, double)> sensor = [](int channel, double) {
    return channel == 0 ? 560.0 : 640.0;
  };
  bool button_down = false;
  int16_t knob = 1000;
  uint8_t bar = 0;
  bool status = false;
  std::vector<std::pair<nanoseconds, bool>> status_changes;
  bool modem_asleep = false;
  bool serial_quiet = false;
  /// Boards that get the pulse of this one (itself among them).
  std::vector<board_model *> wire;
  nanoseconds interrupt_late = 0;  // delay of the compare interrupt, for overruns

  std::vector<nanoseconds> row_times;              // of converter_begin
  std::vector<std::pair<int, nanoseconds>> holds;  // channel and instant of each sample-and-hold

  world &w;
  radio_chip chip;
  chip_bus bus;
  std::optional<nrf24l01> radio;
  std::vector<uint8_t> room;
  array10bits store;
  std::optional<sampler> rows;

  // --- what hardware:: and the fake converter do ---
  uint16_t timer() const;
  void set_prescale(uint16_t prescale);
  void compare_at(uint16_t count);
  void compare_interrupt(bool on);
  moment clock() const;
  void pulse();
  void edge();
  void convert();
  void chassis_next() { next_channel_ = 1; }
  void last_one() { another_ = false; }
  void converter_off() { ++conversion_generation_; }
  void stamp_on(bool on);
  bool take_capture(uint16_t &count);
  bool take_stamp(uint16_t &count);
  void clear_capture() { capture_fresh_ = false; }

 private:
  uint64_t ticks() const;
  nanoseconds time_of(uint64_t count) const;
  nanoseconds cycles(double count) const { return static_cast<nanoseconds>(count * 1e9 / hz_); }
  void schedule_poll();
  void schedule_compare();
  void conversion_ends(nanoseconds begin, nanoseconds hold, int channel, uint64_t generation);

  double hz_;
  std::function<void(moment)> poll_;
  uint64_t life_ = 0;
  uint16_t prescale_ = 1;
  uint64_t tick_base_ = 0;
  nanoseconds time_base_ = 0;
  uint16_t compare_ = 0;
  bool compare_on_ = false;
  uint64_t compare_generation_ = 0;
  uint64_t conversion_generation_ = 0;
  int next_channel_ = 0;
  bool another_ = false;
  bool capture_fresh_ = false;
  uint16_t capture_ = 0;
  bool stamping_ = false;
  bool stamp_fresh_ = false;
  uint16_t stamp_ = 0;
};

/// The board whose code runs.
board_model &this_board();

#endif
