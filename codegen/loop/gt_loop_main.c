/* The program round gt_loop: socket, clock, log, priorities. Prints its port, then one line of JSON at the end.
 *
 * Dry unless --live: EGM gets no answer, RSI gets corrections of zero. Tested against simulators only.
 */
#ifndef _DEFAULT_SOURCE
#define _DEFAULT_SOURCE 1 /* MAP_ANONYMOUS */
#endif

#include "gt_arguments.h"
#include "gt_clock.h"
#include "gt_histogram.h"
#include "gt_laws.h"
#include "gt_log.h"
#include "gt_log_writer.h"
#include "gt_loop.h"
#include "gt_realtime.h"
#include "gt_socket.h"
#include "gt_table.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#define GT_PRIORITY 80
#define GT_RING 4096U
#define GT_LONGEST_WAIT_MS 50U

/* All that a run holds; one object in main, nothing static. */
typedef struct gt_run {
    gt_arguments arguments;
    gt_socket socket;
    gt_table reference;
    gt_table corrections;
    gt_laws laws;
    gt_loop loop;
    gt_log log;
    gt_log_writer writer;
    gt_realtime realtime;
    gt_histogram reply;  /* from waking up to the answer sent */
    gt_histogram period; /* between two cycles */
    uint64_t missed;     /* answers later than a cycle after waking up */
} gt_run;

static int gt_fail(const char *sentence, const char *about)
{
    (void)fprintf(stderr, "gt_loop: %s%s\n", sentence, about);
    return 2;
}

static int gt_asked_to_end(void)
{
    sigset_t pending;

    return (sigpending(&pending) == 0) && (sigismember(&pending, SIGINT) || sigismember(&pending, SIGTERM));
}

static void gt_end_cycle(gt_run *run, uint8_t *answer)
{
    const uint32_t length = gt_loop_cycle(&run->loop, answer);

    if (length > 0U) {
        gt_socket_send(&run->socket, answer, length);
    }
    if (run->arguments.lockstep) {
        gt_socket_send(&run->socket, answer, 0U); /* the cycle is over */
        while (!gt_log_has_room(&run->log)) {
            /* not in real time: the log is to be whole */
        }
    }
    (void)gt_log_put(&run->log, run->loop.record);
}

/* All datagrams that are there; 1 if one of them was empty, the end of a cycle in lock step. */
static int gt_drain(gt_run *run, uint8_t *data)
{
    int32_t length = gt_socket_take(&run->socket, data, GT_DATAGRAM_MAX + 1U);

    while (length >= 0) {
        if ((length == 0) && run->arguments.lockstep) {
            return 1;
        }
        gt_loop_datagram(&run->loop, data, (uint32_t)length);
        length = gt_socket_take(&run->socket, data, GT_DATAGRAM_MAX + 1U);
    }
    return 0;
}

/* How long to wait [ms]: a cycle and a half once the robot sends; else as long as a person waits for an end. */
static int gt_patience(const gt_run *run)
{
    if (run->arguments.lockstep || !run->loop.sequence.started) {
        return (run->arguments.idle_ms < GT_LONGEST_WAIT_MS) ? (int)run->arguments.idle_ms : (int)GT_LONGEST_WAIT_MS;
    }
    return (int)(run->arguments.cycle_ms + ((run->arguments.cycle_ms + 1U) / 2U));
}

static void gt_go_round(gt_run *run)
{
    uint8_t data[GT_DATAGRAM_MAX + 1U];
    uint8_t answer[GT_DATAGRAM_MAX];
    const int64_t cycle_ns = (int64_t)run->arguments.cycle_ms * 1000000;
    int64_t last = gt_clock_ns();
    int64_t heard = last;

    (void)memset(data, 0, sizeof(data));
    while (!gt_asked_to_end() && ((run->arguments.cycles == 0U) || (run->loop.cycles < run->arguments.cycles))) {
        const int there = gt_socket_wait(&run->socket, gt_patience(run));
        const int64_t now = gt_clock_ns();
        const int ended = there ? gt_drain(run, data) : 0;

        if (there) {
            heard = now;
        } else if ((now - heard) >= ((int64_t)run->arguments.idle_ms * 1000000)) {
            return; /* the watchdog: nobody is there */
        } else {
            /* a cycle without a datagram */
        }
        if (run->arguments.lockstep ? ended : (run->loop.sequence.started || (run->loop.datagrams > 0U))) {
            int64_t sent;

            gt_end_cycle(run, answer);
            sent = gt_clock_ns();
            gt_histogram_add(&run->reply, sent - now);
            gt_histogram_add(&run->period, now - last);
            run->missed += ((sent - now) > cycle_ns) ? 1U : 0U;
            last = now;
        }
    }
}

static void gt_print_histogram(const char *name, const gt_histogram *histogram)
{
    uint32_t n;

    (void)printf(", \"%s_worst_us\": %" PRId64 ", \"%s_below_us\": {", name, histogram->worst_ns / 1000, name);
    for (n = 0U; n < GT_BUCKETS; n++) {
        (void)printf("%s\"%" PRIu32 "\": %" PRIu64, (n > 0U) ? ", " : "", ((uint32_t)1U) << n, histogram->count[n]);
    }
    (void)printf("}");
}

static void gt_report(const gt_run *run, int log_complete)
{
    const gt_loop *loop = &run->loop;

    (void)printf("{\"cycles\": %" PRIu64 ", \"state\": %d, \"status\": %d, \"late\": %" PRIu64 ", \"lost\": %" PRIu64
                 ", \"repeated\": %" PRIu64 ", \"reordered\": %" PRIu64 ", \"stale\": %" PRIu64
                 ", \"garbage\": %" PRIu64 ", \"foreign\": %" PRIu64,
                 loop->cycles, (int)loop->state, (int)loop->status, loop->late, loop->sequence.lost,
                 loop->sequence.repeated, loop->sequence.reordered, loop->sequence.stale, loop->garbage,
                 run->socket.foreign);
    (void)printf(", \"dry\": %d, \"memory_locked\": %d, \"fifo\": %d, \"missed_deadlines\": %" PRIu64
                 ", \"log_dropped\": %" PRIu64 ", \"log_complete\": %d",
                 run->arguments.live ? 0 : 1, run->realtime.locked, run->realtime.fifo, run->missed,
                 run->log.dropped, log_complete);
    gt_print_histogram("reply", &run->reply);
    gt_print_histogram("period", &run->period);
    (void)printf("}\n");
}

static int gt_prepare(gt_run *run)
{
    gt_arguments *a = &run->arguments;
    gt_loop_settings settings;
    gt_peer peer;
    gt_law law;

    if (!gt_table_open(&run->reference, a->reference)) {
        return gt_fail("no reference table in ", a->reference);
    }
    if ((a->corrections != NULL) && !gt_table_open(&run->corrections, a->corrections)) {
        return gt_fail("no table of corrections in ", a->corrections);
    }
    if (!gt_laws_choose(&run->laws, a, &run->reference.traj, &run->corrections.traj, &law)) {
        return gt_fail("--law is trajectory, dynamics, replay (with --corrections) or path, not ", a->law);
    }
    (void)memset(&peer, 0, sizeof(peer));
    peer.protocol = a->peer;
    peer.axes = gt_loop_model.axes;
    peer.cycle_ms = a->cycle_ms;
    settings.dry = !a->live;
    settings.hold_cycles = a->hold_cycles;
    settings.ramp_cycles = a->ramp_cycles;
    settings.limits = a->limits;
    gt_loop_init(&run->loop, &settings, &peer, &law);
    if (!gt_socket_open(&run->socket, a->bind, (uint16_t)a->port, a->allow)) {
        return gt_fail("cannot listen at ", a->bind);
    }
    return 0;
}

static int gt_whole_run(gt_run *run, double *records)
{
    int code = gt_prepare(run);
    int complete;

    if (code != 0) {
        return code;
    }
    if (!gt_log_init(&run->log, records, GT_RING, GT_RECORD_COLUMNS) ||
        !gt_log_writer_start(&run->writer, &run->log, run->arguments.log)) {
        return gt_fail("cannot write ", run->arguments.log);
    }
    if (!run->arguments.lockstep) {
        run->realtime = gt_realtime_ask(GT_PRIORITY);
    }
    (void)printf("port %d\n", (int)run->socket.port);
    (void)fflush(stdout);
    gt_go_round(run);
    gt_loop_term(&run->loop);
    complete = gt_log_writer_stop(&run->writer) && (run->log.dropped == 0U);
    gt_report(run, complete);
    return 0;
}

int main(int argc, char **argv)
{
    gt_run run;
    sigset_t ends;
    const size_t size = sizeof(double) * GT_RING * GT_RECORD_COLUMNS;
    const char *wrong;
    void *records;
    int code;

    (void)memset(&run, 0, sizeof(run));
    wrong = gt_arguments_read(&run.arguments, argc, argv);
    if (wrong != NULL) {
        return gt_fail(wrong, "");
    }
    (void)sigemptyset(&ends);
    (void)sigaddset(&ends, SIGINT);
    (void)sigaddset(&ends, SIGTERM);
    (void)sigprocmask(SIG_BLOCK, &ends, NULL);
    records = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (records == MAP_FAILED) {
        return gt_fail("no memory for the log: ", strerror(errno));
    }
    code = gt_whole_run(&run, (double *)records);
    gt_socket_close(&run.socket);
    gt_table_close(&run.reference);
    gt_table_close(&run.corrections);
    (void)munmap(records, size);
    return code;
}
