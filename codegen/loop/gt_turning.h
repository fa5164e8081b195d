/* Rotation in lead-through, a cycle at a time: guided by the handle's moment, aligned by the tool's.
 *
 * Dressler 2012, (8.5), (8.11). TurningLaw of gtmodel/control/lead_through is the same in Python, operation by operation.
 */
#ifndef GT_TURNING_H
#define GT_TURNING_H

#include "gt_vector.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GT_TURNING_NUMBERS 16U

/* What the rotation about the axis does in contact. */
#define GT_ABOUT_FREE 0.0
#define GT_ABOUT_LOCK 1.0
#define GT_ABOUT_HOLD 2.0
#define GT_ABOUT_GUIDE 3.0

/* TurningGains, axis and a direction across it in the tool's frame. In a table they stand in this order. */
typedef struct gt_turning_gains {
    double by_handle; /* 0 or 1: the handle's moment turns the tool, free of contact */
    double inertia_kg_m2;
    double damping_N_m_s;
    double moment_gain; /* [rad/s/(N m)] turns the tool to no moment, in contact */
    double about_axis;
    double hold_gain_1_s;
    double rate_limit_rad_s;
    double moment_rate_limit_rad_s;
    double acceleration_limit_rad_s2;
    double moment_range_N_m;
    gt_vector axis;
    gt_vector across;
} gt_turning_gains;

typedef struct gt_turning_state {
    gt_vector rate_rad_s;   /* the command */
    gt_vector guided_rad_s; /* for the next cycle */
    gt_vector across;       /* where the direction across the axis pointed when contact began */
    double about_rad;       /* commanded turn about the axis in contact */
} gt_turning_state;

/* Gains from a row of a table; 0 for what TurningGains does not accept. */
int gt_turning_gains_of(gt_turning_gains *gains, const double *numbers);

gt_turning_state gt_turning_start(void);

/* The state after a cycle with moments about the tool centre point; turn: rows of the matrix whose columns are the
 * tool's axes; began: contact began in this cycle. */
gt_turning_state gt_turning_step(const gt_turning_gains *gains, const gt_turning_state *state, int contact,
                                 gt_vector handle_N_m, gt_vector tool_N_m, const double *turn, int began, double cycle_s);

/* The state after a cycle that brakes within the acceleration limit. */
gt_turning_state gt_turning_stop(const gt_turning_gains *gains, const gt_turning_state *state, double cycle_s);

#ifdef __cplusplus
}
#endif

#endif
