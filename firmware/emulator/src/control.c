#include "control.h"

#include <math.h>
#include <string.h>

#include "action.h"

static void answer(world *w, FILE *answers, bool running)
{
    if (w->line.report.file)
        fflush(w->line.report.file);
    fprintf(answers, "{\"t\": %.17g, \"data\": \"", w->line.now);
    laptop_bytes *heard = &w->laptop.heard;
    for (size_t i = 0; i < heard->count; i++)
        fprintf(answers, "%02x", heard->bytes[heard->first + i]);
    heard->first = heard->count = 0;
    fprintf(answers, "\", \"running\": %s}\n", running ? "true" : "false");
    fflush(answers);
}

static void refuse(FILE *answers, const char *problem)
{
    fputs("{\"problem\": ", answers);
    report_quoted(answers, problem);
    fputs("}\n", answers);
    fflush(answers);
}

static bool is(const text *t, const char *word)
{
    return strcmp(t->words[0], word) == 0;
}

int control_obey(world *w, FILE *commands, FILE *answers)
{
    char line[TEXT_LINE * 2];
    bool running = true;
    while (fgets(line, sizeof line, commands)) {
        text t;
        double time;
        if (!text_split(&t, line)) {
            refuse(answers, t.problem);
        } else if (t.count == 0) {
            continue;
        } else if (is(&t, "quit")) {
            return 0;
        } else if (is(&t, "run") || is(&t, "wait")) {
            if (t.count != 2 || !text_quantity(t.words[1], 's', &time) || time < 0) {
                refuse(answers, "run and wait need a time: run 0.1");
                continue;
            }
            w->laptop.stop_on_data = is(&t, "run");
            double end = fmin(w->line.now + time, w->duration);
            running = running && timeline_run(&w->line, end);
            answer(w, answers, running && w->line.now < w->duration);
        } else if (is(&t, "statistics")) {
            world_statistics(w);
            answer(w, answers, running);
        } else {
            action *a = action_read(w, &t, 0);
            if (a) {
                action_do(a);
                answer(w, answers, running);
            } else {
                refuse(answers, t.problem);
            }
        }
    }
    return 0;
}
