#include "modem.h"

#include <math.h>

/* ---- the channel ---- */

void modem_channel_start(modem_channel *c, timeline *line)
{
    c->line = line;
    c->chance = chance_stream(line->seed, "modem channel");
}

static void key_up(modem *m, double time);

static void log_packet(const modem *m, double time, const char *fate)
{
    report *r = &m->channel->line->report;
    if (!r->radio)
        return;
    report_begin(r, time, "modem_packet");
    report_text(r, "from", m->name);
    report_text(r, "fate", fate);
    report_bytes(r, "bytes", m->packet, (size_t)m->packet_count);
    report_end(r);
}

static void deliver(modem *m, double time)
{
    modem_channel *c = m->channel;
    modem *to = m->other;
    /* The draws are made whatever becomes of the packet: its fate does not shift those of the next.
     */
    uint8_t bytes[MODEM_PACKET];
    unsigned long spoilt = 0;
    for (int i = 0; i < m->packet_count; i++)
        bytes[i] = serial_spoil(m->packet[i], c->error_rate, &c->chance, &spoilt);
    bool lost = chance_happens(&c->chance, c->loss);
    m->total.packets++;
    if (m->collided) {
        m->total.collided++;
        log_packet(m, time, "collided");
        return;
    }
    if (lost || c->blocked || !m->heard_from_start || to->asleep ||
        (spoilt && c->errors == MODEM_DROP_ERRORS)) {
        m->total.lost++;
        log_packet(m, time, "lost");
        return;
    }
    m->total.spoilt += spoilt;
    m->total.bytes += (unsigned long)m->packet_count;
    log_packet(m, time, "heard");
    for (int i = 0; i < m->packet_count; i++)
        serial_send(&to->out, bytes[i], time);
}

/* ---- one modem ---- */

static void look_at_cts(modem *m, double time)
{
    bool cts = m->asleep || m->count >= MODEM_CTS_HIGH || (m->cts && m->count >= MODEM_CTS_LOW);
    if (cts == m->cts)
        return;
    m->cts = cts;
    if (m->cts_changed)
        m->cts_changed(m->owner, cts, time);
}

static void packet_over(void *owner, double time)
{
    modem *m = owner;
    m->carrier = false;
    m->quiet_since = time;
    m->state = MODEM_IDLE;
    deliver(m, time);
    key_up(m, time);
    key_up(m->other, time);
}

static void header_over(void *owner, double time)
{
    modem *m = owner;
    m->state = MODEM_SENDING;
    m->packet_count = m->count < MODEM_PACKET ? m->count : MODEM_PACKET;
    for (int i = 0; i < m->packet_count; i++) {
        m->packet[i] = m->buffer[m->first];
        m->first = (m->first + 1) % MODEM_BUFFER;
    }
    m->count -= m->packet_count;
    look_at_cts(m, time);
    queue_add(&m->channel->line->calls, time + MODEM_BYTE * m->packet_count + MODEM_CRC,
              packet_over, m);
}

static void carrier_on(void *owner, double time)
{
    modem *m = owner;
    m->state = MODEM_HEADING;
    m->carrier = true;
    m->collided = m->other->carrier;
    m->heard_from_start = !m->other->carrier && !m->other->asleep;
    if (m->other->carrier)
        m->other->collided = true;
    queue_add(&m->channel->line->calls, time + MODEM_HEADER, header_over, m);
}

static void try_again(void *owner, double time)
{
    key_up(owner, time);
}

/* Begins to send if there is something to send and the channel is free. */
static void key_up(modem *m, double time)
{
    if (m->state != MODEM_IDLE || m->count == 0 || m->asleep || m->other->carrier)
        return;
    double free = m->other->quiet_since + MODEM_GAP;
    if (time < free) {
        queue_cancel(&m->channel->line->calls, try_again, m);
        queue_add(&m->channel->line->calls, free, try_again, m);
        return;
    }
    m->state = MODEM_KEYING;
    queue_add(&m->channel->line->calls, time + MODEM_KEY_UP, carrier_on, m);
}

static void take(modem *m, uint8_t byte, double time)
{
    if (m->count == MODEM_BUFFER) {
        m->total.overflowed++;
        return;
    }
    m->buffer[(m->first + m->count++) % MODEM_BUFFER] = byte;
    look_at_cts(m, time);
    key_up(m, time);
}

static void say(modem *m, const char *reply, double time)
{
    for (; *reply; reply++)
        serial_send(&m->out, (uint8_t)*reply, time);
}

static void sequence_due(void *owner, double time)
{
    modem *m = owner;
    if (modem_command_enter(&m->command, time))
        say(m, "OK\r", time);
}

static void command_byte(modem *m, uint8_t byte, double time)
{
    char reply[MODEM_REPLY];
    bool left;
    if (modem_command_take(&m->command, byte, time, reply, &left))
        say(m, reply, time);
    if (left) { /* only then does a new baud rate come into force */
        m->bit = 1.0 / modem_command_baud(&m->command);
        m->out.bit = m->bit;
        modem_sleep(m, m->sleep_pin, time);
    }
}

void modem_hear(void *owner, uint8_t byte, double time, double bit)
{
    modem *m = owner;
    if (m->asleep) {
        m->total.asleep++;
        return;
    }
    if (!serial_agrees(m->bit, bit)) {
        m->total.misread++;
        byte = (uint8_t)(byte << 1 ^ 0x55);
    }
    int released;
    modem_byte kind = modem_command_look(&m->command, byte, time, &released);
    for (int i = 0; i < released; i++)
        take(m, (uint8_t)modem_command_value(&m->command, "CC"), time);
    if (kind == MODEM_BYTE_DATA)
        take(m, byte, time);
    else if (kind == MODEM_BYTE_COMMAND)
        command_byte(m, byte, time);
    double due = modem_command_due(&m->command);
    if (isfinite(due))
        queue_add(&m->channel->line->calls, due, sequence_due, m);
}

static void awake(void *owner, double time)
{
    modem *m = owner;
    if (m->sleep_pin)
        return;
    m->asleep = false;
    look_at_cts(m, time);
    key_up(m, time);
}

void modem_sleep(modem *m, bool high, double time)
{
    m->sleep_pin = high;
    bool sleeps = high && modem_command_value(&m->command, "SM") == 1;
    if (sleeps == m->asleep)
        return;
    queue_cancel(&m->channel->line->calls, awake, m);
    if (sleeps) {
        m->asleep = true;
        look_at_cts(m, time);
    } else {
        queue_add(&m->channel->line->calls, time + MODEM_WAKE, awake, m);
    }
}

void modem_start(modem *m, const char *name, modem_channel *c, modem *other, serial_end out)
{
    m->name = name;
    m->channel = c;
    m->other = other;
    m->quiet_since = -INFINITY;
    modem_command_start(&m->command);
    double baud = modem_command_baud(&m->command);
    m->bit = 1.0 / baud;
    serial_start(&m->out, c->line, baud, out);
}

void modem_free(modem *m)
{
    serial_free(&m->out);
}
