/* A quadratic program over the stages of a horizon, by a primal-dual interior point method with Riccati recursion: loops
 * over the stages round generated kernels.
 *
 * gtmodel/predictive/interior_point.py does the same in the same order; the two agree bit for bit. Nothing is
 * allocated; all memory is the caller's. The number of operations is bounded by `max_iterations`.
 */
#ifndef GT_STAGE_QP_H
#define GT_STAGE_QP_H

#include "gt_stage_qp_riccati.h"
#include "gt_stage_qp_sides.h"

/* Share of the way to the nearest limit that a step goes. */
#define GT_STAGE_QP_TO_BOUNDARY 0.995

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
