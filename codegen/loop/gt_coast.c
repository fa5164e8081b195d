/* gt_coast: see gt_coast.h. */
#include "gt_coast.h"

#include "gt_bounds.h"
#include "gt_guard.h"

#include <math.h>
#include <stddef.h>

#define GT_RAMP_MOST 100000U /* cycles */

static double gt_clamped(double value, double lowest, double highest)
{
    if (value < lowest) {
        return lowest;
    }
    return (value > highest) ? highest : value;
}

static double gt_coast_cycle_s(const gt_loop *loop)
{
    return (double)loop->peer.cycle_ms / 1000.0;
}

void gt_coast_follow(gt_loop *loop, const gt_command *command)
{
    const double seconds = (double)(uint32_t)gt_pace_moved(&loop->pace) * gt_coast_cycle_s(loop);
    /* behind cycles without the law that way is a correction too, at which nothing may go on; nor at one that makes a
     * force, as that of a plan does */
    const int plain = (loop->pace.held == 0U) && (loop->pace.cycles <= 1U) && (loop->law.go_on == NULL);
    const gt_command before = loop->command;
    uint32_t n;

    loop->command = *command;
    for (n = 0U; n < loop->peer.axes; n++) {
        loop->command.speed_m_s[n] = (command->position_m[n] - before.position_m[n]) / seconds;
        loop->going_m_s[n] = (plain != 0) ? loop->command.speed_m_s[n] : command->speed_m_s[n];
        loop->coasting_m[n] = 0.0;
    }
}

static void gt_coast_way(gt_loop *loop, uint32_t n, double way)
{
    loop->coasting_m[n] += way;
    if (loop->coasting_m[n] > loop->coasted_m) {
        loop->coasted_m = loop->coasting_m[n];
    }
}

void gt_coast(gt_loop *loop, const double *speed, double share)
{
    const gt_limits *limits = &loop->settings.limits;
    const double seconds = gt_coast_cycle_s(loop);
    uint32_t n;

    for (n = 0U; n < loop->peer.axes; n++) {
        const double from = loop->command.position_m[n];
        const double now = speed[n] * share;
        const double wanted = from + (now * seconds);
        const double near = gt_clamped(wanted, loop->sent_m[n] - limits->step_m, loop->sent_m[n] + limits->step_m);
        /* a robot may stand outside of the limits: from there it goes no further out, and never jumps to them */
        const double lowest = (from < limits->lowest_m[n]) ? from : limits->lowest_m[n];
        const double highest = (from > limits->highest_m[n]) ? from : limits->highest_m[n];
        const double to = gt_clamped(near, lowest, highest);

        loop->command.position_m[n] = to;
        loop->command.speed_m_s[n] = (fabs(to - wanted) > 0.0) ? ((to - from) / seconds) : now;
        gt_coast_way(loop, n, fabs(loop->command.speed_m_s[n] * seconds));
    }
}

/* Like a command that follows, in a cycle that brought nothing to answer. */
static void gt_coast_planned(gt_loop *loop, const gt_command *command)
{
    const double seconds = gt_coast_cycle_s(loop);
    const gt_command before = loop->command;
    uint32_t n;

    loop->command = *command;
    for (n = 0U; n < loop->peer.axes; n++) {
        const double way = command->position_m[n] - before.position_m[n];

        loop->command.speed_m_s[n] = way / seconds;
        loop->going_m_s[n] = command->speed_m_s[n];
        gt_coast_way(loop, n, fabs(way));
    }
}

int gt_coast_goes_on(gt_loop *loop)
{
    gt_command command = loop->command;
    int given = 1;

    if (loop->law.go_on == NULL) {
        gt_coast(loop, loop->going_m_s, 1.0);
    } else if ((loop->law.go_on(loop->law.state, &command) == GT_OK) && gt_bounds_allow(loop, &command)) {
        gt_coast_planned(loop, &command);
    } else {
        given = 0;
    }
    return given;
}

/* Cycles of a ramp to zero: the fastest cart at the declared deceleration, and never fewer than that takes. */
static uint32_t gt_coast_cycles(const gt_loop *loop)
{
    const double lost_m_s = loop->settings.deceleration_m_s2 * gt_coast_cycle_s(loop);
    double fastest = 0.0;
    double cycles;
    uint32_t n;

    if (!(lost_m_s > 0.0)) {
        return loop->settings.ramp_cycles;
    }
    for (n = 0U; n < loop->peer.axes; n++) {
        const double speed = fabs(loop->going_m_s[n]);

        fastest = (speed > fastest) ? speed : fastest;
    }
    cycles = ceil(fastest / lost_m_s);
    return (cycles < (double)GT_RAMP_MOST) ? (uint32_t)cycles : GT_RAMP_MOST;
}

void gt_coast_begin_ramp(gt_loop *loop)
{
    loop->state = GT_LOOP_RAMPING;
    loop->ramp_cycles = gt_coast_cycles(loop);
    loop->ramp_left = loop->ramp_cycles;
    gt_copy(loop->ramp_from, loop->going_m_s, (int)GT_AXES);
}

void gt_coast_ramp(gt_loop *loop)
{
    if (loop->ramp_left > 0U) {
        loop->ramp_left--;
        gt_coast(loop, loop->ramp_from, (double)loop->ramp_left / (double)loop->ramp_cycles);
    }
    if (loop->ramp_left == 0U) {
        gt_coast(loop, loop->ramp_from, 0.0);
        loop->state = GT_LOOP_STOPPED;
    }
}
