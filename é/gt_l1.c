/* gt_l1: guards round the bodies in gt_l1_body.c; see gt_l1.h. */
#include "gt_l1.h"

#include "gt_l1_body.h"
#include "gt_guard.h"

#include <math.h>

/* Below this fraction of its typical size a pivot means singular, and a branch is left. */
#define GT_PIVOT_TOLERANCE (1e-07)

/* 1 if all numbers at n places of so many numbers are finite. It is asked where a sum of them is not. */
static GT_RARE int each_finite(const double *const *place, const int *size, int n)
{
    int good = 1;
    int i;

    for (i = 0; i < n; i++) {
        good &= gt_all_finite(place[i], size[i]);
    }
    return good;
}

#if (GT_L1_FK_SZ_ARG < 1) || (GT_L1_FK_SZ_RES < 2)
#error "the body of gt_l1_fk is from another generation"
#endif

gt_status gt_l1_fk(const gt_l1_fk_in *in, gt_l1_fk_out *out)
{
    gt_l1_fk_out y;
    double margins[2];
    double total;
    const double *arg[GT_L1_FK_SZ_ARG + 1]; /* + 1: C knows no empty array */
    double *res[GT_L1_FK_SZ_RES + 1];
    long long int iw[GT_L1_FK_SZ_IW + 1];
    double w[GT_L1_FK_SZ_W + 1];

    /* The norm of the inputs, each in units of what it may be. */
    total = (in->q_m[0] * in->q_m[0]) + (in->q_m[1] * in->q_m[1]) +
            (in->q_m[2] * in->q_m[2]);
    if (!(total <= 4194304.0)) {
        static const int size[1] = {3};
        const double *place[1];

        place[0] = in->q_m;
        return (each_finite(place, size, 1) != 0) ? GT_OUT_OF_RANGE : GT_NOT_FINITE;
    }
    arg[0] = in->q_m;
    res[0] = y.T_m;
    res[1] = margins;
    (void)gt_l1_fk_body(arg, res, iw, w, 0); /* it returns 0 whatever happens */
    /* discriminant of T[0], T[1], T[2] */
    if (!(margins[0] >= 0.0)) {
        return GT_OUT_OF_RANGE;
    }
    /* pivot of T[0], T[1], T[2] */
    if (!((margins[1] > (GT_PIVOT_TOLERANCE * 69.46797155141661)) ||
          (margins[1] < -(GT_PIVOT_TOLERANCE * 69.46797155141661)))) {
        return GT_SINGULAR;
    }
    if (!(fabs(y.T_m[0] + y.T_m[1] + y.T_m[2]) <= DBL_MAX)) {
        static const int size[1] = {3};
        const double *place[1];

        place[0] = y.T_m;
        if (!(each_finite(place, size, 1))) {
            return GT_NOT_FINITE;
        }
    }
    *out = y;
    return GT_OK;
}
