/* gt_law_lead_through: see gt_law_lead_through.h. */
#include "gt_law_lead_through.h"

#include <stddef.h>

static const double gt_upright[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

/* A status of the loop for why wrenches cannot be used. */
static gt_status gt_lead_status(gt_wrench_status why)
{
    gt_status status = GT_OUT_OF_RANGE; /* saturated, at fault, of the wrong sign */

    if ((why == GT_WRENCH_OK) || (why == GT_WRENCH_NO_FORCE)) {
        status = GT_OK;
    } else if (why == GT_WRENCH_NOT_FINITE) {
        status = GT_NOT_FINITE;
    } else if (why == GT_WRENCH_STALE) {
        status = GT_STALE_INPUT;
    } else {
        /* as above */
    }
    return status;
}

/* What the datagram and the sensors themselves say of the wrenches. */
static gt_wrench_status gt_lead_reported(const gt_feedback *feedback)
{
    gt_wrench_status status = GT_WRENCH_OK;

    if (!feedback->has_wrenches) {
        status = GT_WRENCH_STALE;
    } else if ((feedback->handle.status != 0U) || (feedback->tool.status != 0U)) {
        status = GT_WRENCH_FAULT;
    } else {
        /* the law looks at their numbers */
    }
    return status;
}

/* The carts alone cannot turn the tool. */
static int gt_lead_turns(const gt_turning_gains *rotation)
{
    return (rotation->by_handle > 0.0) || (rotation->moment_gain > 0.0) || (rotation->about_axis > GT_ABOUT_LOCK);
}

static gt_status gt_lead_init(void *state, const gt_feedback *first)
{
    gt_law_lead_through *law = (gt_law_lead_through *)state;
    const gt_traj *numbers = &law->numbers;
    gt_wrench_status sign = gt_lead_reported(first);
    double tcp_m[3];
    gt_status status = GT_OUT_OF_RANGE;

    law->last_ms = 0U;
    if ((law->model == NULL) || (law->model->forward == NULL) || (law->model->carts == NULL) ||
        (numbers->rows == NULL) || (numbers->count != 1U) || (numbers->columns != GT_LEAD_THROUGH_NUMBERS) ||
        !gt_lead_through_of(&law->lead, numbers->rows) || gt_lead_turns(&law->lead.rotation) ||
        (fabs(law->lead.translation.cycle_s - ((double)law->cycle_ms / 1000.0)) > 0.0)) {
        return status;
    }
    law->now = gt_lead_through_start(&law->lead, &first->handle, &first->tool, gt_upright);
    sign = (sign == GT_WRENCH_OK) ? law->now.translation.status : sign;
    if (sign == GT_WRENCH_OK) {
        status = law->model->forward(first->has_planned ? first->planned_m : first->position_m, tcp_m);
    } else if (sign != GT_WRENCH_NO_FORCE) {
        status = gt_lead_status(sign);
    } else {
        /* a load that does not tell the sign is out of range */
    }
    if (status == GT_OK) {
        law->tcp_m = gt_vector_at(tcp_m);
    }
    return status;
}

static gt_status gt_lead_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command)
{
    gt_law_lead_through *law = (gt_law_lead_through *)state;
    const double cycle_s = law->lead.translation.cycle_s;
    const uint64_t passed = (elapsed_ms - law->last_ms) / law->cycle_ms;
    /* without datagrams the loop went on at the last speed, so long as it may */
    const uint64_t bridged = (passed > law->hold_cycles) ? law->hold_cycles : ((passed > 0U) ? (passed - 1U) : 0U);
    const gt_wrench_status bad = gt_lead_reported(feedback);
    const gt_surface_state *moved = &law->now.translation;
    double tcp_m[3];
    double tcp_m_s[3];
    double carts_m[GT_AXES];
    double carts_m_s[GT_AXES];
    gt_status status;

    law->tcp_m = gt_plus(law->tcp_m, (double)(uint32_t)bridged * cycle_s, moved->velocity_m_s);
    law->last_ms = elapsed_ms;
    law->now = (bad == GT_WRENCH_OK)
                   ? gt_lead_through_step(&law->lead, &law->now, &feedback->handle, &feedback->tool, gt_upright)
                   : gt_lead_through_stop(&law->lead, &law->now, bad);
    law->tcp_m = gt_plus(law->tcp_m, cycle_s, moved->velocity_m_s);
    gt_vector_to(tcp_m, law->tcp_m);
    gt_vector_to(tcp_m_s, moved->velocity_m_s);
    status = law->model->carts(tcp_m, tcp_m_s, carts_m, carts_m_s);
    if (status == GT_OK) {
        status = gt_lead_status(moved->status);
        command->along_path = 0;
        command->braking = moved->allowed ? 0 : 1;
        gt_copy(command->position_m, carts_m, (int)law->model->axes);
        gt_copy(command->speed_m_s, carts_m_s, (int)law->model->axes);
    }
    return status;
}

static void gt_lead_term(void *state)
{
    (void)state;
}

gt_law gt_law_lead_through_of(gt_law_lead_through *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 1;
    law.init = gt_lead_init;
    law.step = gt_lead_step;
    law.go_on = NULL;
    law.term = gt_lead_term;
    law.numbers = NULL;
    return law;
}
