/* AT command mode of a 9XStream (manual 2.8, pages 20, 21, 39 to 41). */
#ifndef EMULATOR_MODEM_COMMAND_H
#define EMULATOR_MODEM_COMMAND_H

#include <stdbool.h>
#include <stdint.h>

#define MODEM_PARAMETERS 16
#define MODEM_REPLY 24

typedef struct modem_command {
    bool active;
    char line[24];
    int length;
    int pluses;          /* of the sequence that leads into command mode */
    double last_byte;    /* s: when the last byte came */
    double sequence;     /* s: when the first plus came */
    double last_valid;   /* s: of the last valid command */
    uint16_t values[MODEM_PARAMETERS], stored[MODEM_PARAMETERS];
} modem_command;

typedef enum modem_byte {
    MODEM_BYTE_DATA,    /* goes on the air */
    MODEM_BYTE_HELD,    /* may become the sequence: kept back */
    MODEM_BYTE_COMMAND, /* belongs to the command mode */
} modem_byte;

void modem_command_start(modem_command *c);

/* Looks at a byte that came at `time`. A kept-back sequence that is none goes out as data first:
 * `released` says how many characters. */
modem_byte modem_command_look(modem_command *c, uint8_t byte, double time, int *released);

/* The time after which a complete sequence becomes a command; infinity when there is none. */
double modem_command_due(const modem_command *c);

/* To be called at that time: true when command mode begins, and OK is to be answered. */
bool modem_command_enter(modem_command *c, double time);

/* Takes a byte in command mode; true when `reply` holds an answer. `left`: ATCN has ended the mode.
 */
bool modem_command_take(modem_command *c, uint8_t byte, double time, char reply[MODEM_REPLY],
                        bool *left);

/* Value of a parameter by its two letters. */
uint16_t modem_command_value(const modem_command *c, const char *name);

/* Baud rate that BD stands for. */
double modem_command_baud(const modem_command *c);

#endif
