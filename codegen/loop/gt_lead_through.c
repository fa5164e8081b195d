/* gt_lead_through: see gt_lead_through.h. */
#include "gt_lead_through.h"

#define GT_TURN 1e-3 /* of R R' - I: orientations come with few digits from some controllers */

int gt_lead_through_of(gt_lead_through *law, const double *numbers)
{
    const double *rest = &numbers[GT_SURFACE_NUMBERS + GT_TURNING_NUMBERS];
    const int gains = gt_surface_gains_of(&law->translation, numbers);
    const int turning = gt_turning_gains_of(&law->rotation, &numbers[GT_SURFACE_NUMBERS]);
    const int handle = gt_force_sensor_of(&law->handle, &rest[4]);
    const int tool = gt_force_sensor_of(&law->tool, &rest[4U + GT_FORCE_SENSOR_NUMBERS]);

    law->gravity_m_s2 = gt_vector_at(rest);
    law->drift_N = rest[3];
    return gains && turning && handle && tool && gt_all_finite(rest, 4) && (law->drift_N >= 0.0);
}

static int gt_lead_finite(const gt_wrench *wrench)
{
    return gt_all_finite(wrench->force_N, 3) && gt_all_finite(wrench->moment_N_m, 3);
}

static int gt_lead_saturated(const gt_lead_through *law, const gt_wrench *wrench)
{
    int saturated = 0;
    int k;

    for (k = 0; k < 3; k++) {
        if ((fabs(wrench->force_N[k]) >= law->translation.force_range_N) ||
            (fabs(wrench->moment_N_m[k]) >= law->rotation.moment_range_N_m)) {
            saturated = 1;
        }
    }
    return saturated;
}

static int gt_lead_stale(const gt_lead_through *law, const gt_wrench *wrench)
{
    return !(((double)wrench->age_cycles * law->translation.cycle_s) <= law->translation.age_limit_s);
}

/* Why these readings cannot be used, as they came. */
static gt_wrench_status gt_lead_refusal(const gt_lead_through *law, const gt_wrench *handle, const gt_wrench *tool,
                                        const double *turn)
{
    gt_wrench_status status = GT_WRENCH_OK;

    if (!gt_lead_finite(handle) || !gt_lead_finite(tool) || !gt_all_finite(turn, 9)) {
        status = GT_WRENCH_NOT_FINITE;
    } else if (gt_lead_saturated(law, handle) || gt_lead_saturated(law, tool)) {
        status = GT_WRENCH_SATURATED;
    } else if (gt_lead_stale(law, handle) || gt_lead_stale(law, tool)) {
        status = GT_WRENCH_STALE;
    } else if (!gt_is_turn(turn, GT_TURN)) {
        status = GT_WRENCH_NO_ROTATION;
    } else {
        /* they can be used */
    }
    return status;
}

gt_lead_through_state gt_lead_through_start(const gt_lead_through *law, const gt_wrench *handle, const gt_wrench *tool,
                                            const double *turn)
{
    gt_lead_through_state state;
    gt_wrench_status sign = GT_WRENCH_OK;

    state.translation = gt_surface_start(&law->translation, sign);
    state.rotation = gt_turning_start();
    state = gt_lead_through_step(law, &state, handle, tool, turn); /* what it asks of any reading */
    if (!state.translation.allowed) {
        sign = state.translation.status;
    }
    if (sign == GT_WRENCH_OK) {
        sign = gt_force_sensor_sign(&law->tool, tool, turn, law->gravity_m_s2, law->drift_N);
    }
    if (sign == GT_WRENCH_OK) {
        sign = gt_force_sensor_sign(&law->handle, handle, turn, law->gravity_m_s2, law->drift_N);
    }
    state.translation = gt_surface_start(&law->translation, sign);
    state.rotation = gt_turning_start();
    return state;
}

gt_lead_through_state gt_lead_through_stop(const gt_lead_through *law, const gt_lead_through_state *state,
                                           gt_wrench_status why)
{
    const gt_wrench_status cause = state->translation.allowed ? why : state->translation.status;
    gt_lead_through_state next;

    next.translation = gt_surface_stop(&law->translation, &state->translation, cause);
    next.rotation = gt_turning_stop(&law->rotation, &state->rotation, law->translation.cycle_s);
    return next;
}

gt_lead_through_state gt_lead_through_step(const gt_lead_through *law, const gt_lead_through_state *state,
                                           const gt_wrench *handle, const gt_wrench *tool, const double *turn)
{
    gt_wrench_status bad = gt_lead_refusal(law, handle, tool, turn);
    gt_lead_through_state next = *state;

    if (state->translation.allowed && (bad == GT_WRENCH_OK)) {
        const int before = state->translation.contact;
        gt_vector force[2];
        gt_vector moment[2];

        gt_force_sensor_wrench(&law->handle, handle, turn, law->gravity_m_s2, &force[0], &moment[0]);
        gt_force_sensor_wrench(&law->tool, tool, turn, law->gravity_m_s2, &force[1], &moment[1]);
        next.translation =
            gt_surface_moved(&law->translation, &state->translation, force[0], force[1], gt_length(moment[1]));
        next.rotation = gt_turning_step(&law->rotation, &state->rotation, next.translation.contact, moment[0],
                                        moment[1], turn, next.translation.contact && !before, law->translation.cycle_s);
        bad = next.translation.allowed ? GT_WRENCH_OK : next.translation.status;
        if ((bad == GT_WRENCH_OK) && (!gt_vector_finite(next.rotation.rate_rad_s) ||
                                      !gt_vector_finite(next.rotation.guided_rad_s) ||
                                      !(fabs(next.rotation.about_rad) <= DBL_MAX))) {
            bad = GT_WRENCH_NOT_FINITE;
        }
    }
    if (!state->translation.allowed || (bad != GT_WRENCH_OK)) {
        next = gt_lead_through_stop(law, state, bad);
    }
    return next;
}
