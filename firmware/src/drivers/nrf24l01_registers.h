// Commands, registers and bits of the nRF24L01 (Nordic product specification 2.0, chapters 8 and 9).

#ifndef DRIVERS_NRF24L01_REGISTERS_H
#define DRIVERS_NRF24L01_REGISTERS_H

#include <stdint.h>

namespace nrf {

// Commands (table 16).
constexpr uint8_t r_register = 0x00, w_register = 0x20, r_rx_payload = 0x61, w_tx_payload = 0xA0,
                  flush_tx = 0xE1, flush_rx = 0xE2, nop = 0xFF;

// Registers (table 24).
constexpr uint8_t config = 0x00, en_aa = 0x01, en_rxaddr = 0x02, setup_aw = 0x03, setup_retr = 0x04,
                  rf_ch = 0x05, rf_setup = 0x06, status = 0x07, rx_addr_p0 = 0x0A, rx_addr_p1 = 0x0B,
                  tx_addr = 0x10, rx_pw_p0 = 0x11, rx_pw_p1 = 0x12;

// CONFIG.
constexpr uint8_t prim_rx = 0x01, pwr_up = 0x02, crco = 0x04, en_crc = 0x08;
// STATUS: bits 1 to 3 are the pipe of the waiting payload, 7 = none.
constexpr uint8_t max_rt = 0x10, tx_ds = 0x20, rx_dr = 0x40, rx_pipe = 0x0E;

}  // namespace nrf

#endif
