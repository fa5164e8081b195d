/* gt_egm: see gt_egm.h. One function per message, none of which calls itself: stack and work are bounded. */
#include "gt_egm.h"

#include "gt_guard.h"
#include "gt_wire.h"

#include <string.h>

#define GT_EGM_HAS_SEQUENCE 1U
#define GT_EGM_HAS_TIME 2U

static int gt_egm_is(const gt_field *field, uint32_t number, uint32_t type)
{
    return (field->number == number) && (field->type == type);
}

/* The first GT_EGM_JOINTS doubles are kept, the others read only. */
static void gt_egm_keep(double value, double *values, uint32_t *count)
{
    if (*count < GT_EGM_JOINTS) {
        values[*count] = value;
        (*count)++;
    }
}

/* EgmJoints: 1 repeated double, each with its key or packed. Returns 1 unless the message is at fault. */
static int gt_egm_joints(gt_reader reader, double *values, uint32_t *count)
{
    gt_field field;

    while (gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_FIXED64)) {
            gt_egm_keep(gt_read_double(&reader), values, count);
        } else if (gt_egm_is(&field, 1U, GT_WIRE_BYTES)) {
            gt_reader packed = gt_read_bytes(&reader);

            while (packed.good && (packed.at < packed.end)) {
                gt_egm_keep(gt_read_double(&packed), values, count);
            }
            reader.good = reader.good && packed.good;
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return reader.good;
}

/* EgmCartesian, EgmQuaternion, EgmEuler: a double in each of the fields 1 to `count`. */
static int gt_egm_numbers(gt_reader reader, double *values, uint32_t count, int *present)
{
    gt_field field;

    *present = 1;
    while (gt_read_field(&reader, &field)) {
        if ((field.type == GT_WIRE_FIXED64) && (field.number >= 1U) && (field.number <= count)) {
            values[field.number - 1U] = gt_read_double(&reader);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return reader.good;
}

/* EgmPose: 1 position, 2 quaternion, 3 euler */
static int gt_egm_cartesian(gt_reader reader, gt_egm_pose *pose)
{
    gt_field field;
    int good = 1;

    while (good && gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_BYTES)) {
            good = gt_egm_numbers(gt_read_bytes(&reader), pose->position_mm, 3U, &pose->has_position);
        } else if (gt_egm_is(&field, 2U, GT_WIRE_BYTES)) {
            good = gt_egm_numbers(gt_read_bytes(&reader), pose->quaternion, 4U, &pose->has_quaternion);
        } else if (gt_egm_is(&field, 3U, GT_WIRE_BYTES)) {
            good = gt_egm_numbers(gt_read_bytes(&reader), pose->euler_deg, 3U, &pose->has_euler);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return good && reader.good;
}

/* EgmFeedBack and EgmPlanned: 1 joints, 2 cartesian, 3 externalJoints; the time, 4, is not used */
static int gt_egm_pose_of(gt_reader reader, gt_egm_pose *pose)
{
    gt_field field;
    int good = 1;

    while (good && gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_BYTES)) {
            good = gt_egm_joints(gt_read_bytes(&reader), pose->joints_deg, &pose->joint_count);
        } else if (gt_egm_is(&field, 2U, GT_WIRE_BYTES)) {
            good = gt_egm_cartesian(gt_read_bytes(&reader), pose);
        } else if (gt_egm_is(&field, 3U, GT_WIRE_BYTES)) {
            good = gt_egm_joints(gt_read_bytes(&reader), pose->external_mm, &pose->external_count);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return good && reader.good;
}

static uint32_t gt_egm_uint32(gt_reader *reader)
{
    return (uint32_t)(gt_read_varint(reader) & UINT32_MAX);
}

/* EgmHeader: 1 seqno, 2 tm, 3 mtype */
static int gt_egm_header(gt_reader reader, gt_egm_robot *robot, uint32_t *has)
{
    gt_field field;

    while (gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_VARINT)) {
            robot->sequence = gt_egm_uint32(&reader);
            *has |= GT_EGM_HAS_SEQUENCE;
        } else if (gt_egm_is(&field, 2U, GT_WIRE_VARINT)) {
            robot->time_ms = gt_egm_uint32(&reader);
            *has |= GT_EGM_HAS_TIME;
        } else if (gt_egm_is(&field, 3U, GT_WIRE_VARINT)) {
            robot->type = gt_egm_uint32(&reader);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return reader.good;
}

/* EgmMotorState, EgmMCIState, EgmRapidCtrlExecState: 1 state */
static int gt_egm_state(gt_reader reader, uint32_t *state)
{
    gt_field field;

    while (gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_VARINT)) {
            *state = gt_egm_uint32(&reader);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return reader.good;
}

static int gt_egm_robot_of(gt_reader reader, gt_egm_robot *robot, uint32_t *has)
{
    gt_field field;
    int good = 1;

    while (good && gt_read_field(&reader, &field)) {
        if (gt_egm_is(&field, 1U, GT_WIRE_BYTES)) {
            good = gt_egm_header(gt_read_bytes(&reader), robot, has);
        } else if (gt_egm_is(&field, 2U, GT_WIRE_BYTES)) {
            good = gt_egm_pose_of(gt_read_bytes(&reader), &robot->feedback);
        } else if (gt_egm_is(&field, 3U, GT_WIRE_BYTES)) {
            good = gt_egm_pose_of(gt_read_bytes(&reader), &robot->planned);
        } else if (gt_egm_is(&field, 4U, GT_WIRE_BYTES)) {
            good = gt_egm_state(gt_read_bytes(&reader), &robot->motor_state);
        } else if (gt_egm_is(&field, 5U, GT_WIRE_BYTES)) {
            good = gt_egm_state(gt_read_bytes(&reader), &robot->mci_state);
        } else if (gt_egm_is(&field, 6U, GT_WIRE_VARINT)) {
            robot->convergence_met = (gt_read_varint(&reader) != 0U) ? 1 : 0;
        } else if (gt_egm_is(&field, 8U, GT_WIRE_BYTES)) {
            good = gt_egm_state(gt_read_bytes(&reader), &robot->rapid_state);
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return good && reader.good;
}

static int gt_egm_finite(const gt_egm_pose *pose)
{
    return gt_all_finite(pose->joints_deg, 6) && gt_all_finite(pose->external_mm, 6) &&
           gt_all_finite(pose->position_mm, 3) && gt_all_finite(pose->quaternion, 4) &&
           gt_all_finite(pose->euler_deg, 3);
}

int gt_egm_read_robot(const uint8_t *data, uint32_t length, gt_egm_robot *robot)
{
    uint32_t has = 0U;
    int good;

    (void)memset(robot, 0, sizeof(*robot));
    good = gt_egm_robot_of(gt_reader_of(data, length), robot, &has);
    return good && (has == (GT_EGM_HAS_SEQUENCE | GT_EGM_HAS_TIME)) && gt_egm_finite(&robot->feedback) &&
           gt_egm_finite(&robot->planned);
}
