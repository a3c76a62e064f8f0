#include "scenario.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "action.h"
#include "devices.h"
#include "reading.h"

#define INCLUDES 4

static bool read_file(world *w, const char *path, int depth, char *problem);

static bool one_number(reading *r, char kind, double least, double most, double *value)
{
    const char *given = reading_word(r, 1, "a number");
    if (!given)
        return false;
    if (!text_quantity(given, kind, value) || *value < least || *value > most)
        return text_fail(&r->text, "%s %s is not a number from %g to %g", r->text.words[0], given,
                         least, most);
    return true;
}

/* ---- statements ---- */

static bool read_seed(reading *r)
{
    double seed;
    if (!one_number(r, '1', 0, 9e15, &seed))
        return false;
    if (r->world->line.boards_count)
        return text_fail(&r->text, "seed comes before the boards");
    r->world->line.seed = (uint64_t)seed;
    air_start(&r->world->air, &r->world->line);
    modem_channel_start(&r->world->channel, &r->world->line);
    return true;
}

static bool read_duration(reading *r)
{
    return one_number(r, 's', 0, 1e6, &r->world->duration);
}

static bool read_speed(reading *r)
{
    return one_number(r, '1', 0, 1e6, &r->world->speed);
}

static bool read_board(reading *r)
{
    const char *name = reading_word(r, 1, "a name"), *elf = text_setting(&r->text, "elf"), *problem;
    double ppm = 0, start = 0, clock = NOMINAL_CLOCK, supply = 3.3;
    char path[READING_PATH];
    if (!name || !text_only(&r->text, KEYS("elf", "ppm", "start", "clock", "supply")) ||
        !text_get(&r->text, "ppm", 'p', -1e5, 1e5, &ppm) ||
        !text_get(&r->text, "start", 's', 0, 1e6, &start) ||
        !text_get(&r->text, "clock", 'H', 1e3, 2e7, &clock) ||
        !text_get(&r->text, "supply", 'V', 1.8, 5.5, &supply))
        return false;
    if (!elf)
        return text_fail(&r->text, "board needs elf=, the program's file");
    if (world_board(r->world, name))
        return text_fail(&r->text, "there is a board \"%s\" already", name);
    if (!reading_path(r, elf, path))
        return false;
    board *b = board_new(&r->world->line, name, path, clock, ppm, start, &problem);
    if (!b)
        return text_fail(&r->text, "%s: %s", path, problem);
    b->adc.supply = supply;
    r->world->clock[b->index] = clock;
    return true;
}

static bool read_wire(reading *r)
{
    const char *name = reading_word(r, 1, "a name"), *rest = text_setting(&r->text, "rest");
    if (!name || !text_only(&r->text, KEYS("rest")))
        return false;
    if (rest && strcmp(rest, "low") != 0 && strcmp(rest, "high") != 0)
        return text_fail(&r->text, "rest=%s is neither low nor high", rest);
    if (world_wire(r->world, name) || r->world->wires_count == WORLD_WIRES)
        return text_fail(&r->text, "there is a wire \"%s\" already, or there are too many", name);
    wire *w = wire_new(&r->world->line, name, rest && rest[0] == 'h');
    r->world->wires[r->world->wires_count++] = w;
    int count = text_plain(&r->text, 2);
    if (count < 2)
        return text_fail(&r->text, "a wire joins two pins or more");
    for (int i = 0; i < count; i++) {
        place p;
        if (!reading_pin(r, 2 + i, &p))
            return false;
        if (!wire_add_pin(w, p.board, p.port, p.bit))
            return text_fail(&r->text, "%s is on a wire already, or the wire has too many pins",
                             r->text.words[2 + i]);
    }
    return true;
}

static bool read_log(reading *r)
{
    report *log = &r->world->line.report;
    for (int i = 1; i < r->text.count; i++) {
        const char *what = r->text.words[i];
        bool *flag = strcmp(what, "adc") == 0      ? &log->adc
                     : strcmp(what, "radio") == 0  ? &log->radio
                     : strcmp(what, "wires") == 0  ? &log->wires
                                                   : NULL;
        if (!flag)
            return text_fail(&r->text, "log takes adc, radio, wires, not \"%s\"", what);
        *flag = true;
    }
    return true;
}

static bool read_at(reading *r)
{
    text *t = &r->text;
    double time;
    int used = text_quantity_at(t, 1, 's', &time);
    if (!used || time < 0 || t->count < used + 2)
        return text_fail(t, "at needs a time and what happens then: at 1.5 s press start");
    action *a = action_read(r->world, t, 1 + used);
    if (a)
        action_schedule(a, time);
    return a;
}

static bool read_include(reading *r)
{
    const char *name = reading_word(r, 1, "a file");
    char path[READING_PATH];
    if (!name || !reading_path(r, name, path))
        return false;
    if (r->depth == INCLUDES)
        return text_fail(&r->text, "includes are nested too deep");
    if (read_file(r->world, path, r->depth + 1, r->problem))
        return true;
    r->text.problem[0] = '\1'; /* said already, with its own file and line */
    return false;
}

static bool statement(reading *r)
{
    static const struct {
        const char *name;
        bool (*read)(reading *r);
    } statements[] = {
        {"seed", read_seed},       {"duration", read_duration}, {"speed", read_speed},
        {"board", read_board},     {"wire", read_wire},         {"radio", device_radio},
        {"air", device_air},         {"modem", device_modem},       {"channel", device_channel},
        {"cable", device_cable},     {"button", device_button},     {"light", device_lights},
        {"bar", device_lights},      {"input", device_input},       {"knob", device_knob},
        {"log", read_log},         {"at", read_at},             {"include", read_include},
    };
    if (r->text.count == 0)
        return true;
    for (size_t i = 0; i < sizeof statements / sizeof *statements; i++)
        if (strcmp(r->text.words[0], statements[i].name) == 0)
            return statements[i].read(r);
    return text_fail(&r->text,
                     "\"%s\" is no statement; there are: seed, duration, speed, board, wire, "
                     "radio, air, modem, channel, cable, button, light, bar, input, knob, log, at, "
                     "include",
                     r->text.words[0]);
}

static bool read_file(world *w, const char *path, int depth, char *problem)
{
    FILE *file = fopen(path, "r");
    if (!file) {
        snprintf(problem, TEXT_PROBLEM * 2, "%.500s: cannot be read: %s", path, strerror(errno));
        return false;
    }
    reading r = {.world = w, .path = path, .depth = depth, .problem = problem};
    char line[TEXT_LINE + 2];
    bool well = true;
    for (unsigned number = 1; well && fgets(line, sizeof line, file); number++) {
        well = text_split(&r.text, line) && statement(&r);
        if (!well && r.text.problem[0] != '\1')
            snprintf(problem, TEXT_PROBLEM * 2, "%.250s:%u: %s", path, number, r.text.problem);
    }
    fclose(file);
    return well;
}

bool scenario_read(world *w, const char *path, char problem[TEXT_PROBLEM * 2])
{
    if (!read_file(w, path, 0, problem))
        return false;
    if (w->line.boards_count)
        return true;
    snprintf(problem, TEXT_PROBLEM * 2, "%.500s: there is no board; add a line such as: board "
             "slave_1 elf=slave_1.elf", path);
    return false;
}
