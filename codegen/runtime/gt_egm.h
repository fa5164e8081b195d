/* ABB EGM over UDP: what a robot sends (EgmRobot) and what it takes (EgmSensor, EgmSensorPathCorr).
 *
 * Written from the field numbers of the protocol; no vendor file is used. Joints are in degrees, linear and external
 * linear axes in mm, Cartesian positions in mm. Tested against simulators only, never against a controller.
 */
#ifndef GT_EGM_H
#define GT_EGM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GT_EGM_JOINTS 6U

/* EgmHeader.mtype */
#define GT_EGM_TYPE_UNDEFINED 0U /* also where the header does not say */
#define GT_EGM_TYPE_DATA 2U
#define GT_EGM_TYPE_CORRECTION 3U
#define GT_EGM_TYPE_PATH_CORRECTION 4U

/* EgmMCIState.state */
#define GT_EGM_MCI_RUNNING 3U

/* EgmMotorState.state */
#define GT_EGM_MOTORS_OFF 2U

/* Numbers of EgmFeedBack or EgmPlanned; further joints than GT_EGM_JOINTS are not kept. */
typedef struct gt_egm_pose {
    uint32_t joint_count;
    double joints_deg[GT_EGM_JOINTS];
    uint32_t external_count;
    double external_mm[GT_EGM_JOINTS];
    int has_position;
    double position_mm[3];
    int has_quaternion;
    double quaternion[4]; /* u0 u1 u2 u3 */
    int has_euler;
    double euler_deg[3];
} gt_egm_pose;

/* EgmRobot */
typedef struct gt_egm_robot {
    uint32_t sequence;
    uint32_t time_ms;
    uint32_t type;
    uint32_t motor_state; /* 0 if the robot did not say, 1 on, 2 off */
    uint32_t mci_state;   /* 0 if it did not say, 3 running */
    uint32_t rapid_state;
    int convergence_met;
    gt_egm_pose feedback;
    gt_egm_pose planned;
} gt_egm_robot;

/* EgmSensor: positions and the speeds that go with them. */
typedef struct gt_egm_sensor {
    uint32_t sequence;
    uint32_t time_ms;
    uint32_t joint_count;
    double joints_deg[GT_EGM_JOINTS];
    double joint_speeds_deg_s[GT_EGM_JOINTS];
    uint32_t external_count;
    double external_mm[GT_EGM_JOINTS];
    double external_speeds_mm_s[GT_EGM_JOINTS];
} gt_egm_sensor;

/* EgmSensorPathCorr: an offset in the path's frame, and how old the measurement behind it is. */
typedef struct gt_egm_path_correction {
    uint32_t sequence;
    uint32_t time_ms;
    double position_mm[3];
    uint32_t age_ms;
} gt_egm_path_correction;

/* Reads `length` bytes as EgmRobot. 1 and `robot`, or 0 for a datagram that is cut, malformed, without header, number
 * or time, or holds a number that is not finite. Unknown fields are skipped; doubles are read packed and unpacked. */
int gt_egm_read_robot(const uint8_t *data, uint32_t length, gt_egm_robot *robot);

/* Writes EgmSensor; returns its length, 0 if it does not fit. */
uint32_t gt_egm_write_sensor(const gt_egm_sensor *sensor, uint8_t *data, uint32_t capacity);

/* Writes EgmSensorPathCorr; returns its length, 0 if it does not fit. */
uint32_t gt_egm_write_path_correction(const gt_egm_path_correction *correction, uint8_t *data, uint32_t capacity);

#ifdef __cplusplus
}
#endif

#endif
