/* Enhanced ShockBurst: what a radio sends and hears (product specification 2.0, chapter 6). */
#include "radio.h"

#include <math.h>
#include <string.h>

#define SETTLING 130e-6 /* s, table 13 */
#define ARD_STEP 250e-6 /* s */
#define PIPES 6

static void pipe_address(const radio *r, int pipe, uint8_t address[5])
{
    memcpy(address, pipe == 0 ? r->address_0 : r->address_1, 5);
    if (pipe > 1)
        address[0] = r->registers[NRF_RX_ADDR_P0 + pipe]; /* lowest byte differs */
}

static bool dynamic_length(const radio *r, int pipe)
{
    return r->registers[NRF_FEATURE] & NRF_EN_DPL && r->registers[NRF_DYNPD] >> pipe & 1;
}

/* ---- the packet on the air ---- */

static air_packet frame(const radio *r)
{
    uint8_t config = r->registers[NRF_CONFIG];
    bool enhanced = r->registers[NRF_EN_AA] != 0;
    return (air_packet){
        .channel = r->registers[NRF_RF_CH],
        .address_width = (uint8_t)radio_address_width(r),
        .crc_bytes = config & NRF_CRC_ON || enhanced ? (config & NRF_CRC_TWO ? 2 : 1) : 0,
        .rate_mbit = r->registers[NRF_RF_SETUP] & NRF_RATE_2M ? 2 : 1,
        .enhanced = enhanced,
    };
}

static void load(air_packet *p, const radio_payload *payload)
{
    p->length = payload->length;
    memcpy(p->payload, payload->bytes, payload->length);
}

static void transmit(void *owner, double time)
{
    radio *r = owner;
    if (r->state != RADIO_SETTLING_TX)
        return;
    air_packet p = frame(r);
    memcpy(p.address, r->address_tx, 5);
    p.pid = r->pid;
    p.no_ack = r->tx[0].no_ack;
    load(&p, &r->tx[0]);
    r->total.sent++;
    r->total.retransmitted += r->retries > 0;
    radio_enter(r, RADIO_SENDING);
    air_send(r->air, r, &p, time);
}

void radio_send(radio *r, double time)
{
    radio_enter(r, RADIO_SETTLING_TX);
    queue_add(&r->air->line->calls, time + SETTLING, transmit, r);
}

/* ---- sender ---- */

static bool wants_ack(const radio *r)
{
    return r->registers[NRF_EN_AA] & 1 && !r->tx[0].no_ack;
}

static void delivered(radio *r, double time)
{
    r->total.delivered++;
    r->registers[NRF_OBSERVE_TX] =
        (uint8_t)((r->registers[NRF_OBSERVE_TX] & 0xf0) | r->retries);
    if (!r->reuse)
        radio_drop_tx(r, 0);
    r->pid = (r->pid + 1) & 3;
    r->retries = 0;
    radio_flag(r, NRF_TX_DS, time);
    radio_standby(r, time);
}

static void ack_missed(void *owner, double time)
{
    radio *r = owner;
    if (r->state != RADIO_AWAITING_ACK)
        return;
    if (r->retries < (r->registers[NRF_SETUP_RETR] & 15)) {
        r->retries++;
        /* The delay counts from the end of one packet to the begin of the next. */
        radio_enter(r, RADIO_SETTLING_TX);
        transmit(r, time);
        return;
    }
    uint8_t lost = r->registers[NRF_OBSERVE_TX] >> 4;
    r->registers[NRF_OBSERVE_TX] = (uint8_t)((lost < 15 ? lost + 1 : 15) << 4 | r->retries);
    r->total.failed++;
    r->retries = 0;
    radio_flag(r, NRF_MAX_RT, time); /* the payload stays in the FIFO */
    radio_standby(r, time);
}

static void ack_listen(void *owner, double time)
{
    radio *r = owner;
    if (r->state == RADIO_AWAITING_ACK)
        r->listening = time;
}

void radio_sent(radio *r, double time)
{
    if (r->state == RADIO_SENDING_ACK) {
        radio_standby(r, time); /* and, with CE high, back to receiving */
    } else if (r->state == RADIO_SENDING && !wants_ack(r)) {
        delivered(r, time);
    } else if (r->state == RADIO_SENDING) {
        double delay = ARD_STEP * ((r->registers[NRF_SETUP_RETR] >> 4) + 1);
        radio_enter(r, RADIO_AWAITING_ACK);
        r->listening = INFINITY;
        queue_add(&r->air->line->calls, time + SETTLING, ack_listen, r);
        queue_add(&r->air->line->calls, time + delay, ack_missed, r);
    }
}

/* ---- receiver ---- */

static void listen(void *owner, double time)
{
    radio *r = owner;
    if (r->state != RADIO_SETTLING_RX)
        return;
    radio_enter(r, RADIO_RECEIVING);
    r->listening = time;
}

void radio_listen(radio *r, double time)
{
    radio_enter(r, RADIO_SETTLING_RX);
    queue_add(&r->air->line->calls, time + SETTLING, listen, r);
}

static int ack_payload_for(const radio *r, int pipe)
{
    if (r->registers[NRF_FEATURE] & NRF_EN_ACK_PAY && dynamic_length(r, pipe))
        for (int i = 0; i < r->tx_count; i++)
            if (r->tx[i].pipe == pipe)
                return i;
    return -1;
}

static void send_ack(void *owner, double time)
{
    radio *r = owner;
    if (r->state != RADIO_SETTLING_ACK)
        return;
    air_packet p = frame(r);
    pipe_address(r, r->ack_pipe, p.address);
    p.is_ack = true;
    p.pid = r->last.pid;
    load(&p, &r->ack);
    r->total.acks++;
    radio_enter(r, RADIO_SENDING_ACK);
    air_send(r->air, r, &p, time);
}

/* What a packet is told apart by from a repeat: its identity and its CRC. */
static uint16_t check_of(const air_packet *p)
{
    uint16_t crc = 0xffff;
    for (int i = 0; i < p->length; i++) {
        crc ^= (uint16_t)(p->payload[i] << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

static void receive_ready(void *owner, double time)
{
    radio *r = owner;
    if (r->rx_count)
        radio_flag(r, NRF_RX_DR, time);
}

static bool store(radio *r, const air_packet *p, int pipe, double time)
{
    if (r->rx_count == RADIO_FIFO)
        return false;
    radio_payload *slot = &r->rx[r->rx_count++];
    *slot = (radio_payload){.length = p->length, .pipe = (uint8_t)pipe};
    memcpy(slot->bytes, p->payload, p->length);
    double late = r->air->jitter * chance_uniform(&r->chance);
    queue_add(&r->air->line->calls, time + late, receive_ready, r);
    return true;
}

static void hear_ack(radio *r, const air_packet *p, double time)
{
    uint8_t address[5];
    pipe_address(r, 0, address);
    if (!p->is_ack || !(r->registers[NRF_EN_RXADDR] & 1) ||
        memcmp(address, p->address, p->address_width) != 0)
        return;
    queue_cancel(&r->air->line->calls, ack_missed, r);
    if (p->length)
        store(r, p, 0, time);
    delivered(r, time);
}

static int pipe_of(const radio *r, const air_packet *p)
{
    for (int pipe = 0; pipe < PIPES; pipe++) {
        uint8_t address[5];
        pipe_address(r, pipe, address);
        if (r->registers[NRF_EN_RXADDR] >> pipe & 1 &&
            memcmp(address, p->address, p->address_width) == 0)
            return pipe;
    }
    return -1;
}

static void answer(radio *r, int pipe, bool repeat, double time)
{
    if (!repeat && r->ack_pending && r->ack_pipe == pipe) {
        /* A new packet says that the last ACK payload has arrived. */
        int sent = ack_payload_for(r, pipe);
        if (sent >= 0)
            radio_drop_tx(r, sent);
        r->ack_pending = false;
        radio_flag(r, NRF_TX_DS, time);
    }
    r->ack_pipe = (uint8_t)pipe;
    int payload = ack_payload_for(r, pipe);
    r->ack = payload >= 0 ? r->tx[payload] : (radio_payload){0};
    r->ack_pending = payload >= 0;
    radio_enter(r, RADIO_SETTLING_ACK);
    queue_add(&r->air->line->calls, time + SETTLING, send_ack, r);
}

void radio_hear(radio *r, const air_packet *p, double time)
{
    if (r->state == RADIO_AWAITING_ACK) {
        hear_ack(r, p, time);
        return;
    }
    int pipe = pipe_of(r, p);
    if (p->is_ack || pipe < 0 || p->enhanced != (r->registers[NRF_EN_AA] != 0))
        return;
    if (!dynamic_length(r, pipe) && (r->registers[NRF_RX_PW_P0 + pipe] & 0x3f) != p->length)
        return;
    uint16_t check = check_of(p);
    bool repeat = p->enhanced && r->last.any && r->last.pid == p->pid && r->last.check == check;
    if (repeat) {
        r->total.repeats++;
    } else if (!store(r, p, pipe, time)) {
        r->total.full++; /* dropped, and not acknowledged */
        return;
    } else {
        r->total.received++;
        r->last.any = true;
        r->last.pid = p->pid;
        r->last.check = check;
    }
    if (p->enhanced && r->registers[NRF_EN_AA] >> pipe & 1 && !p->no_ack)
        answer(r, pipe, repeat, time);
}

void radio_cancel(radio *r)
{
    const queue_call timed[] = {transmit, ack_missed, ack_listen, listen, send_ack};
    for (size_t i = 0; i < sizeof timed / sizeof *timed; i++)
        queue_cancel(&r->air->line->calls, timed[i], r);
}
