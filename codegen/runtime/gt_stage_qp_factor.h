/* The gains of an iteration by the Riccati recursion, for gt_stage_qp.h. */
#ifndef GT_STAGE_QP_FACTOR_H
#define GT_STAGE_QP_FACTOR_H

#include "gt_stage_qp_types.h"

/* Least share of a diagonal entry of the Hessian of the inputs that is left after elimination. */
#define GT_STAGE_QP_PIVOT 1e-14

/* Adds row' * weight * row to an upper triangle by columns; `to`: where the entry of the row's first variable is. */
static GT_SHARED void gt_stage_qp_one_row(double *to, const double *a, double weight, int first, int size)
{
    int j;

    for (j = 0; j < size; j++) {
        const double by = a[j] * weight;
        int i;

        for (i = 0; i <= j; i++) {
            to[i] += by * a[i];
        }
        to = &to[first + j + 1];
    }
}

/* The same for three rows a, b, c, one after the other, in half of the time. */
static GT_SHARED void gt_stage_qp_three_rows(double *to, const double *a, const double *b, const double *c,
                                             double weight_a, double weight_b, double weight_c, int first, int size)
{
    int j;

    for (j = 0; j < size; j++) {
        const double by_a = a[j] * weight_a;
        const double by_b = b[j] * weight_b;
        const double by_c = c[j] * weight_c;
        int i;

        for (i = 0; i <= j; i++) {
            to[i] = ((to[i] + (by_a * a[i])) + (by_b * b[i])) + (by_c * c[i]);
        }
        to = &to[first + j + 1];
    }
}

/* Adds to the Hessian of stage k its rows times their weights. */
static inline void gt_stage_qp_thickened(const gt_stage_qp_call *c, int k, double *hessian)
{
    const gt_stage_qp_stage *s = (k < c->f->count) ? &c->f->stage : &c->f->last;
    const double *weight = &c->w->weight[k * c->f->stage.rows];
    const double *entry = &c->w->entries[k * c->f->stage.entries];
    int r = 0;

    while (r < s->rows) {
        const int first = s->first[r];
        const int size = s->size[r];
        double *to = &hessian[(first * (first + 3)) / 2];

        if (((r + 2) < s->rows) && (s->first[r + 1] == first) && (s->first[r + 2] == first) && (s->size[r + 1] == size)
            && (s->size[r + 2] == size)) {
            gt_stage_qp_three_rows(to, entry, &entry[size], &entry[2 * size], weight[r], weight[r + 1], weight[r + 2],
                                   first, size);
            entry = &entry[3 * size];
            r += 3;
        } else {
            gt_stage_qp_one_row(to, entry, weight[r], first, size);
            entry = &entry[size];
            r++;
        }
    }
}

/* Column of a variable in an upper triangle. */
static inline double *gt_stage_qp_column(double *hessian, int variable)
{
    return &hessian[(variable * (variable + 1)) / 2];
}

/* Eliminates the inputs of stage k from its Hessian, the last one first: what is left is that of the state. Each input
 * has a gain for each state and each input before it. GT_SINGULAR if a pivot is too small. */
static inline gt_status gt_stage_qp_eliminated(const gt_stage_qp_call *c, int k, double *hessian)
{
    const gt_stage_qp *f = c->f;
    const int n = f->states;
    double *inverse = &c->w->inverse[k * f->inputs];
    double *gain = &c->w->gain[(k + 1) * f->gains];
    int j;

    for (j = 0; j < f->inputs; j++) {
        c->w->part[j] = GT_STAGE_QP_PIVOT * gt_stage_qp_column(hessian, n + j)[n + j];
    }
    for (j = f->inputs - 1; j >= 0; j--) {
        const double *column = gt_stage_qp_column(hessian, n + j);
        double over;
        int i;

        if (!((column[n + j] - c->w->part[j]) > 0.0)) {
            return GT_SINGULAR;
        }
        over = -1.0 / column[n + j];
        inverse[j] = over;
        gain -= n + j;
        for (i = 0; i < (n + j); i++) {
            gain[i] = column[i] * over;
        }
        for (i = n; i < (n + j); i++) {
            double *to = gt_stage_qp_column(hessian, i);
            int h;

            for (h = 0; h <= i; h++) {
                to[h] += gain[i] * column[h];
            }
        }
    }
    for (j = f->inputs; j >= 3; j -= 3) {
        gt_stage_qp_three_rows(hessian, gt_stage_qp_column(hessian, (n + j) - 1),
                               gt_stage_qp_column(hessian, (n + j) - 2), gt_stage_qp_column(hessian, (n + j) - 3),
                               inverse[j - 1], inverse[j - 2], inverse[j - 3], 0, n);
    }
    for (; j > 0; j--) {
        gt_stage_qp_one_row(hessian, gt_stage_qp_column(hessian, (n + j) - 1), inverse[j - 1], 0, n);
    }
    return GT_OK;
}

/* Gains of the inputs. GT_SINGULAR if a pivot is too small. */
static inline gt_status gt_stage_qp_factored(const gt_stage_qp_call *c)
{
    const gt_stage_qp *f = c->f;
    const int size = f->states + f->inputs;
    const double *arg[2];
    double *res[1];
    double *now = c->w->hessian;
    double *after = &now[(size * (size + 1)) / 2];
    gt_status status = GT_OK;
    int k;

    for (k = f->count; (k >= 0) && (status == GT_OK); k--) {
        double *swap = now;

        arg[0] = (k < f->count) ? &c->data[k * f->stage.numbers] : c->last_data;
        arg[1] = after;
        res[0] = now;
        (void)((k < f->count) ? &f->stage : &f->last)->factor(arg, res, 0, 0, 0);
        gt_stage_qp_thickened(c, k, now);
        if (k < f->count) {
            status = gt_stage_qp_eliminated(c, k, now);
        }
        now = after;
        after = swap;
    }
    return status;
}

#endif
