/* Memory that is there or ends the program: an emulator without memory has nothing to clean up. */
#ifndef EMULATOR_MEMORY_H
#define EMULATOR_MEMORY_H

#include <stddef.h>

void *memory_new(size_t bytes); /* all zero */
void *memory_resize(void *block, size_t bytes);
char *memory_text(const char *text);

#endif
