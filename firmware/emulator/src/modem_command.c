#include "modem_command.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Name, factory default, largest value (page 39 to 41). */
static const struct {
    const char *name;
    uint16_t value, largest;
} parameters[] = {
    {"DT", 0, 0xffff}, {"SM", 0, 7},      {"ST", 100, 0xffff}, {"HT", 0xffff, 0xffff},
    {"BT", 10, 0xffff}, {"AT", 10, 0xffff}, {"CT", 200, 0xffff}, {"FL", 0, 1},
    {"LH", 1, 0xff},   {"HP", 0, 6},      {"MK", 0xffff, 0xffff}, {"CC", '+', 0x7f},
    {"BD", 3, 6},      {"RT", 0, 1},      {"SY", 0, 0xff},     {"VR", 0x4012, 0},
};

#define COUNT ((int)(sizeof parameters / sizeof *parameters))
#define TENTH 0.1 /* s: times are given in tenths */

static int find(const char *name)
{
    for (int i = 0; i < COUNT; i++)
        if (strncmp(parameters[i].name, name, 2) == 0)
            return i;
    return -1;
}

uint16_t modem_command_value(const modem_command *c, const char *name)
{
    return c->values[find(name)];
}

double modem_command_baud(const modem_command *c)
{
    static const double rates[] = {9600, 2400, 4800, 9600, 19200, 38400, 57600};
    return rates[modem_command_value(c, "BD")];
}

void modem_command_start(modem_command *c)
{
    *c = (modem_command){.last_byte = -INFINITY};
    for (int i = 0; i < COUNT; i++)
        c->values[i] = c->stored[i] = parameters[i].value;
}

static double guard(const modem_command *c, const char *name)
{
    return TENTH * modem_command_value(c, name);
}

modem_byte modem_command_look(modem_command *c, uint8_t byte, double time, int *released)
{
    double silence = time - c->last_byte;
    c->last_byte = time;
    *released = 0;
    if (c->active && time - c->last_valid > guard(c, "CT"))
        c->active = false;
    if (c->active)
        return MODEM_BYTE_COMMAND;
    bool is_plus = byte == modem_command_value(c, "CC");
    if (is_plus && c->pluses == 0 && silence >= guard(c, "BT")) {
        c->pluses = 1;
        c->sequence = time;
        return MODEM_BYTE_HELD;
    }
    if (is_plus && (c->pluses == 1 || c->pluses == 2) && time - c->sequence <= 1.0) {
        c->pluses++;
        return MODEM_BYTE_HELD;
    }
    *released = c->pluses;
    c->pluses = 0;
    return MODEM_BYTE_DATA;
}

double modem_command_due(const modem_command *c)
{
    return c->pluses == 3 ? c->last_byte + guard(c, "AT") : INFINITY;
}

bool modem_command_enter(modem_command *c, double time)
{
    if (c->pluses != 3 || time < modem_command_due(c) - 1e-9)
        return false;
    c->pluses = 0;
    c->active = true;
    c->length = 0;
    c->last_valid = time;
    return true;
}

static bool number(const char *text, uint16_t largest, uint16_t *value)
{
    char *end;
    unsigned long read = strtoul(text, &end, 16);
    *value = (uint16_t)read;
    return *text && !*end && read <= largest;
}

static bool obey(modem_command *c, char reply[MODEM_REPLY], bool *left)
{
    const char *name = c->line + 2, *argument = c->line + 4;
    if (c->length < 4 || strncmp(c->line, "AT", 2) != 0)
        return false;
    if (*argument && !isalnum((unsigned char)*argument))
        argument++; /* one separator is allowed */
    strcpy(reply, "OK\r");
    if (strncmp(name, "CN", 2) == 0) {
        c->active = false;
        *left = true;
        return true;
    }
    if (strncmp(name, "WR", 2) == 0) {
        memcpy(c->stored, c->values, sizeof c->stored);
        return true;
    }
    if (strncmp(name, "RE", 2) == 0) {
        for (int i = 0; i < COUNT; i++)
            c->values[i] = parameters[i].value;
        return true;
    }
    int i = find(name);
    if (i < 0)
        return false;
    if (!*argument) {
        snprintf(reply, MODEM_REPLY, "%X\r", c->values[i]);
        return true;
    }
    uint16_t value;
    if (!number(argument, parameters[i].largest, &value))
        return false;
    c->values[i] = value;
    return true;
}

bool modem_command_take(modem_command *c, uint8_t byte, double time, char reply[MODEM_REPLY],
                        bool *left)
{
    *left = false;
    if (byte != '\r') {
        if (c->length + 1 < (int)sizeof c->line)
            c->line[c->length++] = (char)toupper(byte);
        return false;
    }
    c->line[c->length] = '\0';
    if (obey(c, reply, left))
        c->last_valid = time;
    else
        strcpy(reply, "ERROR\r");
    c->length = 0;
    return true;
}
