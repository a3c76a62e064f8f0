/* What happens, as JSON lines: {"t": seconds, "event": name, ...}. */
#ifndef EMULATOR_REPORT_H
#define EMULATOR_REPORT_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct report {
    FILE *file; /* NULL: nothing is written */
    bool adc;   /* each conversion as well */
    bool radio; /* each packet on the air as well */
    bool serial; /* each byte on a serial line as well */
    bool wires; /* each edge on a wire between boards as well */
} report;

/* Starts a line; the fields follow, then `report_end`. */
void report_begin(report *r, double time, const char *event);
void report_text(report *r, const char *key, const char *value);
void report_number(report *r, const char *key, double value);
void report_count(report *r, const char *key, uint64_t value);
void report_flag(report *r, const char *key, bool value);
void report_bytes(report *r, const char *key, const uint8_t *bytes, size_t count); /* hexadecimal */
void report_end(report *r);

/* A line that says in words what went wrong at a board or device. */
void report_warning(report *r, double time, const char *where, const char *what);

/* One JSON string with its quotes, escaped. */
void report_quoted(FILE *file, const char *text);

#endif
