#include "timeline.h"

#include <math.h>

#include "board.h"

/* The board that is furthest behind; `others`: how far the others are, at least. */
static board *furthest_behind(const timeline *line, double *others)
{
    board *behind = NULL;
    *others = INFINITY;
    for (int i = 0; i < line->boards_count; i++) {
        board *b = line->boards[i];
        if (!behind || b->now < behind->now) {
            if (behind)
                *others = earlier_of(*others, behind->now);
            behind = b;
        } else {
            *others = earlier_of(*others, b->now);
        }
    }
    return behind;
}

/* No board but `sleeper` can cause anything before this time. */
static double horizon(const timeline *line, const board *sleeper)
{
    double first = INFINITY;
    for (int i = 0; i < line->boards_count; i++)
        if (line->boards[i] != sleeper)
            first = earlier_of(first, board_next_action(line->boards[i]));
    return first;
}

bool timeline_run(timeline *line, double until)
{
    line->stop = false;
    do {
        double due = queue_next_time(&line->calls), others;
        board *b = furthest_behind(line, &others);
        double reached = b ? b->now : INFINITY;
        if (due <= reached && due <= until) {
            line->now = later_of(line->now, due);
            queue_run_next(&line->calls);
        } else if (reached >= until) {
            line->now = later_of(line->now, until);
            return true;
        } else {
            double end = earlier_of(until, due);
            line->now = later_of(line->now, reached);
            if (board_asleep(b)) {
                if (!board_step(b, earlier_of(end, horizon(line, b))))
                    return false;
                continue;
            }
            /* On with the same board while it stays behind and causes nothing that comes earlier.
             */
            end = earlier_of(end, others);
            do {
                if (!board_step(b, end))
                    return false;
            } while (b->now < end && queue_next_time(&line->calls) >= due && !board_asleep(b));
        }
    } while (!line->stop);
    return true;
}

void timeline_free(timeline *line)
{
    for (int i = 0; i < line->boards_count; i++)
        board_free(line->boards[i]);
    line->boards_count = 0;
    queue_free(&line->calls);
}
