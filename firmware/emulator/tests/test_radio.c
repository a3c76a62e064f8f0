/* The nRF24L01 against its product specification. */
#include <string.h>

#include "radio_rig.h"

static void registers(void)
{
    rig g;
    rig_start(&g, 1, 1);
    /* Reset values, table 24 of the product specification. */
    static const uint8_t reset[][2] = {{0x00, 0x08}, {0x01, 0x3f}, {0x02, 0x03}, {0x03, 0x03},
                                       {0x04, 0x03}, {0x05, 0x02}, {0x06, 0x0f}, {0x07, 0x0e},
                                       {0x08, 0x00}, {0x09, 0x00}, {0x0c, 0xc3}, {0x0f, 0xc6},
                                       {0x11, 0x00}, {0x17, 0x11}, {0x1c, 0x00}, {0x1d, 0x00}};
    for (size_t i = 0; i < sizeof reset / sizeof *reset; i++)
        CHECK_NEAR(rig_get(&g, 0, reset[i][0]), reset[i][1], 0);
    uint8_t bytes[5] = {0};
    CHECK(rig_command(&g, 0, NRF_TX_ADDR, bytes, 5) == 0x0e); /* status comes out first */
    CHECK(bytes[0] == 0xe7 && bytes[4] == 0xe7);
    memset(bytes, 0, 5);
    rig_command(&g, 0, NRF_RX_ADDR_P1, bytes, 5);
    CHECK(bytes[0] == 0xc2 && bytes[4] == 0xc2);
    rig_put(&g, 0, NRF_FEATURE, 7); /* locked until ACTIVATE 0x73 */
    CHECK(rig_get(&g, 0, NRF_FEATURE) == 0);
    uint8_t key = 0x73;
    rig_command(&g, 0, 0x50, &key, 1);
    rig_put(&g, 0, NRF_FEATURE, 7);
    CHECK(rig_get(&g, 0, NRF_FEATURE) == 7);
    rig_put(&g, 0, NRF_OBSERVE_TX, 0xff);
    CHECK(rig_get(&g, 0, NRF_OBSERVE_TX) == 0); /* read only */
    for (int i = 0; i < 4; i++)
        rig_payload(&g, 0, 0xa0, 0, 32);
    CHECK((rig_get(&g, 0, NRF_FIFO_STATUS) & 0x30) == 0x20); /* full */
    CHECK(rig_get(&g, 0, NRF_STATUS) & 1);
    rig_command(&g, 0, 0xe1, NULL, 0);
    CHECK(rig_get(&g, 0, NRF_FIFO_STATUS) & 0x10);
    rig_finish(&g);
}

static void exchange(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    rig_payload(&g, 0, 0xa0, 100, 32);
    double begin = g.line.now;
    rig_pulse(&g, 0);
    CHECK(rig_level(&g, 0, RADIO_IRQ) && rig_level(&g, 1, RADIO_IRQ));
    /* Settling 130 us and (1 + 5 + 32 + 2) bytes and 9 bits at 1 Mbit/s. */
    double packet = 130e-6 + 329e-6;
    rig_run(&g, begin + packet + 1e-6 - g.line.now);
    CHECK(!rig_level(&g, 1, RADIO_IRQ) && rig_level(&g, 0, RADIO_IRQ));
    /* The ACK: 130 us, 8 bytes and 9 bits. */
    rig_run(&g, begin + packet + 130e-6 + 73e-6 - 1e-6 - g.line.now);
    CHECK(rig_level(&g, 0, RADIO_IRQ));
    rig_run(&g, 2e-6);
    CHECK(!rig_level(&g, 0, RADIO_IRQ));
    CHECK(rig_get(&g, 0, NRF_STATUS) == 0x2e);
    CHECK(rig_get(&g, 1, NRF_STATUS) == 0x42); /* RX_DR, pipe 1 */
    uint8_t got[32] = {0};
    rig_command(&g, 1, 0x61, got, 32);
    CHECK(got[0] == 100 && got[31] == 131);
    CHECK(rig_get(&g, 1, NRF_FIFO_STATUS) & 1);
    rig_put(&g, 1, NRF_STATUS, 0x40);
    CHECK(rig_level(&g, 1, RADIO_IRQ));
    CHECK(rig_get(&g, 0, NRF_OBSERVE_TX) == 0);
    rig_finish(&g);
}

static void nobody_there(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    rig_set(&g, 1, RADIO_CE, false);
    rig_payload(&g, 0, 0xa0, 1, 32);
    double begin = g.line.now;
    rig_pulse(&g, 0);
    /* 130 us, then six packets with 500 us from the end of one to the begin of the next. */
    double all = 130e-6 + 6 * (329e-6 + 500e-6);
    rig_run(&g, begin + all - 2e-6 - g.line.now);
    CHECK(rig_level(&g, 0, RADIO_IRQ));
    rig_run(&g, 4e-6);
    CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_MAX_RT);
    CHECK(rig_get(&g, 0, NRF_OBSERVE_TX) == 0x15); /* one packet lost, five repeats */
    CHECK(g.air.total.packets == 6);
    CHECK(!(rig_get(&g, 0, NRF_FIFO_STATUS) & 0x10)); /* the payload is kept */
    rig_pulse(&g, 0);
    rig_run(&g, 10e-3);
    CHECK(g.air.total.packets == 6); /* nothing goes while MAX_RT is set */
    rig_put(&g, 0, NRF_STATUS, NRF_MAX_RT);
    rig_set(&g, 1, RADIO_CE, true);
    rig_run(&g, 200e-6);
    rig_pulse(&g, 0);
    rig_run(&g, 2e-3);
    CHECK(rig_get(&g, 1, NRF_STATUS) & NRF_RX_DR);
    rig_finish(&g);
}

/* An ACK is lost: the repeat is recognised, acknowledged, and not handed over twice. */
static void lost_ack(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    rig_payload(&g, 0, 0xa0, 1, 32);
    rig_pulse(&g, 0);
    rig_run(&g, 130e-6 + 329e-6 + 20e-6 - 12e-6); /* the packet has come, its ACK has not begun */
    g.air.loss = 1.0;
    rig_run(&g, 300e-6);
    g.air.loss = 0.0;
    rig_run(&g, 2e-3);
    CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_TX_DS);
    CHECK((rig_get(&g, 0, NRF_OBSERVE_TX) & 15) == 1);
    CHECK(g.radios[1]->total.received == 1 && g.radios[1]->total.repeats == 1);
    uint8_t got[32] = {0};
    rig_command(&g, 1, 0x61, got, 32);
    CHECK(rig_get(&g, 1, NRF_FIFO_STATUS) & 1);
    /* The same bytes again, as a new packet, are another packet. */
    rig_payload(&g, 0, 0xa0, 1, 32);
    rig_pulse(&g, 0);
    rig_run(&g, 2e-3);
    CHECK(g.radios[1]->total.received == 2);

    /* A receiver that leaves receive mode after the first packet makes the sender fail. */
    rig_payload(&g, 0, 0xa0, 50, 32);
    rig_pulse(&g, 0);
    rig_run(&g, 130e-6 + 329e-6 + 20e-6 - 12e-6);
    g.air.loss = 1.0;
    rig_run(&g, 300e-6);
    g.air.loss = 0.0;
    rig_set(&g, 1, RADIO_CE, false);
    rig_put(&g, 0, NRF_STATUS, 0x70);
    rig_run(&g, 10e-3);
    CHECK(g.radios[1]->total.received == 3);
    CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_MAX_RT);
    rig_finish(&g);
}

static void full_fifo(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    for (uint8_t i = 0; i < 3; i++) {
        rig_payload(&g, 0, 0xa0, i, 32);
        rig_pulse(&g, 0);
        rig_run(&g, 2e-3);
    }
    CHECK(rig_get(&g, 1, NRF_FIFO_STATUS) & 2);
    rig_put(&g, 0, NRF_STATUS, 0x70);
    rig_payload(&g, 0, 0xa0, 9, 32);
    rig_pulse(&g, 0);
    rig_run(&g, 10e-3);
    CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_MAX_RT); /* dropped without an ACK */
    CHECK(g.radios[1]->total.full == 6);
    rig_finish(&g);
}

static void rig_activate(rig *g, int i)
{
    uint8_t key = 0x73;
    rig_command(g, i, 0x50, &key, 1);
    rig_put(g, i, NRF_FEATURE, 7);
    rig_put(g, i, NRF_DYNPD, 0x03);
}

static void dynamic(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    rig_activate(&g, 0);
    rig_activate(&g, 1);
    rig_payload(&g, 1, 0xa9, 200, 7); /* waits as ACK payload for pipe 1 */
    rig_payload(&g, 0, 0xa0, 1, 11);
    rig_pulse(&g, 0);
    rig_run(&g, 2e-3);
    uint8_t width = 0;
    rig_command(&g, 1, 0x60, &width, 1);
    CHECK(width == 11);
    uint8_t got[32] = {0};
    rig_command(&g, 1, 0x61, got, 11);
    CHECK(got[0] == 1 && got[10] == 11);
    CHECK(rig_get(&g, 0, NRF_STATUS) == 0x60); /* TX_DS and RX_DR on pipe 0 */
    rig_command(&g, 0, 0x60, &width, 1);
    CHECK(width == 7);
    rig_command(&g, 0, 0x61, got, 7);
    CHECK(got[0] == 200 && got[6] == 206);
    /* The receiver knows that its ACK payload has arrived with the next new packet. */
    CHECK(!(rig_get(&g, 1, NRF_STATUS) & NRF_TX_DS));
    CHECK(!(rig_get(&g, 1, NRF_FIFO_STATUS) & 0x10));
    rig_payload(&g, 0, 0xa0, 30, 4);
    rig_pulse(&g, 0);
    rig_run(&g, 2e-3);
    CHECK(rig_get(&g, 1, NRF_STATUS) & NRF_TX_DS);
    CHECK(rig_get(&g, 1, NRF_FIFO_STATUS) & 0x10);
    /* The ACK with its payload is lost: the repeat brings the same payload again. */
    rig_put(&g, 0, NRF_STATUS, 0x70);
    rig_put(&g, 1, NRF_STATUS, 0x70);
    rig_command(&g, 0, 0xe2, NULL, 0);
    rig_command(&g, 1, 0xe2, NULL, 0);
    rig_payload(&g, 1, 0xa9, 210, 3);
    rig_payload(&g, 0, 0xa0, 40, 4);
    rig_pulse(&g, 0);
    rig_run(&g, 130e-6 + 105e-6 + 20e-6 - 12e-6); /* 12 bytes and 9 bits on the air, and a little */
    g.air.loss = 1.0;
    rig_run(&g, 250e-6);
    g.air.loss = 0.0;
    rig_run(&g, 2e-3);
    CHECK((rig_get(&g, 0, NRF_OBSERVE_TX) & 15) == 1);
    rig_command(&g, 0, 0x61, got, 3);
    CHECK(got[0] == 210 && got[2] == 212);
    CHECK(!(rig_get(&g, 1, NRF_STATUS) & NRF_TX_DS));
    CHECK(!(rig_get(&g, 1, NRF_FIFO_STATUS) & 0x10));
    /* Without ACK: nothing comes back, and the sender does not wait. */
    unsigned long acks = g.radios[1]->total.acks;
    rig_payload(&g, 0, 0xb0, 60, 5);
    rig_pulse(&g, 0);
    rig_run(&g, 2e-3);
    CHECK(g.radios[1]->total.acks == acks && g.radios[1]->total.received == 4);
    CHECK(rig_get(&g, 0, NRF_OBSERVE_TX) == 0);
    rig_finish(&g);
}

static void conditions(void)
{
    rig g;
    rig_start(&g, 2, 1);
    rig_link_up(&g);
    rig_payload(&g, 0, 0xa0, 1, 32);
    rig_set(&g, 0, RADIO_CE, true);
    rig_run(&g, 8e-6);
    rig_set(&g, 0, RADIO_CE, false); /* too short */
    rig_run(&g, 2e-3);
    CHECK(g.air.total.packets == 0 && g.radios[0]->total.short_ce == 1);
    /* Another length, address, channel or rate is not heard. */
    static const struct {
        uint8_t number, value, back;
    } changes[] = {{NRF_RX_PW_P0 + 1, 31, 32}, {NRF_RF_CH, 77, 76}, {NRF_RF_SETUP, 0x0e, 0x06},
                   {NRF_EN_RXADDR, 1, 3},      {NRF_CONFIG, 0x0b, 0x0f}};
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        rig_put(&g, 1, changes[i].number, changes[i].value);
        rig_pulse(&g, 0);
        rig_run(&g, 10e-3);
        CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_MAX_RT);
        rig_put(&g, 1, changes[i].number, changes[i].back);
        rig_put(&g, 0, NRF_STATUS, 0x70);
    }
    /* An ACK comes to pipe 0, which has to have the address that was sent to. */
    rig_address(&g, 0, NRF_RX_ADDR_P0, 0x11);
    rig_pulse(&g, 0);
    rig_run(&g, 10e-3);
    CHECK(rig_get(&g, 0, NRF_STATUS) & NRF_MAX_RT);
    CHECK(g.radios[1]->total.received == 1 && g.radios[1]->total.repeats == 5);
    /* In power-down it neither sends nor hears. */
    rig_put(&g, 0, NRF_STATUS, 0x70);
    rig_put(&g, 0, NRF_CONFIG, 0x0c);
    unsigned long before = g.air.total.packets;
    rig_pulse(&g, 0);
    rig_run(&g, 5e-3);
    CHECK(g.air.total.packets == before);
    /* A receiver that is ready after a packet has begun does not hear it. */
    rig_put(&g, 0, NRF_CONFIG, 0x0e);
    rig_put(&g, 0, NRF_SETUP_RETR, 0);
    rig_run(&g, 2e-3);
    rig_command(&g, 0, 0xe1, NULL, 0);
    rig_command(&g, 1, 0xe2, NULL, 0);
    rig_set(&g, 1, RADIO_CE, false);
    rig_payload(&g, 0, 0xa0, 77, 32);
    rig_pulse(&g, 0);
    rig_run(&g, 130e-6);
    rig_set(&g, 1, RADIO_CE, true);
    rig_run(&g, 2e-3);
    CHECK(g.radios[1]->total.received == 1);
    rig_put(&g, 0, NRF_STATUS, 0x70);

    /* A carrier is seen by a receiver after 128 us. */
    CHECK(rig_get(&g, 1, NRF_CD) == 0);
    rig_pulse(&g, 0);
    rig_run(&g, 130e-6 - 12e-6 + 200e-6);
    CHECK(rig_get(&g, 1, NRF_CD) == 1);
    rig_finish(&g);
}

void test_radio(void)
{
    registers();
    exchange();
    nobody_there();
    lost_ack();
    full_fifo();
    dynamic();
    conditions();
}
