/* A quadratic program over the stages of a horizon, by a primal-dual interior point method with Riccati recursion: loops
 * over the stages round generated kernels.
 *
 * gtmodel/predictive/interior_point.py does the same in the same order; the two agree bit for bit. Nothing is
 * allocated; all memory is the caller's. The number of operations is bounded by `max_iterations`.
 */
#ifndef GT_STAGE_QP_H
#define GT_STAGE_QP_H

#include "gt_guard.h"
#include "gt_status.h"

#include <math.h>

/* The gradient may be so many times the gap. */
#define GT_STAGE_QP_GRADIENT 10.0
/* Share of the way to the nearest limit that a step goes. */
#define GT_STAGE_QP_TO_BOUNDARY 0.995

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

/* States, rows and cost without prices from the inputs. */
static inline double gt_stage_qp_followed(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[3];
    double *res[3];
    double total = 0.0;
    double cost = 0.0;
    int k;

    for (k = 0; k < f->count; k++) {
        arg[0] = &w->x[k * f->states];
        arg[1] = &c->data[k * f->stage.numbers];
        arg[2] = &w->u[k * f->inputs];
        res[0] = &w->x[(k + 1) * f->states];
        res[1] = &w->y[k * f->stage.rows];
        res[2] = &cost;
        (void)f->stage.follow(arg, res, 0, 0, 0);
        total += cost;
    }
    arg[0] = c->last_data;
    arg[1] = &w->x[f->count * f->states];
    res[0] = &w->y[f->count * f->stage.rows];
    res[1] = &cost;
    (void)f->last.follow(arg, res, 0, 0, 0);
    return total + cost;
}

/* First sides, or those of an earlier solution away from zero. */
static inline void gt_stage_qp_begun(const gt_stage_qp_call *c, const double *start)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[2];
    double *res[1];
    int k;

    for (k = 0; k <= f->count; k++) {
        const gt_stage_qp_stage *stage = (k < f->count) ? &f->stage : &f->last;

        res[0] = &w->sides[k * f->stage.sides];
        if (start != 0) {
            arg[0] = &start[k * f->stage.sides];
            (void)stage->push(arg, res, 0, 0, 0);
        } else {
            arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
            arg[1] = &w->y[k * f->stage.rows];
            (void)stage->begin(arg, res, 0, 0, 0);
        }
    }
}

/* Gap, residual and gradient; adds the price to the cost. */
static inline void gt_stage_qp_judged(const gt_stage_qp_call *c, double cost, gt_stage_qp_outcome *out)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[5];
    double *res[4];
    double part[4] = {0.0, 0.0, 0.0, 0.0};
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    double total = 0.0;
    double inputs = 0.0;
    double *now = w->gradient;
    double *before = &w->gradient[f->states];
    int k;
    int j;

    for (j = 0; j < 4; j++) {
        res[j] = &part[j];
    }
    for (k = 0; k <= f->count; k++) {
        arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        arg[1] = &w->y[k * f->stage.rows];
        arg[2] = &w->sides[k * f->stage.sides];
        (void)((k < f->count) ? f->stage.judge(arg, res, 0, 0, 0) : f->last.judge(arg, res, 0, 0, 0));
        for (j = 0; j < 4; j++) {
            sum[j] += part[j];
        }
    }
    arg[0] = c->last_data;
    arg[1] = &w->x[f->count * f->states];
    arg[2] = &w->sides[f->count * f->stage.sides];
    res[0] = now;
    (void)f->last.adjoint(arg, res, 0, 0, 0);
    res[1] = &inputs;
    for (k = f->count - 1; k >= 0; k--) {
        double *swap = now;

        arg[0] = now;
        arg[1] = &c->data[k * f->stage.numbers];
        arg[2] = &w->x[k * f->states];
        arg[3] = &w->u[k * f->inputs];
        arg[4] = &w->sides[k * f->stage.sides];
        res[0] = before;
        (void)f->stage.adjoint(arg, res, 0, 0, 0);
        total += inputs;
        now = before;
        before = swap;
    }
    out->gap = sum[0];
    out->residual = sum[1];
    out->gradient = sum[2] + total;
    out->cost = cost + sum[3];
}

/* GT_OK, GT_NOT_FINITE, or GT_NOT_CONVERGED as long as a tolerance is not met. */
static inline gt_status gt_stage_qp_status(const gt_stage_qp *f, const gt_stage_qp_outcome *out)
{
    const double numbers[4] = {out->gap, out->residual, out->gradient, out->cost};
    const double allowed = f->tolerance * (1.0 + fabs(out->cost));
    gt_status status = GT_NOT_CONVERGED;

    if (gt_all_finite(numbers, 4) == 0) {
        status = GT_NOT_FINITE;
    } else if ((out->gap <= allowed) && (out->residual <= f->tolerance)
               && (out->gradient <= (GT_STAGE_QP_GRADIENT * allowed))) {
        status = GT_OK;
    } else {
        /* another iteration */
    }
    return status;
}

/* Weights and slopes of the rows for a centre, from the products of the last changes. */
static inline void gt_stage_qp_weighed(const gt_stage_qp_call *c, double centre)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[5];
    double *res[2];
    int k;

    arg[3] = &centre;
    for (k = 0; k <= f->count; k++) {
        arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        arg[1] = &w->y[k * f->stage.rows];
        arg[2] = &w->sides[k * f->stage.sides];
        arg[4] = &w->product[k * f->stage.products];
        res[0] = &w->weight[k * f->stage.rows];
        res[1] = &w->slope[k * f->stage.rows];
        (void)((k < f->count) ? f->stage.weigh(arg, res, 0, 0, 0) : f->last.weigh(arg, res, 0, 0, 0));
    }
}

/* Gains and offsets of the inputs. GT_SINGULAR if a pivot is too small. */
static inline gt_status gt_stage_qp_factored(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[7];
    double *res[7];
    double *now = w->hessian;
    double *before = &w->hessian[f->upper];
    double *gradient = w->gradient;
    double *gradient_before = &w->gradient[f->states];
    int k;
    int j;

    arg[0] = c->last_data;
    arg[1] = &w->x[f->count * f->states];
    arg[2] = &w->weight[f->count * f->stage.rows];
    arg[3] = &w->slope[f->count * f->stage.rows];
    res[0] = now;
    res[1] = gradient;
    (void)f->last.factor(arg, res, 0, 0, 0);
    for (k = f->count - 1; k >= 0; k--) {
        double *swap = now;

        arg[0] = now;
        arg[1] = gradient;
        arg[2] = &c->data[k * f->stage.numbers];
        arg[3] = &w->x[k * f->states];
        arg[4] = &w->u[k * f->inputs];
        arg[5] = &w->weight[k * f->stage.rows];
        arg[6] = &w->slope[k * f->stage.rows];
        res[0] = before;
        res[1] = gradient_before;
        res[2] = &w->gain[k * f->inputs * f->states];
        res[3] = &w->offset[k * f->inputs];
        res[4] = &w->lower[k * f->lower];
        res[5] = &w->inverse[k * f->inputs];
        res[6] = w->part;
        (void)f->stage.factor(arg, res, 0, 0, 0);
        for (j = 0; j < f->inputs; j++) {
            if (!(w->part[j] > 0.0)) {
                return GT_SINGULAR;
            }
        }
        now = before;
        before = swap;
        swap = gradient;
        gradient = gradient_before;
        gradient_before = swap;
    }
    return GT_OK;
}

/* Offsets of the inputs for new slopes. */
static inline void gt_stage_qp_again(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[8];
    double *res[2];
    double *now = w->gradient;
    double *before = &w->gradient[f->states];
    int k;

    arg[0] = c->last_data;
    arg[1] = &w->x[f->count * f->states];
    arg[2] = &w->slope[f->count * f->stage.rows];
    res[0] = now;
    (void)f->last.vector(arg, res, 0, 0, 0);
    for (k = f->count - 1; k >= 0; k--) {
        double *swap = now;

        arg[0] = now;
        arg[1] = &c->data[k * f->stage.numbers];
        arg[2] = &w->x[k * f->states];
        arg[3] = &w->u[k * f->inputs];
        arg[4] = &w->slope[k * f->stage.rows];
        arg[5] = &w->gain[k * f->inputs * f->states];
        arg[6] = &w->lower[k * f->lower];
        arg[7] = &w->inverse[k * f->inputs];
        res[0] = before;
        res[1] = &w->offset[k * f->inputs];
        (void)f->stage.vector(arg, res, 0, 0, 0);
        now = before;
        before = swap;
    }
}

/* Changes of the inputs and the sides, and their products. Returns the largest decrease of a side over the side. */
static inline double gt_stage_qp_changed(const gt_stage_qp_call *c, double centre)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[6];
    double *res[3];
    double *now = w->dx;
    double *after = &w->dx[f->states];
    double largest = 0.0;
    int k;
    int j;

    for (j = 0; j < f->states; j++) {
        now[j] = 0.0;
    }
    for (k = 0; k <= f->count; k++) {
        const gt_stage_qp_stage *stage = (k < f->count) ? &f->stage : &f->last;
        const double *data = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        const double *sides = &w->sides[k * f->stage.sides];
        double *change = &w->change[k * f->stage.sides];
        double *swap = now;

        if (k < f->count) {
            arg[0] = now;
            arg[1] = data;
            arg[2] = &w->gain[k * f->inputs * f->states];
            arg[3] = &w->offset[k * f->inputs];
            res[0] = after;
            res[1] = &w->du[k * f->inputs];
            res[2] = w->dy;
        } else {
            arg[0] = data;
            arg[1] = now;
            res[0] = w->dy;
        }
        (void)stage->move(arg, res, 0, 0, 0);
        now = after;
        after = swap;
        arg[0] = data;
        arg[1] = &w->y[k * f->stage.rows];
        arg[2] = sides;
        arg[3] = &centre;
        arg[4] = &w->product[k * f->stage.products];
        arg[5] = w->dy;
        res[0] = change;
        res[1] = w->part;
        (void)stage->change(arg, res, 0, 0, 0);
        gt_copy(&w->product[k * f->stage.products], w->part, stage->products);
        for (j = 0; j < stage->sides; j++) {
            const double decrease = -change[j] / sides[j];

            if (decrease > largest) {
                largest = decrease;
            }
        }
    }
    return largest;
}

/* The gap after a step. */
static inline double gt_stage_qp_ahead(const gt_stage_qp_call *c, double length)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[3];
    double *res[1];
    double part = 0.0;
    double total = 0.0;
    int k;

    arg[2] = &length;
    res[0] = &part;
    for (k = 0; k <= f->count; k++) {
        arg[0] = &w->sides[k * f->stage.sides];
        arg[1] = &w->change[k * f->stage.sides];
        (void)((k < f->count) ? f->stage.ahead(arg, res, 0, 0, 0) : f->last.ahead(arg, res, 0, 0, 0));
        total += part;
    }
    return total;
}

/* a + length * b in place */
static inline void gt_stage_qp_moved(double *a, const double *b, double length, int size)
{
    int k;

    for (k = 0; k < size; k++) {
        a[k] += length * b[k];
    }
}

/* Solves the problem from the state and the inputs in `w`; `start`: sides of an earlier solution, or 0. */
static inline gt_status gt_stage_qp_solve(const gt_stage_qp_call *c, const double *start, gt_stage_qp_outcome *out)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const int sides = (f->count * f->stage.sides) + f->last.sides;
    const int products = (f->count * f->stage.products) + f->last.products;
    double cost = gt_stage_qp_followed(c);
    gt_status status;
    int k;

    gt_stage_qp_begun(c, start);
    out->iterations = 0;
    gt_stage_qp_judged(c, cost, out);
    status = gt_stage_qp_status(f, out);
    while ((status == GT_NOT_CONVERGED) && (out->iterations < f->max_iterations)) {
        double centre;
        double length;
        double ratio;

        out->iterations++;
        for (k = 0; k < products; k++) {
            w->product[k] = 0.0;
        }
        gt_stage_qp_weighed(c, 0.0);
        if (gt_stage_qp_factored(c) != GT_OK) {
            return GT_SINGULAR;
        }
        length = 1.0 / fmax(gt_stage_qp_changed(c, 0.0), 1.0);
        ratio = gt_stage_qp_ahead(c, length) / out->gap;
        centre = (ratio * ratio * ratio * out->gap) / f->limits;
        gt_stage_qp_weighed(c, centre);
        gt_stage_qp_again(c);
        length = GT_STAGE_QP_TO_BOUNDARY / fmax(gt_stage_qp_changed(c, centre), GT_STAGE_QP_TO_BOUNDARY);
        gt_stage_qp_moved(w->u, w->du, length, f->count * f->inputs);
        gt_stage_qp_moved(w->sides, w->change, length, sides);
        cost = gt_stage_qp_followed(c);
        gt_stage_qp_judged(c, cost, out);
        status = gt_stage_qp_status(f, out);
    }
    return status;
}

#endif
