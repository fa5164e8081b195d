/* The readings of a sensor number by number, for gt_filter.h: Bierman's update of the factors. */
#ifndef GT_FILTER_NUMBER_H
#define GT_FILTER_NUMBER_H

#include "gt_filter_matrix.h"

/* One number of a reading, by a row of an H: the error and the covariance after it. Returns its share of the normalised
 * innovation squared. Bierman 1976, Automatica 12, 375-382: every number of D is multiplied by a share between 0 and 1
 * that is a quotient of sums of what is positive, so that U D U' stays positive whatever the round-off. */
static GT_FILTER_OFTEN double gt_filter_use(const gt_filter *f, const gt_filter_belief *belief, const int *column,
                                            const double *value, int entries, double variance, double residual,
                                            double *error, const gt_filter_work *work)
{
    double *gain = work->vectors;
    double *own = &belief->factor[column[0] * f->stride];
    double left = residual;
    double sum = variance;
    double inverse = 1.0 / variance;
    size_t i;
    int j;
    int k;

    for (j = 0; j < f->stride; j++) {
        gain[j] = 0.0;
    }
    for (k = 0; k < entries; k++) {
        left -= value[k] * error[column[k]];
    }
    /* above the first entry h U is zero */
    for (j = column[0]; j < f->errors; j++) {
        const double before = sum;
        double lever = 0.0;
        double share;
        double factor;

        for (k = 0; k < entries; k++) {
            lever += value[k] * own[column[k]];
        }
        share = belief->diagonal[j] * lever;
        factor = lever * inverse;
        sum += lever * share;
        inverse = 1.0 / sum;
        belief->diagonal[j] *= before * inverse;
        for (i = 0U; i < (((size_t)j / 2U) + 1U); i++) {
            const double first = own[2U * i];
            const double second = own[(2U * i) + 1U];
            const double one = gain[2U * i];
            const double two = gain[(2U * i) + 1U];

            own[2U * i] = first - (factor * one);
            own[(2U * i) + 1U] = second - (factor * two);
            gain[2U * i] = one + (share * first);
            gain[(2U * i) + 1U] = two + (share * second);
        }
        own = &own[f->stride];
    }
    inverse *= left;
    for (i = 0U; i < ((size_t)f->stride / 2U); i++) {
        const double first = error[2U * i] + (gain[2U * i] * inverse);
        const double second = error[(2U * i) + 1U] + (gain[(2U * i) + 1U] * inverse);

        error[2U * i] = first;
        error[(2U * i) + 1U] = second;
    }
    return left * inverse;
}

/* All numbers of a reading, as `gt_filter_use`. */
static GT_FILTER_ONCE double gt_filter_used(const gt_filter *f, const gt_filter_sensor *sensor,
                                            const gt_filter_belief *belief, const double *lever, const double *residual,
                                            double *error, const gt_filter_work *work)
{
    const gt_filter_matrix *matrix = &sensor->jacobian;
    double nis = 0.0;
    int r;

    for (r = 0; r < matrix->rows; r++) {
        const int first = matrix->start[r];

        nis += gt_filter_use(f, belief, &matrix->column[first], &lever[first], matrix->start[r + 1] - first,
                             sensor->variance[r], residual[r], error, work);
    }
    return nis;
}

/* 1 if the gate of a sensor is closed: its normalised innovation squared, alone and before any other reading is used,
 * lies above the limit, or is no number. It is used on a copy. */
static GT_FILTER_ONCE int gt_filter_gated(const gt_filter *f, const gt_filter_sensor *sensor,
                                          const gt_filter_belief *belief, const double *lever, const double *residual,
                                          const gt_filter_work *work)
{
    gt_filter_belief copy = *belief;
    double *error = &work->vectors[f->stride];
    int k;

    copy.factor = work->square;
    copy.diagonal = work->other;
    gt_copy(copy.factor, belief->factor, f->errors * f->stride);
    gt_copy(copy.diagonal, belief->diagonal, f->errors);
    for (k = 0; k < f->stride; k++) {
        error[k] = 0.0;
    }
    return (gt_filter_used(f, sensor, &copy, lever, residual, error, work) <= sensor->gate) ? 0 : 1;
}

#endif
