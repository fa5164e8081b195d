/* Requirements on the arithmetic: IEEE float and double, no fast-math, no contraction of a*b + c into one rounding.
 *
 * Guards such as !(D >= 0) and the self-test's == rely on them. Include this header before any function.
 */
#ifndef GT_FLOAT_H
#define GT_FLOAT_H

#include <float.h>

#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#error "compile without -ffast-math, -Ofast or /fp:fast: they remove the tests for NaN"
#endif
#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error "compile without -ffinite-math-only: it removes the tests for NaN"
#endif
#if (FLT_RADIX != 2) || (DBL_MANT_DIG != 53) || (DBL_MAX_EXP != 1024)
#error "double must be the 64 bit number of IEEE 754"
#endif
#if (FLT_MANT_DIG != 24) || (FLT_MAX_EXP != 128)
#error "float must be the 32 bit number of IEEE 754"
#endif

/* -ffp-contract=off on the command line is the sure way; these are for projects that forget it. The vectoriser of gcc 12
 * makes fmaddsub of a product beside a sum and a difference even so. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && defined(__FP_FAST_FMA)
#pragma GCC optimize("fp-contract=off", "no-tree-slp-vectorize")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#endif
