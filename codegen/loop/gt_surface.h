/* Lead-through in translation, a cycle at a time: guided by hand along a surface, the force held along its normal.
 *
 * Dressler 2012, (8.4)-(8.11). A tool force is the force on the tool, the normal points from the workpiece to the tool.
 * SurfaceLaw of gtmodel/control/lead_through is the same in Python, operation by operation.
 */
#ifndef GT_SURFACE_H
#define GT_SURFACE_H

#include "gt_vector.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Why a wrench cannot be used; the numbers of WrenchStatus in Python. */
typedef enum gt_wrench_status {
    GT_WRENCH_OK = 0,
    GT_WRENCH_NO_FORCE = 1, /* in contact: it has no direction, the normal stays; no reason to stop */
    GT_WRENCH_ONE_DIRECTION = 2,
    GT_WRENCH_WRONG_SIGN = 3,
    GT_WRENCH_NOT_FINITE = 4,
    GT_WRENCH_SATURATED = 5,
    GT_WRENCH_STALE = 6,
    GT_WRENCH_FAULT = 7, /* the sensor says so itself */
    GT_WRENCH_NO_ROTATION = 8,
    GT_WRENCH_WRONG_LOAD = 9 /* at rest: not the weight of its numbers */
} gt_wrench_status;

#define GT_SURFACE_NUMBERS 30U

/* SurfaceGains, OscillationWatch and the nominal normal, in SI. In a table they stand in this order. */
typedef struct gt_surface_gains {
    double cycle_s;
    double mass_kg;
    double damping_N_s_m;
    double force_gain_m_s_N;
    double force_reference_N;
    double any_direction; /* 0 or 1: contact by the size of force and moment, the force's direction as normal */
    double contact_arm_m;
    double cone_cosine; /* of the largest angle between normal and nominal one */
    double normal_filter_s;
    double friction;
    double friction_speed_m_s;
    double least_force_N;
    double enter_force_N;
    double leave_force_N;
    double dwell_cycles;
    double release_force_N;
    double speed_limit_m_s;
    double force_speed_limit_m_s;
    double acceleration_limit_m_s2;
    double force_range_N;
    double age_limit_s;
    double watch_level_N; /* 0: off */
    double watch_constant_s;
    double watch_window_s;
    double watch_fall_s;
    double watch_recovery_s;
    double watch_least_share;
    gt_vector normal;
} gt_surface_gains;

typedef struct gt_surface_state {
    gt_vector velocity_m_s; /* the command */
    gt_vector guided_m_s;   /* V_h of (8.7), for the next cycle */
    gt_vector normal;       /* in use */
    gt_vector filtered;     /* before the cone */
    int contact;
    double since; /* cycles since the contact changed, up to the dwell */
    double slow_N; /* of the watch: slow part of the force, energy of the rest, share of the gain */
    double energy_N2;
    double share;
    gt_wrench_status status;
    int allowed; /* 0: it brakes and stands, until it is started again */
} gt_surface_state;

/* Gains from a row of a table; 0 for what SurfaceGains does not accept. */
int gt_surface_gains_of(gt_surface_gains *gains, const double *numbers);

/* At rest and free; `sign` is what the tests of the sensors' signs ended with: what else than GT_WRENCH_OK never moves. */
gt_surface_state gt_surface_start(const gt_surface_gains *gains, gt_wrench_status sign);

/* The state after a cycle with forces that may be used [N], without bias and weight; moment_N_m: size of the tool's. */
gt_surface_state gt_surface_moved(const gt_surface_gains *gains, const gt_surface_state *state, gt_vector handle_N,
                                  gt_vector tool_N, double moment_N_m);

/* The state after a cycle that brakes within the acceleration limit, for good. */
gt_surface_state gt_surface_stop(const gt_surface_gains *gains, const gt_surface_state *state, gt_wrench_status why);

#ifdef __cplusplus
}
#endif

#endif
