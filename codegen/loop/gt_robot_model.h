/* The generated functions that laws may call, whatever their names. A file written beside a generated folder fills
 * it; a function that the folder does not hold is NULL. */
#ifndef GT_ROBOT_MODEL_H
#define GT_ROBOT_MODEL_H

#include "gt_status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GT_PLAN_GOALS_MOST 1024U /* numbers of all rows */
#define GT_PLAN_AHEAD_MOST 17U   /* cycles */

/* One cycle of a predictive controller: the command that is sent; after the delay, force of the cycle, and carts at its
 * end. Of joints [N m, rad, rad/s]. */
typedef struct gt_plan_cycle {
    double command_m[6];
    double force_N[6];
    double position_m[6];
    double speed_m_s[6];
    double cost;
    double residual;
    double active; /* bits of the limits that are active in the plan */
    int iterations;
    int failed; /* cycles in a row without a solution */
    int lost;   /* cycles in a row without a usable reading */
} gt_plan_cycle;

/* A generated predictive controller; its state is memory of the caller. */
typedef struct gt_robot_plan {
    size_t bytes;       /* of the state */
    uint32_t goals;     /* references of a stage */
    uint32_t rows;      /* 1: the same for all stages; with preview one for each stage, and for the end */
    uint32_t period_ms;
    uint32_t stage_ms;
    uint32_t delay;     /* cycles */
    gt_status (*begin)(void *state, int sends_speed);
    /* one cycle; position_m: the reading, or NULL; before_m: the last command */
    gt_status (*step)(void *state, const double *position_m, const double *before_m, const double *goals,
                      gt_plan_cycle *cycle);
} gt_robot_plan;

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
    const gt_robot_plan *plan; /* NULL: the folder holds no predictive controller with what the law needs */
} gt_robot_model;

/* Columns of a reference: q, der(q), der(q,2) of the carts or joints, then T, der(T), der(T,2). */
#define GT_REFERENCE_COLUMNS(axes) ((3U * (axes)) + 9U)
#define GT_REFERENCE_MOST GT_REFERENCE_COLUMNS(6U)

#ifdef __cplusplus
}
#endif

#endif
