/* Law: a reference and a stored table of corrections, such as one that learning from earlier runs made. */
#ifndef GT_LAW_REPLAY_H
#define GT_LAW_REPLAY_H

#include "gt_law.h"
#include "gt_robot_model.h"
#include "gt_traj.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_law_replay {
    gt_traj reference;
    gt_traj corrections; /* one column per cart [m] */
    uint32_t axes;
} gt_law_replay;

gt_law gt_law_replay_of(gt_law_replay *state);

#ifdef __cplusplus
}
#endif

#endif
