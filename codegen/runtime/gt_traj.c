/* gt_traj: see gt_traj.h. */
#include "gt_traj.h"

#include <stddef.h>

uint64_t gt_traj_end_ms(const gt_traj *traj)
{
    return (traj->count == 0U) ? 0U : ((uint64_t)(traj->count - 1U) * traj->step_ms);
}

gt_status gt_traj_at(const gt_traj *traj, uint64_t time_ms, double *row)
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
        row[k] = (weight > 0.0) ? (below[k] + (weight * (above[k] - below[k]))) : below[k];
    }
    return GT_OK;
}
