/* The loop without its sockets: datagrams go in, an answer and a log record come out, once per cycle.
 *
 * The robot is the clock. Of the datagrams of a cycle the newest counts; without one the last speed is held for some
 * cycles, then it is ramped to zero, and the loop stays stopped. The same for a law that fails and for a clock that
 * stands or goes back. In place of holding, a law that has a plan goes on with it, and the ramp begins where the plan
 * ends. The ramp begins at once for a command outside the limits, a robot that runs no more or whose motors are off, a
 * clock that disagrees with the numbers (gt_pace.h), and carts that do not follow. A law may brake by itself; without a
 * datagram the ramp takes over. Nothing is allocated, nothing waits.
 *
 * Whatever comes in: no command is further than limits.step_m from the one before it and from the last one that was
 * answered, and the speed beside a position is the way from the position before it over the time between the two.
 */
#ifndef GT_LOOP_H
#define GT_LOOP_H

#include "gt_law.h"
#include "gt_pace.h"
#include "gt_peer.h"
#include "gt_sequence.h"
#include "gt_wire.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum gt_loop_state {
    GT_LOOP_WAITING = 0, /* no running robot yet: its own position is sent back */
    GT_LOOP_RUNNING = 1, /* the law's command is sent */
    GT_LOOP_HOLDING = 2, /* no command for some cycles: the last speed is kept */
    GT_LOOP_RAMPING = 3, /* too many: the speed is going to zero */
    GT_LOOP_STOPPED = 4, /* until the program is started again */
    GT_LOOP_BRAKING = 5  /* the law itself brakes; its status says why */
} gt_loop_state;

typedef struct gt_limits {
    double lowest_m[GT_AXES];
    double highest_m[GT_AXES];
    double step_m;      /* most that a cart's command may change from cycle to cycle */
    double path_m;      /* most that a path correction may be */
    double following_m; /* most that a cart may be away from the last command that was answered */
} gt_limits;

typedef struct gt_loop_settings {
    int dry; /* commands are logged, not sent */
    uint32_t hold_cycles;
    uint32_t ramp_cycles;    /* of a ramp to zero without a declared deceleration */
    double deceleration_m_s2; /* of the fastest cart, the others in proportion; 0: none is declared */
    gt_limits limits;
} gt_loop_settings;

/* Numbers of a record: what gtmodel/loop/process.py names. */
#define GT_RECORD_COLUMNS (39U + GT_LAW_NUMBERS)

typedef struct gt_loop {
    gt_loop_settings settings;
    gt_peer peer;
    gt_law law;
    gt_sequence sequence;
    gt_loop_state state;
    gt_status status;        /* of the last cycle */
    int fresh;               /* a newer datagram came since the last cycle */
    gt_feedback feedback;    /* the newest */
    gt_pace pace;            /* the robot's clocks since the law's last command */
    uint64_t cycles;
    uint64_t late;           /* cycles without a newer datagram */
    uint64_t garbage;        /* datagrams that could not be read */
    uint64_t apart;          /* cycles in which a cart was too far from its command */
    uint32_t datagrams;      /* since the last cycle */
    uint32_t misses;         /* cycles without a command, in a row */
    uint32_t ramp_left;
    uint32_t ramp_cycles;    /* of the ramp that goes on */
    double ramp_from[GT_AXES];
    gt_command command;      /* the last one */
    double sent_m[GT_AXES];  /* positions of the last one that was answered */
    double going_m_s[GT_AXES]; /* speeds at which the carts go on without a law */
    double coasting_m[GT_AXES]; /* way since the last command of the law */
    double coasted_m;        /* the longest one of a cart so far */
    double record[GT_RECORD_COLUMNS];
} gt_loop;

void gt_loop_init(gt_loop *loop, const gt_loop_settings *settings, const gt_peer *peer, const gt_law *law);

/* Takes one datagram of this cycle; any bytes are allowed. */
void gt_loop_datagram(gt_loop *loop, const uint8_t *data, uint32_t length);

/* Ends the cycle: writes the answer to the newest datagram, GT_DATAGRAM_MAX bytes at the most, and fills
 * loop->record. Returns the answer's length, 0 if there is nothing to send. */
uint32_t gt_loop_cycle(gt_loop *loop, uint8_t *answer);

/* 1 if the newest datagram asks for a cycle now: not where the loop has answered that cycle of the robot already. */
int gt_loop_is_due(const gt_loop *loop);

/* The loop let so many cycles of its own clock pass; none or fewer say nothing. */
void gt_loop_slept(gt_loop *loop, int64_t cycles);

/* No more commands of the law: the cycles that follow ramp to a stop. */
void gt_loop_stop(gt_loop *loop);

/* Ends the law. */
void gt_loop_term(gt_loop *loop);

#ifdef __cplusplus
}
#endif

#endif
