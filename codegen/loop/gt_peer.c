/* gt_peer: see gt_peer.h. */
#include "gt_peer.h"

#include "gt_egm.h"
#include "gt_guard.h"
#include "gt_rsi.h"

#include <string.h>

#define GT_MM 1000.0
#define GT_DEGREES 57.29577951308232
#define GT_AIPOS 2U
#define GT_ASPOS 3U
#define GT_EIPOS 4U /* places in gt_rsi_robot.given */
#define GT_ESPOS 5U

/* Of what the protocols state, in m or rad. */
static double gt_peer_unit(const gt_peer *peer)
{
    return peer->joints ? GT_DEGREES : GT_MM;
}

static uint32_t gt_peer_count(const gt_peer *peer, const gt_egm_pose *pose)
{
    return peer->joints ? pose->joint_count : pose->external_count;
}

static const double *gt_peer_axes(const gt_peer *peer, const gt_egm_pose *pose)
{
    return peer->joints ? pose->joints_deg : pose->external_mm;
}

static int gt_peer_read_egm(const gt_peer *peer, const uint8_t *data, uint32_t length, gt_feedback *feedback)
{
    gt_egm_robot robot;
    uint32_t n;

    if (!gt_egm_read_robot(data, length, &robot) || (gt_peer_count(peer, &robot.feedback) < peer->axes) ||
        ((robot.type != GT_EGM_TYPE_DATA) && (robot.type != GT_EGM_TYPE_UNDEFINED))) {
        return 0;
    }
    feedback->sequence = robot.sequence;
    feedback->time_ms = robot.time_ms;
    feedback->has_planned = (gt_peer_count(peer, &robot.planned) >= peer->axes) ? 1 : 0;
    feedback->running =
        ((robot.mci_state == GT_EGM_MCI_RUNNING) && (robot.motor_state != GT_EGM_MOTORS_OFF)) ? 1 : 0;
    for (n = 0U; n < peer->axes; n++) {
        feedback->position_m[n] = gt_peer_axes(peer, &robot.feedback)[n] / gt_peer_unit(peer);
        feedback->planned_m[n] = gt_peer_axes(peer, &robot.planned)[n] / gt_peer_unit(peer);
    }
    feedback->joint_count = robot.feedback.joint_count;
    gt_copy(feedback->joints_deg, robot.feedback.joints_deg, (int)GT_AXES);
    if (robot.planned.joint_count == robot.feedback.joint_count) {
        gt_copy(feedback->joints_deg, robot.planned.joints_deg, (int)GT_AXES);
    }
    return 1;
}

/* Of the axes that were given, those of the robot are all there. */
static int gt_peer_has_axes(const gt_peer *peer, uint32_t given)
{
    const uint32_t axes = (((uint32_t)1U) << peer->axes) - 1U;

    return ((given & axes) == axes) ? 1 : 0;
}

static int gt_peer_read_rsi(const gt_peer *peer, const uint8_t *data, uint32_t length, gt_feedback *feedback)
{
    gt_rsi_robot robot;
    uint32_t n;

    if (!gt_rsi_read_robot(data, length, &robot) || !gt_peer_has_axes(peer, robot.given[peer->joints ? GT_AIPOS : GT_EIPOS])) {
        return 0;
    }
    feedback->sequence = robot.ipoc / peer->cycle_ms;
    feedback->time_ms = robot.ipoc;
    feedback->has_planned = gt_peer_has_axes(peer, robot.given[peer->joints ? GT_ASPOS : GT_ESPOS]);
    feedback->running = 1; /* a controller that sends waits for answers */
    feedback->delay = robot.delay;
    for (n = 0U; n < peer->axes; n++) {
        feedback->position_m[n] = (peer->joints ? robot.aipos_deg[n] : robot.eipos_mm[n]) / gt_peer_unit(peer);
        feedback->planned_m[n] = (peer->joints ? robot.aspos_deg[n] : robot.espos_mm[n]) / gt_peer_unit(peer);
    }
    feedback->stamp_length = robot.ipoc_length;
    (void)memcpy(feedback->stamp, robot.ipoc_text, sizeof(feedback->stamp));
    return 1;
}

int gt_peer_read(const gt_peer *peer, const uint8_t *data, uint32_t length, gt_feedback *feedback)
{
    int good;

    (void)memset(feedback, 0, sizeof(*feedback));
    if ((peer->axes > GT_AXES) || (peer->cycle_ms == 0U)) {
        return 0;
    }
    if (peer->protocol == GT_PEER_EGM) {
        good = gt_peer_read_egm(peer, data, length, feedback);
        if (good && peer->reads_wrenches) {
            feedback->has_wrenches = gt_egm_read_wrenches(data, length, &feedback->handle, &feedback->tool);
        }
    } else {
        good = gt_peer_read_rsi(peer, data, length, feedback);
        if (good && peer->reads_wrenches) {
            feedback->has_wrenches = gt_rsi_read_wrenches(data, length, &feedback->handle, &feedback->tool);
        }
    }
    return good;
}

void gt_peer_begin(gt_peer *peer, const gt_feedback *first)
{
    gt_copy(peer->start_m, first->has_planned ? first->planned_m : first->position_m, (int)GT_AXES);
}

static uint32_t gt_peer_write_egm(const gt_peer *peer, const gt_feedback *feedback, const gt_command *command,
                                  uint8_t *data, uint32_t capacity)
{
    gt_egm_sensor sensor;
    uint32_t n;

    if (command->along_path) {
        gt_egm_path_correction correction;

        correction.sequence = (uint32_t)feedback->sequence;
        correction.time_ms = (uint32_t)feedback->time_ms;
        correction.age_ms = 0U;
        for (n = 0U; n < 3U; n++) {
            correction.position_mm[n] = command->path_m[n] * GT_MM;
        }
        return gt_egm_write_path_correction(&correction, data, capacity);
    }
    (void)memset(&sensor, 0, sizeof(sensor));
    sensor.sequence = (uint32_t)feedback->sequence;
    sensor.time_ms = (uint32_t)feedback->time_ms;
    sensor.joint_count = feedback->joint_count;
    gt_copy(sensor.joints_deg, feedback->joints_deg, (int)GT_AXES);
    sensor.external_count = peer->joints ? 0U : peer->axes;
    for (n = 0U; n < peer->axes; n++) {
        (peer->joints ? sensor.joints_deg : sensor.external_mm)[n] = command->position_m[n] * gt_peer_unit(peer);
        (peer->joints ? sensor.joint_speeds_deg_s : sensor.external_speeds_mm_s)[n] =
            command->speed_m_s[n] * gt_peer_unit(peer);
    }
    return gt_egm_write_sensor(&sensor, data, capacity);
}

static uint32_t gt_peer_write_rsi(const gt_peer *peer, const gt_feedback *feedback, const gt_command *command,
                                  uint8_t *data, uint32_t capacity)
{
    gt_rsi_sensor sensor;
    uint32_t n;

    (void)memset(&sensor, 0, sizeof(sensor));
    for (n = 0U; command->along_path && (n < 3U); n++) {
        sensor.rkorr[n] = command->path_m[n] * GT_MM;
    }
    for (n = 0U; !command->along_path && (n < peer->axes); n++) {
        (peer->joints ? sensor.ak_deg : sensor.ek_mm)[n] =
            (command->position_m[n] - peer->start_m[n]) * gt_peer_unit(peer);
    }
    sensor.ipoc_length = feedback->stamp_length;
    (void)memcpy(sensor.ipoc_text, feedback->stamp, sizeof(sensor.ipoc_text));
    return gt_rsi_write_sensor(&sensor, data, capacity);
}

uint32_t gt_peer_write(const gt_peer *peer, const gt_feedback *feedback, const gt_command *command, uint8_t *data,
                       uint32_t capacity)
{
    return (peer->protocol == GT_PEER_EGM) ? gt_peer_write_egm(peer, feedback, command, data, capacity)
                                           : gt_peer_write_rsi(peer, feedback, command, data, capacity);
}
