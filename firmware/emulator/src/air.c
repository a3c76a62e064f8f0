#include "air.h"

#include <math.h>
#include <string.h>

#include "radio.h"

void air_start(air *a, timeline *line)
{
    a->line = line;
    a->chance = chance_stream(line->seed, "air");
}

double air_duration(const air_packet *p)
{
    double bits = 8.0 * (1 + p->address_width + p->length + p->crc_bytes) + (p->enhanced ? 9 : 0);
    return bits / (p->rate_mbit * 1e6);
}

double air_busy_since(const air *a, const radio *listener, uint8_t channel)
{
    double since = INFINITY;
    for (int i = 0; i < AIR_FLIGHTS; i++) {
        const struct air_flight *f = &a->flights[i];
        if (f->in_use && f->sender != listener && f->packet.channel == channel)
            since = fmin(since, f->begin);
    }
    return since;
}

bool air_busy(const air *a, const radio *listener, uint8_t channel)
{
    return isfinite(air_busy_since(a, listener, channel));
}

static void log_packet(const struct air_flight *f, double time, const char *fate)
{
    report *r = &f->air->line->report;
    if (!r->radio)
        return;
    report_begin(r, time, "packet");
    report_text(r, "from", f->sender->board->name);
    report_text(r, "fate", fate);
    report_flag(r, "ack", f->packet.is_ack);
    report_count(r, "pid", f->packet.pid);
    report_number(r, "begin", f->begin);
    report_bytes(r, "payload", f->packet.payload, f->packet.length);
    report_end(r);
}

/* A radio hears what began after it was ready, at its own rate, width and checksum. */
static bool hears(const radio *r, const struct air_flight *f)
{
    bool ready = r->state == RADIO_RECEIVING || r->state == RADIO_AWAITING_ACK;
    uint8_t config = r->registers[NRF_CONFIG];
    bool forced = r->registers[NRF_EN_AA] != 0; /* EN_AA keeps the CRC on */
    int crc = config & NRF_CRC_ON || forced ? (config & NRF_CRC_TWO ? 2 : 1) : 0;
    return r != f->sender && ready && r->listening <= f->begin &&
           r->registers[NRF_RF_CH] == f->packet.channel &&
           (r->registers[NRF_RF_SETUP] & NRF_RATE_2M ? 2 : 1) == f->packet.rate_mbit &&
           radio_address_width(r) == f->packet.address_width && crc == f->packet.crc_bytes;
}

static void arrive(void *owner, double time)
{
    struct air_flight *f = owner;
    air *a = f->air;
    f->in_use = false;
    bool heard = false, lost = false;
    const struct air_flight flight = *f; /* hearing it may put the answer in its place */
    radio_sent(flight.sender, time);
    for (int i = 0; i < a->radios_count; i++) {
        radio *r = a->radios[i];
        if (!hears(r, &flight) || flight.collided || a->blocked)
            continue;
        if (chance_happens(&a->chance, a->loss)) {
            a->total.lost++;
            lost = true;
            continue;
        }
        heard = true;
        a->total.delivered++;
        radio_hear(r, &flight.packet, time);
    }
    a->total.collided += flight.collided;
    log_packet(&flight, time,
               flight.collided ? "collided" : heard ? "heard" : lost ? "lost" : "unheard");
}

void air_send(air *a, radio *sender, const air_packet *p, double time)
{
    struct air_flight *f = NULL;
    for (int i = 0; i < AIR_FLIGHTS && !f; i++)
        if (!a->flights[i].in_use)
            f = &a->flights[i];
    if (!f)
        return; /* more flights than radios: cannot be */
    *f = (struct air_flight){a, sender, *p, time, time + air_duration(p), true, false};
    for (int i = 0; i < AIR_FLIGHTS; i++) {
        struct air_flight *other = &a->flights[i];
        if (other != f && other->in_use && other->packet.channel == p->channel)
            other->collided = f->collided = true;
    }
    a->total.packets++;
    queue_add(&a->line->calls, f->end, arrive, f);
}
