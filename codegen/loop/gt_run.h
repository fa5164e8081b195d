/* All that a run of the program holds; one object in main, nothing static. */
#ifndef GT_RUN_H
#define GT_RUN_H

#include "gt_arguments.h"
#include "gt_histogram.h"
#include "gt_laws.h"
#include "gt_log.h"
#include "gt_log_writer.h"
#include "gt_loop.h"
#include "gt_realtime.h"
#include "gt_socket.h"
#include "gt_table.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_run {
    gt_arguments arguments;
    gt_socket socket;
    gt_table reference;
    gt_table corrections;
    gt_table gains;
    gt_laws laws;
    void *plan; /* memory of gt_loop_model.plan, or NULL */
    gt_loop loop;
    gt_log log;
    gt_log_writer writer;
    gt_realtime realtime;
    int64_t arrived_ns;    /* when the system got the newest datagram */
    gt_histogram reply;    /* from there to the answer sent; from waking up where no datagram is newer */
    gt_histogram period;   /* between two cycles */
    gt_histogram compute;  /* law, checks and answer of a cycle, without sockets */
    uint64_t missed;       /* answers later than a cycle */
    const char *ended_by;  /* NULL while it runs: cycles, signal, silence */
    gt_loop_state ended_in; /* state when it was asked to end */
} gt_run;

/* Says on stderr why the program does not go on; returns its exit code. Each text may be "". */
int gt_fail(const char *about, const char *sentence, const char *reason);

/* The law that the options ask for, with its tables, which gt_run_close gives back; 0 or what gt_fail returned. */
int gt_run_law(gt_run *run, gt_law *law);
void gt_run_close(gt_run *run);

/* Counts a cycle that is over: its answer, and how long it is since the one before. */
void gt_report_count(gt_run *run, int64_t reply_ns, int64_t period_ns, int64_t cycle_ns);

/* For the other end to read: where the loop listens, and at the end one line of JSON. */
void gt_report_port(const gt_run *run);
void gt_report(const gt_run *run, int log_complete);

/* For a person, on stdout. */
void gt_report_text(const char *text);

#ifdef __cplusplus
}
#endif

#endif
