/* gt_sequence: see gt_sequence.h. */
#include "gt_sequence.h"

#include <string.h>

#define GT_WINDOW 64U

void gt_sequence_init(gt_sequence *sequence)
{
    (void)memset(sequence, 0, sizeof(*sequence));
}

static int gt_take(gt_sequence *sequence, uint64_t number)
{
    int newer = 1;

    if (!sequence->started) {
        sequence->started = 1;
        sequence->first = number;
        sequence->newest = number;
        sequence->seen = 1U;
    } else if (number > sequence->newest) {
        const uint64_t gap = number - sequence->newest;

        sequence->lost += gap - 1U;
        sequence->seen = (gap < GT_WINDOW) ? ((sequence->seen << gap) | 1U) : 1U;
        sequence->newest = number;
    } else {
        const uint64_t age = sequence->newest - number;

        newer = 0;
        if ((age >= GT_WINDOW) || (number < sequence->first)) {
            sequence->stale++;
        } else if (((sequence->seen >> age) & 1U) != 0U) {
            sequence->repeated++;
        } else {
            sequence->seen |= ((uint64_t)1U) << age;
            sequence->reordered++;
            sequence->lost--;
        }
    }
    return newer;
}

static int gt_near(uint64_t last, uint32_t low, uint64_t *number)
{
    const uint32_t ahead = low - (uint32_t)(last & UINT32_MAX);
    const uint32_t behind = (uint32_t)(last & UINT32_MAX) - low;
    int good = 1;

    if (ahead <= (UINT32_MAX / 2U)) {
        *number = last + ahead;
    } else if (behind <= last) {
        *number = last - behind;
    } else {
        *number = 0U;
        good = 0;
    }
    return good;
}

int gt_sequence_take(gt_sequence *sequence, uint64_t number)
{
    return gt_take(sequence, number);
}

int gt_sequence_near(uint64_t last, uint32_t low, uint64_t *number)
{
    return gt_near(last, low, number);
}

int gt_sequence_take_32(gt_sequence *sequence, uint64_t *number)
{
    const uint32_t low = (uint32_t)(*number & UINT32_MAX);
    int newer = 0;

    if (sequence->started && !gt_near(sequence->newest, low, number)) {
        sequence->stale++;
    } else {
        newer = gt_take(sequence, *number);
    }
    return newer;
}
