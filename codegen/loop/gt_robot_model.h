/* The generated functions that laws may call, whatever their names. A file written beside a generated folder fills
 * it; a function that the folder does not hold is NULL. */
#ifndef GT_ROBOT_MODEL_H
#define GT_ROBOT_MODEL_H

#include "gt_status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_robot_model {
    uint32_t axes; /* carts [m], or joints [rad] */
    /* tool centre point from carts or joints [m, rad] */
    gt_status (*forward)(const double *position_m, double *tcp_m);
    /* motor forces [N] from tool centre point, its velocity and acceleration [m, m/s, m/s2]; of joints, torques [N m]
     * from the joints, their speeds and accelerations [rad, rad/s, rad/s2] */
    gt_status (*inverse_dynamics)(const double *tcp_m, const double *tcp_m_s, const double *tcp_m_s2, double *force_N);
    /* carts and their speeds from tool centre point and its velocity [m, m/s] */
    gt_status (*carts)(const double *tcp_m, const double *tcp_m_s, double *position_m, double *speed_m_s);
    int joints; /* 1: the axes are joints */
} gt_robot_model;

/* Columns of a reference: q, der(q), der(q,2) of the carts or joints, then T, der(T), der(T,2). */
#define GT_REFERENCE_COLUMNS(axes) ((3U * (axes)) + 9U)
#define GT_REFERENCE_MOST GT_REFERENCE_COLUMNS(6U)

#ifdef __cplusplus
}
#endif

#endif
