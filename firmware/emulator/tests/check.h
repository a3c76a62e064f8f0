/* A small harness: checks that count, and worlds from scenarios that are written in the test. */
#ifndef CHECK_H
#define CHECK_H

#include <stdbool.h>
#include <stdio.h>

#include "world.h"

void check_true(bool holds, const char *what, const char *file, int line);
void check_near(double got, double wanted, double tolerance, const char *what, const char *file,
                int line);
void check_text(const char *got, const char *wanted, const char *file, int line);

#define CHECK(condition) check_true(condition, #condition, __FILE__, __LINE__)
#define CHECK_NEAR(got, wanted, tolerance) \
    check_near(got, wanted, tolerance, #got, __FILE__, __LINE__)
#define CHECK_TEXT(got, wanted) check_text(got, wanted, __FILE__, __LINE__)

/* A world from the text of a scenario, in which %s stands for the folder of the test programs; the
 * program ends when the scenario is wrong. */
world *check_world(const char *scenario);

/* The same where the scenario is expected to be wrong: the sentence that says so. */
const char *check_problem(const char *scenario);

void check_done(world *w);

/* What a test program has left in its results. */
unsigned check_result(const board *b, int index);

/* Runs until the program says that it has finished; a check fails when it has not within `limit` s.
 */
void check_finishes(world *w, const board *b, double limit);

/* Writes a file into the folder of the tests and returns its path. */
const char *check_file(const char *name, const char *text);

#define CHECK_EDGES 4096

/* Edges that a pin has made. */
typedef struct edges {
    double times[CHECK_EDGES];
    int count;
} edges;

void check_watch(edges *e, board *b, int port, int bit);

/* A driver of the test's own on a wire; its number. */
int check_hand(wire *w, board *b);

void test_queue(void);
void test_chance(void);
void test_text(void);
void test_analog(void);
void test_serial(void);
void test_modem(void);
void test_modem_command(void);
void test_radio(void);
void test_air(void);
void test_wire(void);
void test_scenario(void);
void test_timer(void);
void test_capture(void);
void test_converter(void);
void test_usart(void);
void test_pins(void);
void test_timeline(void);

#endif
