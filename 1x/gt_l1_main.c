/* Runs the self-test, so that `cc *.c -lm && ./a.out` says whether this compiler computes the right numbers.
 *
 * main is weak where the compiler knows that word: a program with its own main may link this file too.
 * Elsewhere define GT_NO_MAIN, or leave this file out.
 */
#include "gt_l1.h"

#include <stdio.h>

#ifndef GT_NO_MAIN

#if defined(__GNUC__) && (defined(__ELF__) || defined(__APPLE__))
__attribute__((weak))
#endif
int main(void)
{
    const int failures = gt_l1_selftest();

    if (failures == 0) {
        (void)printf("gt_l1 self-test: every vector is reproduced bit for bit\n");
    } else {
        (void)printf("gt_l1 self-test: %d vectors differ, by up to %.3g\n", failures,
                     gt_l1_selftest_difference());
        (void)printf("About 1e-15 comes from another libm or from -ffp-contract; more is an error.\n");
    }
    return (failures == 0) ? 0 : 1;
}

#endif
