/* gt_law_dynamics: see gt_law_dynamics.h. */
#include "gt_law_dynamics.h"

#include <stddef.h>

static gt_status gt_dynamics_init(void *state, const gt_feedback *first)
{
    const gt_law_dynamics *law = (const gt_law_dynamics *)state;
    uint32_t n;

    (void)first;
    if ((law->model == NULL) || (law->model->inverse_dynamics == NULL) || (law->model->axes > GT_AXES) ||
        (law->reference.columns != GT_REFERENCE_COLUMNS(law->model->axes))) {
        return GT_OUT_OF_RANGE;
    }
    for (n = 0U; n < law->model->axes; n++) {
        if (!(law->kp_N_m[n] > 0.0)) {
            return GT_SINGULAR;
        }
    }
    return GT_OK;
}

static gt_status gt_dynamics_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command)
{
    const gt_law_dynamics *law = (const gt_law_dynamics *)state;
    const uint32_t axes = law->model->axes;
    double row[GT_REFERENCE_MOST];
    double force[GT_AXES];
    gt_status status = gt_traj_at(&law->reference, elapsed_ms + law->lead_ms, row);
    const double *given = law->model->joints ? row : &row[3U * axes];
    const uint32_t width = law->model->joints ? axes : 3U;
    uint32_t n;

    (void)feedback;
    if ((status == GT_OK) && law->feedforward) {
        status = law->model->inverse_dynamics(given, &given[width], &given[2U * width], force);
    }
    if (status != GT_OK) {
        return status;
    }
    command->along_path = 0;
    for (n = 0U; n < axes; n++) {
        const double speed = row[axes + n];

        command->position_m[n] = row[n];
        if (law->feedforward) {
            const double damping = law->sends_speed ? 0.0 : (law->kd_N_s_m[n] * speed);

            command->position_m[n] = row[n] + ((force[n] + damping) / law->kp_N_m[n]);
        }
        command->speed_m_s[n] = speed;
    }
    return GT_OK;
}

static void gt_dynamics_term(void *state)
{
    (void)state;
}

gt_law gt_law_dynamics_of(gt_law_dynamics *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 0;
    law.init = gt_dynamics_init;
    law.step = gt_dynamics_step;
    law.go_on = NULL;
    law.term = gt_dynamics_term;
    law.numbers = NULL;
    return law;
}
