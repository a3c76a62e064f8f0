// The seam between the portable program and its board: AVR code in boards/avr/, a made-up board in tests/.
//
// Nothing here waits longer than the transfer or the conversion that it names. Register names are those of
// the ATmega644 data sheet (2593).

#ifndef BOARDS_HARDWARE_H
#define BOARDS_HARDWARE_H

#include <stdint.h>

#include "units.h"

namespace hardware {

/// CPU cycles from a row's compare match to the start of its first conversion: interrupt response, jump,
/// registers saved, tests. Counted in the listing of TIMER1_COMPA and confirmed in emulation (13.5 us); one
/// to three more where an instruction was running.
constexpr uint16_t row_latency = 54;

// Time.
uint16_t timer();                        ///< Timer 1's count (TCNT1)
void timer_prescale(uint16_t prescale);  ///< 1, 8, 64, 256 or 1024 (TCCR1B)
void compare_afresh(uint16_t count);  ///< OCR1A: the next row's interrupt; forgets a match that waits (OCF1A)
void compare_interrupt(bool on);      ///< TIMSK1
moment clock();                       ///< Timer 0 at 1/1024, extended; to be read at least every 60 ms
uint8_t lock();                       ///< interrupts off; returns what unlock() wants
void unlock(uint8_t before);

// Converter. What a row does with it is given to the sampler's interrupts as a class, so that they can inline
// it.
void converter_off();
int16_t knob();  ///< potentiometer, averaged; -1 when the converter did not answer. Not while rows are taken

// Synch wire (ICP1, data sheet 13.6).
void capture_clear();
bool captured(uint16_t &count);  ///< a rising edge came since capture_clear(); its timer count
void wire_pulse();               ///< 20 us high

// Radio lines other than SPI.
void radio_enable(bool on);  ///< CE
bool radio_irq();            ///< true when IRQ is active (low)
void stamp_on(bool on);      ///< notes the timer's count at IRQ's falling edges (INT1)
bool stamped(uint16_t &count);

// Slave 1's driver and modem.
bool button();  ///< true while pressed
void lights(uint8_t bar, bool status);
void modem_sleep(bool asleep);
void serial_quiet(bool on);  ///< no receive interrupt while rows are taken: it would move a row by 10 us

uint16_t ram_never_used();  ///< bytes between the data and the deepest stack so far

}  // namespace hardware

/// Interrupts are off as long as it lives. For a few instructions only: rows wait.
class interrupt_lock {
 public:
  interrupt_lock() : before_(hardware::lock()) {}
  ~interrupt_lock() { hardware::unlock(before_); }
  interrupt_lock(const interrupt_lock &) = delete;
  interrupt_lock &operator=(const interrupt_lock &) = delete;

 private:
  uint8_t before_;
};

#endif
