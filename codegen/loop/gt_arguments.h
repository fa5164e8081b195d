/* The command line of the loop. */
#ifndef GT_ARGUMENTS_H
#define GT_ARGUMENTS_H

#include "gt_loop.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_arguments {
    gt_protocol peer;
    const char *bind;         /* address to listen at */
    const char *allow;        /* address of the robot */
    int beyond_loopback;      /* the explicit switch */
    int has_limits;           /* lowest, highest and step were given */
    uint32_t port;
    uint32_t cycle_ms;
    const char *law;          /* trajectory, dynamics, replay, path, lead_through, predictive */
    int feedforward;
    int live;
    int lockstep;             /* cycles end with an empty datagram, not with time */
    uint32_t cycles;          /* 0: until nothing came for idle_ms */
    uint32_t idle_ms;
    uint32_t hold_cycles;
    uint32_t ramp_cycles;
    uint32_t delay_ms;
    uint32_t lead_ms;
    double deceleration_m_s2; /* 0: ramp_cycles */
    gt_limits limits;
    double a[GT_AXES];
    double b[GT_AXES];
    double kp_N_m[GT_AXES];
    double kd_N_s_m[GT_AXES];
    double gain_per_s;
    const char *reference;    /* files */
    const char *corrections;
    const char *gains;
    const char *log;
    uint32_t fewest;          /* numbers that an option for all carts was given */
    const char *about;        /* the option that a sentence is about, NULL for none */
} gt_arguments;

/* Reads `--name value` pairs; NULL, or a sentence on what is wrong. Refuses a peer beyond loopback without limits and
 * the explicit switch. */
const char *gt_arguments_read(gt_arguments *arguments, int argc, char **argv);

/* All options, for a person. */
const char *gt_arguments_help(void);

#ifdef __cplusplus
}
#endif

#endif
