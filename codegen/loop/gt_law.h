/* What a control law gets, what it gives, and how the loop calls it.
 *
 * Feedback is what the thesis calls the submit state, command its obtain state: carts in m, speeds in m/s, SI inside.
 */
#ifndef GT_LAW_H
#define GT_LAW_H

#include "gt_status.h"
#include "gt_wrench.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GT_AXES 6U
#define GT_IPOC_DIGITS 20U

typedef struct gt_feedback {
    uint64_t sequence;          /* number of the datagram */
    uint64_t time_ms;           /* the robot's clock */
    double position_m[GT_AXES]; /* carts, measured */
    double planned_m[GT_AXES];  /* carts, the robot's own reference */
    int has_planned;
    int running;                /* the robot takes corrections */
    uint32_t delay;             /* answers that the robot found late, where it says so */
    uint32_t joint_count;
    double joints_deg[GT_AXES]; /* of a robot that also has joints: sent back as they came */
    uint32_t stamp_length;      /* digits that the answer has to repeat */
    uint8_t stamp[GT_IPOC_DIGITS];
    int has_wrenches;           /* 1: both; only ever for a law that reads them */
    gt_wrench handle;
    gt_wrench tool;
} gt_feedback;

typedef struct gt_command {
    int along_path;             /* 1: path_m is meant, 0: positions */
    double position_m[GT_AXES]; /* carts */
    double speed_m_s[GT_AXES];  /* of the motion at this position */
    double path_m[3];           /* offset of the tool centre point */
    int braking;                /* 1: the law brings the motion to its end, and its status says why */
} gt_command;

/* What a law with a plan logs; gtmodel/loop/process.py names the numbers. Failed, lost, refused and skipped count
 * since the start. */
enum {
    GT_PLAN_ITERATIONS,
    GT_PLAN_COST,
    GT_PLAN_RESIDUAL,
    GT_PLAN_ACTIVE,  /* a bit for each limit that is active in the plan */
    GT_PLAN_FAILED,  /* cycles without a solution */
    GT_PLAN_LOST,    /* cycles without a reading that could be used */
    GT_PLAN_REFUSED, /* rows of goals that could not be used */
    GT_PLAN_SKIPPED  /* cycles of the robot that the loop did not go through */
};
#define GT_PLAN_PREDICTED 8U /* carts at this reading, as they were predicted */
#define GT_PLAN_FORCE (GT_PLAN_PREDICTED + GT_AXES) /* of the plan */
#define GT_LAW_NUMBERS (GT_PLAN_FORCE + GT_AXES)

/* A law: `state` belongs to the caller. Each function returns GT_OK or why it cannot go on; then the loop holds. */
typedef struct gt_law {
    void *state;
    int reads_wrenches; /* 1: datagrams have to carry them */
    /* once, with the first feedback of a running robot */
    gt_status (*init)(void *state, const gt_feedback *first);
    /* each cycle; elapsed_ms since the first on the robot's clock. Writes the command only with GT_OK, or
     * with another status a command that brakes: it counts too, and the loop stops when its speeds are zero. */
    gt_status (*step)(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command);
    /* in a cycle that brought nothing that step could answer: the command of a plan, with GT_OK; NULL: no plan, and
     * the last speed is held. Without a command of the plan the loop ramps to a stop at once. */
    gt_status (*go_on)(void *state, gt_command *command);
    /* once, at the end */
    void (*term)(void *state);
    const double *numbers; /* GT_LAW_NUMBERS for the log, or NULL */
} gt_law;

#ifdef __cplusplus
}
#endif

#endif
