// Slave 2's side of the synchronisation: captures what it is told to, and answers for it. See synch.h.

#ifndef CONTROL_SYNCH_FOLLOWER_H
#define CONTROL_SYNCH_FOLLOWER_H

#include "control/synch.h"
#include "drivers/radio_mail.h"
#include "protocol/bytes.h"
#include "sampling/sampler.h"

class synch_follower {
 public:
  synch_follower(radio_mail &mail, nrf24l01 &chip, sampler &rows)
      : mail_(mail), chip_(chip), sampler_(rows) {}

  /// For the run to come.
  void prepare(uint16_t prescale, uint16_t cycles, uint8_t readings, uint32_t end_row);
  void forget();

  /// ARM: the next edge of the wire is pulse `number`.
  void arm(uint8_t number);
  /// Answers TIME.
  void write_time(uint8_t number, byte_writer &out) const;
  /// LISTEN: hears beacons from when the reply has gone.
  void listen(moment now);
  /// A beacon came.
  void beacon(uint8_t number);
  /// Answers BEACONS.
  void write_beacons(byte_writer &out) const;
  /// BEGIN: the start mark. False when it is past.
  bool begin_at(tick mark);
  /// CLOSE: the end mark by radio (0: as captured) and the shift of the start mark.
  void close(tick end_mark, int16_t shift);

  void poll(moment now);

  uint8_t last_captured() const { return captured_; }
  uint16_t lead() const { return static_cast<uint16_t>(lead_ - static_cast<uint16_t>(shift_)); }
  tick elapsed() const { return end_mark_ - start_mark_ - static_cast<tick>(static_cast<int32_t>(shift_)); }
  uint32_t mark_row() const { return mark_row_; }

 private:
  void capture(tick at);
  void begin_rows();
  void set_end_mark(tick at);

  radio_mail &mail_;
  nrf24l01 &chip_;
  sampler &sampler_;
  uint16_t lead_ = 0;
  uint16_t cycles_ = 0;
  uint8_t readings_ = 4;
  uint32_t end_row_ = no_row;
  uint8_t armed_ = 0;     // number of the pulse awaited, 0 none
  uint8_t captured_ = 0;  // number of the last one captured; trigger only when the rows began
  bool begin_waits_ = false;
  tick origin_ = 0;
  tick captured_at_ = 0;
  tick start_mark_ = 0;
  tick end_mark_ = 0;
  uint32_t mark_row_ = 0;
  int16_t shift_ = 0;

  enum class ear : uint8_t { closed, opening, open };
  ear ear_ = ear::closed;
  moment opened_ = 0;
  uint8_t heard_ = 0;
  tick heard_at_[beacon_count] = {};
};

#endif
