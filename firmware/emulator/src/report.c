#include "report.h"

#include <math.h>

void report_quoted(FILE *file, const char *text)
{
    fputc('"', file);
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        if (*c == '"' || *c == '\\')
            fprintf(file, "\\%c", *c);
        else if (*c < 0x20)
            fprintf(file, "\\u%04x", *c);
        else
            fputc(*c, file);
    }
    fputc('"', file);
}

static void key_of(report *r, const char *key)
{
    fputs(", ", r->file);
    report_quoted(r->file, key);
    fputs(": ", r->file);
}

void report_begin(report *r, double time, const char *event)
{
    if (!r->file)
        return;
    fprintf(r->file, "{\"t\": %.9f, \"event\": ", time);
    report_quoted(r->file, event);
}

void report_text(report *r, const char *key, const char *value)
{
    if (!r->file)
        return;
    key_of(r, key);
    report_quoted(r->file, value);
}

void report_number(report *r, const char *key, double value)
{
    if (!r->file)
        return;
    key_of(r, key);
    if (isfinite(value))
        fprintf(r->file, "%.12g", value);
    else
        fputs("null", r->file); /* JSON has no infinity */
}

void report_count(report *r, const char *key, uint64_t value)
{
    if (!r->file)
        return;
    key_of(r, key);
    fprintf(r->file, "%llu", (unsigned long long)value);
}

void report_flag(report *r, const char *key, bool value)
{
    if (!r->file)
        return;
    key_of(r, key);
    fputs(value ? "true" : "false", r->file);
}

void report_bytes(report *r, const char *key, const uint8_t *bytes, size_t count)
{
    if (!r->file)
        return;
    key_of(r, key);
    fputc('"', r->file);
    for (size_t i = 0; i < count; i++)
        fprintf(r->file, "%02x", bytes[i]);
    fputc('"', r->file);
}

void report_end(report *r)
{
    if (r->file)
        fputs("}\n", r->file);
}

void report_warning(report *r, double time, const char *where, const char *what)
{
    report_begin(r, time, "warning");
    report_text(r, "where", where);
    report_text(r, "what", what);
    report_end(r);
}
