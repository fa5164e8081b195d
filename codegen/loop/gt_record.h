/* What the loop logs each cycle; gtmodel/loop/process.py names the numbers. */
#ifndef GT_RECORD_H
#define GT_RECORD_H

#include "gt_loop.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fills loop->record with the state after a cycle and a hash of the answer that was sent. */
void gt_record(gt_loop *loop, const uint8_t *answer, uint32_t length);

#ifdef __cplusplus
}
#endif

#endif
