/* Limits in an iteration: weights and slopes of their rows, and their changes, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_LIMITS_H
#define GT_STAGE_QP_LIMITS_H

#include "gt_stage_qp_types.h"

/* Weights and slopes of the rows for products of zero. */
static inline void gt_stage_qp_weighed(const gt_stage_qp_call *c)
{
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const int *row = at.of->row;
        const double *sign = at.of->sign;
        const double *price = at.of->price;
        gt_stage_qp_excess *s = at.excess;
        gt_stage_qp_limit *h;
        int j;

        for (j = 0; j < at.of->rows; j++) {
            at.weight[j] = 0.0;
            at.slope[j] = 0.0;
        }
        for (h = at.limit; h < at.soft; h++) {
            h->over_t = 1.0 / h->t;
            h->ratio = h->l * h->over_t;
            at.weight[*row] += h->ratio;
            at.slope[*row] += *sign * (h->ratio * h->residual);
            row++;
            sign++;
        }
        for (; h < at.end; h++) {
            double ratio;

            h->over_t = 1.0 / h->t;
            h->ratio = h->l * h->over_t;
            s->over_e = 1.0 / s->e;
            s->fall = -price[0] - (price[1] * s->e);
            s->own = price[1] + (s->v * s->over_e);
            s->over = 1.0 / (h->ratio + s->own);
            ratio = h->ratio * s->over;
            at.weight[*row] += ratio * s->own;
            at.slope[*row] += *sign * (ratio * ((s->own * h->residual) + s->fall));
            row++;
            sign++;
            price += 2;
            s++;
        }
    }
}

/* Products of the changes with the other sign, and their sum, for products of zero. Returns the largest decrease of a
 * positive number over the number. */
static inline double gt_stage_qp_tried(const gt_stage_qp_call *c, double *sum)
{
    double total = 0.0;
    double least = 0.0;
    double most = 0.0;
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const int *row = at.of->row;
        const double *sign = at.of->sign;
        gt_stage_qp_excess *s = at.excess;
        gt_stage_qp_limit *h;

        for (h = at.limit; h < at.end; h++) {
            double dt = (*sign * at.dy[*row]) + h->residual;
            double share;

            if (h >= at.soft) {
                const double de = (s->fall - (h->ratio * dt)) * s->over;

                dt = ((s->own * dt) + s->fall) * s->over;
                share = de * s->over_e;
                s->aim = de * (s->v * (1.0 + share));
                total += s->aim;
                least = gt_stage_qp_smaller(share, least);
                most = gt_stage_qp_larger(share, most);
                s++;
            }
            share = dt * h->over_t;
            h->aim = dt * (h->l * (1.0 + share));
            total += h->aim;
            least = gt_stage_qp_smaller(share, least);
            most = gt_stage_qp_larger(share, most);
            row++;
            sign++;
        }
    }
    *sum = total;
    return gt_stage_qp_larger(-least, 1.0 + most); /* a multiplier decreases by 1 + share */
}

/* Slopes of the rows for products of `centre` with the changes of before. */
static inline void gt_stage_qp_aimed(const gt_stage_qp_call *c, double centre)
{
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const int *row = at.of->row;
        const double *sign = at.of->sign;
        gt_stage_qp_excess *s = at.excess;
        gt_stage_qp_limit *h;
        int j;

        for (j = 0; j < at.of->rows; j++) {
            at.slope[j] = 0.0;
        }
        for (h = at.limit; h < at.end; h++) {
            double steep;

            h->aim = (centre + h->aim) * h->over_t;
            if (h < at.soft) {
                steep = h->ratio * h->residual;
            } else {
                s->aim = (centre + s->aim) * s->over_e;
                steep = (h->ratio * s->over) * ((s->own * h->residual) + ((h->aim + s->aim) + s->fall));
                s++;
            }
            at.slope[*row] += *sign * (steep - h->aim);
            row++;
            sign++;
        }
    }
}

/* Changes of the positive numbers. Returns the largest decrease over the number. */
static inline double gt_stage_qp_changed(const gt_stage_qp_call *c)
{
    double least = 0.0;
    int k;

    for (k = 0; k <= c->f->count; k++) {
        const gt_stage_qp_place at = gt_stage_qp_at(c, k);
        const int *row = at.of->row;
        const double *sign = at.of->sign;
        gt_stage_qp_excess *s = at.excess;
        gt_stage_qp_limit *h;

        for (h = at.limit; h < at.end; h++) {
            double dt = (*sign * at.dy[*row]) + h->residual;

            if (h >= at.soft) {
                const double rest = (h->aim + s->aim) + s->fall;

                s->de = (rest - (h->ratio * dt)) * s->over;
                s->dv = (s->aim - ((s->v * s->over_e) * s->de)) - s->v;
                dt = ((s->own * dt) + rest) * s->over;
                least = gt_stage_qp_smaller(s->de * s->over_e, least);
                least = gt_stage_qp_smaller(s->dv / s->v, least);
                s++;
            }
            h->dt = dt;
            h->dl = (h->aim - (h->ratio * dt)) - h->l;
            least = gt_stage_qp_smaller(dt * h->over_t, least);
            least = gt_stage_qp_smaller(h->dl / h->l, least);
            row++;
            sign++;
        }
    }
    return -least;
}

#endif
