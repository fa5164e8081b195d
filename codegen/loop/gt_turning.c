/* gt_turning: see gt_turning.h. */
#include "gt_turning.h"

#define GT_ORTHOGONAL 1e-9

int gt_turning_gains_of(gt_turning_gains *gains, const double *numbers)
{
    int good = gt_all_finite(numbers, (int)GT_TURNING_NUMBERS);
    int n;

    gains->by_handle = numbers[0];
    gains->inertia_kg_m2 = numbers[1];
    gains->damping_N_m_s = numbers[2];
    gains->moment_gain = numbers[3];
    gains->about_axis = numbers[4];
    gains->hold_gain_1_s = numbers[5];
    gains->rate_limit_rad_s = numbers[6];
    gains->moment_rate_limit_rad_s = numbers[7];
    gains->acceleration_limit_rad_s2 = numbers[8];
    gains->moment_range_N_m = numbers[9];
    gains->axis = gt_vector_at(&numbers[10]);
    gains->across = gt_vector_at(&numbers[13]);
    for (n = 5; n < 10; n++) {
        good = good && (numbers[n] > 0.0);
    }
    return good && (gains->inertia_kg_m2 > 0.0) && (gains->damping_N_m_s > 0.0) && (gains->moment_gain >= 0.0) &&
           gt_is_direction(gains->axis) && gt_is_direction(gains->across) &&
           (fabs(gt_dot(gains->axis, gains->across)) <= GT_ORTHOGONAL);
}

gt_turning_state gt_turning_start(void)
{
    gt_turning_state state;

    state.rate_rad_s = gt_vector_of(0.0, 0.0, 0.0);
    state.guided_rad_s = state.rate_rad_s;
    state.across = state.rate_rad_s;
    state.about_rad = 0.0;
    return state;
}

static int gt_about(const gt_turning_gains *p, double what)
{
    return !(fabs(p->about_axis - what) > 0.0);
}

/* (8.11): towards no moment on the tool; about the axis as it is declared. */
static gt_vector gt_turning_aligned(const gt_turning_gains *p, gt_vector tool, gt_vector axis, gt_vector across,
                                    gt_vector reference)
{
    gt_vector aligned = gt_plus(gt_vector_of(0.0, 0.0, 0.0), p->moment_gain, tool);

    if (!gt_about(p, GT_ABOUT_FREE)) {
        aligned = gt_plus(aligned, -gt_dot(axis, aligned), axis);
    }
    aligned = gt_limited(aligned, p->moment_rate_limit_rad_s);
    if (gt_about(p, GT_ABOUT_HOLD)) {
        const double back = p->hold_gain_1_s * gt_dot(axis, gt_cross(across, reference));

        aligned = gt_plus(aligned, gt_clamped_to(back, p->moment_rate_limit_rad_s), axis);
    }
    return aligned;
}

gt_turning_state gt_turning_step(const gt_turning_gains *gains, const gt_turning_state *state, int contact,
                                 gt_vector handle_N_m, gt_vector tool_N_m, const double *turn, int began, double cycle_s)
{
    const gt_turning_gains *p = gains;
    const gt_vector zero = gt_vector_of(0.0, 0.0, 0.0);
    const gt_vector axis = gt_turned(turn, p->axis);
    const gt_vector across = gt_turned(turn, p->across);
    gt_turning_state next = *state;
    gt_vector projected = zero;
    gt_vector aligned = zero;
    gt_vector change;

    next.across = began ? across : state->across;
    if (contact) {
        aligned = gt_turning_aligned(p, tool_N_m, axis, across, next.across);
        if (gt_about(p, GT_ABOUT_GUIDE)) {
            projected = gt_plus(zero, gt_dot(axis, state->guided_rad_s), axis);
        }
    } else if (p->by_handle > 0.0) {
        projected = state->guided_rad_s;
    } else {
        /* free of contact, and not guided: it does not turn */
    }
    projected = gt_limited(projected, p->rate_limit_rad_s);
    change = gt_plus(gt_plus(projected, 1.0, aligned), -1.0, state->rate_rad_s);
    change = gt_limited(change, p->acceleration_limit_rad_s2 * cycle_s);
    next.rate_rad_s = gt_plus(state->rate_rad_s, 1.0, change);
    next.guided_rad_s = gt_plus(projected, cycle_s / p->inertia_kg_m2,
                                gt_plus(handle_N_m, -p->damping_N_m_s, next.rate_rad_s));
    if (contact) {
        next.about_rad = state->about_rad + (cycle_s * gt_dot(axis, next.rate_rad_s));
    }
    return next;
}

gt_turning_state gt_turning_stop(const gt_turning_gains *gains, const gt_turning_state *state, double cycle_s)
{
    const gt_vector zero = gt_vector_of(0.0, 0.0, 0.0);
    const gt_vector change =
        gt_limited(gt_plus(zero, -1.0, state->rate_rad_s), gains->acceleration_limit_rad_s2 * cycle_s);
    gt_turning_state next = *state;

    next.rate_rad_s = gt_plus(state->rate_rad_s, 1.0, change);
    next.guided_rad_s = zero;
    return next;
}
