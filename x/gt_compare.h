/* Comparison of computed numbers with stored ones, for self-tests. */
#ifndef GT_COMPARE_H
#define GT_COMPARE_H

#include "gt_float.h"

#include <math.h>

/* 1 if all n numbers are equal by ==, else 0. Raises *worst to their largest difference, which is relative
 * where the stored number is greater than one; NaN counts as infinitely far. */
static inline int gt_all_equal(const double *computed, const double *stored, int n, double *worst)
{
    int equal = 1;
    int i;

    for (i = 0; i < n; i++) {
        if (!(computed[i] == stored[i])) {
            const double size = fabs(stored[i]);
            const double difference = fabs(computed[i] - stored[i]) / ((size > 1.0) ? size : 1.0);

            equal = 0;
            if (!(difference <= *worst)) {
                *worst = (difference <= DBL_MAX) ? difference : HUGE_VAL;
            }
        }
    }
    return equal;
}

#endif
