// Pin map of the three boards (ATmega644V, 4 MHz crystal, 40-pin DIP). PROTOCOL.md shows it as a table.
//
// Only numbers: no register is named here, so that host tests and the emulation can read it as well.
// Source of the assignments: ATmega644 data sheet (2593), "Pin Configurations": ICP1 is PD6, ADC0..7 are
// PORTA, RXD0/TXD0 are PD0/PD1. The reference's wiring (App. A) is only drawn; this map is our own.

#ifndef PINS_H
#define PINS_H

namespace pins {

// PORTA: analogue inputs, reference AVCC (the sensors are ratiometric and share that supply).
constexpr unsigned char adc_wheel = 0;          // PA0, both slaves
constexpr unsigned char adc_chassis = 1;        // PA1, both slaves
constexpr unsigned char adc_potentiometer = 2;  // PA2, Slave 1: rate knob

// PORTB: nRF24L01 on a bit-banged SPI port, all boards.
constexpr unsigned char radio_ce = 0;    // PB0
constexpr unsigned char radio_csn = 1;   // PB1
constexpr unsigned char radio_sck = 2;   // PB2
constexpr unsigned char radio_mosi = 3;  // PB3
constexpr unsigned char radio_miso = 4;  // PB4

// PORTC: lights of Slave 1. PC2..PC5 belong to JTAG until the program turns it off.
constexpr unsigned char bar_first = 0;  // PC0..PC4: LED bar, 50, 100, 200, 400, 800 Hz, lit when high
constexpr unsigned char bar_count = 5;  //
constexpr unsigned char row_mark =
    6;  // PC6, both slaves: high while the converter works on a row (test point)
constexpr unsigned char status_light = 7;  // PC7, Slave 1: status LED, lit when high

// PORTD: serial link, radio interrupt, button, wire.
constexpr unsigned char rxd = 0;          // PD0, Slave 1 (from the modem's DO) and Master (from the laptop)
constexpr unsigned char txd = 1;          // PD1, Slave 1 (to the modem's DI) and Master (to the laptop)
constexpr unsigned char button = 2;       // PD2, Slave 1: push button to ground, pull-up on
constexpr unsigned char radio_irq = 3;    // PD3 (INT1), all boards: nRF24L01 IRQ, active low
constexpr unsigned char modem_cts = 4;    // PD4, Slave 1: modem pin 1, low = may send; pull-up on
constexpr unsigned char synch_out = 5;    // PD5, Slave 1: drives the synch wire
constexpr unsigned char synch_in = 6;     // PD6 (ICP1), both slaves: the synch wire, rising edge
constexpr unsigned char modem_sleep = 7;  // PD7, Slave 1: modem pin 2, high = pin sleep

}  // namespace pins

#endif
