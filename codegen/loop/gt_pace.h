/* How many cycles of the robot a datagram lies behind the law's last command, and whether that may be believed.
 *
 * Three clocks say it: the robot's numbers, its time stamps, and the loop's own cycles. The motion goes on by the lesser
 * of numbers and stamps. Where those are fewer than the cycles that the loop answered, it goes on by these, and leads
 * the robot until that has caught up.
 */
#ifndef GT_PACE_H
#define GT_PACE_H

#include "gt_law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum gt_pace_verdict {
    GT_PACE_GOOD = 0,
    GT_PACE_MISS = 1, /* a clock that stands or went back, or a robot that falls behind by more than may be held */
    GT_PACE_FALSE = 2 /* clocks that disagree by more than a cycle, or time that the loop never saw */
} gt_pace_verdict;

typedef struct gt_pace {
    uint64_t number;     /* of the datagram that the law's last command answers */
    uint64_t time_ms;    /* its stamp */
    uint64_t elapsed_ms; /* time of the law */
    uint64_t cycles;     /* by which the law goes on now; 0 in its first cycle */
    uint64_t faults;     /* datagrams whose stamp stands, goes back, or disagrees with the numbers */
    int64_t skew_ms;     /* stamps over numbers; a millisecond of it is forgotten with each datagram */
    int false_stamp;     /* they disagreed since the law's last command */
    uint64_t lead;       /* cycles that the law is ahead of that number */
    uint32_t held;       /* cycles since the law's last command that went on without one */
    uint32_t slept;      /* cycles of its own clock that the loop let pass since the law's last command */
} gt_pace;

/* The law begins with this datagram. */
void gt_pace_begin(gt_pace *pace, const gt_feedback *first);

/* Looks at the stamp of a newer datagram, beside the newest one before it. */
void gt_pace_note(gt_pace *pace, const gt_feedback *before, const gt_feedback *newer, uint32_t cycle_ms);

/* Whether the law may answer this datagram; then `cycles` says how far it goes on. hold_cycles: as many may go on
 * without a command; answered: a cycle without a datagram got an answer (EGM). */
gt_pace_verdict gt_pace_of(gt_pace *pace, const gt_feedback *now, uint32_t cycle_ms, uint32_t hold_cycles,
                           int answered);

/* 1 if the datagram is of a cycle that the loop has not answered yet. */
int gt_pace_is_ahead(const gt_pace *pace, const gt_feedback *now);

/* Cycles that the law's command moves the carts on from where they are, 1 at least. */
uint64_t gt_pace_moved(const gt_pace *pace);

/* The law's command for this datagram counts. */
void gt_pace_take(gt_pace *pace, const gt_feedback *now, uint32_t cycle_ms);

#ifdef __cplusplus
}
#endif

#endif
