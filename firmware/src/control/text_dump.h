// The reference's text dump with all four channels: index from 1, front wheel, front chassis, rear wheel,
// rear chassis.
//
// Slave 1 has room for one block only, so it fetches ten of Slave 2's rows at a time while it prints ten of
// its own. Comment lines before give the actual rate, the channels' delays and the rear clock, as `bayes-asv`
// reads them.

#ifndef CONTROL_TEXT_DUMP_H
#define CONTROL_TEXT_DUMP_H

#include "drivers/radio_mail.h"
#include "protocol/block.h"
#include "protocol/serial_line.h"
#include "units.h"

class text_dump {
 public:
  text_dump(serial_line &line, radio_mail &mail, const block &own) : line_(line), mail_(mail), own_(own) {}

  /// `facts` of the own block; `elapsed_there` ticks of Slave 2 between the marks, 0 when not known.
  void start(const run_facts &facts, tick elapsed_there, moment now);
  bool busy() const { return busy_; }
  void forget() { busy_ = false; }
  void received(const frame &f);
  void poll(moment now);

 private:
  bool write_comment(uint8_t number, char *out) const;
  void write_row(char *out) const;
  void say(const char *flash_text);

  serial_line &line_;
  radio_mail &mail_;
  const block &own_;
  const run_facts *facts_ = nullptr;
  tick elapsed_there_ = 0;
  bool busy_ = false;
  uint8_t comment_ = 0;
  uint16_t row_ = 0;
  bool have_ = false;  // ten rows of Slave 2, from rear_first_ on
  uint16_t rear_first_ = 0;
  uint8_t rear_[row_frame_bytes];
  uint8_t tries_ = 0;
  uint8_t seq_ = 0;
  moment asked_at_ = 0;
};

#endif
