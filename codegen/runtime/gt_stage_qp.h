/* A quadratic program over the stages of a horizon, by a primal-dual interior point method with Riccati recursion: loops
 * over the stages round generated kernels.
 *
 * gtmodel/predictive/interior_point.py does the same in the same order; the two agree bit for bit. Nothing is
 * allocated; all memory is the caller's. The number of operations is bounded by `max_iterations`.
 */
#ifndef GT_STAGE_QP_H
#define GT_STAGE_QP_H

#include "gt_stage_qp_factor.h"
#include "gt_stage_qp_limits.h"
#include "gt_stage_qp_riccati.h"
#include "gt_stage_qp_sides.h"

/* First products of distance and multiplier: their sum is so many times 1 + |cost|, without and with a start. */
#define GT_STAGE_QP_FIRST 300.0
#define GT_STAGE_QP_AGAIN 1.0
/* Share of the way to the nearest limit that a step goes. */
#define GT_STAGE_QP_TO_BOUNDARY 0.995
/* The gradient may be so many times the gap. */
#define GT_STAGE_QP_GRADIENT 10.0

/* GT_OK, GT_NOT_FINITE, or GT_NOT_CONVERGED as long as a tolerance is not met. */
static inline gt_status gt_stage_qp_status(const gt_stage_qp *f, const gt_stage_qp_outcome *out)
{
    const double numbers[4] = {out->gap, out->residual, out->gradient, out->cost};
    const double allowed = f->tolerance * (1.0 + fabs(out->cost));
    gt_status status = GT_NOT_CONVERGED;

    if (gt_stage_qp_finite(numbers, 4) == 0) {
        status = GT_NOT_FINITE;
    } else if ((out->gap <= allowed) && (out->residual <= f->tolerance)
               && (out->gradient <= (GT_STAGE_QP_GRADIENT * allowed))) {
        status = GT_OK;
    } else {
        /* another iteration */
    }
    return status;
}

/* How far the iterate is from the optimum. The inputs' gradient is computed where all else would end the iteration. */
static inline gt_status gt_stage_qp_judged(const gt_stage_qp_call *c, double cost, gt_stage_qp_outcome *out)
{
    gt_status status;

    gt_stage_qp_measured(c, cost, out);
    status = gt_stage_qp_status(c->f, out);
    if ((status == GT_OK) || (out->iterations == c->f->max_iterations)) {
        gt_stage_qp_kept(c);
        out->gradient += gt_stage_qp_sloped(c);
        status = gt_stage_qp_status(c->f, out);
    }
    return status;
}

/* Solves the problem from the state and the inputs in `w`; `start`: sides of an earlier solution, or 0. */
static inline gt_status gt_stage_qp_solve(const gt_stage_qp_call *c, const double *start, gt_stage_qp_outcome *out)
{
    const gt_stage_qp *f = c->f;
    const gt_stage_qp_work *w = c->w;
    double cost;
    gt_status status;

    gt_stage_qp_followed(c);
    cost = gt_stage_qp_graded(c);
    if (start != 0) {
        gt_stage_qp_pushed(c, start, (GT_STAGE_QP_AGAIN * (1.0 + fabs(cost))) / f->products);
    } else {
        gt_stage_qp_begun(c, (GT_STAGE_QP_FIRST * (1.0 + fabs(cost))) / f->products);
    }
    out->iterations = 0;
    status = gt_stage_qp_judged(c, cost, out);
    while ((status == GT_NOT_CONVERGED) && (out->iterations < f->max_iterations)) {
        double sum = 0.0;
        double centre;
        double ratio;
        double length;

        out->iterations++;
        gt_stage_qp_weighed(c);
        if (gt_stage_qp_factored(c) != GT_OK) {
            return GT_SINGULAR;
        }
        gt_stage_qp_stepped(c);
        length = 1.0 / gt_stage_qp_larger(gt_stage_qp_tried(c, &sum), 1.0);
        /* the gap after this step, over the gap: the terms linear in the length add up to -1 */
        ratio = gt_stage_qp_larger((1.0 - length) - (length * (length * (sum / out->gap))), 0.0);
        centre = gt_stage_qp_larger(ratio * (ratio * (ratio * out->gap)),
                                    f->enough * (1.0 + fabs(out->cost)));
        gt_stage_qp_aimed(c, centre / f->products);
        gt_stage_qp_stepped(c);
        length = GT_STAGE_QP_TO_BOUNDARY / gt_stage_qp_larger(gt_stage_qp_changed(c), GT_STAGE_QP_TO_BOUNDARY);
        gt_stage_qp_moved(w->x, w->dx, length, (f->count + 1) * f->states);
        gt_stage_qp_moved(w->u, w->du, length, f->count * f->inputs);
        gt_stage_qp_moved(w->y, w->dy, length, (f->count * f->stage.rows) + f->last.rows);
        gt_stage_qp_advanced(c, length);
        cost = gt_stage_qp_graded(c);
        status = gt_stage_qp_judged(c, cost, out);
    }
    return status;
}

#endif
