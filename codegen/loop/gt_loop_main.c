/* The program round gt_loop: socket, clock, log, priorities. Prints its port, then one line of JSON at the end.
 *
 * Dry unless --live: EGM gets no answer, RSI gets corrections of zero. Tested against simulators only.
 */
#ifndef _DEFAULT_SOURCE
#define _DEFAULT_SOURCE 1 /* MAP_ANONYMOUS */
#endif

#include "gt_clock.h"
#include "gt_run.h"

#include <errno.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>

#define GT_PRIORITY 80
#define GT_RING 4096U
#define GT_LONGEST_WAIT_MS 50U
#define GT_MS_NS 1000000
#define GT_DRAIN_MOST 512U /* datagrams of a cycle: a flood must not keep the answer back */
#define GT_LOG_INCOMPLETE 1

/* 1 if a signal asks for the end; each is taken once. */
static int gt_asked_to_end(const sigset_t *ends)
{
    const struct timespec now = {0, 0};

    return sigtimedwait(ends, NULL, &now) > 0;
}

static void gt_ends_by(gt_run *run, const char *what)
{
    run->ended_by = what;
    run->ended_in = run->loop.state;
}

static void gt_end_cycle(gt_run *run, uint8_t *answer)
{
    const int64_t begun = gt_clock_ns();
    const uint32_t length = gt_loop_cycle(&run->loop, answer);

    gt_histogram_add(&run->compute, gt_clock_ns() - begun);
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

/* The datagrams that are there; 1 if one of them was empty, the end of a cycle in lock step. */
static int gt_drain(gt_run *run, uint8_t *data)
{
    uint32_t n;

    for (n = 0U; n < GT_DRAIN_MOST; n++) {
        const int32_t length = gt_socket_take(&run->socket, data, GT_DATAGRAM_MAX + 1U);
        const uint64_t before = run->loop.sequence.started ? run->loop.sequence.newest : UINT64_MAX;

        if (length == GT_SOCKET_EMPTY) {
            return 0;
        }
        if ((length == 0) && run->arguments.lockstep) {
            return 1;
        }
        if (length >= 0) {
            gt_loop_datagram(&run->loop, data, (uint32_t)length);
        }
        if (run->loop.sequence.started && !run->socket.kept) {
            gt_socket_keep(&run->socket); /* the first datagram that could be read: this is the robot */
        }
        if (run->loop.fresh && (run->loop.sequence.newest != before)) {
            run->arrived_ns = gt_clock_ns() - gt_socket_age_ns(&run->socket);
        }
    }
    return 0;
}

/* How long to wait for a datagram [ms]; before the robot sends, as long as a person waits for an end. */
static int gt_wait_ms(const gt_run *run, int64_t left_ns)
{
    if (run->arguments.lockstep || !run->loop.sequence.started) {
        return (run->arguments.idle_ms < GT_LONGEST_WAIT_MS) ? (int)run->arguments.idle_ms : (int)GT_LONGEST_WAIT_MS;
    }
    return (left_ns > 0) ? (int)((left_ns + GT_MS_NS - 1) / GT_MS_NS) : 0;
}

/* 1 when the loop has come to its end: in real time it ramps to a stop before, unless it is asked a second time. */
static int gt_is_over(gt_run *run, const sigset_t *ends)
{
    const int asked = gt_asked_to_end(ends);
    const int full = (run->arguments.cycles > 0U) && (run->loop.cycles >= run->arguments.cycles);

    if (run->ended_by != NULL) {
        return asked || (run->loop.state == GT_LOOP_STOPPED);
    }
    if (asked || full) {
        gt_ends_by(run, asked ? "signal" : "cycles");
        gt_loop_stop(&run->loop);
        return run->arguments.lockstep || (run->loop.state == GT_LOOP_STOPPED);
    }
    return 0;
}

static void gt_go_round(gt_run *run, const sigset_t *ends)
{
    uint8_t data[GT_DATAGRAM_MAX + 1U];
    uint8_t answer[GT_DATAGRAM_MAX];
    const int64_t cycle_ns = (int64_t)run->arguments.cycle_ms * GT_MS_NS;
    const int64_t patience_ns = (3 * cycle_ns) / 2; /* then a cycle is over also without a newer datagram */
    int64_t last = gt_clock_ns(); /* when the robot's cycle began; those without a datagram follow like its own */
    int64_t heard = last;
    int64_t ended_ns = last;

    (void)memset(data, 0, sizeof(data));
    while (!gt_is_over(run, ends)) {
        const int there = gt_socket_wait(&run->socket, gt_wait_ms(run, (last + patience_ns) - gt_clock_ns()));
        const int64_t now = gt_clock_ns();
        const int64_t before_ns = run->arrived_ns;
        const int ended = there ? gt_drain(run, data) : 0;
        const int arrived = run->arrived_ns != before_ns;
        const int due = gt_loop_is_due(&run->loop);
        const int late = run->loop.sequence.started && ((now - last) >= patience_ns);

        if (run->loop.fresh || (there && run->arguments.lockstep)) {
            heard = now;
        }
        if (run->arguments.lockstep ? ended : (due || late)) {
            const int64_t from = due ? run->arrived_ns : now;
            const int64_t asleep = run->arguments.lockstep ? 0 : (((now - last) / cycle_ns) - 1);

            gt_loop_slept(&run->loop, asleep);
            gt_end_cycle(run, answer);
            gt_report_count(run, gt_clock_ns() - from, now - ended_ns, cycle_ns);
            ended_ns = now;
            last = (due || (asleep > 0)) ? now : (last + cycle_ns);
        } else {
            last = arrived ? now : last; /* the robot's next cycle counts from a datagram also where it makes none */
        }
        if ((now - heard) >= ((int64_t)run->arguments.idle_ms * GT_MS_NS)) {
            if (run->ended_by == NULL) {
                gt_ends_by(run, "silence"); /* the watchdog: nobody is there */
            }
            return;
        }
    }
}

static int gt_prepare(gt_run *run)
{
    gt_arguments *a = &run->arguments;
    gt_loop_settings settings;
    gt_peer peer;
    gt_law law;
    int code;

    if (a->fewest < gt_loop_model.axes) {
        return gt_fail("", "an option for all carts has fewer numbers than there are carts", "");
    }
    code = gt_run_law(run, &law);
    if (code != 0) {
        return code;
    }
    (void)memset(&peer, 0, sizeof(peer));
    peer.protocol = a->peer;
    peer.axes = gt_loop_model.axes;
    peer.joints = gt_loop_model.joints;
    peer.cycle_ms = a->cycle_ms;
    settings.dry = !a->live;
    settings.hold_cycles = a->hold_cycles;
    settings.ramp_cycles = a->ramp_cycles;
    settings.deceleration_m_s2 = a->deceleration_m_s2;
    settings.limits = a->limits;
    gt_loop_init(&run->loop, &settings, &peer, &law);
    if (!gt_socket_open(&run->socket, a->bind, (uint16_t)a->port, a->allow)) {
        return gt_fail(a->bind, "cannot listen there", strerror(errno));
    }
    return 0;
}

static int gt_whole_run(gt_run *run, double *records, const sigset_t *ends)
{
    int code = gt_prepare(run);
    int complete;

    if (code != 0) {
        return code;
    }
    if (!gt_log_init(&run->log, records, GT_RING, GT_RECORD_COLUMNS) ||
        !gt_log_writer_start(&run->writer, &run->log, run->arguments.log)) {
        return gt_fail(run->arguments.log, "cannot write this log", strerror(errno));
    }
    if (!run->arguments.lockstep) {
        run->realtime = gt_realtime_ask(GT_PRIORITY);
    }
    gt_report_port(run);
    gt_go_round(run, ends);
    gt_loop_term(&run->loop);
    complete = gt_log_writer_stop(&run->writer) && (run->log.dropped == 0U);
    gt_report(run, complete);
    if (!complete) {
        (void)gt_fail(run->arguments.log, "the log is not complete: records were dropped or could not be written", "");
        return GT_LOG_INCOMPLETE;
    }
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
    run.socket.file = -1;
    if ((argc == 2) && (strcmp(argv[1], "--help") == 0)) {
        gt_report_text(gt_arguments_help());
        return 0;
    }
    wrong = gt_arguments_read(&run.arguments, argc, argv);
    if (wrong != NULL) {
        return gt_fail((run.arguments.about != NULL) ? run.arguments.about : "", wrong, "");
    }
    /* a closed terminal asks for the end too; a closed pipe or a full file must not stop a moving robot */
    (void)sigemptyset(&ends);
    (void)sigaddset(&ends, SIGINT);
    (void)sigaddset(&ends, SIGTERM);
    (void)sigaddset(&ends, SIGHUP);
    (void)sigprocmask(SIG_BLOCK, &ends, NULL);
    (void)signal(SIGPIPE, SIG_IGN);
    (void)signal(SIGXFSZ, SIG_IGN);
    records = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (records == MAP_FAILED) {
        return gt_fail("", "no memory for the log", strerror(errno));
    }
    code = gt_whole_run(&run, (double *)records, &ends);
    gt_socket_close(&run.socket);
    gt_run_close(&run);
    (void)munmap(records, size);
    return code;
}
