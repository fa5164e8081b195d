/* Law: an optimum over a horizon, solved anew in each cycle by a generated step function (gt_robot_plan).
 *
 * The plan gives the force of a cycle, and positions and speeds at its end. The protocols take no forces: a servo
 * F = kp (u - q) + kd (du - dq), which the step function knows, makes that force on average over the cycle by the
 * command that this law sends. Drives that follow positions whatever the force are no plant of such a plan: readings of
 * positions that were commanded say nothing about forces.
 *
 * In a cycle without a datagram, or with a reading that cannot be used, the plan moves on by one period. A row of goals
 * that is not finite is refused: the goals before it stay, for hold_cycles in a row.
 */
#ifndef GT_LAW_PREDICTIVE_H
#define GT_LAW_PREDICTIVE_H

#include "gt_law.h"
#include "gt_robot_model.h"
#include "gt_traj.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_predictive {
    gt_traj goals; /* a row: the references of one stage */
    const gt_robot_model *model;
    void *plan;    /* memory of model->plan->bytes */
    int sends_speed; /* the protocol carries speeds */
    uint32_t cycle_ms;
    uint32_t hold_cycles;
    uint64_t done;     /* cycles of the plan so far */
    uint32_t refused;  /* rows of goals in a row */
    gt_status over;    /* why there is no plan any more */
    double goal[GT_PLAN_GOALS_MOST];
    double predicted_m[GT_PLAN_AHEAD_MOST][GT_AXES]; /* for the cycles to come; a ring */
    double numbers[GT_LAW_NUMBERS];
} gt_law_predictive;

gt_law gt_law_predictive_of(gt_law_predictive *state);

#ifdef __cplusplus
}
#endif

#endif
