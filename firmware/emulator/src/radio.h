/* nRF24L01 (Nordic product specification 2.0, July 2007; not the later "+").
 *
 * Registers, commands over a bit-banged SPI port, FIFOs, Enhanced ShockBurst with ACK, ACK payload,
 * dynamic payload length, retransmission and MAX_RT. What is on the air is in air.h. */
#ifndef EMULATOR_RADIO_H
#define EMULATOR_RADIO_H

#include <stdbool.h>
#include <stdint.h>

#include "air.h"
#include "board.h"
#include "wire.h"

#define RADIO_PAYLOAD 32
#define RADIO_FIFO 3
#define RADIO_REGISTERS 0x20

enum { RADIO_CE, RADIO_CSN, RADIO_SCK, RADIO_MOSI, RADIO_MISO, RADIO_IRQ, RADIO_PINS };

typedef enum radio_state {
    RADIO_POWER_DOWN,
    RADIO_STARTING, /* crystal, 1.5 ms */
    RADIO_STANDBY,
    RADIO_SETTLING_RX, /* 130 us */
    RADIO_RECEIVING,
    RADIO_SETTLING_TX,
    RADIO_SENDING,
    RADIO_AWAITING_ACK,
    RADIO_SETTLING_ACK, /* a receiver on its way to send its ACK */
    RADIO_SENDING_ACK,
} radio_state;

typedef struct radio_payload {
    uint8_t bytes[RADIO_PAYLOAD];
    uint8_t length, pipe;
    bool no_ack;
} radio_payload;

typedef struct radio {
    board *board;
    air *air;
    chance chance;
    struct {
        wire *wire;
        int device;
    } pins[RADIO_PINS];

    radio_state state;
    uint8_t registers[RADIO_REGISTERS];
    uint8_t address_0[5], address_1[5], address_tx[5];
    bool activated; /* commands and registers unlocked by ACTIVATE */
    radio_payload tx[RADIO_FIFO], rx[RADIO_FIFO];
    int tx_count, rx_count;
    bool reuse; /* REUSE_TX_PL: the last payload stays */

    bool ce, csn, sck, mosi;
    double ce_rose;       /* s */
    double listening;     /* s: in receive mode since */
    double carrier_since; /* s: something has been on the channel since; infinity when not */
    uint8_t pid, retries;
    struct {
        bool any;
        uint8_t pid;
        uint16_t check;
    } last; /* packet received, to tell repeats */
    radio_payload ack;  /* on its way */
    bool ack_pending;   /* an ACK payload has been sent and not yet confirmed */
    uint8_t ack_pipe;

    uint8_t shift_in, shift_out, command, args[RADIO_PAYLOAD];
    int bits, bytes;

    struct {
        unsigned long sent, retransmitted, delivered, failed; /* as sender */
        unsigned long received, repeats, full, acks;          /* as receiver */
        unsigned long short_ce, spi_bytes;
    } total;
} radio;

/* Mounts a radio; `pins` are wires in the order of the enumeration, IRQ may be NULL. */
radio *radio_new(board *b, air *medium, wire *const pins[RADIO_PINS]);

void radio_free(radio *r);

/* Used by air.c: a packet has arrived undamaged at a radio that was listening. */
void radio_hear(radio *r, const air_packet *p, double time);

/* Used by air.c: the own packet has left the antenna. */
void radio_sent(radio *r, double time);

/* In radio_link.c: settles and then sends the first payload, or listens; takes back what is due. */
void radio_send(radio *r, double time);
void radio_listen(radio *r, double time);
void radio_cancel(radio *r);

/* Used by radio_link.c. */
void radio_enter(radio *r, radio_state state);
void radio_standby(radio *r, double time); /* where it goes when nothing is under way */
void radio_flag(radio *r, uint8_t bits, double time); /* raises flags of STATUS */

/* Used by radio_spi.c. */
void radio_power_changed(radio *r, double time); /* CONFIG or CE */
void radio_update_irq(radio *r, double time);
uint8_t radio_status(const radio *r);
int radio_address_width(const radio *r);
void radio_flush_tx(radio *r);
void radio_drop_tx(radio *r, int index); /* takes one payload out of the TX FIFO */

/* In radio_spi.c. */
void radio_spi_select(radio *r, bool csn, double time);
void radio_spi_clock(radio *r, bool sck, double time);

/* Registers and bits. */
enum {
    NRF_CONFIG = 0x00,
    NRF_EN_AA = 0x01,
    NRF_EN_RXADDR = 0x02,
    NRF_SETUP_AW = 0x03,
    NRF_SETUP_RETR = 0x04,
    NRF_RF_CH = 0x05,
    NRF_RF_SETUP = 0x06,
    NRF_STATUS = 0x07,
    NRF_OBSERVE_TX = 0x08,
    NRF_CD = 0x09,
    NRF_RX_ADDR_P0 = 0x0a,
    NRF_RX_ADDR_P1 = 0x0b,
    NRF_RX_ADDR_P5 = 0x0f,
    NRF_TX_ADDR = 0x10,
    NRF_RX_PW_P0 = 0x11,
    NRF_FIFO_STATUS = 0x17,
    NRF_DYNPD = 0x1c,
    NRF_FEATURE = 0x1d,

    NRF_PRIM_RX = 0x01,
    NRF_PWR_UP = 0x02,
    NRF_CRC_TWO = 0x04,
    NRF_CRC_ON = 0x08,
    NRF_RX_DR = 0x40,
    NRF_TX_DS = 0x20,
    NRF_MAX_RT = 0x10,
    NRF_INTERRUPTS = 0x70,
    NRF_RATE_2M = 0x08,
    NRF_EN_DPL = 0x04,
    NRF_EN_ACK_PAY = 0x02,
    NRF_EN_DYN_ACK = 0x01,
};

#endif
