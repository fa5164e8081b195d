/* A sampled reference: rows of numbers at a constant step, such as the motion that an optimisation exported.
 *
 * The rows belong to the caller, who keeps them as long as the reference is used.
 */
#ifndef GT_TRAJ_H
#define GT_TRAJ_H

#include "gt_guard.h"
#include "gt_status.h"

#include <stddef.h>
#include <stdint.h>

/* Row n stands at n * step_ms; row by row, `columns` numbers each. */
typedef struct gt_traj {
    const double *rows;
    uint32_t count;
    uint32_t columns;
    uint32_t step_ms;
} gt_traj;

/* The row at a time, linear between two rows, the last row after the end. GT_OUT_OF_RANGE for an empty reference or a
 * step of zero, GT_NOT_FINITE if a number or the difference of two consecutive numbers is not finite. `row` is written
 * only with GT_OK. */
static inline gt_status gt_traj_at(const gt_traj *traj, uint64_t time_ms, double *row)
{
    const double *below;
    const double *above;
    double weight;
    uint64_t n;
    uint32_t k;

    if ((traj->rows == NULL) || (traj->count == 0U) || (traj->step_ms == 0U)) {
        return GT_OUT_OF_RANGE;
    }
    n = time_ms / traj->step_ms;
    if (n >= (uint64_t)traj->count - 1U) {
        n = (uint64_t)traj->count - 1U;
        weight = 0.0;
    } else {
        weight = (double)(uint32_t)(time_ms % traj->step_ms) / (double)traj->step_ms;
    }
    below = &traj->rows[(size_t)n * traj->columns];
    above = (weight > 0.0) ? &below[traj->columns] : below;
    if (!gt_all_finite(below, (int)traj->columns) || !gt_all_finite(above, (int)traj->columns)) {
        return GT_NOT_FINITE;
    }
    for (k = 0U; k < traj->columns; k++) {
        if (!(fabs(above[k] - below[k]) <= DBL_MAX)) {
            return GT_NOT_FINITE;
        }
    }
    for (k = 0U; k < traj->columns; k++) {
        row[k] = (weight > 0.0) ? (below[k] + (weight * (above[k] - below[k]))) : below[k];
    }
    return GT_OK;
}

/* Time of the last row [ms]; 0 for an empty reference. */
static inline uint64_t gt_traj_end_ms(const gt_traj *traj)
{
    return (traj->count == 0U) ? 0U : ((uint64_t)(traj->count - 1U) * traj->step_ms);
}

#endif
