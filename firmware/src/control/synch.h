// Slave 1's side of the synchronisation (reference 6.3.2, class `synch` of App. B.25): brings the rows of
// both boards to one start, and marks the end of a run so that the drift between the crystals can be taken
// out.
//
// Six steps by wire: 1, 2 a pulse that sets both clocks to zero; 3, 4 a pulse that measures what is left
// between them; 5, 6 the pulse that starts the rows. The short form has only the last. By radio, packets
// without ACK take the wire's place: the sender's TX_DS and the receiver's RX_DR mark the same instant.
// Departure: "setting a clock to zero" is a subtraction; Timer 1 itself is never written to.

#ifndef CONTROL_SYNCH_H
#define CONTROL_SYNCH_H

#include "control/beacon_clock.h"
#include "drivers/exchange.h"
#include "drivers/nrf24l01.h"
#include "protocol/messages.h"
#include "sampling/sampler.h"
#include "units.h"

enum class synch_method : uint8_t { six_steps = 0, short_form = 1, by_radio = 2 };

namespace pulse {
constexpr uint8_t reset = 1, check = 2, trigger = 3, end = 4;
}

constexpr uint32_t lead_cycles =
    16000;  // 4 ms from the start mark to row 0: time to see the mark on both boards

class synch {
 public:
  enum class outcome : uint8_t { idle, working, done, failed };

  synch(exchange &radio, radio_mail &mail, nrf24l01 &chip, sampler &rows)
      : exchange_(radio), mail_(mail), chip_(chip), sampler_(rows) {}

  /// Begins the steps that end with the rows running on both boards.
  void start(synch_method method, uint16_t prescale, uint16_t cycles, uint8_t readings, uint32_t end_row,
             moment now);
  /// Begins to mark the end of the run.
  void mark_end(moment now);
  void forget();

  outcome poll(moment now);
  /// True when the end was marked by radio because the wire failed after the start; failure() says how.
  bool fell_back() const { return fell_back_; }
  /// After `failed`, or fallen back: which event to tell.
  event_code failure() const { return failure_; }
  uint8_t failed_board() const { return failed_board_; }

  /// Ticks from the start mark to row 0.
  uint16_t lead() const { return static_cast<uint16_t>(lead_cycles / prescale_); }
  /// Steps 3 and 4: Slave 2's clock minus ours; not_measured in the other methods.
  int16_t difference() const { return difference_; }
  /// Ticks from start mark to end mark, here and there; there 0 when only Slave 2 knows.
  tick elapsed() const { return end_mark_ - start_mark_; }
  tick elapsed_there() const { return elapsed_there_; }
  /// Number of the last row that had begun at the end mark.
  uint32_t mark_row() const { return mark_row_; }
  /// By radio: the end mark on Slave 2's clock, and by how much its start mark came late (ticks).
  tick end_mark_there() const { return end_mark_there_; }
  int16_t shift() const { return shift_; }

 private:
  enum class step : uint8_t {
    idle,
    arming,
    capturing,
    asking,
    listening,
    settling,
    beaconing,
    fetching,
    beginning,
    nearing
  };

  void arm(uint8_t number, moment now);
  void ask_time(uint8_t number, moment now);
  void ask_again(moment now);
  void listen(moment now);
  void fail(event_code code, uint8_t board);
  void fail_wire(uint8_t board, moment now);
  void poll_capture(moment now);
  void poll_time(moment now);
  void poll_beacons(moment now);
  void poll_fetched(moment now);
  void poll_beginning(moment now);
  void begin_by_radio(moment now);
  void begin_rows(moment now);
  void set_end_mark(tick at);
  bool answered(exchange::state state);

  exchange &exchange_;
  radio_mail &mail_;
  nrf24l01 &chip_;
  sampler &sampler_;

  outcome outcome_ = outcome::idle;
  step step_ = step::idle;
  synch_method method_ = synch_method::six_steps;
  bool at_end_ = false;
  bool fell_back_ = false;
  uint16_t prescale_ = 1;
  uint16_t cycles_ = 0;
  uint8_t readings_ = 4;
  uint32_t end_row_ = no_row;
  uint8_t number_ = 0;  // of the pulse or the beacon
  uint8_t tries_ = 0;
  uint8_t asked_ = 0;
  moment since_ = 0;
  event_code failure_ = event_code::no_answer;
  uint8_t failed_board_ = 0;

  tick origin_ = 0;
  tick checked_ = 0;
  tick start_mark_ = 0;
  tick end_mark_ = 0;
  tick elapsed_there_ = 0;
  uint32_t mark_row_ = 0;
  int16_t difference_ = 0;
  tick end_mark_there_ = 0;
  int16_t shift_ = 0;
  tick start_there_ = 0;
  beacon_clock beacons_;
  common_instant first_;  // from the beacons before the run
};

#endif
