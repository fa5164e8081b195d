/* Generated bodies without guards: call the functions of gt_l1.h instead. No pointer may be NULL. SZ_*: how
 * many pointers, integers and doubles of scratch a body takes.
 */
#ifndef GT_L1_BODY_H
#define GT_L1_BODY_H

#ifdef __cplusplus
extern "C" {
#endif

#define GT_L1_FK_SZ_ARG 1
#define GT_L1_FK_SZ_RES 2
#define GT_L1_FK_SZ_IW 0
#define GT_L1_FK_SZ_W 0
int gt_l1_fk_body(const double **arg, double **res, long long int *iw, double *w, int mem);

#ifdef __cplusplus
}
#endif

#endif
