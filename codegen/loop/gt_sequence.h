/* Which datagram is new, and what the others are: repeated, reordered, lost. */
#ifndef GT_SEQUENCE_H
#define GT_SEQUENCE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_sequence {
    int started;
    uint64_t first;
    uint64_t newest;
    uint64_t seen;      /* bit n: number newest - n has come */
    uint64_t lost;      /* numbers between the first and the newest that have not come */
    uint64_t repeated;  /* datagrams whose number had come before */
    uint64_t reordered; /* datagrams that came after a newer one */
    uint64_t stale;     /* datagrams older than the first, or by more than 63 numbers */
} gt_sequence;

void gt_sequence_init(gt_sequence *sequence);

/* Counts a datagram of this number; 1 if it is newer than all before. */
int gt_sequence_take(gt_sequence *sequence, uint64_t number);

/* Counters of 32 bits run over: 1 and the number nearest to `last` whose low 32 bits are `low`; 0 if it would lie below
 * zero. */
int gt_sequence_near(uint64_t last, uint32_t low, uint64_t *number);

/* gt_sequence_take for a counter of 32 bits; `number` in and out, 32 bits in. */
int gt_sequence_take_32(gt_sequence *sequence, uint64_t *number);

#ifdef __cplusplus
}
#endif

#endif
