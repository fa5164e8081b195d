/* From one instant to the next, for gt_filter.h: the mean, F, Q and the covariance. */
#ifndef GT_FILTER_MOTION_H
#define GT_FILTER_MOTION_H

#include "gt_filter_matrix.h"

/* to = from + factor along, so many numbers; where these are odd, one more. */
static GT_FILTER_OFTEN void gt_filter_along(size_t count, const double *from, double factor, const double *along,
                                            double *to)
{
    size_t n;

    for (n = 0U; n < ((count + 1U) / 2U); n++) {
        const double first = from[2U * n] + (factor * along[2U * n]);
        const double second = from[(2U * n) + 1U] + (factor * along[(2U * n) + 1U]);

        to[2U * n] = first;
        to[(2U * n) + 1U] = second;
    }
}

/* How the responses to noise make Q, from the entries of A and, behind them, of G. */
static GT_FILTER_ONCE void gt_filter_noise(const gt_filter *f, const double *value, const gt_filter_work *work)
{
    static const double one = 1.0;
    const gt_filter_motion *motion = f->motion;
    const int moving = motion->response.entries;
    const int fixed = motion->fixed_responses;
    const int every = moving + fixed;
    const int changing = f->noise.changing;
    double *total = work->other;
    double *term = &total[every + 1];
    double *sum = &term[changing + 1];
    double *power = work->square;
    int node;
    int k;
    int n;

    for (n = 0; n < moving; n++) {
        power[n] = 0.0;
    }
    for (n = 0; n < motion->drive.entries; n++) {
        power[motion->drive.column[n]] = value[motion->drift.entries + n];
    }
    for (k = 0; k < GT_FILTER_TERMS; k++) {
        double *own = &power[k * every];

        for (n = 0; n < fixed; n++) {
            own[moving + n] = motion->fixed_response[(k * fixed) + n];
        }
        gt_filter_multiply(&motion->response, value, own, &own[every]);
    }
    for (n = 0; n < changing; n++) {
        sum[n] = 0.0;
    }
    for (node = 0; node < GT_FILTER_NODES; node++) {
        gt_copy(total, power, moving);
        gt_filter_sum(total, ((size_t)moving + 1U) / 2U, power, motion->power, &one, 0,
                      &motion->powers[node * GT_FILTER_TERMS], GT_FILTER_TERMS);
        for (n = 0; n < fixed; n++) {
            total[moving + n] = motion->fixed_total[(node * fixed) + n];
        }
        gt_filter_multiply(&motion->spread, total, total, term);
        gt_filter_along((size_t)changing, sum, motion->weights[node], term, sum);
    }
    gt_filter_fill(&f->noise, sum, work->noise);
}

/* One step of Runge and Kutta from `mean`, F and Q on the way. */
static GT_FILTER_ONCE void gt_filter_move(const gt_filter *f, double time, double *mean, const double *u0,
                                          const double *u1, const gt_filter_work *work)
{
    static const double share[4] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[4] = {1.0, 2.0, 2.0, 1.0};
    const gt_filter_motion *motion = f->motion;
    const int entries = motion->jacobian.rows * motion->width;
    const double step = f->step;
    double *rates = work->values;
    double *x = &rates[f->size];
    double *total = &x[f->size];
    double *u = &total[f->size];
    double *value = &u[f->inputs];
    double *changing = &value[motion->values];
    double *begin = &changing[motion->changing];
    double *change = &begin[entries];
    double *sum = &change[entries];
    double *path = &sum[entries];
    double *made = &path[entries + motion->fixed_paths];
    const double *fixed = motion->fixed_path;
    const double *arg[3];
    double *res[2];
    double now;
    int stage;
    int n;

    arg[0] = &time;
    arg[1] = mean;
    arg[2] = u0;
    if (motion->noise != NULL) {
        res[0] = value;
        res[1] = &value[motion->drift.entries];
        (void)motion->noise(arg, res, 0, 0, 0);
    }
    gt_filter_noise(f, value, work);

    for (n = 0; n < entries; n++) {
        begin[n] = 0.0;
        change[n] = 0.0;
        sum[n] = 0.0;
    }
    for (n = 0; n < f->size; n++) {
        rates[n] = 0.0;
        total[n] = 0.0;
    }
    if (motion->frame != NULL) {
        arg[0] = mean;
        res[0] = value;
        (void)motion->frame(arg, res, 0, 0, 0);
    }
    for (n = 0; n < motion->frames.entries; n++) {
        begin[motion->frames.column[n]] = value[n];
    }
    for (stage = 0; stage < 4; stage++) {
        const double part = share[stage] * step;

        now = time + part;
        for (n = 0; n < f->size; n++) {
            x[n] = mean[n] + (part * rates[n]);
        }
        for (n = 0; n < f->inputs; n++) {
            u[n] = u0[n] + (share[stage] * (u1[n] - u0[n]));
        }
        arg[0] = &now;
        arg[1] = x;
        arg[2] = u;
        res[0] = rates;
        res[1] = value;
        (void)motion->rates(arg, res, 0, 0, 0);
        gt_filter_along((size_t)entries, begin, part, change, path);
        for (n = 0; n < motion->fixed_paths; n++) {
            path[entries + n] = *fixed;
            fixed++;
        }
        gt_filter_rows(&motion->jacobian, (size_t)motion->width / 2U, value, path, change);
        for (n = 0; n < f->size; n++) {
            total[n] += weight[stage] * rates[n];
        }
        gt_filter_along((size_t)entries, sum, weight[stage], change, sum);
    }
    for (n = 0; n < f->size; n++) {
        mean[n] += (step / 6.0) * total[n];
    }
    gt_filter_along((size_t)entries, begin, step / 6.0, sum, path);
    for (n = 0; n < motion->fixed_paths; n++) {
        path[entries + n] = fixed[n];
    }
    for (n = 0; n < f->quaternions; n++) {
        double *own = &mean[f->turned[2 * n]];

        gt_copy(x, own, 4);
        arg[0] = x;
        res[0] = own;
        res[1] = &changing[12 * n];
        (void)f->unit(arg, res, 0, 0, 0);
    }
    gt_filter_fill(&motion->arrival, changing, value);
    gt_filter_rows(&motion->arrival, (size_t)motion->width / 2U, value, path, made);
    for (n = 0; n < f->transition.changing; n++) {
        changing[n] = made[motion->picked[n]];
    }
    gt_filter_fill(&f->transition, changing, work->transition);
}

/* The belief one cycle later, the known inputs straight from u0 to u1. */
static GT_FILTER_ONCE gt_status gt_filter_advance(const gt_filter *f, const gt_filter_belief *belief, const double *u0,
                                                  const double *u1, const gt_filter_work *work)
{
    double *after = work->values;
    double *begin = &after[f->size];
    double *end = &begin[f->inputs];
    gt_filter_work inner = *work;
    const double *arg[4];
    double *res[2];
    gt_status status = GT_OK;
    int part;
    int n;

    inner.values = &end[f->inputs];
    for (part = 0; (part < f->parts) && (status == GT_OK); part++) {
        const double from = (double)part / (double)f->parts;
        const double to = ((double)part + 1.0) / (double)f->parts;

        for (n = 0; n < f->inputs; n++) {
            begin[n] = u0[n] + (from * (u1[n] - u0[n]));
            end[n] = u0[n] + (to * (u1[n] - u0[n]));
        }
        if (f->motion != NULL) {
            gt_filter_move(f, *belief->time, belief->mean, begin, end, &inner);
        } else {
            arg[0] = belief->time;
            arg[1] = belief->mean;
            arg[2] = begin;
            arg[3] = end;
            res[0] = after;
            res[1] = inner.values;
            (void)f->given(arg, res, 0, 0, 0);
            gt_copy(belief->mean, after, f->size);
            gt_filter_fill(&f->transition, inner.values, work->transition);
            gt_filter_fill(&f->noise, after, work->noise);
        }
        status = gt_filter_spread(f, belief, work);
        *belief->time += f->step;
    }
    return status;
}

#endif
