/* The pair of modems, against figures worked out by hand from the manual. */
#include <math.h>
#include <string.h>

#include "check.h"

typedef struct pair {
    timeline line;
    modem_channel channel;
    modem a, b;
    uint8_t at_a[4096], at_b[4096];
    int count_a, count_b;
    double first_b, last_b;
    double cts_high, cts_low; /* buffer filling at the last change */
} pair;

static void hear_a(void *owner, uint8_t byte, double time, double bit)
{
    (void)time, (void)bit;
    pair *p = owner;
    p->at_a[p->count_a++ % 4096] = byte;
}

static void hear_b(void *owner, uint8_t byte, double time, double bit)
{
    (void)bit;
    pair *p = owner;
    if (p->count_b == 0)
        p->first_b = time;
    p->last_b = time;
    p->at_b[p->count_b++ % 4096] = byte;
}

static void cts(void *owner, bool high, double time)
{
    (void)time;
    pair *p = owner;
    *(high ? &p->cts_high : &p->cts_low) = p->a.count;
}

static void start(pair *p, uint64_t seed)
{
    memset(p, 0, sizeof *p);
    p->line.seed = seed;
    modem_channel_start(&p->channel, &p->line);
    modem_start(&p->a, "a", &p->channel, &p->b, (serial_end){hear_a, p});
    modem_start(&p->b, "b", &p->channel, &p->a, (serial_end){hear_b, p});
    p->a.cts_changed = cts;
    p->a.owner = p;
}

static void finish(pair *p)
{
    modem_free(&p->a);
    modem_free(&p->b);
    timeline_free(&p->line);
}

#define BIT (1.0 / 9600)

static void give(pair *p, modem *m, const char *bytes, int count)
{
    for (int i = 0; i < count; i++)
        modem_hear(m, (uint8_t)bytes[i], p->line.now, BIT);
}

static const char sample[128] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-";

static void latency(void)
{
    pair p;
    start(&p, 1);
    give(&p, &p.a, sample, 32);
    CHECK(timeline_run(&p.line, 1.0));
    CHECK(p.count_b == 32 && memcmp(p.at_b, sample, 32) == 0);
    /* 2.0 + 41.8 + 32 * 0.8 + 1.6 ms, then the first byte's 9.5 bits; the manual gives 72 ms. */
    CHECK_NEAR(p.first_b - 9.5 * BIT, 71.0e-3, 1e-9);
    finish(&p);
}

/* A sender at 960 bytes a second that obeys CTS. */
static void stream(void)
{
    pair p;
    start(&p, 1);
    int sent = 0;
    while (sent < 2000) {
        if (!p.a.cts)
            give(&p, &p.a, &sample[sent++ % 36], 1);
        CHECK(timeline_run(&p.line, p.line.now + 10 * BIT));
    }
    CHECK(timeline_run(&p.line, p.line.now + 2.0));
    CHECK(p.count_b == 2000);
    CHECK(p.a.total.overflowed == 0);
    CHECK_NEAR(p.cts_high, MODEM_CTS_HIGH, 0);
    CHECK(p.cts_low < MODEM_CTS_LOW && p.cts_low >= MODEM_CTS_LOW - MODEM_PACKET);
    double rate = (2000 - 36) / (p.last_b - p.first_b);
    CHECK_NEAR(rate, 36 / 74.2e-3, 5.0); /* 485 bytes a second */
    for (int i = 0; i < 2000; i++)
        if (p.at_b[i] != (uint8_t)sample[i % 36]) {
            CHECK(!"in order");
            break;
        }
    finish(&p);

    /* One that does not obey loses what the 132 bytes do not hold. */
    start(&p, 1);
    give(&p, &p.a, sample, 64);
    give(&p, &p.a, sample, 64);
    give(&p, &p.a, sample, 64);
    CHECK(p.a.total.overflowed == 60);
    CHECK(timeline_run(&p.line, 2.0));
    CHECK(p.count_b == MODEM_BUFFER);
    finish(&p);
}

static void half_duplex(void)
{
    pair p;
    start(&p, 1);
    give(&p, &p.a, sample, 36);
    CHECK(timeline_run(&p.line, 0.010)); /* a's carrier is on */
    give(&p, &p.b, sample, 10);
    CHECK(timeline_run(&p.line, 1.0));
    CHECK(p.count_b == 36 && p.count_a == 10); /* b waited */
    CHECK(p.a.total.collided == 0 && p.b.total.collided == 0);

    give(&p, &p.a, sample, 108); /* three packets in a row are not broken into */
    CHECK(timeline_run(&p.line, p.line.now + 0.010));
    give(&p, &p.b, sample, 10);
    CHECK(timeline_run(&p.line, p.line.now + 3 * 74.2e-3));
    CHECK(p.a.total.packets == 4 && p.b.total.packets == 1);
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK(p.count_b == 144 && p.count_a == 20);
    CHECK(p.a.total.collided == 0 && p.b.total.collided == 0);

    give(&p, &p.a, sample, 5); /* both key up: neither hears the other's carrier */
    give(&p, &p.b, sample, 5);
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK(p.count_b == 144 && p.count_a == 20);
    CHECK(p.a.total.collided == 1 && p.b.total.collided == 1);
    finish(&p);
}

static void errors(void)
{
    pair p;
    start(&p, 11);
    p.channel.error_rate = 1e-3;
    int packets = 400;
    for (int i = 0; i < packets; i++) {
        give(&p, &p.a, sample, 32);
        CHECK(timeline_run(&p.line, p.line.now + 0.2));
    }
    CHECK(p.count_b == packets * 32);
    double expected = packets * 32 * (1 - pow(1 - 1e-3, 8));
    CHECK_NEAR(p.a.total.spoilt, expected, 4 * sqrt(expected));
    finish(&p);

    start(&p, 12);
    p.channel.error_rate = 1e-3;
    p.channel.errors = MODEM_DROP_ERRORS;
    for (int i = 0; i < packets; i++) {
        give(&p, &p.a, sample, 32);
        CHECK(timeline_run(&p.line, p.line.now + 0.2));
    }
    double through = pow(1 - 1e-3, 8 * 32);
    CHECK_NEAR(p.a.total.lost, packets * (1 - through),
               4 * sqrt(packets * through * (1 - through)));
    CHECK(p.count_b == 32 * (packets - (int)p.a.total.lost));
    CHECK(p.a.total.spoilt == 0);
    finish(&p);
}

static void sleeping(void)
{
    pair p;
    start(&p, 1);
    modem_sleep(&p.a, true, 0.0);
    CHECK(!p.a.asleep); /* SM is 0: the pin is ignored */
    modem_sleep(&p.a, false, 0.0);
    CHECK(timeline_run(&p.line, 1.5));
    give(&p, &p.a, "+++", 3);
    CHECK(timeline_run(&p.line, 3.0));
    give(&p, &p.a, "ATSM1\rATCN\r", 11);
    CHECK(timeline_run(&p.line, 3.1));
    modem_sleep(&p.a, true, p.line.now);
    CHECK(p.a.asleep && p.a.cts);
    give(&p, &p.a, "x", 1);
    CHECK(p.a.total.asleep == 1);
    modem_sleep(&p.a, false, p.line.now);
    CHECK(timeline_run(&p.line, p.line.now + 0.084));
    CHECK(p.a.cts);
    CHECK(timeline_run(&p.line, p.line.now + 0.002));
    CHECK(!p.a.cts);
    finish(&p);
}

void test_modem(void)
{
    latency();
    stream();
    half_duplex();
    errors();
    sleeping();
}

static void expect(pair *p, const char *sent, const char *answer)
{
    p->count_a = 0;
    memset(p->at_a, 0, sizeof p->at_a);
    give(p, &p->a, sent, (int)strlen(sent));
    CHECK(timeline_run(&p->line, p->line.now + 0.1));
    CHECK_TEXT((const char *)p->at_a, answer);
}

void test_modem_command(void)
{
    pair p;
    start(&p, 1);
    CHECK(timeline_run(&p.line, 2.0));
    expect(&p, "+++", "");
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK_TEXT((const char *)p.at_a, "OK\r"); /* after a second of silence */
    expect(&p, "ATBD\r", "3\r");
    expect(&p, "atbd 4\r", "OK\r");
    expect(&p, "ATBD9\r", "ERROR\r");
    expect(&p, "ATXX\r", "ERROR\r");
    expect(&p, "ATBD3\r", "OK\r");
    expect(&p, "ATWR\r", "OK\r");
    expect(&p, "ATCN\r", "OK\r");
    CHECK(p.count_b == 0);
    expect(&p, "ATBD\r", ""); /* data again */
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK(p.count_b == 5);

    /* No silence before, or not after: three pluses are data. */
    p.count_b = 0;
    expect(&p, "a+++", "");
    CHECK(timeline_run(&p.line, p.line.now + 2.0));
    CHECK(p.count_b == 4);
    p.count_b = 0;
    memset(p.at_b, 0, 8);
    expect(&p, "+++b", "");
    CHECK(timeline_run(&p.line, p.line.now + 2.0));
    CHECK(p.count_b == 4 && memcmp(p.at_b, "+++b", 4) == 0);

    /* Command mode ends by itself after 20 s without a valid command. */
    expect(&p, "+++", "");
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK(p.a.command.active);
    CHECK(timeline_run(&p.line, p.line.now + 20.1));
    p.count_b = 0;
    expect(&p, "x", "");
    CHECK(timeline_run(&p.line, p.line.now + 1.0));
    CHECK(p.count_b == 1);
    finish(&p);
}
