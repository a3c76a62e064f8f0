#include "laptop.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include "memory.h"

volatile int laptop_quit;

static void put(laptop_bytes *b, uint8_t byte)
{
    if (b->first + b->count == b->capacity) {
        if (b->first)
            memmove(b->bytes, b->bytes + b->first, b->count);
        b->first = 0;
        if (b->count == b->capacity) {
            b->capacity = b->capacity ? 2 * b->capacity : 1024;
            b->bytes = memory_resize(b->bytes, b->capacity);
        }
    }
    b->bytes[b->first + b->count++] = byte;
}

/* Puts the next waiting byte on the line, one at a time so that CTS is obeyed to the byte. */
static void pump(void *owner, double time)
{
    laptop *l = owner;
    if (l->hold || l->out.busy || l->waiting.count == 0)
        return;
    l->waiting.count--;
    l->sent++;
    serial_send(&l->out, l->waiting.bytes[l->waiting.first++], time);
}

void laptop_start(laptop *l, timeline *line, double baud, serial_end out)
{
    l->line = line;
    l->connected = true;
    serial_start(&l->out, line, baud, out);
    l->out.emptied = pump;
    l->out.emptied_owner = l;
}

bool laptop_open_terminal(laptop *l)
{
    if (openpty(&l->master, &l->slave, l->path, NULL, NULL) != 0)
        return false;
    struct termios raw;
    tcgetattr(l->slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(l->slave, TCSANOW, &raw);
    fcntl(l->master, F_SETFL, O_NONBLOCK);
    return true;
}

void laptop_wait_until_opened(laptop *l, volatile const int *quit)
{
    /* The master hangs up while nobody has the other side open. */
    close(l->slave);
    struct pollfd state = {.fd = l->master};
    do {
        usleep(10000);
        state.revents = 0;
        poll(&state, 1, 0);
    } while (state.revents & POLLHUP && !*quit);
    /* Our own handle, so that it does not hang up between two readers. */
    l->slave = open(l->path, O_RDWR | O_NOCTTY);
    usleep(100000); /* pyserial flushes what has come when it opens a port */
}

void laptop_drain(laptop *l, volatile const int *quit)
{
    /* The kernel hands over in portions: empty means empty for a while. */
    for (int empty = 0; empty < 5 && !*quit;) {
        int unread = 0;
        ioctl(l->slave, FIONREAD, &unread);
        empty = unread ? 0 : empty + 1;
        usleep(10000);
    }
}

void laptop_hear(void *owner, uint8_t byte, double time, double bit)
{
    (void)time, (void)bit;
    laptop *l = owner;
    l->received++;
    if (l->by_control) {
        put(&l->heard, byte);
        l->line->stop |= l->stop_on_data;
        return;
    }
    while (l->master >= 0 && !laptop_quit && write(l->master, &byte, 1) < 0) {
        if (errno != EAGAIN && errno != EINTR)
            return;
        struct pollfd room = {.fd = l->master, .events = POLLOUT};
        poll(&room, 1, 100);
    }
}

void laptop_send(laptop *l, const uint8_t *bytes, size_t count, double time)
{
    for (size_t i = 0; i < count; i++)
        put(&l->waiting, bytes[i]);
    if (l->connected)
        pump(l, time);
}

void laptop_poll(laptop *l, double time)
{
    uint8_t bytes[256];
    if (l->master < 0 || l->waiting.count >= sizeof bytes)
        return;
    ssize_t count = read(l->master, bytes, sizeof bytes);
    if (count > 0)
        laptop_send(l, bytes, (size_t)count, time);
}

void laptop_hold(void *owner, bool high, double time)
{
    laptop *l = owner;
    l->hold = high;
    pump(l, time);
}

void laptop_free(laptop *l)
{
    if (l->master >= 0) {
        close(l->master);
        close(l->slave);
    }
    serial_free(&l->out);
    free(l->waiting.bytes);
    free(l->heard.bytes);
}
