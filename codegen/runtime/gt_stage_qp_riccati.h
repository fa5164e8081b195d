/* The step of an iteration by the Riccati recursion, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_RICCATI_H
#define GT_STAGE_QP_RICCATI_H

#include "gt_stage_qp_types.h"

/* a + length * b in place */
static GT_SHARED void gt_stage_qp_moved(double *a, const double *b, double length, int size)
{
    int k;

    for (k = 0; k < size; k++) {
        a[k] += length * b[k];
    }
}

/* Bounds of the limits, entries of the rows; states and rows of the inputs. */
static inline void gt_stage_qp_followed(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[3];
    double *res[3];
    int k;
    int j;

    for (k = 0; k <= f->count; k++) {
        const gt_stage_qp_stage *s = (k < f->count) ? &f->stage : &f->last;

        arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        res[0] = w->bound;
        res[1] = &w->entries[k * f->stage.entries];
        res[2] = w->gradient;
        (void)s->given(arg, res, 0, 0, 0);
        for (j = 0; j < s->limits; j++) {
            w->limits[(k * f->stage.limits) + j].bound = w->bound[j];
        }
        arg[1] = &w->x[k * f->states];
        arg[2] = &w->u[k * f->inputs];
        res[0] = &w->y[k * f->stage.rows];
        res[1] = &w->x[(k + 1) * f->states];
        (void)s->move(arg, res, 0, 0, 0);
        if (k < f->count) {
            gt_stage_qp_moved(res[1], w->gradient, 1.0, f->states);
        }
    }
}

/* Derivatives of the cost by states and inputs. Returns the cost without prices. */
static GT_SHARED double gt_stage_qp_graded(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[3];
    double *res[3];
    double cost = 0.0;
    double total = 0.0;
    int k;

    res[0] = &cost;
    for (k = 0; k <= f->count; k++) {
        const gt_stage_qp_stage *s = (k < f->count) ? &f->stage : &f->last;

        arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        arg[1] = &w->x[k * f->states];
        arg[2] = &w->u[k * f->inputs];
        res[1] = &w->by_x[k * f->states];
        res[2] = &w->by_u[k * f->inputs];
        (void)s->grade(arg, res, 0, 0, 0);
        total += cost;
    }
    return total;
}

/* Derivatives by the state and the inputs of stage k for the slopes of the rows; g: by the state after it. */
static GT_SHARED void gt_stage_qp_pulled(const gt_stage_qp_call *c, int k, const double *g, double *h)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *arg[5];
    double *res[2];

    arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
    arg[1] = &w->slope[k * f->stage.rows];
    arg[2] = &w->by_x[k * f->states];
    arg[3] = &w->by_u[k * f->inputs];
    arg[4] = g;
    res[0] = h;
    res[1] = w->part;
    (void)((k < f->count) ? &f->stage : &f->last)->pull(arg, res, 0, 0, 0);
}

/* Sum of the absolute derivatives by the inputs for the slopes of the rows. */
static inline double gt_stage_qp_sloped(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    double *now = w->gradient;
    double *before = &w->gradient[f->states];
    double total = 0.0;
    int k;
    int j;

    gt_stage_qp_pulled(c, f->count, 0, now);
    for (k = f->count - 1; k >= 0; k--) {
        double *swap = now;

        gt_stage_qp_pulled(c, k, now, before);
        for (j = 0; j < f->inputs; j++) {
            total += fabs(w->part[j]);
        }
        now = before;
        before = swap;
    }
    return total;
}

/* Changes of the inputs of stage k at dx = 0, where its derivatives are g and w->part, and the inputs before it stay; g
 * becomes the derivatives by the state, the inputs chosen so. */
static inline void gt_stage_qp_offset(const gt_stage_qp_call *c, int k, double *g)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const double *gain = &w->gain[(k + 1) * f->gains];
    int j;

    for (j = f->inputs - 1; j >= 0; j--) {
        const double by = w->part[j];
        int i;

        gain -= f->states + j;
        w->offset[(k * f->inputs) + j] = by * w->inverse[(k * f->inputs) + j];
        for (i = 0; i < f->states; i++) {
            g[i] += gain[i] * by;
        }
        for (i = 0; i < j; i++) {
            w->part[i] += gain[f->states + i] * by;
        }
    }
}

/* Changes of the inputs of stage k from that of its state. */
static inline void gt_stage_qp_fed(const gt_stage_qp_call *c, int k)
{
    const gt_stage_qp *f = c->f;
    const double *gain = &c->w->gain[k * f->gains];
    const double *dx = &c->w->dx[k * f->states];
    double *du = &c->w->du[k * f->inputs];
    int j;

    for (j = 0; j < f->inputs; j++) {
        double sum = c->w->offset[(k * f->inputs) + j];
        int i;

        for (i = 0; i < f->states; i++) {
            sum += gain[i] * dx[i];
        }
        gain = &gain[f->states];
        for (i = 0; i < j; i++) {
            sum += gain[i] * du[i];
        }
        gain = &gain[j];
        du[j] = sum;
    }
}

/* Changes of the inputs, the states and the rows for the slopes of the rows. */
static inline void gt_stage_qp_stepped(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    const int n = f->states;
    const double *arg[3];
    double *res[2];
    double *now = w->gradient;
    double *before = &w->gradient[n];
    int k;

    gt_stage_qp_pulled(c, f->count, 0, now);
    for (k = f->count - 1; k >= 0; k--) {
        double *swap = now;

        gt_stage_qp_pulled(c, k, now, before);
        gt_stage_qp_offset(c, k, before);
        now = before;
        before = swap;
    }
    for (k = 0; k < n; k++) {
        w->dx[k] = 0.0;
    }
    for (k = 0; k < f->count; k++) {
        gt_stage_qp_fed(c, k);
        arg[0] = &c->data[k * f->stage.numbers];
        arg[1] = &w->dx[k * n];
        arg[2] = &w->du[k * f->inputs];
        res[0] = &w->dy[k * f->stage.rows];
        res[1] = &w->dx[(k + 1) * n];
        (void)f->stage.move(arg, res, 0, 0, 0);
    }
    arg[0] = c->last_data;
    arg[1] = &w->dx[f->count * n];
    res[0] = &w->dy[f->count * f->stage.rows];
    (void)f->last.move(arg, res, 0, 0, 0);
}

#endif
