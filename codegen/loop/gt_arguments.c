/* gt_arguments: see gt_arguments.h. */
#include "gt_arguments.h"

#include "gt_guard.h"
#include "gt_socket.h"

#include <stdlib.h>
#include <string.h>

#define GT_HAS_LOWEST 1
#define GT_HAS_HIGHEST 2
#define GT_HAS_STEP 4
#define GT_HAS_ALL 7
#define GT_MOST_MS 1000U      /* of a cycle */
#define GT_MOST_CYCLES 100000U /* to hold, to ramp */

static void gt_arguments_default(gt_arguments *a)
{
    uint32_t n;

    (void)memset(a, 0, sizeof(*a));
    a->bind = "127.0.0.1";
    a->allow = "127.0.0.1";
    a->cycle_ms = 4U;
    a->law = "trajectory";
    a->idle_ms = 1000U;
    a->hold_cycles = 5U;
    a->ramp_cycles = 50U;
    a->limits.step_m = 0.02;
    a->limits.path_m = 0.01;
    a->limits.following_m = 0.25;
    a->fewest = GT_AXES;
    for (n = 0U; n < GT_AXES; n++) {
        a->limits.lowest_m[n] = -10.0;
        a->limits.highest_m[n] = 10.0;
        a->a[n] = 0.0;
        a->b[n] = 1.0;
    }
}

/* Numbers separated by commas, `most` at the most: how many, 0 for anything else. strtod: the program never leaves the
 * "C" locale it starts in. */
static uint32_t gt_numbers(const char *text, double *values, uint32_t most)
{
    const char *at = text;
    char *end = NULL;
    uint32_t n;

    for (n = 0U; n < most; n++) {
        values[n] = strtod(at, &end);
        if ((end == at) || !gt_all_finite(&values[n], 1)) {
            return 0U;
        }
        if (*end == '\0') {
            return n + 1U;
        }
        if (*end != ',') {
            return 0U;
        }
        at = end + 1;
    }
    return 0U;
}

static int gt_whole(const char *text, uint32_t *value)
{
    char *end = NULL;
    const unsigned long number = strtoul(text, &end, 10);

    *value = (uint32_t)number;
    return (end != text) && (*end == '\0') && (text[0] != '-') && (number <= UINT32_MAX);
}

static int gt_is(const char *name, const char *option)
{
    return strcmp(name, option) == 0;
}

static int gt_text_option(gt_arguments *a, const char *name, const char *value)
{
    const char **place = gt_is(name, "--bind")          ? &a->bind
                         : gt_is(name, "--allow")       ? &a->allow
                         : gt_is(name, "--law")         ? &a->law
                         : gt_is(name, "--reference")   ? &a->reference
                         : gt_is(name, "--corrections") ? &a->corrections
                         : gt_is(name, "--gains")       ? &a->gains
                         : gt_is(name, "--log")         ? &a->log
                                                        : NULL;

    if (place == NULL) {
        return 0;
    }
    *place = value;
    return 1;
}

static uint32_t *gt_whole_option(gt_arguments *a, const char *name)
{
    return gt_is(name, "--port")       ? &a->port
           : gt_is(name, "--cycle-ms") ? &a->cycle_ms
           : gt_is(name, "--cycles")   ? &a->cycles
           : gt_is(name, "--idle-ms")  ? &a->idle_ms
           : gt_is(name, "--hold")     ? &a->hold_cycles
           : gt_is(name, "--ramp")     ? &a->ramp_cycles
           : gt_is(name, "--delay-ms") ? &a->delay_ms
           : gt_is(name, "--lead-ms")  ? &a->lead_ms
                                       : NULL;
}

static double *gt_number_option(gt_arguments *a, const char *name, uint32_t *most)
{
    *most = GT_AXES;
    if (gt_is(name, "--step") || gt_is(name, "--path-limit") || gt_is(name, "--gain") ||
        gt_is(name, "--deceleration") || gt_is(name, "--following")) {
        *most = 1U;
    }
    return gt_is(name, "--lowest")       ? a->limits.lowest_m
           : gt_is(name, "--highest")    ? a->limits.highest_m
           : gt_is(name, "--step")       ? &a->limits.step_m
           : gt_is(name, "--path-limit") ? &a->limits.path_m
           : gt_is(name, "--following")  ? &a->limits.following_m
           : gt_is(name, "--a")          ? a->a
           : gt_is(name, "--b")          ? a->b
           : gt_is(name, "--kp")         ? a->kp_N_m
           : gt_is(name, "--kd")         ? a->kd_N_s_m
           : gt_is(name, "--gain")       ? &a->gain_per_s
           : gt_is(name, "--deceleration") ? &a->deceleration_m_s2
                                         : NULL;
}

static const char *gt_one(gt_arguments *a, const char *name, const char *value)
{
    uint32_t most;
    uint32_t *whole = gt_whole_option(a, name);
    double *numbers = gt_number_option(a, name, &most);

    if (gt_text_option(a, name, value)) {
        return NULL;
    }
    if (whole != NULL) {
        return gt_whole(value, whole) ? NULL : "expected a whole number that is not negative";
    }
    if (numbers != NULL) {
        const uint32_t count = gt_numbers(value, numbers, most);

        a->has_limits |= gt_is(name, "--lowest") ? GT_HAS_LOWEST : 0;
        a->has_limits |= gt_is(name, "--highest") ? GT_HAS_HIGHEST : 0;
        a->has_limits |= gt_is(name, "--step") ? GT_HAS_STEP : 0;
        a->fewest = ((most > 1U) && (count < a->fewest)) ? count : a->fewest;
        return (count > 0U) ? NULL : "expected finite numbers, six at the most, separated by commas";
    }
    if (gt_is(name, "--peer")) {
        a->peer = gt_is(value, "rsi") ? GT_PEER_RSI : GT_PEER_EGM;
        return (gt_is(value, "rsi") || gt_is(value, "egm")) ? NULL : "expected egm or rsi";
    }
    if (gt_is(name, "--feedforward")) {
        a->feedforward = gt_is(value, "on");
        return (gt_is(value, "on") || gt_is(value, "off")) ? NULL : "expected on or off";
    }
    return "there is no such option; --help shows all";
}

/* What must hold between numbers, whichever options gave them. */
static const char *gt_ranges(const gt_arguments *a)
{
    uint32_t n;

    for (n = 0U; n < GT_AXES; n++) {
        if (a->limits.lowest_m[n] > a->limits.highest_m[n]) {
            return "--lowest is above --highest";
        }
    }
    if (!(a->limits.step_m > 0.0) || !(a->limits.following_m > 0.0) || !(a->limits.path_m >= 0.0)) {
        return "--step has to be above zero, and so has --following; --path-limit not below";
    }
    if (!(a->deceleration_m_s2 >= 0.0)) {
        return "--deceleration has to be above zero, or 0 for --ramp";
    }
    if ((a->port > UINT16_MAX) || (a->cycle_ms == 0U) || (a->cycle_ms > GT_MOST_MS)) {
        return "--port is at most 65535, --cycle-ms from 1 to 1000";
    }
    if ((a->hold_cycles > GT_MOST_CYCLES) || (a->ramp_cycles > GT_MOST_CYCLES)) {
        return "--hold and --ramp are at most 100000 cycles";
    }
    return NULL;
}

const char *gt_arguments_read(gt_arguments *a, int argc, char **argv)
{
    const char *wrong = NULL;
    int n = 1;

    gt_arguments_default(a);
    while (n < argc) {
        a->about = argv[n];
        if (gt_is(argv[n], "--live")) {
            a->live = 1;
        } else if (gt_is(argv[n], "--lockstep")) {
            a->lockstep = 1;
        } else if (gt_is(argv[n], "--beyond-loopback")) {
            a->beyond_loopback = 1;
        } else if ((n + 1) < argc) {
            wrong = gt_one(a, argv[n], argv[n + 1]);
            n++;
        } else {
            wrong = "this option lacks its value, or does not exist; --help shows all";
        }
        if (wrong != NULL) {
            return wrong;
        }
        n++;
    }
    a->about = NULL;
    if (gt_is(a->law, "lead_through") ? (a->gains == NULL) : (a->reference == NULL)) {
        return "--reference is needed, for law lead_through --gains; --help shows all options";
    }
    if (a->log == NULL) {
        return "--log is needed; --help shows all options";
    }
    wrong = gt_ranges(a);
    if (wrong != NULL) {
        return wrong;
    }
    if ((!gt_is_loopback(a->bind) || !gt_is_loopback(a->allow)) &&
        (!a->beyond_loopback || (a->has_limits != GT_HAS_ALL))) {
        return "a peer beyond loopback needs --lowest, --highest, --step and --beyond-loopback";
    }
    return NULL;
}
