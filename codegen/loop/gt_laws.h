/* The laws that the program offers, by their names. */
#ifndef GT_LAWS_H
#define GT_LAWS_H

#include "gt_arguments.h"
#include "gt_law_dynamics.h"
#include "gt_law_lead_through.h"
#include "gt_law_path.h"
#include "gt_law_predictive.h"
#include "gt_law_replay.h"
#include "gt_law_trajectory.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The generated functions; gtmodel writes gt_loop_model.c beside a generated folder. */
extern const gt_robot_model gt_loop_model;

/* Room for the state of each. */
typedef struct gt_laws {
    gt_law_trajectory trajectory;
    gt_law_dynamics dynamics;
    gt_law_replay replay;
    gt_law_path path;
    gt_law_lead_through lead_through;
    gt_law_predictive predictive;
} gt_laws;

/* Tables of the laws; without rows where they were not given. plan: memory of gt_loop_model.plan, or NULL. */
typedef struct gt_laws_tables {
    gt_traj reference;
    gt_traj corrections;
    gt_traj gains;
    void *plan;
} gt_laws_tables;

/* The law of arguments->law; 0 if there is none, or if it lacks its table. */
int gt_laws_choose(gt_laws *laws, const gt_arguments *arguments, const gt_laws_tables *tables, gt_law *law);

#ifdef __cplusplus
}
#endif

#endif
