#include "analog.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"

#define LINE_LENGTH 4096
#define SAY(...) snprintf(problem, 200, __VA_ARGS__)

double analog_at(void *owner, double time)
{
    analog *s = owner;
    double value = s->level;
    if (s->count) {
        double t = time - s->start;
        if (s->hint >= s->count || s->times[s->hint] > t)
            s->hint = 0;
        while (s->hint + 1 < s->count && s->times[s->hint + 1] <= t)
            s->hint++;
        size_t i = s->hint;
        value = s->values[i];
        if (i + 1 < s->count && t > s->times[i])
            value += (s->values[i + 1] - value) * (t - s->times[i]) /
                     (s->times[i + 1] - s->times[i]);
    }
    return s->noise > 0.0 ? value + s->noise * chance_normal(&s->chance) : value;
}

/* The next field of a line, without blanks around it; NULL at its end. */
static char *field(char **rest)
{
    if (!*rest)
        return NULL;
    char *start = *rest, *comma = strchr(start, ',');
    *rest = comma ? comma + 1 : NULL;
    char *end = comma ? comma : start + strlen(start);
    while (start < end && (*start == ' ' || *start == '\t'))
        start++;
    while (end > start && strchr(" \t\r\n", end[-1]))
        end--;
    *end = '\0';
    return start;
}

/* Splits `name [unit]`; true when the name is the one wanted. */
static bool is_column(char *title, const char *wanted, char unit[16])
{
    unit[0] = '\0';
    char *bracket = strchr(title, '[');
    if (bracket) {
        sscanf(bracket, "[%15[^]]", unit);
        while (bracket > title && bracket[-1] == ' ')
            bracket--;
        *bracket = '\0';
    }
    return strcmp(title, wanted) == 0;
}

static double factor(const char *unit, double supply)
{
    static const struct {
        const char *name;
        double factor;
    } units[] = {{"s", 1.0}, {"ms", 1e-3}, {"V", 1.0}, {"mV", 1e-3}};
    if (strcmp(unit, "counts") == 0)
        return supply / 1024.0;
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(unit, units[i].name) == 0)
            return units[i].factor;
    return 0.0;
}

typedef struct columns {
    int time, value;
    double time_factor, value_factor;
    double offset; /* V: the middle of a step, so that a whole count is read back as itself */
} columns;

static bool read_header(char *text, const char *wanted, double supply, columns *c,
                        char problem[200])
{
    char unit[16], *rest = text, *title;
    c->time = c->value = -1;
    for (int i = 0; (title = field(&rest)); i++) {
        char copy[LINE_LENGTH];
        strcpy(copy, title);
        if (is_column(copy, "time", unit)) {
            c->time = i;
            c->time_factor = factor(unit, supply);
        }
        strcpy(copy, title);
        if (is_column(copy, wanted, unit)) {
            c->value = i;
            c->value_factor = factor(unit, supply);
            c->offset = strcmp(unit, "counts") == 0 ? 0.5 * supply / 1024.0 : 0.0;
            if (c->value_factor == 0.0 || strcmp(unit, "s") == 0 || strcmp(unit, "ms") == 0) {
                SAY("column %s is in [%s]; give it in [V], [mV] or [counts]", wanted, unit);
                return false;
            }
        }
    }
    if (c->time < 0 || (c->time_factor != 1.0 && c->time_factor != 1e-3))
        SAY("there is no column time [s] or time [ms]");
    else if (c->value < 0)
        SAY("there is no column %s", wanted);
    else
        return true;
    return false;
}

static bool read_row(char *text, const columns *c, double *time, double *value)
{
    char *rest = text, *number;
    bool got_time = false, got_value = false;
    for (int i = 0; (number = field(&rest)); i++) {
        if (i != c->time && i != c->value)
            continue;
        char *end;
        errno = 0;
        double read = strtod(number, &end);
        if (end == number || *end || !isfinite(read))
            return false;
        if (i == c->time) {
            *time = read * c->time_factor;
            got_time = true;
        } else {
            *value = read * c->value_factor + c->offset;
            got_value = true;
        }
    }
    return got_time && got_value;
}

bool analog_read(analog *s, const char *path, const char *column, double supply,
                 char problem[200], unsigned *at)
{
    *at = 0;
    FILE *file = fopen(path, "r");
    if (!file) {
        SAY("cannot be read: %s", strerror(errno));
        return false;
    }
    char text[LINE_LENGTH];
    columns c = {.time = -1};
    bool header = false, good = true;
    size_t capacity = 0;
    while (good && fgets(text, sizeof text, file)) {
        ++*at;
        if (text[0] == '#' || text[strspn(text, " \t\r\n")] == '\0')
            continue;
        if (!header) {
            header = good = read_header(text, column, supply, &c, problem);
            continue;
        }
        if (s->count == capacity) {
            capacity = capacity ? 2 * capacity : 1024;
            s->times = memory_resize(s->times, capacity * sizeof *s->times);
            s->values = memory_resize(s->values, capacity * sizeof *s->values);
        }
        double *time = &s->times[s->count];
        good = read_row(text, &c, time, &s->values[s->count]);
        if (!good)
            SAY("the row has no number for time and %s", column);
        else if (s->count && *time <= time[-1]) {
            SAY("time does not increase");
            good = false;
        }
        s->count++;
    }
    fclose(file);
    if (good && !s->count) {
        *at = 0;
        SAY("there are no rows");
        good = false;
    }
    return good;
}

void analog_free(analog *s)
{
    free(s->times);
    free(s->values);
    s->times = s->values = NULL;
    s->count = 0;
}
