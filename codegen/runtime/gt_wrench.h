/* Two wrenches beside what a robot reports: of a force sensor at the handle and of one at the tool, with their ages.
 *
 * Neither protocol has them: the fields of EGM and the elements of RSI below are gtmodel's own. They are read where a law
 * declares that it needs them, from datagrams that gt_egm_read_robot or gt_rsi_read_robot has accepted.
 */
#ifndef GT_WRENCH_H
#define GT_WRENCH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As the sensor gives it, about its origin and along its axes: on the handle by the hand, on the tool from outside. */
typedef struct gt_wrench {
    double force_N[3]; /* of EGM they may be any number, NaN too: the law judges */
    double moment_N_m[3];
    uint32_t age_cycles; /* of the robot, since it was measured */
    uint32_t status;     /* the sensor's own word: 0 for a wrench that can be used */
} gt_wrench;

/* EgmRobot: 100 handle, 101 tool, each {1 repeated double force, 2 repeated double moment, 3 age, 4 status}; doubles
 * packed or unpacked, three each; larger numbers of age and status than 32 bits hold count as the largest. 1 and both
 * wrenches, or 0 where one of them is not there once, whole and well formed; then they are all zero. */
int gt_egm_read_wrenches(const uint8_t *data, uint32_t length, gt_wrench *handle, gt_wrench *tool);

/* <Rob>: <FtHandle FX FY FZ MX MY MZ Age State/>, <FtTool .../>, decimal numbers; State may be left out. Returns the
 * same. */
int gt_rsi_read_wrenches(const uint8_t *data, uint32_t length, gt_wrench *handle, gt_wrench *tool);

#ifdef __cplusplus
}
#endif

#endif
