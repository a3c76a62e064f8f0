/* emulator: the logger's boards and what they are wired to, in virtual time. */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "control.h"
#include "scenario.h"

#define SLICE 1e-3 /* s of virtual time between looks at the pseudo-terminal and the clock */

static const char usage[] =
    "usage: emulator [--control] [--events FILE] [--now] SCENARIO\n"
    "  --events FILE  what happens, as JSON lines (- for standard error)\n"
    "  --control      commands on standard input, answers on standard output, no pseudo-terminal\n"
    "  --now          time starts at once, not when the pseudo-terminal is opened\n";

static void on_signal(int number)
{
    (void)number;
    laptop_quit = 1;
}

static void quiet(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr;
    if (level <= LOG_ERROR)
        vfprintf(stderr, format, arguments);
}

static double host_time(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Runs against the clock on the wall: virtual time never gets ahead of `speed` times it. */
static bool run_paced(world *w)
{
    double start = host_time(), virtual_start = w->line.now;
    while (w->line.now < w->duration && !laptop_quit) {
        laptop_poll(&w->laptop, w->line.now);
        if (!timeline_run(&w->line, fmin(w->line.now + SLICE, w->duration)))
            return false;
        if (w->speed <= 0)
            continue;
        double ahead = (w->line.now - virtual_start) / w->speed - (host_time() - start);
        if (ahead > 2e-3) {
            struct timespec pause = {(time_t)ahead, (long)(fmod(ahead, 1.0) * 1e9)};
            nanosleep(&pause, NULL);
        }
    }
    return true;
}

static int run_on_terminal(world *w, FILE *answers, bool at_once)
{
    if (w->laptop.connected) {
        if (!laptop_open_terminal(&w->laptop)) {
            fputs("emulator: the system gives no pseudo-terminal\n", stderr);
            return 1;
        }
        fprintf(answers, "{\"terminal\": \"%s\"}\n", w->laptop.path);
        fflush(answers);
        if (!at_once)
            laptop_wait_until_opened(&w->laptop, &laptop_quit);
    }
    bool good = run_paced(w);
    if (w->laptop.connected)
        laptop_drain(&w->laptop, &laptop_quit);
    return good ? 0 : 3;
}

static FILE *open_events(const char *path)
{
    return strcmp(path, "-") == 0 ? stderr : fopen(path, "w");
}

int main(int count, char **words)
{
    bool control = false, at_once = false;
    const char *scenario = NULL, *events = NULL;
    for (int i = 1; i < count; i++) {
        if (strcmp(words[i], "--control") == 0)
            control = true;
        else if (strcmp(words[i], "--now") == 0)
            at_once = true;
        else if (strcmp(words[i], "--events") == 0 && i + 1 < count)
            events = words[++i];
        else if (words[i][0] != '-' && !scenario)
            scenario = words[i];
        else
            return fputs(usage, stderr), 2;
    }
    if (!scenario)
        return fputs(usage, stderr), 2;

    /* simavr prints to standard output: our answers go to a copy of it. */
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    dup2(STDERR_FILENO, STDOUT_FILENO);
    avr_global_logger_set(quiet);
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);

    world *w = calloc(1, sizeof *w);
    if (!w || !answers)
        return fputs("emulator: out of memory\n", stderr), 1;
    world_start(w);
    if (events && !(w->line.report.file = open_events(events))) {
        fprintf(stderr, "emulator: %s cannot be written: %s\n", events, strerror(errno));
        return 2;
    }
    char problem[TEXT_PROBLEM * 2];
    int status = 2;
    if (scenario_read(w, scenario, problem)) {
        world_settle(w);
        w->laptop.by_control = control;
        status = control ? control_obey(w, stdin, answers) : run_on_terminal(w, answers, at_once);
        world_statistics(w);
    } else {
        fprintf(stderr, "emulator: %s\n", problem);
    }
    world_free(w);
    if (w->line.report.file && w->line.report.file != stderr)
        fclose(w->line.report.file);
    free(w);
    fclose(answers);
    return status;
}
