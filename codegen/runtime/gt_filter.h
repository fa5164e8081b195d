/* A Kalman filter of the error of a state, one cycle at a time: loops for the covariance round generated kernels.
 *
 * Means lie on a product of vectors and unit quaternions, errors in its tangent space. Readings of one instant are all
 * linearised at the predicted mean and then used one number after the other, so that nothing is inverted; together they
 * are what the joint update is. The covariance is kept as U D U', which is positive where D is.
 * gtmodel/filtering/controller/twin.py does the same in the same order; the two agree bit for bit. Nothing is
 * allocated; all memory is the caller's.
 */
#ifndef GT_FILTER_H
#define GT_FILTER_H

#include "gt_filter_correct.h"
#include "gt_filter_motion.h"

/* What a reading must be before it is used: finite, of unit length where it is a quaternion, not too large. */
static GT_FILTER_ONCE gt_status gt_filter_judged(const gt_filter_sensor *sensor, const double *z)
{
    gt_status status = GT_OK;
    double square = 0.0;
    int k;

    if (gt_all_finite(z, sensor->numbers) == 0) {
        status = GT_NOT_FINITE;
    } else {
        for (k = 0; k < sensor->numbers; k++) {
            square += z[k] * z[k];
            if (!(fabs(z[k]) <= sensor->limit[k])) {
                status = GT_OUT_OF_RANGE;
            }
        }
        if ((sensor->quaternion != 0) && !(fabs(square - 1.0) <= GT_FILTER_UNIT)) {
            status = GT_OUT_OF_RANGE;
        }
    }
    return status;
}

/* A belief at the start: GT_OK, GT_NOT_FINITE, or GT_OUT_OF_RANGE for a quaternion that is not of unit length and a
 * deviation that is not above zero. The memory is empty before. */
static GT_FILTER_ONCE gt_status gt_filter_begin(const gt_filter *f, const gt_filter_memory *memory, const double *mean,
                                           const double *deviation, const double *u)
{
    gt_status status = GT_OK;
    int k;
    int n;

    for (n = 0; n < f->quaternions; n++) {
        double square = 0.0;

        for (k = 0; k < 4; k++) {
            square += mean[f->turned[2 * n] + k] * mean[f->turned[2 * n] + k];
        }
        if (!(fabs(square - 1.0) <= GT_FILTER_UNIT)) {
            status = GT_OUT_OF_RANGE;
        }
    }
    for (n = 0; n < f->errors; n++) {
        const double variance = deviation[n] * deviation[n];

        if (!((deviation[n] > 0.0) && (variance > 0.0) && (variance <= DBL_MAX))) {
            status = GT_OUT_OF_RANGE;
        }
        memory->belief.factor[n * (f->stride + 1)] = 1.0;
        memory->belief.diagonal[n] = variance;
    }
    if ((gt_all_finite(mean, f->size) == 0) || (gt_all_finite(deviation, f->errors) == 0) ||
        (gt_all_finite(u, f->inputs) == 0)) {
        status = GT_NOT_FINITE;
    }
    gt_copy(memory->belief.mean, mean, f->size);
    gt_copy(memory->before, u, f->inputs);
    return status;
}

/* A belief at the next instant, that of a slot of the ring. */
static GT_FILTER_ONCE gt_status gt_filter_instant(const gt_filter *f, const gt_filter_memory *memory,
                                                  const gt_filter_belief *belief, const double *before, int slot,
                                                  const gt_filter_outcome *outcome, const gt_filter_work *work)
{
    const double *u = &memory->inputs[slot * f->inputs];
    gt_status status = gt_filter_advance(f, belief, before, u, work);

    if (status == GT_OK) {
        status = gt_filter_correct(f, belief, u, &memory->readings[slot * f->numbers],
                                   &memory->present[slot * f->sensors], outcome, work);
    }
    return status;
}

/* One cycle: known inputs u, readings z and whether each sensor has one. `now` is what is known at this instant, in
 * memory of its own where there are delays; outcome tells of the newest instant whose readings are all there. The
 * memory is to be used further with GT_OK only. */
static GT_FILTER_ONCE gt_status gt_filter_cycle(const gt_filter *f, const gt_filter_memory *memory, const double *u,
                                        const double *z, const int *flags, const gt_filter_belief *now,
                                        const gt_filter_outcome *outcome, const gt_filter_work *work)
{
    const int ring = f->depth + 1;
    const gt_filter_belief *belief = &memory->belief;
    const double *before = memory->before;
    gt_status status = (gt_all_finite(u, f->inputs) != 0) ? GT_OK : GT_NOT_FINITE;
    gt_filter_outcome ahead = *outcome;
    double nis = 0.0;
    int count = 0;
    int slot;
    int left;
    int k;
    int s;

    *outcome->nis = 0.0;
    *outcome->count = 0;
    for (s = 0; (s < f->sensors) && (status == GT_OK); s++) {
        outcome->gated[s] = 0;
        if (flags[s] != 0) {
            status = gt_filter_judged(&f->sensor[s], &z[f->sensor[s].first]);
        }
    }
    if (status != GT_OK) {
        return status;
    }
    slot = (*memory->place + 1) % ring;
    *memory->place = slot;
    if (*memory->begun <= f->depth) {
        *memory->begun += 1;
    }
    for (k = 0; k < f->inputs; k++) {
        memory->inputs[(slot * f->inputs) + k] = u[k];
    }
    for (s = 0; s < f->sensors; s++) {
        memory->present[(slot * f->sensors) + s] = 0;
    }
    for (s = 0; (s < f->sensors) && (status == GT_OK); s++) {
        const gt_filter_sensor *sensor = &f->sensor[s];

        if (flags[s] == 0) {
            memory->age[s] += (memory->age[s] < GT_FILTER_MOST) ? 1 : 0;
            if ((sensor->stale > 0) && (memory->age[s] > sensor->stale)) {
                status = GT_STALE_INPUT;
            }
        } else {
            memory->age[s] = 0;
            if (sensor->delay < *memory->begun) {
                const int there = (slot + ring - sensor->delay) % ring;

                gt_copy(&memory->readings[(there * f->numbers) + sensor->first], &z[sensor->first], sensor->numbers);
                memory->present[(there * f->sensors) + s] = 1;
            }
        }
    }
    left = *memory->begun;
    if ((left > f->depth) && (status == GT_OK)) {
        slot = (slot + 1) % ring;
        left = f->depth;
        status = gt_filter_instant(f, memory, belief, before, slot, outcome, work);
        gt_copy(memory->before, &memory->inputs[slot * f->inputs], f->inputs);
    }
    if (f->depth > 0) {
        *now->time = *belief->time;
        gt_copy(now->mean, belief->mean, f->size);
        gt_copy(now->factor, belief->factor, f->errors * f->stride);
        gt_copy(now->diagonal, belief->diagonal, f->errors);
        for (s = 0; s < f->sensors; s++) {
            now->closed[s] = belief->closed[s];
        }
        ahead.nis = &nis;
        ahead.count = &count;
        ahead.gated = &now->closed[f->sensors];
        slot = (*memory->place + ring + 1 - left) % ring;
        for (; (left > 0) && (status == GT_OK); left--) {
            status = gt_filter_instant(f, memory, now, before, slot, &ahead, work);
            before = &memory->inputs[slot * f->inputs];
            slot = (slot + 1) % ring;
        }
    }
    return status;
}

#endif
