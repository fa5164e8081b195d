/* Law: a tool led through by hand, with force sensors at handle and tool; gt_lead_through on a robot with carts.
 *
 * The tool of such a robot does not turn. The speed of the tool centre point is added up from where the robot stood; carts
 * follow by the model. A lost datagram leaves the speed as it was, as the loop does. Wrenches that cannot be used, or are
 * not there, brake the motion within the law's acceleration limit, for good, with the status of their cause.
 */
#ifndef GT_LAW_LEAD_THROUGH_H
#define GT_LAW_LEAD_THROUGH_H

#include "gt_law.h"
#include "gt_lead_through.h"
#include "gt_robot_model.h"
#include "gt_traj.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_lead_through {
    const gt_robot_model *model;
    gt_traj numbers; /* one row, see gt_lead_through.h */
    uint32_t cycle_ms;
    uint32_t hold_cycles; /* that the loop bridges without a datagram */
    gt_lead_through lead; /* from here on set by the law */
    gt_lead_through_state now;
    gt_vector tcp_m;
    uint64_t last_ms;
} gt_law_lead_through;

gt_law gt_law_lead_through_of(gt_law_lead_through *state);

#ifdef __cplusplus
}
#endif

#endif
