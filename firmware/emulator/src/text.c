#include "text.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    char kind;
    const char *name;
    double factor;
} units[] = {
    {'s', "s", 1.0},   {'s', "ms", 1e-3},   {'s', "us", 1e-6},  {'V', "V", 1.0},
    {'V', "mV", 1e-3}, {'%', "%", 1e-2},    {'p', "ppm", 1.0},  {'H', "Hz", 1.0},
    {'H', "kHz", 1e3}, {'H', "MHz", 1e6},
};

bool text_fail(text *t, const char *format, ...)
{
    if (t->problem[0])
        return false;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(t->problem, sizeof t->problem, format, arguments);
    va_end(arguments);
    return false;
}

bool text_split(text *t, const char *line)
{
    t->count = 0;
    t->problem[0] = '\0';
    if (strlen(line) >= sizeof t->line)
        return text_fail(t, "the line is longer than %zu characters", sizeof t->line - 1);
    strcpy(t->line, line);
    t->line[strcspn(t->line, "#\r\n")] = '\0';
    for (char *rest = t->line, *word; (word = strtok_r(rest, " \t", &rest));) {
        if (t->count == TEXT_WORDS)
            return text_fail(t, "there are more than %d words", TEXT_WORDS);
        t->words[t->count++] = word;
    }
    return true;
}

const char *text_setting(const text *t, const char *key)
{
    size_t length = strlen(key);
    for (int i = 0; i < t->count; i++)
        if (strncmp(t->words[i], key, length) == 0 && t->words[i][length] == '=')
            return t->words[i] + length + 1;
    return NULL;
}

int text_plain(const text *t, int from)
{
    int i = from;
    while (i < t->count && !strchr(t->words[i], '='))
        i++;
    return i - from;
}

bool text_only(text *t, const char *const *keys)
{
    char known[TEXT_PROBLEM / 2] = "";
    for (const char *const *key = keys; *key; key++) {
        strncat(known, key == keys ? "" : ", ", sizeof known - strlen(known) - 1);
        strncat(known, *key, sizeof known - strlen(known) - 1);
    }
    for (int i = 1; i < t->count; i++) {
        const char *equals = strchr(t->words[i], '=');
        if (!equals)
            continue;
        size_t length = (size_t)(equals - t->words[i]);
        bool found = false;
        for (const char *const *key = keys; *key && !found; key++)
            found = strlen(*key) == length && strncmp(*key, t->words[i], length) == 0;
        if (!found)
            return text_fail(t, "%s does not take %.*s=; it takes: %s", t->words[0], (int)length,
                             t->words[i], *known ? known : "nothing");
    }
    return true;
}

bool text_quantity(const char *word, char kind, double *value)
{
    char *end;
    double read = strtod(word, &end);
    if (end == word || !isfinite(read))
        return false;
    bool bare = *end == '\0';
    for (size_t i = 0; !bare && i < sizeof units / sizeof *units; i++)
        if (units[i].kind == kind && strcmp(end, units[i].name) == 0) {
            *value = read * units[i].factor;
            return true;
        }
    if (bare)
        *value = read;
    return bare;
}

int text_quantity_at(const text *t, int at, char kind, double *value)
{
    char both[64];
    if (at >= t->count)
        return 0;
    if (at + 1 < t->count &&
        snprintf(both, sizeof both, "%s%s", t->words[at], t->words[at + 1]) < (int)sizeof both &&
        text_quantity(both, kind, value))
        return 2;
    return text_quantity(t->words[at], kind, value);
}

bool text_get(text *t, const char *key, char kind, double least, double most, double *value)
{
    const char *setting = text_setting(t, key);
    double read;
    if (!setting)
        return true;
    if (!text_quantity(setting, kind, &read))
        return text_fail(t, "%s=%s is not a number%s", key, setting,
                         kind == '1' ? "" : " with a unit that fits");
    if (read < least || read > most)
        return text_fail(t, "%s=%s is out of range; it goes from %g to %g", key, setting, least,
                         most);
    *value = read;
    return true;
}
