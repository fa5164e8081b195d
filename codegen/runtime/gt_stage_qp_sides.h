/* States and limits of all stages, and how far an iterate is from the optimum, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_SIDES_H
#define GT_STAGE_QP_SIDES_H

#include "gt_stage_qp_types.h"

/* The gradient may be so many times the gap. */
#define GT_STAGE_QP_GRADIENT 10.0
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
    const double *arg[3];
    double *res[1];
    int k;

    for (k = 0; k <= f->count; k++) {
        const gt_stage_qp_stage *stage = gt_stage_qp_at(c, k, arg);

        res[0] = &w->sides[k * f->stage.sides];
        if (start != 0) {
            arg[0] = &start[k * f->stage.sides];
            (void)stage->push(arg, res, 0, 0, 0);
        } else {
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
        (void)gt_stage_qp_at(c, k, arg)->judge(arg, res, 0, 0, 0);
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
        const gt_stage_qp_stage *stage = gt_stage_qp_at(c, k, arg);

        arg[4] = &w->product[k * f->stage.products];
        res[0] = &w->weight[k * f->stage.rows];
        res[1] = &w->slope[k * f->stage.rows];
        (void)stage->weigh(arg, res, 0, 0, 0);
    }
}

#endif
