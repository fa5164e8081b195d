/* Distances, multipliers and excesses: their start, how far they are from the optimum, and the solution, for
 * gt_stage_qp.h. */
#ifndef GT_STAGE_QP_SIDES_H
#define GT_STAGE_QP_SIDES_H

#include "gt_stage_qp_types.h"

/* Least distance at the beginning. */
#define GT_STAGE_QP_COLD 1.0

/* First numbers whose products are `centre`. */
static inline void gt_stage_qp_begun(const gt_stage_qp_call *c, double centre)
{
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const double *price = at.of->price;
        int j;

        for (j = 0; j < at.of->limits; j++) {
            gt_stage_qp_limit *h = &at.limit[j];

            h->t = gt_stage_qp_larger((at.of->sign[j] * at.y[at.of->row[j]]) - h->bound, GT_STAGE_QP_COLD);
            h->l = centre / h->t;
        }
        for (j = 0; j < at.of->soft; j++) {
            at.excess[j].v = price[0] + price[1];
            at.excess[j].e = centre / at.excess[j].v;
            price += 2;
        }
    }
}

/* t with t - 1 / t = d */
static GT_SHARED double gt_stage_qp_centred(double d)
{
    const double root = sqrt((d * d) + 4.0);

    return (d > 0.0) ? (0.5 * (root + d)) : (2.0 / (root - d));
}

/* The same near an earlier solution: distance minus multiplier / centre stays. */
static inline void gt_stage_qp_pushed(const gt_stage_qp_call *c, const double *start, double centre)
{
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const double *t = &start[k * c->f->stage.sides];
        const double *e = &t[2 * at.of->limits];
        int j;

        for (j = 0; j < at.of->limits; j++) {
            at.limit[j].t = gt_stage_qp_centred(t[j] - (t[j + at.of->limits] / centre));
            at.limit[j].l = centre / at.limit[j].t;
        }
        for (j = 0; j < at.of->soft; j++) {
            at.excess[j].e = gt_stage_qp_centred(e[j] - (e[j + at.of->soft] / centre));
            at.excess[j].v = centre / at.excess[j].e;
        }
    }
}

/* Residuals of the limits, gap, gradient of the excesses, and cost with prices. */
static inline void gt_stage_qp_measured(const gt_stage_qp_call *c, double cost, gt_stage_qp_outcome *out)
{
    double gap = 0.0;
    double residual = 0.0;
    double gradient = 0.0;
    double total = cost;
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const int *row = at.of->row;
        const double *sign = at.of->sign;
        const double *price = at.of->price;
        gt_stage_qp_excess *s = at.excess;
        gt_stage_qp_limit *h;

        for (h = at.limit; h < at.end; h++) {
            h->residual = ((*sign * at.y[*row]) - h->bound) - h->t;
            if (h >= at.soft) {
                const double rise = price[1] * s->e;

                h->residual += s->e;
                gap += s->e * s->v;
                gradient += fabs(((price[0] + rise) - h->l) - s->v);
                total += (price[0] + (0.5 * rise)) * s->e;
                price += 2;
                s++;
            }
            gap += h->t * h->l;
            residual += fabs(h->residual);
            row++;
            sign++;
        }
    }
    out->gap = gap;
    out->residual = residual;
    out->gradient = gradient;
    out->cost = total;
}

/* Takes the step. */
static inline void gt_stage_qp_advanced(const gt_stage_qp_call *c, double length)
{
    const gt_stage_qp *f = c->f;
    gt_stage_qp_limit *h = c->w->limits;
    gt_stage_qp_excess *s = c->w->excesses;
    int k;

    for (k = (f->count * f->stage.limits) + f->last.limits; k > 0; k--) {
        h->t += length * h->dt;
        h->l += length * h->dl;
        h++;
    }
    for (k = (f->count * f->stage.soft) + f->last.soft; k > 0; k--) {
        s->e += length * s->de;
        s->v += length * s->dv;
        s++;
    }
}

/* Slopes of the rows by the multipliers as they are; writes the sides of the solution. */
static inline void gt_stage_qp_kept(const gt_stage_qp_call *c)
{
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        double *t = &c->w->sides[k * c->f->stage.sides];
        double *e = &t[2 * at.of->limits];
        int j;

        for (j = 0; j < at.of->rows; j++) {
            at.slope[j] = 0.0;
        }
        for (j = 0; j < at.of->limits; j++) {
            t[j] = at.limit[j].t;
            t[j + at.of->limits] = at.limit[j].l;
            at.slope[at.of->row[j]] -= at.of->sign[j] * at.limit[j].l;
        }
        for (j = 0; j < at.of->soft; j++) {
            e[j] = at.excess[j].e;
            e[j + at.of->soft] = at.excess[j].v;
        }
    }
}

#endif
