/* Guards on numbers, written so that NaN fails them. */
#ifndef GT_GUARD_H
#define GT_GUARD_H

#include "gt_float.h"

#include <math.h>

/* For functions that few calls need: out of line, so that other calls are not slowed down. */
#if defined(__GNUC__)
#define GT_RARE __attribute__((noinline, cold))
#else
#define GT_RARE
#endif

/* For code that several functions of a file share: one copy instead of one in each function. */
#if defined(__GNUC__)
#define GT_SHARED __attribute__((noinline))
#else
#define GT_SHARED
#endif

/* 1 if none of the n numbers at x is NaN or infinite, else 0; denormal numbers are finite. */
static inline int gt_all_finite(const double *x, int n)
{
    int good = 1;
    int i;

    for (i = 0; i < n; i++) {
        if (!(fabs(x[i]) <= DBL_MAX)) {
            good = 0;
        }
    }
    return good;
}

/* Copies n numbers; the two places must not overlap. */
static inline void gt_copy(double *to, const double *from, int n)
{
    int i;

    for (i = 0; i < n; i++) {
        to[i] = from[i];
    }
}

#endif
