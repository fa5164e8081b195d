/* Newton's method with a fixed number of steps on a generated kernel, for equations without a closed form.
 *
 * It follows the solution that it starts from: the first step is bounded and every further step must be at most a
 * quarter of the one before, so that it hardly ends in another assembly mode. GT_OK is returned only if the residual
 * of the answer is below its limit. gtmodel/cgen/newton_steps.py does the same steps in the same order; the two agree
 * bit for bit.
 */
#ifndef GT_NEWTON_H
#define GT_NEWTON_H

#include "gt_float.h"
#include "gt_status.h"

#include <math.h>

/* Steps; the kernel runs once more for the residual of the answer. */
#define GT_NEWTON_STEPS 4
/* Largest first step, in nominal sizes of the unknowns. */
#define GT_NEWTON_REACH 0.5
/* Largest ratio of a step to the one before. */
#define GT_NEWTON_CONTRACTION 0.25
/* Steps below this, in nominal sizes, are round-off and need not shrink. */
#define GT_NEWTON_ROUND_OFF 1e-10

/* A generated kernel: arg[0] the unknowns, arg[1] its constants, res[0] the residual, res[1] the Jacobian by rows, or 0
 * if only the residual is needed. */
typedef int (*gt_newton_kernel)(const double **arg, double **res, long long int *iw, double *w, int mem);

/* How near its limits the last call was. A call that failed writes only the member that exceeded its limit. */
typedef struct gt_newton_marks {
    double step; /* last step, in nominal sizes */
    double pivot; /* smallest pivot over its limit: ok above one */
    double residual; /* largest residual over its limit: ok up to one */
} gt_newton_marks;

/* Solves J x = r in place, n unknowns: r becomes x. LU by rows with partial pivoting; the first of equal candidates is
 * the pivot; a row with a factor of zero is not changed. Returns 0 if a pivot is not above `least`; lowers *smallest to
 * the smallest pivot. */
static inline int gt_newton_lu(double *jacobian, double *r, int n, double least, double *smallest)
{
    int i;
    int j;
    int k;

    for (k = 0; k < n; k++) {
        double *upper = &jacobian[n * k];
        double best = fabs(upper[k]);
        double inverse;
        double x;
        int row = k;

        for (i = k + 1; i < n; i++) {
            const double size = fabs(jacobian[(n * i) + k]);

            if (size > best) {
                best = size;
                row = i;
            }
        }
        if (!(best > least)) {
            *smallest = best;
            return 0;
        }
        if (best < *smallest) {
            *smallest = best;
        }
        x = r[row];
        if (row != k) {
            double *other = &jacobian[n * row];

            r[row] = r[k];
            r[k] = x;
            for (j = k; j < n; j++) {
                const double t = other[j];

                other[j] = upper[j];
                upper[j] = t;
            }
        }
        inverse = 1.0 / upper[k];
        for (i = k + 1; i < n; i++) {
            double *lower = &jacobian[n * i];
            const double factor = lower[k] * inverse;

            if (factor != 0.0) {
                r[i] -= factor * x;
                for (j = k + 1; j < n; j++) {
                    lower[j] -= factor * upper[j];
                }
            }
        }
    }
    for (k = n - 1; k >= 0; k--) {
        const double *upper = &jacobian[n * k];
        double x = r[k];

        for (j = n - 1; j > k; j--) {
            x -= upper[j] * r[j];
        }
        r[k] = x / upper[k];
    }
    return 1;
}

/* Moves z from its start to the solution. `nominal` and `largest` (n each): nominal sizes of the unknowns and limits of
 * the residuals, both inverted; `least`: limit of the pivots. arg[0] must be z; z is a solution only with GT_OK. Sets
 * res[1] to 0 before the residual of the answer. */
static inline gt_status gt_newton(gt_newton_kernel kernel, const double **arg, double **res, long long int *iw,
                                  double *w, int n, const double *nominal, const double *largest, double least,
                                  double *z, gt_newton_marks *marks)
{
    double *r = res[0];
    double most = GT_NEWTON_REACH;
    double smallest = DBL_MAX;
    double worst = 0.0;
    double last = 0.0;
    int step;
    int i;

    for (step = 0; step < GT_NEWTON_STEPS; step++) {
        double size = 0.0;

        if (kernel(arg, res, iw, w, 0) != 0) {
            return GT_NOT_CONVERGED;
        }
        if (!gt_newton_lu(res[1], r, n, least, &smallest)) {
            marks->pivot = smallest / least;
            return GT_SINGULAR;
        }
        for (i = 0; i < n; i++) {
            const double x = r[i];
            const double part = fabs(x) * nominal[i];

            if (!(part <= most)) {
                marks->step = part;
                return GT_NOT_CONVERGED;
            }
            if (part > size) {
                size = part;
            }
            z[i] -= x;
        }
        last = size;
        most = GT_NEWTON_CONTRACTION * size;
        if (most < GT_NEWTON_ROUND_OFF) {
            most = GT_NEWTON_ROUND_OFF;
        }
    }
    res[1] = 0;
    if (kernel(arg, res, iw, w, 0) != 0) {
        return GT_NOT_CONVERGED;
    }
    for (i = 0; i < n; i++) {
        const double part = fabs(r[i]) * largest[i];

        if (!(part <= 1.0)) {
            marks->residual = part;
            return GT_NOT_CONVERGED;
        }
        if (part > worst) {
            worst = part;
        }
    }
    marks->step = last;
    marks->pivot = smallest / least;
    marks->residual = worst;
    return GT_OK;
}

#endif
