/* A sampled reference: rows of numbers at a constant step, such as the motion that an optimisation exported.
 *
 * The rows belong to the caller, who keeps them as long as the reference is used.
 */
#ifndef GT_TRAJ_H
#define GT_TRAJ_H

#include "gt_guard.h"
#include "gt_status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Row n stands at n * step_ms; row by row, `columns` numbers each. */
typedef struct gt_traj {
    const double *rows;
    uint32_t count;
    uint32_t columns;
    uint32_t step_ms;
} gt_traj;

/* The row at a time, linear between two rows, the last one behind the end. GT_OUT_OF_RANGE for an empty reference,
 * GT_NOT_FINITE for a number that is not finite; `row` is written only with GT_OK. */
gt_status gt_traj_at(const gt_traj *traj, uint64_t time_ms, double *row);

/* When the last row stands [ms]; 0 for an empty reference. */
uint64_t gt_traj_end_ms(const gt_traj *traj);

#ifdef __cplusplus
}
#endif

#endif
