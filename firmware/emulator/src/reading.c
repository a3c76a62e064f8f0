#include "reading.h"

#include <stdio.h>
#include <string.h>

bool reading_path(reading *r, const char *name, char path[READING_PATH])
{
    const char *slash = strrchr(r->path, '/');
    int folder = name[0] == '/' || !slash ? 0 : (int)(slash - r->path) + 1;
    if (snprintf(path, READING_PATH, "%.*s%s", folder, r->path, name) >= READING_PATH)
        return text_fail(&r->text, "the path %s is too long", name);
    return true;
}

const char *reading_word(reading *r, int i, const char *what)
{
    if (i < r->text.count && !strchr(r->text.words[i], '='))
        return r->text.words[i];
    text_fail(&r->text, "%s needs %s", r->text.words[0], what);
    return NULL;
}

board *reading_board(reading *r, int i)
{
    const char *name = reading_word(r, i, "the name of a board");
    board *b = name ? world_board(r->world, name) : NULL;
    if (name && !b)
        text_fail(&r->text, "there is no board \"%s\" above this line", name);
    return b;
}

bool reading_pin(reading *r, int i, place *p)
{
    const char *name = reading_word(r, i, "a pin such as slave_1.D6");
    if (name && !world_pin(r->world, name, &p->board, &p->port, &p->bit))
        return text_fail(&r->text, "\"%s\" is no pin of a board above this line", name);
    return name;
}

wire *reading_wire(reading *r, board *b, const char *key, bool needed)
{
    const char *name = text_setting(&r->text, key);
    if (!name) {
        if (needed)
            text_fail(&r->text, "%s needs %s=, a pin such as B3", r->text.words[0], key);
        return NULL;
    }
    if (strlen(name) != 2 || name[0] < 'A' || name[0] > 'D' || name[1] < '0' || name[1] > '7') {
        text_fail(&r->text, "%s=%s is no pin; they go from A0 to D7", key, name);
        return NULL;
    }
    return wire_at(b, name[0] - 'A', name[1] - '0');
}

bool reading_well(const reading *r)
{
    return r->text.problem[0] == '\0';
}
