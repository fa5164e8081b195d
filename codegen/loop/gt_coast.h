/* Motion of the carts from cycle to cycle: to the law's commands, without them on at the last speed, then to a stop. */
#ifndef GT_COAST_H
#define GT_COAST_H

#include "gt_loop.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The law's command counts; its speeds are the way there over the robot's time for it. */
void gt_coast_follow(gt_loop *loop, const gt_command *command);

/* The carts go on for a cycle at these speeds times `share`, within the limits, and no further than a step from what
 * was answered last: without answers a robot stands. From outside of the limits they go no further out. */
void gt_coast(gt_loop *loop, const double *speed, double share);

/* A cycle that brought nothing to answer: the last speed is held, or the law's plan followed; 0 where it has none. */
int gt_coast_goes_on(gt_loop *loop);

/* The ramp to zero starts at the speed at which the carts go on. */
void gt_coast_begin_ramp(gt_loop *loop);

/* One cycle of the ramp; behind its last one the loop is stopped. */
void gt_coast_ramp(gt_loop *loop);

#ifdef __cplusplus
}
#endif

#endif
