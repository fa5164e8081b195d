/* Lead-through in six degrees of freedom: the readings of two sensors in, speed and rate of the tool out.
 *
 * LeadThroughLaw of gtmodel/control/lead_through is the same in Python, operation by operation.
 */
#ifndef GT_LEAD_THROUGH_H
#define GT_LEAD_THROUGH_H

#include "gt_force_sensor.h"
#include "gt_turning.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A row of a table: gains of translation and rotation, gravity, drift, handle, tool. */
#define GT_LEAD_THROUGH_NUMBERS (GT_SURFACE_NUMBERS + GT_TURNING_NUMBERS + 4U + (2U * GT_FORCE_SENSOR_NUMBERS))

typedef struct gt_lead_through {
    gt_surface_gains translation;
    gt_turning_gains rotation;
    gt_vector gravity_m_s2; /* in the world frame */
    double drift_N;         /* largest change of a bias with its noise: it does not decide the sign */
    gt_force_sensor handle;
    gt_force_sensor tool;
} gt_lead_through;

typedef struct gt_lead_through_state {
    gt_surface_state translation;
    gt_turning_state rotation;
} gt_lead_through_state;

/* The law of a row of numbers; 0 for what Python does not accept. */
int gt_lead_through_of(gt_lead_through *law, const double *numbers);

/* At rest and free of contact and hand; unless the first readings weigh both loads no step ever moves the robot. */
gt_lead_through_state gt_lead_through_start(const gt_lead_through *law, const gt_wrench *handle, const gt_wrench *tool,
                                            const double *turn);

/* The state after a cycle; turn: rows of the matrix whose columns are the tool's axes in the world frame. What cannot be
 * used brakes for good. The status of the sensors themselves is not asked here. */
gt_lead_through_state gt_lead_through_step(const gt_lead_through *law, const gt_lead_through_state *state,
                                           const gt_wrench *handle, const gt_wrench *tool, const double *turn);

/* The state after a cycle that brakes; the first cause stays. */
gt_lead_through_state gt_lead_through_stop(const gt_lead_through *law, const gt_lead_through_state *state,
                                           gt_wrench_status why);

#ifdef __cplusplus
}
#endif

#endif
