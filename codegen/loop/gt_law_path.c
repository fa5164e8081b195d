/* gt_law_path: see gt_law_path.h. */
#include "gt_law_path.h"

#include <stddef.h>

static gt_status gt_path_init(void *state, const gt_feedback *first)
{
    gt_law_path *law = (gt_law_path *)state;
    gt_status status = GT_OK;
    int k;

    law->last_ms = 0U;
    for (k = 0; k < 3; k++) {
        law->correction_m[k] = 0.0;
    }
    if ((law->model == NULL) || (law->model->forward == NULL) || !first->has_planned || !(law->limit_m >= 0.0)) {
        status = GT_OUT_OF_RANGE;
    }
    return status;
}

static double gt_within(double value, double limit)
{
    const double below = (value > limit) ? limit : value;

    return (below < -limit) ? -limit : below;
}

static gt_status gt_path_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command)
{
    gt_law_path *law = (gt_law_path *)state;
    const double seconds = (double)(uint32_t)(elapsed_ms - law->last_ms) / 1000.0;
    double wanted[3];
    double found[3];
    gt_status status = law->model->forward(feedback->planned_m, wanted);
    int k;

    if (status == GT_OK) {
        status = law->model->forward(feedback->position_m, found);
    }
    if (status != GT_OK) {
        return status;
    }
    command->along_path = 1;
    law->last_ms = elapsed_ms;
    for (k = 0; k < 3; k++) {
        const double step = (law->gain_per_s * seconds) * (wanted[k] - found[k]);

        law->correction_m[k] = gt_within(law->correction_m[k] + step, law->limit_m);
        command->path_m[k] = law->correction_m[k];
    }
    return GT_OK;
}

static void gt_path_term(void *state)
{
    (void)state;
}

gt_law gt_law_path_of(gt_law_path *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 0;
    law.init = gt_path_init;
    law.step = gt_path_step;
    law.go_on = NULL;
    law.term = gt_path_term;
    law.numbers = NULL;
    return law;
}
