/* gt_record: see gt_record.h. */
#include "gt_record.h"

#include "gt_guard.h"

#include <stddef.h>

/* FNV-1a, so that a log says which bytes were sent. */
static uint32_t gt_record_hash(const uint8_t *data, uint32_t length)
{
    uint32_t hash = 2166136261U;
    uint32_t n;

    for (n = 0U; n < length; n++) {
        hash = (hash ^ data[n]) * 16777619U;
    }
    return hash;
}

void gt_record(gt_loop *loop, const uint8_t *answer, uint32_t length)
{
    double *r = loop->record;
    uint32_t n;

    r[0] = (double)loop->cycles;
    r[1] = (double)loop->feedback.sequence;
    r[2] = (double)loop->feedback.time_ms;
    r[3] = (double)loop->state;
    r[4] = (double)loop->status;
    r[5] = (double)loop->datagrams;
    r[6] = (double)loop->late;
    r[7] = (double)loop->sequence.lost;
    r[8] = (double)loop->sequence.repeated;
    r[9] = (double)loop->sequence.reordered;
    r[10] = (double)loop->sequence.stale;
    r[11] = (double)loop->garbage;
    r[12] = (double)loop->feedback.delay;
    r[13] = (double)length;
    r[14] = (double)gt_record_hash(answer, length);
    for (n = 0U; n < GT_AXES; n++) {
        r[15U + n] = loop->feedback.position_m[n];
        r[21U + n] = loop->command.position_m[n];
        r[27U + n] = loop->command.speed_m_s[n];
    }
    gt_copy(&r[33], loop->command.path_m, 3);
    r[36] = (double)loop->settings.dry;
    r[37] = (double)loop->pace.faults;
    r[38] = (double)loop->apart;
    if (loop->law.numbers != NULL) {
        gt_copy(&r[39], loop->law.numbers, (int)GT_LAW_NUMBERS);
    }
}
