/* Motion of the loop without commands of its law: on at the last speed, then ramped to a stop. */
#ifndef GT_COAST_H
#define GT_COAST_H

#include "gt_loop.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The carts go on for a cycle at these speeds times `share`, within the limits. */
void gt_coast(gt_loop *loop, const double *speed, double share);

/* The ramp to zero starts at the speed of the last command. */
void gt_coast_begin_ramp(gt_loop *loop);

/* One cycle of the ramp; behind its last one the loop is stopped. */
void gt_coast_ramp(gt_loop *loop);

#ifdef __cplusplus
}
#endif

#endif
