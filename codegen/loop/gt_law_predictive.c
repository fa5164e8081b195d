/* gt_law_predictive: see gt_law_predictive.h. */
#include "gt_law_predictive.h"

#include <stddef.h>
#include <string.h>

/* Cycles from a reading to the position that is predicted when it comes. */
static uint64_t gt_predictive_ahead(const gt_law_predictive *law)
{
    return (uint64_t)law->model->plan->delay + 1U;
}

static gt_status gt_predictive_init(void *state, const gt_feedback *first)
{
    gt_law_predictive *law = (gt_law_predictive *)state;
    const gt_robot_plan *plan = (law->model != NULL) ? law->model->plan : NULL;
    uint32_t k;

    if ((plan == NULL) || (law->plan == NULL) || (plan->period_ms != law->cycle_ms) ||
        (law->goals.columns != plan->goals)) {
        return GT_OUT_OF_RANGE;
    }
    law->done = 0U;
    law->refused = 0U;
    law->over = GT_OK;
    (void)memset(law->numbers, 0, sizeof(law->numbers));
    for (k = 0U; k < GT_PLAN_AHEAD_MOST; k++) {
        gt_copy(law->predicted_m[k], first->position_m, (int)GT_AXES);
    }
    return plan->begin(law->plan, law->sends_speed);
}

/* The references of this cycle: of one row, or of all stages. Those before stay where they cannot be used. */
static gt_status gt_predictive_goals(gt_law_predictive *law)
{
    const gt_robot_plan *plan = law->model->plan;
    const uint64_t now_ms = law->done * law->cycle_ms;
    double goal[GT_PLAN_GOALS_MOST];
    gt_status status = GT_OK;
    uint32_t k;

    for (k = 0U; (status == GT_OK) && (k < plan->rows); k++) {
        const uint64_t stage_ms = ((uint64_t)plan->delay * law->cycle_ms) + ((uint64_t)k * plan->stage_ms);

        status = gt_traj_at(&law->goals, (plan->rows > 1U) ? (now_ms + stage_ms) : now_ms, &goal[k * plan->goals]);
    }
    if (status == GT_OK) {
        law->refused = 0U;
        gt_copy(law->goal, goal, (int)(plan->rows * plan->goals));
    } else {
        law->refused++;
        law->numbers[GT_PLAN_REFUSED] += 1.0;
        if ((law->done > 0U) && (law->refused <= law->hold_cycles)) {
            status = GT_OK;
        }
    }
    return status;
}

/* One cycle of the plan; position_m: the reading, or NULL. */
static gt_status gt_predictive_run(gt_law_predictive *law, const double *position_m, gt_command *command)
{
    const gt_robot_plan *plan = law->model->plan;
    double *numbers = law->numbers;
    double *ahead = law->predicted_m[law->done % gt_predictive_ahead(law)];
    gt_plan_cycle cycle;
    gt_status status;
    uint32_t n;

    (void)memset(&cycle, 0, sizeof(cycle));
    gt_copy(&numbers[GT_PLAN_PREDICTED], ahead, (int)GT_AXES);
    status = gt_predictive_goals(law);
    if (status != GT_OK) {
        return status;
    }
    status = plan->step(law->plan, position_m, command->position_m, law->goal, &cycle);
    if (status != GT_OK) {
        numbers[GT_PLAN_FAILED] += (status != GT_STALE_INPUT) ? 1.0 : 0.0;
        numbers[GT_PLAN_LOST] += (status == GT_STALE_INPUT) ? 1.0 : 0.0;
        return status;
    }
    numbers[GT_PLAN_ITERATIONS] = (double)cycle.iterations;
    numbers[GT_PLAN_COST] = cycle.cost;
    numbers[GT_PLAN_RESIDUAL] = cycle.residual;
    numbers[GT_PLAN_ACTIVE] = cycle.active;
    numbers[GT_PLAN_FAILED] += (cycle.failed > 0) ? 1.0 : 0.0;
    numbers[GT_PLAN_LOST] += (cycle.lost > 0) ? 1.0 : 0.0;
    for (n = 0U; n < law->model->axes; n++) {
        numbers[GT_PLAN_FORCE + n] = cycle.force_N[n];
        ahead[n] = cycle.position_m[n];
        command->position_m[n] = cycle.command_m[n];
        command->speed_m_s[n] = cycle.speed_m_s[n];
    }
    command->along_path = 0;
    law->done++;
    return GT_OK;
}

static gt_status gt_predictive_step(void *state, const gt_feedback *feedback, uint64_t elapsed_ms, gt_command *command)
{
    gt_law_predictive *law = (gt_law_predictive *)state;
    const uint64_t now = elapsed_ms / law->cycle_ms;
    gt_command own = *command;
    gt_status status = GT_OK;

    while ((law->done < now) && (status == GT_OK)) {
        /* cycles of the robot that the loop did not go through */
        gt_command passed = own;

        status = gt_predictive_run(law, NULL, &passed);
        law->numbers[GT_PLAN_SKIPPED] += 1.0;
    }
    if (status == GT_OK) {
        status = gt_predictive_run(law, feedback->position_m, &own);
    }
    law->over = status;
    if (status == GT_OK) {
        law->done = now + 1U;
        *command = own;
    }
    return status;
}

static gt_status gt_predictive_go_on(void *state, gt_command *command)
{
    gt_law_predictive *law = (gt_law_predictive *)state;
    gt_command own = *command;
    const gt_status status = (law->over != GT_OK) ? law->over : gt_predictive_run(law, NULL, &own);

    if (status == GT_OK) {
        *command = own;
    }
    return status;
}

static void gt_predictive_term(void *state)
{
    (void)state;
}

gt_law gt_law_predictive_of(gt_law_predictive *state)
{
    gt_law law;

    law.state = state;
    law.reads_wrenches = 0;
    law.init = gt_predictive_init;
    law.step = gt_predictive_step;
    law.go_on = gt_predictive_go_on;
    law.term = gt_predictive_term;
    law.numbers = state->numbers;
    return law;
}
