// The three programs: compiled with MASTER, SLAVE_1 or SLAVE_2 defined.

#include <avr/interrupt.h>
#include <avr/io.h>

#include "boards/avr/bits.h"
#include "boards/hardware.h"
#include "drivers/nrf24l01.h"
#include "drivers/spi_bb_port.h"
#include "pins.h"

#if defined(MASTER)
#include "boards/avr/nb_uart.h"
#include "control/master.h"
#elif defined(SLAVE_1)
#include "boards/avr/avr_9xstream.h"
#include "control/slave_1.h"
#elif defined(SLAVE_2)
#include "control/slave_2.h"
#else
#error "define MASTER, SLAVE_1 or SLAVE_2"
#endif

#ifndef MASTER
#include "boards/avr/converter.h"
#include "sampling/sampler.h"

static uint8_t room[ring_bytes];
static array10bits store(room, ring_rows *channels);
static sampler rows(store);

ISR(TIMER1_COMPA_vect) { rows.compare<converter>(); }

ISR(ADC_vect) { rows.conversion<converter>(ADC); }
#endif

static void set_up_pins() {
  // JTAG off: two writes within four cycles (data sheet 23.6), else PC2..PC5 are its own.
  MCUCR = bit(JTD);
  MCUCR = bit(JTD);
  PORTB = bit(pins::radio_csn);
  DDRB = bit(pins::radio_ce) | bit(pins::radio_csn) | bit(pins::radio_sck) | bit(pins::radio_mosi);
  DDRC = bit(pins::row_mark);
#ifdef SLAVE_1
  DDRC = 0x1F << pins::bar_first | bit(pins::row_mark) | bit(pins::status_light);
  set_bits(DDRD, bit(pins::synch_out));
  set_bits(PORTD, bit(pins::button));
#endif
  DIDR0 = 0x07;                    // no digital inputs on the analogue pins
  TCCR0B = bit(CS02) | bit(CS00);  // 1/1024
}

static spi_bb_port spi(&PINB, &PORTB, &DDRB, bit(pins::radio_sck), bit(pins::radio_mosi),
                       bit(pins::radio_miso));
static nrf24l01 radio(spi, 0);
#if defined(MASTER)
static nb_uart laptop(uart::divisor_9600);
static master program(laptop, radio);
#elif defined(SLAVE_1)
static avr_9xstream modem;
static slave_1 program(modem, radio, store, rows);
#else
static slave_2 program(radio, store, rows);
#endif

int main() {
  set_up_pins();
  spi.add_slave(bit(pins::radio_csn), 0);
  sei();
  program.start(hardware::clock());
  for (;;) program.poll(hardware::clock());
}
