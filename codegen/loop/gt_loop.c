/* gt_loop: see gt_loop.h. */
#include "gt_loop.h"

#include "gt_coast.h"
#include "gt_guard.h"
#include "gt_record.h"

#include <math.h>
#include <string.h>

void gt_loop_init(gt_loop *loop, const gt_loop_settings *settings, const gt_peer *peer, const gt_law *law)
{
    (void)memset(loop, 0, sizeof(*loop));
    loop->settings = *settings;
    loop->peer = *peer;
    loop->law = *law;
    loop->peer.reads_wrenches = law->reads_wrenches;
    loop->state = GT_LOOP_WAITING;
    loop->status = GT_STALE_INPUT;
    gt_sequence_init(&loop->sequence);
}

/* 1 if it is newer than all before; number and time of EGM, of 32 bits, go on where they run over. */
static int gt_loop_is_newer(gt_loop *loop, gt_feedback *feedback)
{
    if (loop->peer.protocol != GT_PEER_EGM) {
        return gt_sequence_take(&loop->sequence, feedback->sequence);
    }
    if (loop->sequence.started) {
        (void)gt_sequence_near(loop->feedback.time_ms, (uint32_t)feedback->time_ms, &feedback->time_ms);
    }
    return gt_sequence_take_32(&loop->sequence, &feedback->sequence);
}

void gt_loop_datagram(gt_loop *loop, const uint8_t *data, uint32_t length)
{
    gt_feedback feedback;

    loop->datagrams++;
    if ((length > GT_DATAGRAM_MAX) || !gt_peer_read(&loop->peer, data, length, &feedback)) {
        loop->garbage++;
        return;
    }
    if (gt_loop_is_newer(loop, &feedback)) {
        loop->feedback = feedback;
        loop->fresh = 1;
    }
}

/* Cycles of the robot's clock since the last command; no more than may be held, whatever the clock says. */
static double gt_loop_passed(const gt_loop *loop)
{
    const uint64_t most = (uint64_t)loop->settings.hold_cycles + 1U;
    uint64_t cycles = 1U;

    if (loop->feedback.time_ms > loop->command_ms) {
        cycles = (loop->feedback.time_ms - loop->command_ms) / loop->peer.cycle_ms;
    }
    if (cycles > most) {
        cycles = most;
    }
    return (cycles > 0U) ? (double)cycles : 1.0;
}

static int gt_loop_allowed(const gt_loop *loop, const gt_command *command)
{
    const gt_limits *limits = &loop->settings.limits;
    const double furthest = limits->step_m * gt_loop_passed(loop);
    uint32_t n;

    if (command->along_path) {
        for (n = 0U; n < 3U; n++) {
            if (!(fabs(command->path_m[n]) <= limits->path_m)) {
                return 0;
            }
        }
        return 1;
    }
    for (n = 0U; n < loop->peer.axes; n++) {
        const double step = command->position_m[n] - loop->command.position_m[n];

        if (!(command->position_m[n] >= limits->lowest_m[n]) || !(command->position_m[n] <= limits->highest_m[n]) ||
            !(fabs(step) <= furthest) || !gt_all_finite(&command->speed_m_s[n], 1)) {
            return 0;
        }
    }
    return 1;
}

/* The robot stands where it stands; once it runs, the law begins. */
static void gt_loop_wait(gt_loop *loop)
{
    gt_peer_begin(&loop->peer, &loop->feedback);
    gt_copy(loop->command.position_m, loop->peer.start_m, (int)GT_AXES);
    if (loop->feedback.running) {
        loop->first_ms = loop->feedback.time_ms;
        loop->command_ms = loop->feedback.time_ms;
        loop->status = loop->law.init(loop->law.state, &loop->feedback);
        loop->state = (loop->status == GT_OK) ? GT_LOOP_RUNNING : GT_LOOP_STOPPED;
    }
}

/* Running, or on the way to the stop that the law makes; without its next command the ramp begins at once. */
static void gt_loop_take(gt_loop *loop, const gt_command *command)
{
    uint32_t n;

    loop->command = *command;
    loop->command_ms = loop->feedback.time_ms;
    (void)memset(loop->coasting_m, 0, sizeof(loop->coasting_m));
    loop->misses = 0U;
    loop->state = GT_LOOP_RUNNING;
    if (command->braking) {
        loop->misses = loop->settings.hold_cycles;
        loop->state = GT_LOOP_STOPPED;
        for (n = 0U; n < loop->peer.axes; n++) {
            if (fabs(command->speed_m_s[n]) > 0.0) {
                loop->state = GT_LOOP_BRAKING;
            }
        }
    }
}

/* 1 if the law gave a command that counts. */
static int gt_loop_law(gt_loop *loop)
{
    gt_command command = loop->command;
    int given;

    if (!loop->feedback.running) {
        /* what it would do with commands when it runs again is not known: the ramp begins at once */
        loop->status = GT_STALE_INPUT;
        loop->misses = loop->settings.hold_cycles;
        return 0;
    }
    if (loop->feedback.time_ms < loop->command_ms) {
        loop->status = GT_STALE_INPUT; /* the robot's clock went back */
        return 0;
    }
    command.braking = 0;
    loop->status = loop->law.step(loop->law.state, &loop->feedback, loop->feedback.time_ms - loop->first_ms, &command);
    given = (loop->status == GT_OK) || command.braking;
    if (given && !gt_loop_allowed(loop, &command)) {
        /* a wrong command is no hiccup: the ramp begins at once */
        loop->status = GT_OUT_OF_RANGE;
        loop->misses = loop->settings.hold_cycles;
        given = 0;
    }
    if (given) {
        gt_loop_take(loop, &command);
    }
    return given;
}

/* Hold last, then ramp to stop. */
static void gt_loop_miss(gt_loop *loop)
{
    loop->misses++;
    if (loop->misses <= loop->settings.hold_cycles) {
        loop->state = GT_LOOP_HOLDING;
        gt_coast(loop, loop->command.speed_m_s, 1.0);
    } else {
        gt_coast_begin_ramp(loop);
    }
}

static uint32_t gt_loop_answer(const gt_loop *loop, int fresh, uint8_t *answer)
{
    gt_command command = loop->command;

    /* RSI answers datagrams only; EGM takes the newest command whenever it comes */
    if (!loop->sequence.started || (!fresh && (loop->peer.protocol == GT_PEER_RSI))) {
        return 0U;
    }
    if (loop->settings.dry) {
        if (loop->peer.protocol == GT_PEER_EGM) {
            return 0U;
        }
        /* an RSI controller drops a partner that does not answer: it gets no correction */
        (void)memset(&command, 0, sizeof(command));
        gt_copy(command.position_m, loop->peer.start_m, (int)GT_AXES);
    }
    return gt_peer_write(&loop->peer, &loop->feedback, &command, answer, GT_DATAGRAM_MAX);
}

uint32_t gt_loop_cycle(gt_loop *loop, uint8_t *answer)
{
    const int fresh = loop->fresh;
    uint32_t length;

    loop->cycles++;
    if (fresh && (loop->state == GT_LOOP_WAITING)) {
        gt_loop_wait(loop);
    }
    if ((loop->state == GT_LOOP_RUNNING) || (loop->state == GT_LOOP_HOLDING) || (loop->state == GT_LOOP_BRAKING)) {
        if (loop->state != GT_LOOP_BRAKING) {
            loop->status = GT_STALE_INPUT; /* else it says already why the motion ends */
        }
        if (!fresh || !gt_loop_law(loop)) {
            gt_loop_miss(loop);
        }
    }
    if (loop->state == GT_LOOP_RAMPING) {
        gt_coast_ramp(loop);
    }
    loop->late += (!fresh && loop->sequence.started) ? 1U : 0U;
    length = gt_loop_answer(loop, fresh, answer);
    gt_record(loop, answer, length);
    loop->fresh = 0;
    loop->datagrams = 0U;
    return length;
}

void gt_loop_stop(gt_loop *loop)
{
    if (loop->state == GT_LOOP_WAITING) {
        loop->state = GT_LOOP_STOPPED;
    }
    if ((loop->state == GT_LOOP_RUNNING) || (loop->state == GT_LOOP_HOLDING)) {
        gt_coast_begin_ramp(loop);
    }
}

void gt_loop_term(gt_loop *loop)
{
    loop->law.term(loop->law.state);
}
