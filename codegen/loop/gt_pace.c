/* gt_pace: see gt_pace.h. */
#include "gt_pace.h"

#define GT_SKEW_MOST 1000000 /* ms: any more says no more */

void gt_pace_begin(gt_pace *pace, const gt_feedback *first)
{
    pace->number = first->sequence;
    pace->time_ms = first->time_ms;
    pace->elapsed_ms = 0U;
    pace->cycles = 0U;
    pace->skew_ms = 0;
    pace->false_stamp = 0;
    pace->lead = 0U;
    pace->held = 0U;
    pace->slept = 0U;
}

/* a - b of two counters, as far as it says anything. */
static int64_t gt_pace_difference(uint64_t a, uint64_t b)
{
    uint64_t size = a - b;
    int64_t kept;

    if (a < b) {
        size = b - a;
    }
    kept = (size < (uint64_t)GT_SKEW_MOST) ? (int64_t)size : (int64_t)GT_SKEW_MOST;
    return (a > b) ? kept : -kept;
}

void gt_pace_note(gt_pace *pace, const gt_feedback *before, const gt_feedback *newer, uint32_t cycle_ms)
{
    const int64_t clock = gt_pace_difference(newer->time_ms, before->time_ms);
    const int64_t counted = gt_pace_difference(newer->sequence * cycle_ms, before->sequence * cycle_ms);
    const int64_t skew = pace->skew_ms + (clock - counted);
    int fault = 0;

    if (clock <= 0) {
        fault = 1;
    }
    if ((skew > (int64_t)cycle_ms) || (skew < -(int64_t)cycle_ms)) {
        pace->false_stamp = 1;
        pace->skew_ms = 0; /* from here on they are compared anew */
        fault = 1;
    } else if (skew > 0) {
        pace->skew_ms = skew - 1;
    } else if (skew < 0) {
        pace->skew_ms = skew + 1;
    } else {
        pace->skew_ms = 0;
    }
    pace->faults += (fault != 0) ? 1U : 0U;
}

static int gt_ahead(const gt_pace *pace, const gt_feedback *now)
{
    return ((now->sequence - pace->number) > (pace->lead + pace->held)) ? 1 : 0;
}

int gt_pace_is_ahead(const gt_pace *pace, const gt_feedback *now)
{
    return gt_ahead(pace, now);
}

/* By numbers and stamps, where the numbers say more cycles than the loop went through. */
static uint64_t gt_pace_lesser(const gt_pace *pace, const gt_feedback *now, uint32_t cycle_ms)
{
    const uint64_t numbers = now->sequence - pace->number;
    const uint64_t clock = (now->time_ms - pace->time_ms) / cycle_ms;
    const uint64_t least = pace->lead + pace->held + 1U;
    const uint64_t lesser = (clock < numbers) ? clock : numbers;

    return ((lesser > least) ? lesser : least) - pace->lead;
}

gt_pace_verdict gt_pace_of(gt_pace *pace, const gt_feedback *now, uint32_t cycle_ms, uint32_t hold_cycles,
                           int answered)
{
    const uint64_t numbers = now->sequence - pace->number; /* never below: only newer datagrams come here */
    const uint64_t own = (uint64_t)pace->held + 1U;
    gt_pace_verdict verdict = GT_PACE_GOOD;

    pace->cycles = own;
    if (numbers == 0U) {
        pace->cycles = 0U; /* the law's first cycle */
    } else if (now->time_ms <= pace->time_ms) {
        verdict = GT_PACE_MISS;
    } else if (pace->false_stamp != 0) {
        verdict = GT_PACE_FALSE;
    } else if (gt_ahead(pace, now) != 0) {
        pace->cycles = gt_pace_lesser(pace, now, cycle_ms);
        verdict = (pace->cycles > (own + pace->slept + hold_cycles)) ? GT_PACE_FALSE : GT_PACE_GOOD;
    } else if (answered == 0) {
        pace->cycles = numbers; /* what was not sent is not ahead */
    } else {
        verdict = ((pace->lead + own) > (numbers + hold_cycles)) ? GT_PACE_MISS : GT_PACE_GOOD;
    }
    return verdict;
}

uint64_t gt_pace_moved(const gt_pace *pace)
{
    return (pace->cycles > pace->held) ? (pace->cycles - pace->held) : 1U;
}

void gt_pace_take(gt_pace *pace, const gt_feedback *now, uint32_t cycle_ms)
{
    const uint64_t numbers = now->sequence - pace->number;
    const uint64_t law = pace->lead + pace->cycles;

    pace->elapsed_ms += pace->cycles * cycle_ms;
    pace->lead = 0U;
    if (law > numbers) {
        pace->lead = law - numbers;
    }
    pace->number = now->sequence;
    pace->time_ms = now->time_ms;
    pace->held = 0U;
    pace->slept = 0U;
}
