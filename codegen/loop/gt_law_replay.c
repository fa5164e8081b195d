/* gt_law_replay: see gt_law_replay.h. */
#include "gt_law_replay.h"

#include <stddef.h>

static gt_status gt_replay_init(void *state, const gt_feedback *first)
{
    const gt_law_replay *law = (const gt_law_replay *)state;

    (void)first;
    if ((law->axes > GT_AXES) || (law->corrections.columns != law->axes) ||
        (law->reference.columns != GT_REFERENCE_COLUMNS(law->axes))) {
        return GT_OUT_OF_RANGE;
    }
    return GT_OK;
}

static gt_status gt_replay_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command)
{
    const gt_law_replay *law = (const gt_law_replay *)state;
    double row[GT_REFERENCE_MOST];
    double correction[GT_AXES];
    gt_status status = gt_traj_at(&law->reference, elapsed_ms, row);
    uint32_t n;

    (void)feedback;
    if (status == GT_OK) {
        status = gt_traj_at(&law->corrections, elapsed_ms, correction);
    }
    if (status != GT_OK) {
        return status;
    }
    command->along_path = 0;
    for (n = 0U; n < law->axes; n++) {
        command->position_m[n] = row[n] + correction[n];
        command->speed_m_s[n] = row[law->axes + n];
    }
    return GT_OK;
}

static void gt_replay_term(void *state)
{
    (void)state;
}

gt_law gt_law_replay_of(gt_law_replay *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 0;
    law.init = gt_replay_init;
    law.step = gt_replay_step;
    law.go_on = NULL;
    law.term = gt_replay_term;
    law.numbers = NULL;
    return law;
}
