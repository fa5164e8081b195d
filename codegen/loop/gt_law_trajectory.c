/* gt_law_trajectory: see gt_law_trajectory.h. */
#include "gt_law_trajectory.h"

#include <math.h>
#include <stddef.h>

static gt_status gt_trajectory_init(void *state, const gt_feedback *first)
{
    gt_law_trajectory *law = (gt_law_trajectory *)state;
    double row[GT_REFERENCE_MOST];
    gt_status status;
    uint32_t n;

    (void)first;
    if ((law->axes > GT_AXES) || (law->reference.columns != GT_REFERENCE_COLUMNS(law->axes))) {
        return GT_OUT_OF_RANGE;
    }
    for (n = 0U; n < law->axes; n++) {
        if (law->feedforward && !(fabs(law->b[n]) > 0.0)) {
            return GT_SINGULAR;
        }
    }
    status = gt_traj_at(&law->reference, 0U, row);
    if (status == GT_OK) {
        gt_copy(law->start_m, row, (int)law->axes);
    }
    return status;
}

static gt_status gt_trajectory_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms,
                                    gt_command *command)
{
    const gt_law_trajectory *law = (const gt_law_trajectory *)state;
    const uint64_t ahead = law->feedforward ? (elapsed_ms + law->delay_ms) : elapsed_ms;
    double row[GT_REFERENCE_MOST];
    double before[GT_REFERENCE_MOST];
    gt_status status = gt_traj_at(&law->reference, ahead, row);
    uint32_t n;

    (void)feedback;
    if (status == GT_OK) {
        status = gt_traj_at(&law->reference, (ahead > law->cycle_ms) ? (ahead - law->cycle_ms) : 0U, before);
    }
    if (status != GT_OK) {
        return status;
    }
    command->along_path = 0;
    for (n = 0U; n < law->axes; n++) {
        command->position_m[n] = row[n];
        if (law->feedforward) {
            const double wanted = row[n] - law->start_m[n];
            const double previous = before[n] - law->start_m[n];

            command->position_m[n] = law->start_m[n] + ((wanted - (law->a[n] * previous)) / law->b[n]);
        }
        command->speed_m_s[n] = row[law->axes + n];
    }
    return GT_OK;
}

static void gt_trajectory_term(void *state)
{
    (void)state;
}

gt_law gt_law_trajectory_of(gt_law_trajectory *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 0;
    law.init = gt_trajectory_init;
    law.step = gt_trajectory_step;
    law.go_on = NULL;
    law.term = gt_trajectory_term;
    law.numbers = NULL;
    return law;
}
