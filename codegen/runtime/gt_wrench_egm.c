/* The wrenches of an EGM datagram; see gt_wrench.h. */
#include "gt_wire.h"
#include "gt_wrench.h"

#include <string.h>

#define GT_WRENCH_HANDLE 100U
#define GT_WRENCH_TOOL 101U
#define GT_WRENCH_NUMBERS 3U

/* The age wraps nowhere: a larger number is the largest, not a young one. */
static uint32_t gt_wrench_uint32(uint64_t value)
{
    return (value < UINT32_MAX) ? (uint32_t)value : UINT32_MAX;
}

static void gt_wrench_keep(double value, double *three, uint32_t *count)
{
    if (*count < GT_WRENCH_NUMBERS) {
        three[*count] = value;
    }
    (*count)++;
}

static int gt_wrench_doubles(gt_reader *reader, uint32_t type, double *three, uint32_t *count)
{
    int good = 1;

    if (type == GT_WIRE_FIXED64) {
        gt_wrench_keep(gt_read_double(reader), three, count);
    } else if (type == GT_WIRE_BYTES) {
        gt_reader packed = gt_read_bytes(reader);

        while (packed.good && (packed.at < packed.end)) {
            gt_wrench_keep(gt_read_double(&packed), three, count);
        }
        good = packed.good;
    } else {
        good = 0;
    }
    return good;
}

/* 1 if the message holds three forces, three moments and one age. */
static int gt_wrench_of(gt_reader reader, gt_wrench *wrench)
{
    uint32_t forces = 0U;
    uint32_t moments = 0U;
    uint32_t ages = 0U;
    gt_field field;
    int good = 1;

    while (good && gt_read_field(&reader, &field)) {
        if (field.number == 1U) {
            good = gt_wrench_doubles(&reader, field.type, wrench->force_N, &forces);
        } else if (field.number == 2U) {
            good = gt_wrench_doubles(&reader, field.type, wrench->moment_N_m, &moments);
        } else if ((field.number == 3U) && (field.type == GT_WIRE_VARINT)) {
            wrench->age_cycles = gt_wrench_uint32(gt_read_varint(&reader));
            ages++;
        } else if ((field.number == 4U) && (field.type == GT_WIRE_VARINT)) {
            wrench->status = gt_wrench_uint32(gt_read_varint(&reader));
        } else {
            gt_skip(&reader, field.type);
        }
    }
    return good && reader.good && (forces == GT_WRENCH_NUMBERS) && (moments == GT_WRENCH_NUMBERS) && (ages == 1U);
}

int gt_egm_read_wrenches(const uint8_t *data, uint32_t length, gt_wrench *handle, gt_wrench *tool)
{
    gt_reader reader = gt_reader_of(data, length);
    uint32_t handles = 0U;
    uint32_t tools = 0U;
    gt_field field;
    int good = 1;

    (void)memset(handle, 0, sizeof(*handle));
    (void)memset(tool, 0, sizeof(*tool));
    while (good && gt_read_field(&reader, &field)) {
        if ((field.number == GT_WRENCH_HANDLE) && (field.type == GT_WIRE_BYTES)) {
            good = gt_wrench_of(gt_read_bytes(&reader), handle);
            handles++;
        } else if ((field.number == GT_WRENCH_TOOL) && (field.type == GT_WIRE_BYTES)) {
            good = gt_wrench_of(gt_read_bytes(&reader), tool);
            tools++;
        } else {
            gt_skip(&reader, field.type);
        }
    }
    if (!reader.good || (handles != 1U) || (tools != 1U)) {
        good = 0;
    }
    if (!good) {
        (void)memset(handle, 0, sizeof(*handle));
        (void)memset(tool, 0, sizeof(*tool));
    }
    return good;
}
