/* gt_loop: see gt_loop.h. */
#include "gt_loop.h"

#include "gt_bounds.h"
#include "gt_coast.h"
#include "gt_guard.h"
#include "gt_record.h"

#include <math.h>
#include <string.h>

#define GT_SLEPT_MOST 100000U /* cycles */

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
    const int known = loop->sequence.started;
    gt_feedback feedback;

    loop->datagrams++;
    if ((length > GT_DATAGRAM_MAX) || !gt_peer_read(&loop->peer, data, length, &feedback)) {
        loop->garbage++;
        return;
    }
    if (gt_loop_is_newer(loop, &feedback)) {
        if (known != 0) {
            gt_pace_note(&loop->pace, &loop->feedback, &feedback, loop->peer.cycle_ms);
        }
        loop->feedback = feedback;
        loop->fresh = 1;
    }
}

/* The robot stands where it stands; once it runs, the law begins. */
static void gt_loop_wait(gt_loop *loop)
{
    gt_peer_begin(&loop->peer, &loop->feedback);
    gt_copy(loop->command.position_m, loop->peer.start_m, (int)GT_AXES);
    gt_copy(loop->sent_m, loop->peer.start_m, (int)GT_AXES);
    if (loop->feedback.running && gt_bounds_apart(loop)) {
        loop->apart++;
        loop->status = GT_OUT_OF_RANGE;
        loop->state = GT_LOOP_STOPPED;
    } else if (loop->feedback.running) {
        gt_pace_begin(&loop->pace, &loop->feedback);
        loop->status = loop->law.init(loop->law.state, &loop->feedback);
        loop->state = (loop->status == GT_OK) ? GT_LOOP_RUNNING : GT_LOOP_STOPPED;
    } else {
        /* it is waited for */
    }
}

/* Running, or on the way to the stop that the law makes; without its next command the ramp begins at once. */
static void gt_loop_take(gt_loop *loop, const gt_command *command)
{
    int moves = 0;
    uint32_t n;

    for (n = 0U; n < loop->peer.axes; n++) {
        moves = (moves || (fabs(command->speed_m_s[n]) > 0.0)) ? 1 : 0;
    }
    gt_coast_follow(loop, command);
    gt_pace_take(&loop->pace, &loop->feedback, loop->peer.cycle_ms);
    loop->misses = 0U;
    loop->state = GT_LOOP_RUNNING;
    if (command->braking) {
        loop->misses = loop->settings.hold_cycles;
        loop->state = (moves != 0) ? GT_LOOP_BRAKING : GT_LOOP_STOPPED;
    }
}

/* GT_OK if the law may be asked; else why not, and whether the ramp begins at once. */
static gt_status gt_loop_asks(gt_loop *loop)
{
    const gt_pace_verdict pace = gt_pace_of(&loop->pace, &loop->feedback, loop->peer.cycle_ms,
                                            loop->settings.hold_cycles, (loop->peer.protocol == GT_PEER_EGM) ? 1 : 0);
    gt_status status = GT_OK;

    if (gt_bounds_apart(loop) != 0) {
        loop->apart++;
        status = GT_OUT_OF_RANGE;
        loop->misses = loop->settings.hold_cycles;
    } else if (!loop->feedback.running || (pace == GT_PACE_FALSE)) {
        /* what it would do with commands when it runs again, or how far it is, is not known */
        status = GT_STALE_INPUT;
        loop->misses = loop->settings.hold_cycles;
    } else if (pace == GT_PACE_MISS) {
        status = GT_STALE_INPUT;
    } else {
        /* a datagram to answer */
    }
    return status;
}

/* 1 if the law gave a command that counts. */
static int gt_loop_law(gt_loop *loop)
{
    gt_command command = loop->command;
    int given = 0;

    loop->status = gt_loop_asks(loop);
    if (loop->status == GT_OK) {
        command.braking = 0;
        loop->status = loop->law.step(loop->law.state, &loop->feedback,
                                      loop->pace.elapsed_ms + (loop->pace.cycles * loop->peer.cycle_ms), &command);
        given = (loop->status == GT_OK) || command.braking;
        if (given && !gt_bounds_allow(loop, &command)) {
            /* a wrong command is no hiccup: the ramp begins at once */
            loop->status = GT_OUT_OF_RANGE;
            loop->misses = loop->settings.hold_cycles;
            given = 0;
        }
    }
    if (given) {
        gt_loop_take(loop, &command);
    }
    return given;
}

/* Hold last or follow the plan, then ramp to stop. */
static void gt_loop_miss(gt_loop *loop)
{
    loop->misses++;
    loop->pace.held++;
    if ((loop->misses <= loop->settings.hold_cycles) && gt_coast_goes_on(loop)) {
        loop->state = GT_LOOP_HOLDING;
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
    if (loop->state == GT_LOOP_STOPPED) {
        (void)memset(loop->command.speed_m_s, 0, sizeof(loop->command.speed_m_s));
    }
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
    if (fresh || (loop->peer.protocol == GT_PEER_EGM)) {
        gt_copy(loop->sent_m, loop->command.position_m, (int)GT_AXES); /* in a dry run as well */
    }
    gt_record(loop, answer, length);
    loop->fresh = 0;
    loop->datagrams = 0U;
    return length;
}

int gt_loop_is_due(const gt_loop *loop)
{
    const int asked = (loop->state == GT_LOOP_RUNNING) || (loop->state == GT_LOOP_HOLDING);
    const int ahead = gt_pace_is_ahead(&loop->pace, &loop->feedback);

    return loop->fresh && (ahead || !asked || (loop->peer.protocol == GT_PEER_RSI));
}

void gt_loop_slept(gt_loop *loop, int64_t cycles)
{
    if (cycles > 0) {
        loop->pace.slept = (cycles < (int64_t)GT_SLEPT_MOST) ? (uint32_t)cycles : GT_SLEPT_MOST;
    }
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
