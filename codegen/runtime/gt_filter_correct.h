/* The readings of one instant, for gt_filter.h. */
#ifndef GT_FILTER_CORRECT_H
#define GT_FILTER_CORRECT_H

#include "gt_filter_number.h"

/* The mean moved by an error; four numbers of memory. */
static inline void gt_filter_plus(const gt_filter *f, double *mean, const double *error, double *four)
{
    const double *arg[2];
    double *res[1];
    int n;

    for (n = 0; n < f->size; n++) {
        if (f->error_of[n] >= 0) {
            mean[n] += error[f->error_of[n]];
        }
    }
    for (n = 0; n < f->quaternions; n++) {
        gt_copy(four, &mean[f->turned[2 * n]], 4);
        arg[0] = four;
        arg[1] = &error[f->turned[(2 * n) + 1]];
        res[0] = &mean[f->turned[2 * n]];
        (void)f->turn(arg, res, 0, 0, 0);
    }
}

/* The belief after the readings of an instant; `present` says of each sensor whether there is one. */
static GT_FILTER_ONCE gt_status gt_filter_correct(const gt_filter *f, const gt_filter_belief *belief, const double *u,
                                          const double *readings, const int *present,
                                          const gt_filter_outcome *outcome, const gt_filter_work *work)
{
    double *error = &work->vectors[3 * f->stride];
    double *lever = work->lever;
    double *changing = work->values;
    const double *arg[4];
    double *res[2];
    gt_status status = GT_OK;
    double nis = 0.0;
    int count = 0;
    int r;
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
            res[1] = gt_filter_target(&sensor->jacobian, changing, lever);
            (void)sensor->kernel(arg, res, 0, 0, 0);
            gt_filter_fill(&sensor->jacobian, changing, lever);
            if (sensor->gate > 0.0) {
                outcome->gated[s] = gt_filter_gated(f, sensor, belief->covariance, lever, res[0], work);
            }
        }
        lever = &lever[sensor->jacobian.entries];
    }
    for (r = 0; r < f->stride; r++) {
        error[r] = 0.0;
    }
    lever = work->lever;
    for (s = 0; s < f->sensors; s++) {
        const gt_filter_sensor *sensor = &f->sensor[s];
        const gt_filter_matrix *matrix = &sensor->jacobian;

        if ((present[s] != 0) && (outcome->gated[s] == 0)) {
            for (r = 0; r < matrix->rows; r++) {
                const int first = matrix->start[r];

                nis += gt_filter_use(f, &matrix->column[first], &lever[first], matrix->start[r + 1] - first,
                                     sensor->variance[r], work->residual[sensor->first + r], belief->covariance, error,
                                     work);
                count++;
            }
            belief->closed[s] = 0;
        }
        if ((outcome->gated[s] != 0) && (belief->closed[s] < GT_FILTER_MOST)) {
            belief->closed[s]++;
        }
        lever = &lever[matrix->entries];
    }
    gt_filter_plus(f, belief->mean, error, work->values);
    *outcome->nis = nis;
    *outcome->count = count;
    if ((gt_all_finite(belief->mean, f->size) == 0) || !(fabs(nis) <= DBL_MAX)) {
        status = GT_NOT_FINITE;
    } else {
        status = gt_filter_positive(f, belief->covariance, work);
    }
    gt_filter_mirror(f, belief->covariance);
    for (s = 0; (s < f->sensors) && (status == GT_OK); s++) {
        if ((f->sensor[s].closed > 0) && (belief->closed[s] > f->sensor[s].closed)) {
            status = GT_OUT_OF_RANGE;
        }
    }
    return status;
}

#endif
