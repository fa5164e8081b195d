/* Sizes, kernels and memory of a quadratic program over a horizon, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_TYPES_H
#define GT_STAGE_QP_TYPES_H

#include "gt_guard.h"
#include "gt_status.h"

#include <math.h>

/* A generated kernel; its arguments and results stand in gtmodel/predictive/kernels.py. */
typedef int (*gt_stage_qp_kernel)(const double **arg, double **res, long long int *iw, double *w, int mem);

/* One stage: sizes and kernels. */
typedef struct gt_stage_qp_stage {
    int numbers; /* of data */
    int rows; /* quantities with limits */
    int sides; /* distances, multipliers, excesses and their multipliers */
    int products; /* half of the sides */
    gt_stage_qp_kernel begin;
    gt_stage_qp_kernel push;
    gt_stage_qp_kernel weigh;
    gt_stage_qp_kernel change;
    gt_stage_qp_kernel judge;
    gt_stage_qp_kernel ahead;
    gt_stage_qp_kernel follow;
    gt_stage_qp_kernel factor;
    gt_stage_qp_kernel vector;
    gt_stage_qp_kernel move;
    gt_stage_qp_kernel adjoint;
} gt_stage_qp_stage;

/* A problem: `count` stages with an input, then one without. */
typedef struct gt_stage_qp {
    int count;
    int states;
    int inputs;
    int upper; /* entries of the upper triangle of a Hessian of the states */
    int lower; /* entries below the diagonal of a factor of the inputs */
    int max_iterations;
    double limits; /* number of products of all stages */
    double tolerance;
    gt_stage_qp_stage stage;
    gt_stage_qp_stage last;
} gt_stage_qp;

/* Working memory; what belongs to one stage follows what belongs to the stage before. */
typedef struct gt_stage_qp_work {
    double *x; /* states of count + 1 stages */
    double *u;
    double *du;
    double *y; /* rows, also of the last stage */
    double *sides; /* also of the last stage */
    double *change; /* of the sides */
    double *product; /* of the changes, also of the last stage */
    double *weight;
    double *slope;
    double *gain;
    double *offset; /* of the inputs */
    double *lower;
    double *inverse;
    double *part; /* pivots or products of one stage */
    double *hessian; /* two */
    double *gradient; /* two */
    double *dx; /* two */
    double *dy; /* of one stage */
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

/* Points to what all kernels of limits begin with, data, rows and sides of stage k; returns the stage. */
static inline const gt_stage_qp_stage *gt_stage_qp_at(const gt_stage_qp_call *c, int k, const double **arg)
{
    const gt_stage_qp *f = c->f;

    arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
    arg[1] = &c->w->y[k * f->stage.rows];
    arg[2] = &c->w->sides[k * f->stage.sides];
    return (k < f->count) ? &f->stage : &f->last;
}

#endif
