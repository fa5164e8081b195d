/* gt_laws: see gt_laws.h. */
#include "gt_laws.h"

#include "gt_guard.h"

#include <stddef.h>
#include <string.h>

int gt_laws_choose(gt_laws *laws, const gt_arguments *arguments, const gt_laws_tables *tables, gt_law *law)
{
    (void)memset(laws, 0, sizeof(*laws));
    laws->trajectory.reference = tables->reference;
    laws->trajectory.axes = gt_loop_model.axes;
    laws->trajectory.feedforward = arguments->feedforward;
    laws->trajectory.delay_ms = arguments->delay_ms;
    laws->trajectory.cycle_ms = arguments->cycle_ms;
    gt_copy(laws->trajectory.a, arguments->a, (int)GT_AXES);
    gt_copy(laws->trajectory.b, arguments->b, (int)GT_AXES);
    laws->dynamics.reference = tables->reference;
    laws->dynamics.model = &gt_loop_model;
    laws->dynamics.feedforward = arguments->feedforward;
    laws->dynamics.sends_speed = (arguments->peer == GT_PEER_EGM) ? 1 : 0;
    laws->dynamics.lead_ms = arguments->lead_ms;
    gt_copy(laws->dynamics.kp_N_m, arguments->kp_N_m, (int)GT_AXES);
    gt_copy(laws->dynamics.kd_N_s_m, arguments->kd_N_s_m, (int)GT_AXES);
    laws->replay.reference = tables->reference;
    laws->replay.corrections = tables->corrections;
    laws->replay.axes = gt_loop_model.axes;
    laws->path.model = &gt_loop_model;
    laws->path.gain_per_s = arguments->gain_per_s;
    laws->path.limit_m = arguments->limits.path_m;
    laws->lead_through.model = &gt_loop_model;
    laws->lead_through.numbers = tables->gains;
    laws->lead_through.cycle_ms = arguments->cycle_ms;
    laws->lead_through.hold_cycles = arguments->hold_cycles;
    laws->predictive.goals = tables->reference;
    laws->predictive.model = &gt_loop_model;
    laws->predictive.plan = tables->plan;
    laws->predictive.sends_speed = laws->dynamics.sends_speed;
    laws->predictive.cycle_ms = arguments->cycle_ms;
    laws->predictive.hold_cycles = arguments->hold_cycles;
    if ((strcmp(arguments->law, "lead_through") == 0) && (tables->gains.rows != NULL)) {
        *law = gt_law_lead_through_of(&laws->lead_through);
    } else if (tables->reference.rows == NULL) {
        return 0;
    } else if (strcmp(arguments->law, "trajectory") == 0) {
        *law = gt_law_trajectory_of(&laws->trajectory);
    } else if (strcmp(arguments->law, "dynamics") == 0) {
        *law = gt_law_dynamics_of(&laws->dynamics);
    } else if ((strcmp(arguments->law, "replay") == 0) && (tables->corrections.rows != NULL)) {
        *law = gt_law_replay_of(&laws->replay);
    } else if (strcmp(arguments->law, "predictive") == 0) {
        *law = gt_law_predictive_of(&laws->predictive);
    } else if (strcmp(arguments->law, "path") == 0) {
        *law = gt_law_path_of(&laws->path);
    } else {
        return 0;
    }
    return 1;
}
