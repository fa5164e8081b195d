/* Law: the robot runs its own programme; the loop moves the tool centre point by an integral of its deviation.
 *
 * c(k) = c(k-1) + gain dt (T(r) - T(q)), within +-limit; r is the reference of the carts by the robot's own
 * programme, without the correction. In the frame of the model, which on a real controller has to be the one of the
 * correction.
 */
#ifndef GT_LAW_PATH_H
#define GT_LAW_PATH_H

#include "gt_law.h"
#include "gt_robot_model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_path {
    const gt_robot_model *model;
    double gain_per_s;
    double limit_m;
    uint64_t last_ms;      /* set by the law */
    double correction_m[3];
} gt_law_path;

gt_law gt_law_path_of(gt_law_path *state);

#ifdef __cplusplus
}
#endif

#endif
