/* The law of a run and its tables; see gt_run.h. */
#include "gt_run.h"

#include <stddef.h>

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
    tables.reference = run->reference.traj;
    tables.corrections = run->corrections.traj;
    tables.gains = run->gains.traj;
    if ((code == 0) && !gt_laws_choose(&run->laws, a, &tables, law)) {
        code = gt_fail("--law",
                       "expected trajectory, dynamics, replay (with --corrections), path or lead_through; found", a->law);
    }
    return code;
}

void gt_run_close(gt_run *run)
{
    gt_table_close(&run->reference);
    gt_table_close(&run->corrections);
    gt_table_close(&run->gains);
}
