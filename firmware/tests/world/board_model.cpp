#include "world/board_model.h"

#include <algorithm>
#include <cmath>

#include "boards/hardware.h"

namespace {

board_model *running = nullptr;

/// What the sampler's interrupts do with the converter.
struct model_converter {
  static void begin() { this_board().convert(); }
  static void chassis_next() { this_board().chassis_next(); }
  static void last_one() { this_board().last_one(); }
  static void end() { this_board().converter_off(); }
  static void compare_at(uint16_t count) { this_board().compare_at(count); }
};

}  // namespace

board_model &this_board() { return *running; }

uint8_t chip_bus::transfer_bytes(uint8_t *bytes, uint8_t size, uint8_t) {
  chip_.transfer(bytes, size);
  return 0;
}

board_model::board_model(world &w_, air &a, double ppm)
    : w(w_),
      chip(w_, a),
      bus(chip),
      room(static_cast<size_t>(ring_bytes)),
      store(room.data(), ring_rows * channels),
      hz_(cpu_hz * (1 + ppm * 1e-6)) {
  reset();
  chip.on_irq = [this] {
    if (!stamping_) return;
    stamp_ = timer();
    stamp_fresh_ = true;
  };
}

void board_model::as_this(const std::function<void()> &what) {
  board_model *before = running;
  running = this;
  what();
  running = before;
}

void board_model::reset() {
  power_off();
  std::fill(room.begin(), room.end(), uint8_t{0});
  radio.emplace(bus, uint8_t{0});
  rows.emplace(store);
  capture_fresh_ = stamp_fresh_ = stamping_ = false;
}

void board_model::run(std::function<void(moment)> poll) {
  poll_ = std::move(poll);
  ++life_;
  schedule_poll();
}

void board_model::power_off() {
  ++life_;
  compare_on_ = false;
  ++compare_generation_;
  ++conversion_generation_;
}

void board_model::schedule_poll() {
  w.at(w.now() + w.between(100 * us, 1500 * us), [this, life = life_] {
    if (life != life_) return;
    as_this([this] { poll_(clock()); });
    schedule_poll();
  });
}

uint64_t board_model::ticks() const {
  const double cycles_since = static_cast<double>(w.now() - time_base_) * 1e-9 * hz_;
  return tick_base_ + static_cast<uint64_t>(std::floor(cycles_since / prescale_ + 1e-6));
}

nanoseconds board_model::time_of(uint64_t count) const {
  return time_base_ +
         static_cast<nanoseconds>(std::ceil(static_cast<double>(count - tick_base_) * prescale_ * 1e9 / hz_));
}

uint16_t board_model::timer() const { return static_cast<uint16_t>(ticks()); }

moment board_model::clock() const {
  return static_cast<moment>(static_cast<double>(w.now()) * 1e-9 * hz_ / 1024);
}

void board_model::set_prescale(uint16_t prescale) {
  tick_base_ = ticks();
  time_base_ = w.now();
  prescale_ = prescale;
  schedule_compare();
}

void board_model::compare_at(uint16_t count) {
  compare_ = count;
  schedule_compare();
}

void board_model::compare_interrupt(bool on) {
  compare_on_ = on;
  schedule_compare();
}

void board_model::schedule_compare() {
  const uint64_t mine = ++compare_generation_;
  const uint64_t present = ticks();
  uint64_t match = (present & ~uint64_t{0xFFFF}) | compare_;
  if (match <= present) match += 0x10000;
  w.at(time_of(match) + interrupt_late, [this, mine] {
    if (mine != compare_generation_ || !compare_on_) return;
    as_this([this] { rows->compare<model_converter>(); });
  });
}

void board_model::convert() {
  row_times.push_back(w.now());
  next_channel_ = 0;
  another_ = true;
  conversion_ends(w.now() + cycles(25 * 32), w.now() + cycles(13.5 * 32), 0, ++conversion_generation_);
}

void board_model::conversion_ends(nanoseconds end, nanoseconds hold, int channel, uint64_t generation) {
  w.at(end, [this, end, hold, channel, generation] {
    if (generation != conversion_generation_) return;
    // Free running: the next conversion has begun with the channel selected before this one's interrupt.
    if (another_) conversion_ends(end + cycles(13 * 32), end + cycles(1.5 * 32), next_channel_, generation);
    holds.emplace_back(channel, hold);
    const double value = sensor(channel, static_cast<double>(hold) * 1e-9);
    const double clipped = std::min(1023.0, std::max(0.0, std::floor(value)));
    as_this([this, clipped] { rows->conversion<model_converter>(static_cast<uint16_t>(clipped)); });
  });
}

void board_model::pulse() {
  for (board_model *other : wire) other->edge();
}

void board_model::edge() {
  capture_ = timer();
  capture_fresh_ = true;
}

bool board_model::take_capture(uint16_t &count) {
  if (!capture_fresh_) return false;
  capture_fresh_ = false;
  count = capture_;
  return true;
}

void board_model::stamp_on(bool on) {
  stamping_ = on;
  stamp_fresh_ = false;
}

bool board_model::take_stamp(uint16_t &count) {
  const bool fresh = stamp_fresh_;
  stamp_fresh_ = false;
  count = stamp_;
  return fresh;
}

// --- the seam
// --------------------------------------------------------------------------------------------------------

namespace hardware {

uint16_t timer() { return running->timer(); }
void timer_prescale(uint16_t prescale) { running->set_prescale(prescale); }
void compare_afresh(uint16_t count) { running->compare_at(count); }
void compare_interrupt(bool on) { running->compare_interrupt(on); }
moment clock() { return running->clock(); }
uint8_t lock() { return 0; }
void unlock(uint8_t) {}
void converter_off() { running->converter_off(); }
int16_t knob() { return running->knob; }
void capture_clear() { running->clear_capture(); }
bool captured(uint16_t &count) { return running->take_capture(count); }
void wire_pulse() { running->pulse(); }
void radio_enable(bool on) { running->chip.enable(on); }
bool radio_irq() { return running->chip.irq(); }
void stamp_on(bool on) { running->stamp_on(on); }
bool stamped(uint16_t &count) { return running->take_stamp(count); }
bool button() { return running->button_down; }
void lights(uint8_t bar, bool status) {
  if (status != running->status) running->status_changes.emplace_back(running->w.now(), status);
  running->bar = bar;
  running->status = status;
}
void modem_sleep(bool asleep) { running->modem_asleep = asleep; }
void serial_quiet(bool on) { running->serial_quiet = on; }
uint16_t ram_never_used() { return 0; }

}  // namespace hardware
