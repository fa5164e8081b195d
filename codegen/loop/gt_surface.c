/* gt_surface: see gt_surface.h. */
#include "gt_surface.h"

#define GT_SHORTEST 1e-9 /* of a mixture of directions: below it they are opposed */

/* The numbers as they stand in a row, one after the other. */
static void gt_surface_numbers(gt_surface_gains *p, const double *row)
{
    double *const places[27] = {&p->cycle_s, &p->mass_kg, &p->damping_N_s_m, &p->force_gain_m_s_N,
                                &p->force_reference_N, &p->any_direction, &p->contact_arm_m, &p->cone_cosine,
                                &p->normal_filter_s, &p->friction, &p->friction_speed_m_s, &p->least_force_N,
                                &p->enter_force_N, &p->leave_force_N, &p->dwell_cycles, &p->release_force_N,
                                &p->speed_limit_m_s, &p->force_speed_limit_m_s, &p->acceleration_limit_m_s2,
                                &p->force_range_N, &p->age_limit_s, &p->watch_level_N, &p->watch_constant_s,
                                &p->watch_window_s, &p->watch_fall_s, &p->watch_recovery_s, &p->watch_least_share};
    int n;

    for (n = 0; n < 27; n++) {
        *places[n] = row[n];
    }
    p->normal = gt_vector_at(&row[27]);
}

int gt_surface_gains_of(gt_surface_gains *gains, const double *numbers)
{
    /* what has to be above zero, and what may be zero */
    static const int above[18] = {0, 1, 2, 3, 6, 10, 11, 12, 15, 16, 17, 18, 19, 22, 23, 24, 25, 26};
    static const int least[8] = {4, 5, 7, 8, 9, 14, 20, 21};
    int good = gt_all_finite(numbers, (int)GT_SURFACE_NUMBERS);
    int n;

    gt_surface_numbers(gains, numbers);
    for (n = 0; n < 18; n++) {
        good = good && (numbers[above[n]] > 0.0);
    }
    for (n = 0; n < 8; n++) {
        good = good && (numbers[least[n]] >= 0.0);
    }
    return good && (gains->leave_force_N < gains->enter_force_N) && (gains->friction <= 1.0) &&
           (gains->watch_least_share <= 1.0) &&
           ((gains->any_direction > 0.0) || (gains->enter_force_N <= gains->force_reference_N)) &&
           gt_is_direction(gains->normal);
}

gt_surface_state gt_surface_start(const gt_surface_gains *gains, gt_wrench_status sign)
{
    gt_surface_state state;

    state.velocity_m_s = gt_vector_of(0.0, 0.0, 0.0);
    state.guided_m_s = state.velocity_m_s;
    state.normal = gains->normal;
    state.filtered = gains->normal;
    state.contact = 0;
    state.since = gains->dwell_cycles;
    state.slow_N = 0.0;
    state.energy_N2 = 0.0;
    state.share = 1.0;
    state.status = sign;
    state.allowed = (sign == GT_WRENCH_OK) ? 1 : 0;
    return state;
}

gt_surface_state gt_surface_stop(const gt_surface_gains *gains, const gt_surface_state *state, gt_wrench_status why)
{
    const gt_vector zero = gt_vector_of(0.0, 0.0, 0.0);
    const gt_vector change = gt_limited(gt_plus(zero, -1.0, state->velocity_m_s),
                                        gains->acceleration_limit_m_s2 * gains->cycle_s);
    gt_surface_state next = *state;

    next.velocity_m_s = gt_plus(state->velocity_m_s, 1.0, change);
    next.guided_m_s = zero;
    next.status = why;
    next.allowed = 0;
    return next;
}

/* Two thresholds and a dwell; from the forces along the nominal normal, or the size of the tool's. */
static void gt_surface_contact(const gt_surface_gains *p, gt_surface_state *next, double pulled, double pressed)
{
    next->since = ((next->since + 1.0) > p->dwell_cycles) ? p->dwell_cycles : (next->since + 1.0);
    if (!(next->since < p->dwell_cycles)) {
        const int ends = (pressed <= p->leave_force_N) || (pulled >= p->release_force_N);
        const int begins = (pressed >= p->enter_force_N) && (pulled < p->release_force_N);

        if (next->contact ? ends : begins) {
            next->contact = next->contact ? 0 : 1;
            next->since = 0.0;
        }
    }
}

/* The energy of the force above a corner frequency, in a window that fades: where it is large the gain falls. */
static void gt_surface_watch(const gt_surface_gains *p, gt_surface_state *next, double force)
{
    if (fabs(p->watch_level_N) > 0.0) {
        const double slow =
            next->slow_N + ((p->cycle_s / (p->watch_constant_s + p->cycle_s)) * (force - next->slow_N));
        const double fast = force - slow;

        next->slow_N = slow;
        next->energy_N2 = next->energy_N2 +
                          ((p->cycle_s / (p->watch_window_s + p->cycle_s)) * ((fast * fast) - next->energy_N2));
        if (next->energy_N2 > (p->watch_level_N * p->watch_level_N)) {
            const double fallen = next->share - ((p->cycle_s / (p->watch_fall_s + p->cycle_s)) * next->share);

            next->share = (p->watch_least_share > fallen) ? p->watch_least_share : fallen;
        } else if (!next->contact) {
            next->share = next->share + ((p->cycle_s / (p->watch_recovery_s + p->cycle_s)) * (1.0 - next->share));
        } else {
            /* in contact it stays */
        }
    }
}

/* The tool force without friction, which acts against the motion along the surface. */
static gt_vector gt_surface_pushed(const gt_surface_gains *p, const gt_surface_state *state, gt_vector tool)
{
    const gt_vector along =
        gt_plus(state->velocity_m_s, -gt_dot(state->normal, state->velocity_m_s), state->normal);
    const double moving = gt_length(along);
    const double speed = (p->friction_speed_m_s > moving) ? p->friction_speed_m_s : moving;
    const double onto = gt_dot(tool, state->normal);
    const double pressed = (0.0 > onto) ? 0.0 : onto;

    return gt_plus(tool, (p->friction * pressed) / speed, along);
}

/* (8.9), (8.10): the direction of the tool force, filtered, and the nominal normal outside of the cone. */
static void gt_surface_normal(const gt_surface_gains *p, const gt_surface_state *state, gt_surface_state *next,
                              gt_vector tool)
{
    const gt_vector pushed = gt_surface_pushed(p, state, tool);
    const double size = gt_length(pushed);

    next->status = GT_WRENCH_OK;
    if (!next->contact) {
        next->filtered = p->normal;
        next->normal = p->normal;
    } else if (size <= p->least_force_N) {
        next->status = GT_WRENCH_NO_FORCE;
    } else if ((p->any_direction > 0.0) && !state->contact) {
        next->filtered = gt_divided(pushed, size); /* where it begins the nominal normal says nothing */
        next->normal = next->filtered;
    } else {
        const double share = p->cycle_s / (p->normal_filter_s + p->cycle_s);
        const gt_vector step = gt_plus(gt_divided(pushed, size), -1.0, state->filtered);
        const gt_vector mixed = gt_plus(state->filtered, share, step);
        const double mixture = gt_length(mixed);

        next->filtered = (mixture <= GT_SHORTEST) ? p->normal : gt_divided(mixed, mixture);
        next->normal = next->filtered;
        if (!(p->any_direction > 0.0) && !(gt_dot(p->normal, next->filtered) >= p->cone_cosine)) {
            next->normal = p->normal;
        }
    }
}

gt_surface_state gt_surface_moved(const gt_surface_gains *gains, const gt_surface_state *state, gt_vector handle_N,
                                  gt_vector tool_N, double moment_N_m)
{
    const gt_surface_gains *p = gains;
    const int any = (p->any_direction > 0.0) ? 1 : 0;
    const double force = any ? gt_length(tool_N) : gt_dot(tool_N, p->normal);
    const double by_moment = moment_N_m / p->contact_arm_m;
    gt_surface_state next = *state;
    gt_vector projected = state->guided_m_s;
    gt_vector change;
    double pressed = 0.0;

    gt_surface_contact(p, &next, any ? 0.0 : gt_dot(handle_N, p->normal),
                       (any && (by_moment > force)) ? by_moment : force);
    gt_surface_watch(p, &next, force);
    gt_surface_normal(p, state, &next, tool_N);
    if (next.contact && (!any || (next.status != GT_WRENCH_NO_FORCE))) {
        const double along = gt_dot(next.normal, projected);

        projected = gt_plus(projected, -along, next.normal);
        pressed = (p->force_gain_m_s_N * next.share) * (gt_dot(tool_N, next.normal) - p->force_reference_N);
        pressed = gt_clamped_to(pressed, p->force_speed_limit_m_s);
    }
    projected = gt_limited(projected, p->speed_limit_m_s);
    change = gt_plus(gt_plus(projected, pressed, next.normal), -1.0, state->velocity_m_s);
    change = gt_limited(change, p->acceleration_limit_m_s2 * p->cycle_s);
    next.velocity_m_s = gt_plus(state->velocity_m_s, 1.0, change);
    /* (8.6) with the back-calculation of (8.7): what projection and limits took away is not integrated */
    next.guided_m_s = gt_plus(projected, p->cycle_s / p->mass_kg,
                              gt_plus(handle_N, -p->damping_N_s_m, next.velocity_m_s));
    if (!gt_vector_finite(next.velocity_m_s) || !gt_vector_finite(next.guided_m_s) ||
        !gt_vector_finite(gt_vector_of(next.slow_N, next.energy_N2, next.share))) { /* of gains beyond reason */
        next = gt_surface_stop(p, state, GT_WRENCH_NOT_FINITE);
    }
    return next;
}
