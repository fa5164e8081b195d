/* The readings of one instant, for gt_filter.h. */
#ifndef GT_FILTER_CORRECT_H
#define GT_FILTER_CORRECT_H

#include "gt_filter_number.h"

/* A quaternion turned by the rotation vector d, which is small or not: q exp(d / 2). */
static GT_FILTER_ONCE void gt_filter_turn(double *q, const double *d)
{
    const double square = (((d[0] * d[0]) + (d[1] * d[1])) + (d[2] * d[2])) / 4.0;
    const double w = q[0];
    const double x = q[1];
    const double y = q[2];
    const double z = q[3];
    double share = 1.0 - (square / 6.0);
    double c = 1.0 - (square / 2.0);
    double a;
    double b;
    double e;

    if (!(square < 1e-8)) {
        const double half = sqrt(square);

        c = cos(half);
        share = sin(half) / half;
    }
    share /= 2.0;
    a = share * d[0];
    b = share * d[1];
    e = share * d[2];
    q[0] = (((w * c) - (x * a)) - (y * b)) - (z * e);
    q[1] = (((w * a) + (x * c)) + (y * e)) - (z * b);
    q[2] = (((w * b) - (x * e)) + (y * c)) + (z * a);
    q[3] = (((w * e) + (x * b)) - (y * a)) + (z * c);
}

/* The mean moved by an error. */
static inline void gt_filter_plus(const gt_filter *f, double *mean, const double *error)
{
    int n;

    for (n = 0; n < f->size; n++) {
        if (f->error_of[n] >= 0) {
            mean[n] += error[f->error_of[n]];
        }
    }
    for (n = 0; n < f->quaternions; n++) {
        gt_filter_turn(&mean[f->turned[2 * n]], &error[f->turned[(2 * n) + 1]]);
    }
}

/* The variances of the errors. GT_OK where all are finite and each number of D is more than round-off could make of its
 * variance. With D above zero U D U' is positive; with this share it is so too for whoever multiplies it. */
static GT_FILTER_ONCE gt_status gt_filter_judge(const gt_filter *f, const gt_filter_belief *belief, double *variance)
{
    const double *own = belief->factor;
    gt_status status = GT_OK;
    size_t i;
    int j;

    for (j = 0; j < f->stride; j++) {
        variance[j] = 0.0;
    }
    for (j = 0; j < f->errors; j++) {
        const double share = belief->diagonal[j];

        for (i = 0U; i < (((size_t)j / 2U) + 1U); i++) {
            const double first = own[2U * i];
            const double second = own[(2U * i) + 1U];
            const double left = variance[2U * i] + ((share * first) * first);
            const double right = variance[(2U * i) + 1U] + ((share * second) * second);

            variance[2U * i] = left;
            variance[(2U * i) + 1U] = right;
        }
        own = &own[f->stride];
    }
    for (j = 0; j < f->errors; j++) {
        if (!(belief->diagonal[j] > (f->pivot * variance[j]))) {
            status = GT_SINGULAR;
        }
    }
    return (gt_all_finite(variance, f->errors) != 0) ? status : GT_NOT_FINITE;
}

/* The belief after the readings of an instant; `present` says of each sensor whether there is one. */
static GT_FILTER_ONCE gt_status gt_filter_correct(const gt_filter *f, const gt_filter_belief *belief, const double *u,
                                          const double *readings, const int *present,
                                          const gt_filter_outcome *outcome, const gt_filter_work *work)
{
    double *error = work->error;
    double *lever = work->lever;
    const double *arg[4];
    double *res[2];
    gt_status status = GT_OK;
    double nis = 0.0;
    int count = 0;
    int s;

    for (s = 0; s < f->sensors; s++) {
        const gt_filter_sensor *sensor = &f->sensor[s];

        outcome->gated[s] = 0;
        if (present[s] != 0) {
            arg[0] = belief->time;
            arg[1] = belief->mean;
            arg[2] = u;
            arg[3] = &readings[sensor->first];
            res[0] = &work->residual[sensor->first];
            res[1] = lever;
            (void)sensor->kernel(arg, res, 0, 0, 0);
            if (sensor->gate > 0.0) {
                outcome->gated[s] = gt_filter_gated(f, sensor, belief, lever, res[0], work);
            }
        }
        lever = &lever[sensor->jacobian.entries];
    }
    for (s = 0; s < f->stride; s++) {
        error[s] = 0.0;
    }
    lever = work->lever;
    for (s = 0; s < f->sensors; s++) {
        const gt_filter_sensor *sensor = &f->sensor[s];

        if (outcome->gated[s] != 0) {
            if (belief->closed[s] < GT_FILTER_MOST) {
                belief->closed[s]++;
            }
        } else if (present[s] != 0) {
            nis += gt_filter_used(f, sensor, belief, lever, &work->residual[sensor->first], error, work);
            count += sensor->jacobian.rows;
            belief->closed[s] = 0;
        } else {
            /* no reading */
        }
        lever = &lever[sensor->jacobian.entries];
    }
    gt_filter_plus(f, belief->mean, error);
    *outcome->nis = nis;
    *outcome->count = count;
    if ((gt_all_finite(belief->mean, f->size) == 0) || !(fabs(nis) <= DBL_MAX)) {
        status = GT_NOT_FINITE;
    } else {
        status = gt_filter_judge(f, belief, work->variance);
    }
    for (s = 0; (s < f->sensors) && (status == GT_OK); s++) {
        if ((f->sensor[s].closed > 0) && (belief->closed[s] > f->sensor[s].closed)) {
            status = GT_OUT_OF_RANGE;
        }
    }
    return status;
}

#endif
