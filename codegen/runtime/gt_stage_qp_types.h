/* Sizes, kernels and memory of a quadratic program over a horizon, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_TYPES_H
#define GT_STAGE_QP_TYPES_H

#include "gt_guard.h"
#include "gt_status.h"

#include <math.h>

/* A generated kernel; its arguments and results stand in gtmodel/predictive/kernels.py. */
typedef int (*gt_stage_qp_kernel)(const double **arg, double **res, long long int *iw, double *w, int mem);

/* One stage: sizes, limits and kernels. The first limits are exact, the last `soft` ones have prices. */
typedef struct gt_stage_qp_stage {
    int numbers; /* of data */
    int rows; /* quantities with limits */
    int limits; /* sign * row >= bound */
    int soft;
    int sides; /* distances, multipliers, excesses and their multipliers */
    int entries; /* of all rows, each from its first entry other than zero to its last */
    const int *first; /* variable of each row: states, then inputs */
    const int *size;
    const int *row;
    const double *sign;
    const double *price; /* linear and quadratic one of each soft limit */
    gt_stage_qp_kernel given;
    gt_stage_qp_kernel grade;
    gt_stage_qp_kernel pull;
    gt_stage_qp_kernel move;
    gt_stage_qp_kernel factor;
} gt_stage_qp_stage;

/* A problem: `count` stages with an input, then one without. */
typedef struct gt_stage_qp {
    int count;
    int states;
    int inputs;
    int gains; /* of all inputs of a stage */
    int max_iterations;
    double products; /* number of limits and excesses of all stages */
    double tolerance;
    double enough; /* the gap is not made smaller, relative to 1 + |cost|: weights beyond would only round off */
    gt_stage_qp_stage stage;
    gt_stage_qp_stage last;
} gt_stage_qp;

/* A limit: distance t, multiplier l, and their changes. */
typedef struct gt_stage_qp_limit {
    double t;
    double l;
    double dt;
    double dl;
    double bound;
    double residual;
    double over_t; /* 1 / t */
    double ratio; /* l / t */
    double aim; /* minus the product of the changes; then what l * t is to become, over t */
} gt_stage_qp_limit;

/* A soft limit beside: excess e, multiplier v, and their changes. */
typedef struct gt_stage_qp_excess {
    double e;
    double v;
    double de;
    double dv;
    double over_e; /* 1 / e */
    double aim; /* as above */
    double fall; /* slope of the price, with the other sign */
    double own; /* curvature of price and barrier */
    double over; /* 1 / curvature with that of the limit */
} gt_stage_qp_excess;

/* Working memory; what belongs to one stage follows what belongs to the stage before, the last stage at the end. */
typedef struct gt_stage_qp_work {
    gt_stage_qp_limit *limits;
    gt_stage_qp_excess *excesses;
    double *bound; /* of the limits of one stage */
    double *sides; /* of the solution */
    double *x; /* states of count + 1 stages */
    double *u;
    double *dx;
    double *du;
    double *y; /* rows */
    double *dy;
    double *weight; /* of the rows */
    double *slope;
    double *by_x; /* derivatives of the cost */
    double *by_u;
    double *entries; /* of the rows */
    double *gain;
    double *offset; /* of the inputs */
    double *inverse; /* of the pivots, with the other sign */
    double *part; /* of the inputs of one stage: least pivots, or derivatives */
    double *hessian; /* two */
    double *gradient; /* two */
} gt_stage_qp_work;

/* What a solution leaves. */
typedef struct gt_stage_qp_outcome {
    int iterations;
    double cost;
    double gap;
    double residual;
    double gradient;
} gt_stage_qp_outcome;

/* Problem, data and memory of a call. */
typedef struct gt_stage_qp_call {
    const gt_stage_qp *f;
    const double *data; /* of all stages */
    const double *last_data;
    const gt_stage_qp_work *w;
} gt_stage_qp_call;

/* Limits of one stage, the exact ones first. */
typedef struct gt_stage_qp_place {
    const gt_stage_qp_stage *of;
    gt_stage_qp_limit *limit;
    gt_stage_qp_limit *soft;
    gt_stage_qp_limit *end;
    gt_stage_qp_excess *excess;
    const double *y;
    const double *dy;
    double *weight;
    double *slope;
} gt_stage_qp_place;

/* The limits of stage k. */
static GT_SHARED gt_stage_qp_place gt_stage_qp_at(const gt_stage_qp_call *c, int k)
{
    const gt_stage_qp_stage *s = &c->f->stage;
    const gt_stage_qp_work *w = c->w;
    gt_stage_qp_place at;

    at.of = (k < c->f->count) ? s : &c->f->last;
    at.limit = &w->limits[k * s->limits];
    at.end = &at.limit[at.of->limits];
    at.soft = &at.limit[at.of->limits - at.of->soft];
    at.excess = &w->excesses[k * s->soft];
    at.y = &w->y[k * s->rows];
    at.dy = &w->dy[k * s->rows];
    at.weight = &w->weight[k * s->rows];
    at.slope = &w->slope[k * s->rows];
    return at;
}

/* gt_all_finite and gt_copy for the many calls of one step: one copy of them. */
static GT_SHARED int gt_stage_qp_finite(const double *x, int n)
{
    return gt_all_finite(x, n);
}

static GT_SHARED void gt_stage_qp_copy(double *to, const double *from, int n)
{
    gt_copy(to, from, n);
}

/* The larger number, and b if a is none. */
static inline double gt_stage_qp_larger(double a, double b)
{
    return (a > b) ? a : b;
}

/* The smaller number, and b if a is none. */
static inline double gt_stage_qp_smaller(double a, double b)
{
    return (a < b) ? a : b;
}

#endif
