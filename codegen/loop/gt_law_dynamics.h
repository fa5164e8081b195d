/* Law: inverse-dynamics feedforward for carts under position control of known stiffness.
 *
 * The protocols take no forces. A servo F = kp (u - q) + kd (du - dq) makes the force tau of the model when it is sent
 * u = r + tau / kp and du = dr; where speeds are not sent (du = 0), u = r + (tau + kd dr) / kp.
 */
#ifndef GT_LAW_DYNAMICS_H
#define GT_LAW_DYNAMICS_H

#include "gt_law.h"
#include "gt_robot_model.h"
#include "gt_traj.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_dynamics {
    gt_traj reference;
    const gt_robot_model *model;
    int feedforward;      /* 0: the reference as it is */
    int sends_speed;      /* the protocol carries speeds */
    uint32_t lead_ms;     /* the reference is taken this much later, for half a cycle of a held command */
    double kp_N_m[GT_AXES];
    double kd_N_s_m[GT_AXES];
} gt_law_dynamics;

gt_law gt_law_dynamics_of(gt_law_dynamics *state);

#ifdef __cplusplus
}
#endif

#endif
