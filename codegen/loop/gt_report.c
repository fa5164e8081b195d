/* What the program says; see gt_run.h. */
#include "gt_run.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdio.h>

#define GT_REFUSED 2

int gt_fail(const char *about, const char *sentence, const char *reason)
{
    const char *colon = (about[0] != '\0') ? ": " : "";
    const char *dash = (reason[0] != '\0') ? ": " : "";

    (void)fprintf(stderr, "gt_loop: %s%s%s%s%s\n", about, colon, sentence, dash, reason);
    return GT_REFUSED;
}

void gt_report_port(const gt_run *run)
{
    (void)printf("port %d\n", (int)run->socket.port);
    (void)fflush(stdout);
}

void gt_report_text(const char *text)
{
    (void)printf("%s", text);
}

static void gt_report_histogram(const char *name, const gt_histogram *histogram)
{
    uint32_t n;

    (void)printf(", \"%s_worst_us\": %" PRId64 ", \"%s_below_us\": {", name, histogram->worst_ns / 1000, name);
    for (n = 0U; n < GT_BUCKETS; n++) {
        (void)printf("%s\"%" PRIu32 "\": %" PRIu64, (n > 0U) ? ", " : "", ((uint32_t)1U) << n, histogram->count[n]);
    }
    (void)printf("}");
}

void gt_report_count(gt_run *run, int64_t reply_ns, int64_t period_ns, int64_t cycle_ns)
{
    gt_histogram_add(&run->reply, reply_ns);
    gt_histogram_add(&run->period, period_ns);
    run->missed += (reply_ns > cycle_ns) ? 1U : 0U;
}

void gt_report(const gt_run *run, int log_complete)
{
    const gt_loop *loop = &run->loop;

    (void)printf("{\"cycles\": %" PRIu64 ", \"ended_by\": \"%s\", \"state\": %d, \"status\": %d, \"late\": %" PRIu64
                 ", \"lost\": %" PRIu64 ", \"repeated\": %" PRIu64 ", \"reordered\": %" PRIu64 ", \"stale\": %" PRIu64
                 ", \"garbage\": %" PRIu64 ", \"foreign\": %" PRIu64,
                 loop->cycles, run->ended_by, (int)run->ended_in, (int)loop->status, loop->late, loop->sequence.lost,
                 loop->sequence.repeated, loop->sequence.reordered, loop->sequence.stale, loop->garbage,
                 run->socket.foreign);
    (void)printf(", \"dry\": %d, \"memory_locked\": %d, \"fifo\": %d, \"missed_deadlines\": %" PRIu64
                 ", \"log_dropped\": %" PRIu64 ", \"log_complete\": %d",
                 run->arguments.live ? 0 : 1, run->realtime.locked, run->realtime.fifo, run->missed,
                 run->log.dropped, log_complete);
    (void)printf(", \"clock_faults\": %" PRIu64 ", \"following_faults\": %" PRIu64 ", \"coasted_m\": %.17g",
                 loop->pace.faults, loop->apart, loop->coasted_m);
    if (loop->law.numbers != NULL) {
        const double *n = loop->law.numbers;

        (void)printf(", \"plan_failed\": %.0f, \"plan_lost\": %.0f, \"plan_refused\": %.0f, \"plan_skipped\": %.0f",
                     n[GT_PLAN_FAILED], n[GT_PLAN_LOST], n[GT_PLAN_REFUSED], n[GT_PLAN_SKIPPED]);
    }
    gt_report_histogram("reply", &run->reply);
    gt_report_histogram("period", &run->period);
    gt_report_histogram("compute", &run->compute);
    (void)printf("}\n");
    (void)fflush(stdout);
}
