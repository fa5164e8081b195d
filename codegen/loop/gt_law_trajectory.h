/* Law: the carts of an optimised motion, with the closed-loop drives b q^-d / (1 - a q^-1) inverted.
 *
 * Dressler 2012, eq. (6.11). With feedforward, u(k) = r0 + (r(k+d) - r0 - a (r(k+d-1) - r0)) / b; without, u(k) = r(k).
 */
#ifndef GT_LAW_TRAJECTORY_H
#define GT_LAW_TRAJECTORY_H

#include "gt_law.h"
#include "gt_robot_model.h"
#include "gt_traj.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_trajectory {
    gt_traj reference;
    uint32_t axes;
    int feedforward;    /* 0: the reference as it is */
    uint32_t delay_ms;  /* of the drives */
    uint32_t cycle_ms;  /* sample time of a and b */
    double a[GT_AXES];
    double b[GT_AXES];
    double start_m[GT_AXES]; /* where the reference begins; set by init */
} gt_law_trajectory;

gt_law gt_law_trajectory_of(gt_law_trajectory *state);

#ifdef __cplusplus
}
#endif

#endif
