/* What was counted, as one line a device. */
#include "world.h"

static void board_line(world *w, board *b)
{
    report *r = &w->line.report;
    report_begin(r, b->now, "board");
    report_text(r, "name", b->name);
    report_count(r, "cycles", b->avr->cycle);
    report_count(r, "asleep", b->asleep);
    report_count(r, "resets", b->resets);
    report_count(r, "ram_data", (uint64_t)(b->data_end - 0x100));
    report_count(r, "ram_free",
                 b->stack_low >= b->data_end ? (uint64_t)(b->stack_low - b->data_end + 1) : 0);
    report_count(r, "captures", b->capture.captured);
    report_count(r, "conversions", b->adc.conversions);
    report_count(r, "conversions_lost", b->adc.lost);
    report_count(r, "serial_sent", b->usart.total.sent);
    report_count(r, "serial_received", b->usart.total.received);
    report_count(r, "serial_overruns", b->usart.total.overruns);
    report_count(r, "serial_framing", b->usart.total.framing);
    report_count(r, "serial_overwritten", b->usart.total.overwritten);
    report_end(r);
}

static void radio_line(world *w, const radio *x)
{
    report *r = &w->line.report;
    report_begin(r, w->line.now, "radio");
    report_text(r, "board", x->board->name);
    report_count(r, "sent", x->total.sent);
    report_count(r, "retransmitted", x->total.retransmitted);
    report_count(r, "delivered", x->total.delivered);
    report_count(r, "failed", x->total.failed);
    report_count(r, "received", x->total.received);
    report_count(r, "repeats", x->total.repeats);
    report_count(r, "full", x->total.full);
    report_count(r, "acks", x->total.acks);
    report_count(r, "spi_bytes", x->total.spi_bytes);
    report_end(r);
}

static void modem_line(world *w, const modem *m)
{
    report *r = &w->line.report;
    report_begin(r, w->line.now, "modem");
    report_text(r, "name", m->name);
    report_count(r, "packets", m->total.packets);
    report_count(r, "lost", m->total.lost);
    report_count(r, "collided", m->total.collided);
    report_count(r, "bytes", m->total.bytes);
    report_count(r, "spoilt", m->total.spoilt);
    report_count(r, "overflowed", m->total.overflowed);
    report_count(r, "asleep", m->total.asleep);
    report_count(r, "misread", m->total.misread);
    report_end(r);
}

static void wire_line(world *w, const wire *one)
{
    report *r = &w->line.report;
    report_begin(r, w->line.now, "wire_total");
    report_text(r, "name", one->name);
    report_count(r, "edges", one->edges);
    report_count(r, "contentions", one->contentions);
    report_end(r);
}

void world_statistics(world *w)
{
    for (int i = 0; i < w->line.boards_count; i++) {
        board_line(w, w->line.boards[i]);
        if (w->radios[i])
            radio_line(w, w->radios[i]);
    }
    for (int i = 0; i < w->wires_count; i++)
        wire_line(w, w->wires[i]);
    report *r = &w->line.report;
    if (w->air.radios_count) {
        report_begin(r, w->line.now, "air");
        report_count(r, "packets", w->air.total.packets);
        report_count(r, "lost", w->air.total.lost);
        report_count(r, "collided", w->air.total.collided);
        report_count(r, "delivered", w->air.total.delivered);
        report_end(r);
    }
    if (w->modem_board)
        for (int i = 0; i < 2; i++)
            modem_line(w, &w->modems[i]);
    if (w->laptop.connected) {
        report_begin(r, w->line.now, "laptop");
        report_count(r, "received", w->laptop.received);
        report_count(r, "sent", w->laptop.sent);
        report_end(r);
    }
    if (r->file)
        fflush(r->file);
}
