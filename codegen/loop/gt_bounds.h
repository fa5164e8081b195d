/* What a law's command and the carts themselves have to keep: gt_limits. */
#ifndef GT_BOUNDS_H
#define GT_BOUNDS_H

#include "gt_loop.h"

#ifdef __cplusplus
extern "C" {
#endif

/* 1 if a cart is not where it was sent, unless the robot runs its own programme. */
int gt_bounds_apart(const gt_loop *loop);

/* 1 if the command keeps the limits of place, path and step, the last from the command before it, from the last one
 * that was answered, and by its speeds. */
int gt_bounds_allow(const gt_loop *loop, const gt_command *command);

#ifdef __cplusplus
}
#endif

#endif
