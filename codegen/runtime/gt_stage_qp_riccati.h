/* The step of an iteration by the Riccati recursion, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_RICCATI_H
#define GT_STAGE_QP_RICCATI_H

#include "gt_stage_qp_types.h"

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
        const gt_stage_qp_stage *stage = gt_stage_qp_at(c, k, arg);
        const double *sides = arg[2];
        double *change = &w->change[k * f->stage.sides];
        double *swap = now;

        if (k < f->count) {
            const double *motion[4] = {now, arg[0], &w->gain[k * f->inputs * f->states], &w->offset[k * f->inputs]};

            res[0] = after;
            res[1] = &w->du[k * f->inputs];
            res[2] = w->dy;
            (void)stage->move(motion, res, 0, 0, 0);
        } else {
            const double *motion[2] = {arg[0], now};

            res[0] = w->dy;
            (void)stage->move(motion, res, 0, 0, 0);
        }
        now = after;
        after = swap;
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

#endif
