#include "memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *checked(void *block)
{
    if (!block) {
        fputs("emulator: out of memory\n", stderr);
        exit(1);
    }
    return block;
}

void *memory_new(size_t bytes)
{
    return checked(calloc(1, bytes ? bytes : 1));
}

void *memory_resize(void *block, size_t bytes)
{
    return checked(realloc(block, bytes ? bytes : 1));
}

char *memory_text(const char *text)
{
    size_t bytes = strlen(text) + 1;
    return memcpy(memory_new(bytes), text, bytes);
}
