/* gt_l1: functions made from the equations of a model.
 *
 * gtmodel 0.1.0, CasADi 3.8.2.
 *
 * Every number is in SI units; a member's name ends in its unit. Matrices are stored row by row. A function
 * writes its outputs only when it returns GT_OK; otherwise they keep their last values. Functions hold no
 * state of their own and may be called from several threads at once. Pointers must not be NULL.
 */
#ifndef GT_L1_H
#define GT_L1_H

#include "gt_status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What this code was made from, for logs; manifest.json holds the same. */
#define GT_L1_PARAMETERS_SHA256 "e65e0536141a8cef677df009b7aa4ba628344b9307f9b020ec2380bf0bb9fc05"
#define GT_L1_BODY_SHA256 "2f8292b6fa5524486dff2eeca8c14696de742372990ef0ba33c6b60a11f856b3"

/* fk: T from q.
 * - of the two solutions for T[0], T[1], T[2] the one with the + root: branch plate_ahead
 * - GT_OUT_OF_RANGE where no real solution exists
 * - GT_SINGULAR where a pivot vanishes; manifest.json names the pivots
 * - GT_OUT_OF_RANGE where the norm of the inputs, each over this, is above one: q 2048
 */
typedef struct gt_l1_fk_in {
    double q_m[3]; /* q [m]: cart coordinates along their guideways (robots/three_link.py:52) */
} gt_l1_fk_in;

typedef struct gt_l1_fk_out {
    double T_m[3]; /* T [m]: tool centre point (robots/three_link.py:53) */
} gt_l1_fk_out;

gt_status gt_l1_fk(const gt_l1_fk_in *in, gt_l1_fk_out *out);

/* Compares every function with stored results of Python by ==; returns how many vectors differ. */
int gt_l1_selftest(void);

/* The largest difference that the self-test sees, relative where the number is above one. */
double gt_l1_selftest_difference(void);

#ifdef __cplusplus
}
#endif

#endif
