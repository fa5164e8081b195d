/* The law of a run, its tables and its memory; see gt_run.h. */
#ifndef _DEFAULT_SOURCE
#define _DEFAULT_SOURCE 1 /* MAP_ANONYMOUS */
#endif

#include "gt_run.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>
#include <sys/mman.h>

/* Memory for the state of the plan, where the folder holds one. */
static int gt_open_plan(gt_run *run)
{
    int code = 0;

    if (gt_loop_model.plan != NULL) {
        run->plan = mmap(NULL, gt_loop_model.plan->bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (run->plan == MAP_FAILED) {
            run->plan = NULL;
            code = gt_fail("", "no memory for the plan", strerror(errno));
        }
    }
    return code;
}

static int gt_open(gt_table *table, const char *option, const char *path)
{
    int code = 0;

    if ((path != NULL) && !gt_table_open(table, path)) {
        code = gt_fail(option, "there is no such table", path);
    }
    return code;
}

int gt_run_law(gt_run *run, gt_law *law)
{
    const gt_arguments *a = &run->arguments;
    gt_laws_tables tables;
    int code = gt_open(&run->reference, "--reference", a->reference);

    code = (code != 0) ? code : gt_open(&run->corrections, "--corrections", a->corrections);
    code = (code != 0) ? code : gt_open(&run->gains, "--gains", a->gains);
    code = (code != 0) ? code : gt_open_plan(run);
    tables.reference = run->reference.traj;
    tables.corrections = run->corrections.traj;
    tables.gains = run->gains.traj;
    tables.plan = run->plan;
    if ((code == 0) && !gt_laws_choose(&run->laws, a, &tables, law)) {
        code = gt_fail("--law",
                       "expected trajectory, dynamics, replay (with --corrections), path, lead_through or predictive; "
                       "found",
                       a->law);
    }
    return code;
}

void gt_run_close(gt_run *run)
{
    gt_table_close(&run->reference);
    gt_table_close(&run->corrections);
    gt_table_close(&run->gains);
    if (run->plan != NULL) {
        (void)munmap(run->plan, gt_loop_model.plan->bytes);
    }
}
