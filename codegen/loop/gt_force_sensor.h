/* A force sensor on the robot: its wrench without bias and load, about the tool centre point, in the world frame.
 *
 * MountedSensor of gtmodel/control/lead_through is the same in Python, operation by operation.
 */
#ifndef GT_FORCE_SENSOR_H
#define GT_FORCE_SENSOR_H

#include "gt_surface.h"
#include "gt_wrench.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GT_FORCE_SENSOR_NUMBERS 22U
#define GT_OTHER_LOAD 0.3 /* of the weight: as OTHER_LOAD in Python */

/* At rest and free it reads force = bias + mass g, moment = bias + first moment x g, g along its own axes. In a table
 * the numbers stand in this order. */
typedef struct gt_force_sensor {
    double turn[9];    /* rows; columns are the sensor's axes in the tool's frame */
    gt_vector point_m; /* from the sensor's origin to the tool centre point, along its axes */
    gt_vector bias_N;
    gt_vector bias_N_m;
    double mass_kg;
    gt_vector first_moment_kg_m;
} gt_force_sensor;

/* A sensor from a row of a table; 0 for numbers that MountedSensor does not accept. */
int gt_force_sensor_of(gt_force_sensor *sensor, const double *numbers);

/* Force and moment from outside; turn: rows of the matrix whose columns are the tool's axes in the world frame. */
void gt_force_sensor_wrench(const gt_force_sensor *sensor, const gt_wrench *reading, const double *turn,
                            gt_vector gravity, gt_vector *force_N, gt_vector *moment_N_m);

/* At rest and free: does the weight pull where it has to? GT_WRENCH_WRONG_LOAD where it does, but is off by more than
 * drift_N and 0.3 of itself: another load, sensor or frame. GT_WRENCH_NO_FORCE where drift_N, the largest change of the
 * bias with its noise, does not let it tell. */
gt_wrench_status gt_force_sensor_sign(const gt_force_sensor *sensor, const gt_wrench *reading, const double *turn,
                                      gt_vector gravity, double drift_N);

#ifdef __cplusplus
}
#endif

#endif
