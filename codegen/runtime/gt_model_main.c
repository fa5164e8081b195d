/* Runs the self-test, so that `cc *.c -lm && ./a.out` shows whether this compiler computes the right numbers.
 *
 * main is weak if the compiler supports that: a program with its own main may link this file too.
 * Otherwise define GT_NO_MAIN, or leave this file out.
 */
#include "gt_model.h"

#include <stdio.h>

#ifndef GT_NO_MAIN

#if defined(__GNUC__) && (defined(__ELF__) || defined(__APPLE__))
__attribute__((weak))
#endif
int main(void)
{
    const int failures = gt_model_selftest();

    if (failures == 0) {
        (void)printf("gt_model self-test: every vector is reproduced bit for bit\n");
    } else {
        (void)printf("gt_model self-test: %d vectors differ, by up to %.3g\n", failures,
                     gt_model_selftest_difference());
        (void)printf("About 1e-15 comes from another libm or from -ffp-contract; more is an error.\n");
    }
    return (failures == 0) ? 0 : 1;
}

#endif
