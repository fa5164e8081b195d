/* The messages that a sensor sends to an EGM robot; see gt_egm.h. */
#include "gt_egm.h"

#include "gt_wire.h"

static uint32_t gt_egm_header_size(uint32_t sequence, uint32_t time_ms)
{
    return 1U + gt_size_varint(sequence) + 1U + gt_size_varint(time_ms) + 2U;
}

static void gt_egm_write_header(gt_writer *writer, uint32_t sequence, uint32_t time_ms, uint32_t type)
{
    gt_write_message(writer, 1U, gt_egm_header_size(sequence, time_ms));
    gt_write_varint_field(writer, 1U, sequence);
    gt_write_varint_field(writer, 2U, time_ms);
    gt_write_varint_field(writer, 3U, type);
}

/* Bytes of EgmJoints as a field; an empty one is left out. */
static uint32_t gt_egm_joints_size(uint32_t count)
{
    return (count == 0U) ? 0U : gt_size_message(count * GT_SIZE_DOUBLE_FIELD);
}

static void gt_egm_write_joints(gt_writer *writer, uint32_t number, const double *values, uint32_t count)
{
    uint32_t n;

    if (count > 0U) {
        gt_write_message(writer, number, count * GT_SIZE_DOUBLE_FIELD);
    }
    for (n = 0U; n < count; n++) {
        gt_write_double_field(writer, 1U, values[n]);
    }
}

/* EgmPlanned and EgmSpeedRef: 1 joints, 3 externalJoints */
static void gt_egm_write_axes(gt_writer *writer, uint32_t number, const double *joints, uint32_t joint_count,
                              const double *external, uint32_t external_count)
{
    gt_write_message(writer, number, gt_egm_joints_size(joint_count) + gt_egm_joints_size(external_count));
    gt_egm_write_joints(writer, 1U, joints, joint_count);
    gt_egm_write_joints(writer, 3U, external, external_count);
}

static uint32_t gt_egm_finished(const gt_writer *writer)
{
    return writer->good ? writer->at : 0U;
}

uint32_t gt_egm_write_sensor(const gt_egm_sensor *sensor, uint8_t *data, uint32_t capacity)
{
    gt_writer writer = gt_writer_of(data, capacity);
    const uint32_t joints = (sensor->joint_count < GT_EGM_JOINTS) ? sensor->joint_count : GT_EGM_JOINTS;
    const uint32_t external = (sensor->external_count < GT_EGM_JOINTS) ? sensor->external_count : GT_EGM_JOINTS;

    gt_egm_write_header(&writer, sensor->sequence, sensor->time_ms, GT_EGM_TYPE_CORRECTION);
    gt_egm_write_axes(&writer, 2U, sensor->joints_deg, joints, sensor->external_mm, external);
    gt_egm_write_axes(&writer, 3U, sensor->joint_speeds_deg_s, joints, sensor->external_speeds_mm_s, external);
    return gt_egm_finished(&writer);
}

uint32_t gt_egm_write_path_correction(const gt_egm_path_correction *correction, uint8_t *data, uint32_t capacity)
{
    gt_writer writer = gt_writer_of(data, capacity);
    const uint32_t position = 3U * GT_SIZE_DOUBLE_FIELD;
    const uint32_t age = 1U + gt_size_varint(correction->age_ms);
    uint32_t n;

    gt_egm_write_header(&writer, correction->sequence, correction->time_ms, GT_EGM_TYPE_PATH_CORRECTION);
    gt_write_message(&writer, 2U, gt_size_message(position) + age);
    gt_write_message(&writer, 1U, position);
    for (n = 0U; n < 3U; n++) {
        gt_write_double_field(&writer, n + 1U, correction->position_mm[n]);
    }
    gt_write_varint_field(&writer, 2U, correction->age_ms);
    return gt_egm_finished(&writer);
}
