/* Words, settings and quantities of a scenario. */
#ifndef EMULATOR_TEXT_H
#define EMULATOR_TEXT_H

#include <stdbool.h>
#include <stddef.h>

#define TEXT_WORDS 24
#define TEXT_LINE 1024
#define TEXT_PROBLEM 300

/* One line in words; a word such as `ppm=30` is a setting. What follows # is left out. */
typedef struct text {
    char line[TEXT_LINE];
    const char *words[TEXT_WORDS];
    int count;
    char problem[TEXT_PROBLEM]; /* empty while all is well */
} text;

/* Splits a line; false, with a problem, when it is too long. */
bool text_split(text *t, const char *line);

/* Notes the first problem only, as for printf; returns false. */
bool text_fail(text *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Value of the setting `key`, or NULL. */
const char *text_setting(const text *t, const char *key);

/* Number of leading words that are no settings, from word `from` on. */
int text_plain(const text *t, int from);

/* True when every setting's key is in `keys` (NULL at the end). */
bool text_only(text *t, const char *const *keys);

/* Reads `1.5ms` or `1.5`. `kind` is 's' for a time, 'V' for a voltage, '%' for a
 * share (0.2 or 20%), 'p' for ppm, 'H' for a frequency, '1' for a bare number. */
bool text_quantity(const char *word, char kind, double *value);

/* The same from words, which may be two; returns how many were used, 0 when there is no such
 * number. */
int text_quantity_at(const text *t, int at, char kind, double *value);

/* A setting as a quantity within limits; untouched when absent. False with a problem when wrong. */
bool text_get(text *t, const char *key, char kind, double least, double most, double *value);

#endif
