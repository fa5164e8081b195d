/* See gt_fmu.h: modes, values by reference, saved states. */
#include "gt_fmu.h"

#include "gt_guard.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define TEXT 320
#define TOKEN_BYTES (sizeof(GT_FMU_TOKEN))
#define SUM_BYTES 4U

int gt_fmu_is_said(const gt_fmu *f, gt_fmu_result result)
{
    return ((f->logger != NULL) && ((f->logging != 0) || (result == GT_FMU_ERROR))) ? 1 : 0;
}

gt_fmu_result gt_fmu_log(gt_fmu *f, int on, size_t n, const char *const *categories)
{
    int discards = (n == 0U) ? 1 : 0;
    size_t k;

    for (k = 0U; k < n; k++) {
        const char *const category = (categories != NULL) ? categories[k] : NULL;

        if ((category != NULL) && (strcmp(category, "logStatusDiscard") == 0)) {
            discards = 1;
        } else if ((category == NULL) || (strcmp(category, "logStatusError") != 0)) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetDebugLogging", "there is no such log category");
        }
    }
    f->logging = (discards != 0) ? on : f->logging;
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_refuse(const gt_fmu *f, gt_fmu_result result, const char *call, const char *sentence)
{
    char text[TEXT];

    (void)snprintf(text, sizeof(text), "%s: %s", call, sentence);
    f->say(f, result, text);
    return result;
}

char *gt_fmu_copied(const char *text, void *(*allocate)(size_t, size_t))
{
    const size_t size = strlen(text) + 1U;
    char *copy = (char *)allocate(size, 1U);

    if (copy != NULL) {
        (void)memcpy(copy, text, size);
    }
    return copy;
}

void gt_fmu_reset(gt_fmu *f)
{
    int k;

    (void)memset(&f->data, 0, sizeof(f->data));
    gt_copy(f->data.v, gt_fmu_start, GT_FMU_REALS);
    for (k = 0; k < GT_FMU_INTEGERS; k++) {
        f->data.n[k] = gt_fmu_start_integers[k];
    }
    f->data.stop = DBL_MAX;
    f->data.stale = 1;
    f->data.mode = (int)GT_FMU_INSTANTIATED;
}

gt_fmu_result gt_fmu_in(const gt_fmu *f, int modes, const char *call)
{
    if ((f->data.mode & modes) != 0) {
        return GT_FMU_OK;
    }
    return gt_fmu_refuse(f, GT_FMU_ERROR, call, "this call is not allowed in the present mode");
}

gt_fmu_result gt_fmu_change(gt_fmu *f, int from, gt_fmu_mode to, const char *call)
{
    const gt_fmu_result allowed = gt_fmu_in(f, from, call);

    if (allowed == GT_FMU_OK) {
        f->data.mode = (int)to;
    }
    return allowed;
}

/* The status of an evaluation as the result of a call, said in a sentence. */
static gt_fmu_result judged(const gt_fmu *f, gt_status status, const char *call)
{
    char text[TEXT];

    if (status == GT_OK) {
        return GT_FMU_OK;
    }
    (void)snprintf(text, sizeof(text), "%s, at time %.17g s", gt_status_sentence(status), f->data.v[0]);
    return gt_fmu_refuse(f, GT_FMU_DISCARD, call, text);
}

/* Computes what is out of date. */
static gt_fmu_result fresh(gt_fmu *f, const char *call)
{
    gt_fmu_memory tried = f->data.kept;
    gt_status status;

    if (f->data.stale == 0) {
        return GT_FMU_OK;
    }
    status = gt_fmu_compute(&tried, f->data.v);
    f->data.last = (int)status;
    if (GT_FMU_HOLD != 0) {
        f->data.n[GT_FMU_STATUS_PLACE] = (int)status;
    }
    if (status == GT_OK) {
        f->data.tried = tried;
        f->data.stale = 0;
    } else if (GT_FMU_HOLD != 0) {
        f->data.stale = 0;
        f->data.tried = f->data.kept; /* a failed trial leads nowhere */
        (void)judged(f, status, call);
        return GT_FMU_OK;
    }
    return judged(f, status, call);
}

gt_fmu_result gt_fmu_set_experiment(gt_fmu *f, double start, double stop, const char *call)
{
    if (gt_fmu_in(f, (int)GT_FMU_INSTANTIATED, call) != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    if (!(fabs(start) <= DBL_MAX) || !(stop >= start)) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "the start time is not finite, or the stop time is before it");
    }
    f->data.v[0] = start;
    f->data.stop = stop;
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_enter_initialization(gt_fmu *f, double start)
{
    gt_fmu_result result;

    if (gt_fmu_change(f, (int)GT_FMU_INSTANTIATED, GT_FMU_INITIALIZATION, "EnterInitializationMode") != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    f->data.v[0] = start;
    f->data.began = start;
    f->data.reached = start;
    f->data.stale = 1;
    result = judged(f, gt_fmu_begin(&f->data.kept, f->data.v), "EnterInitializationMode");
    if (result != GT_FMU_OK) {
        f->data.mode = (int)GT_FMU_INSTANTIATED; /* nothing can run from there; another start can be set */
    }
    return result;
}

gt_fmu_result gt_fmu_exit_initialization(gt_fmu *f)
{
    gt_fmu_result result = gt_fmu_in(f, (int)GT_FMU_INITIALIZATION, "ExitInitializationMode");

    if (result == GT_FMU_OK) {
        result = fresh(f, "ExitInitializationMode");
    }
    if (result != GT_FMU_OK) {
        return result;
    }
    f->data.kept = f->data.tried;
    f->data.mode = (int)((f->co_simulation != 0) ? GT_FMU_STEPPING : GT_FMU_EVENT);
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_get(gt_fmu *f, const unsigned int *references, size_t n, double *values)
{
    gt_fmu_result result = GT_FMU_OK;
    int computed = 0;
    size_t k;

    if ((n > 0U) && ((references == NULL) || (values == NULL))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "GetFloat64", "a pointer is NULL");
    }
    for (k = 0U; k < n; k++) {
        if (references[k] >= (unsigned int)GT_FMU_REALS) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "GetFloat64", "no number has this value reference");
        }
        computed |= (gt_fmu_kinds[references[k]] == GT_FMU_COMPUTED) ? 1 : 0;
    }
    if (computed != 0) {
        result = gt_fmu_in(f, (int)GT_FMU_INITIALIZATION + GT_FMU_RUNNING + (int)GT_FMU_TERMINATED, "GetFloat64");
        if (result == GT_FMU_OK) {
            result = fresh(f, "GetFloat64");
        }
    }
    for (k = 0U; (k < n) && (result == GT_FMU_OK); k++) {
        values[k] = f->data.v[references[k]];
    }
    return result;
}

/* Whether a variable of this kind may be set now. */
static int settable(const gt_fmu *f, unsigned char kind)
{
    int modes = 0;

    if (kind == GT_FMU_FIXED) {
        modes = (int)GT_FMU_BEFORE;
    } else if (kind == GT_FMU_STATE) {
        /* importers of model exchange set states one by one too */
        modes = (int)GT_FMU_BEFORE + (int)GT_FMU_EVENT + (int)GT_FMU_CONTINUOUS;
    } else if (kind == GT_FMU_TUNABLE) {
        modes = (int)GT_FMU_BEFORE + (int)GT_FMU_EVENT + (int)GT_FMU_STEPPING;
    } else if (kind == GT_FMU_INPUT) {
        modes = (int)GT_FMU_BEFORE + GT_FMU_RUNNING;
    }
    return f->data.mode & modes;
}

#ifdef GT_FMU_PARAMETERS
int gt_fmu_within(unsigned int reference, double value)
{
    const unsigned int first = (unsigned int)GT_FMU_FIRST_PARAMETER;
    const double *limits;

    if ((reference < first) || (reference >= (first + (unsigned int)GT_FMU_PARAMETERS))) {
        return 1;
    }
    limits = gt_fmu_limits[reference - first];
    return ((value >= limits[0]) && (value <= limits[1])) ? 1 : 0;
}

#endif /* GT_FMU_PARAMETERS */
/* What begins with parameters begins anew when one is set during initialisation; no start with them, no change. */
static gt_fmu_result begun(gt_fmu *f, const unsigned int *references, size_t n, const double *values)
{
    double v[GT_FMU_REALS];
    gt_fmu_memory memory = f->data.kept;
    gt_fmu_result result;
    size_t k;

    gt_copy(v, f->data.v, GT_FMU_REALS);
    for (k = 0U; k < n; k++) {
        v[references[k]] = values[k];
    }
    result = judged(f, gt_fmu_begin(&memory, v), "SetFloat64");
    if (result == GT_FMU_OK) {
        f->data.kept = memory;
        gt_copy(f->data.v, v, GT_FMU_REALS);
    }
    return result;
}

gt_fmu_result gt_fmu_set(gt_fmu *f, const unsigned int *references, size_t n, const double *values)
{
    int fixed = 0;
    size_t k;

    if ((n > 0U) && ((references == NULL) || (values == NULL))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFloat64", "a pointer is NULL");
    }
    for (k = 0U; k < n; k++) {
        if (references[k] >= (unsigned int)GT_FMU_REALS) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFloat64", "no number has this value reference");
        }
        if (settable(f, gt_fmu_kinds[references[k]]) == 0) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFloat64", "this variable cannot be set, or not in this mode");
        }
        if (!(fabs(values[k]) <= DBL_MAX)) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFloat64", gt_status_sentence(GT_NOT_FINITE));
        }
#ifdef GT_FMU_PARAMETERS
        if (gt_fmu_within(references[k], values[k]) == 0) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFloat64",
                                 "this parameter is below its least value or above its greatest one");
        }
#endif /* GT_FMU_PARAMETERS */
        fixed |= (gt_fmu_kinds[references[k]] == GT_FMU_FIXED) ? 1 : 0;
    }
    if ((fixed != 0) && (f->data.mode == (int)GT_FMU_INITIALIZATION)) {
        const gt_fmu_result result = begun(f, references, n, values);

        if (result != GT_FMU_OK) {
            return result;
        }
    }
    for (k = 0U; k < n; k++) {
        f->data.v[references[k]] = values[k];
        f->data.stale = 1;
    }
    return GT_FMU_OK;
}

/* The place of an integer, or -1. */
static int place_of(unsigned int reference)
{
    const unsigned int first = (unsigned int)GT_FMU_REALS;

    if ((reference < first) || (reference >= (first + (unsigned int)GT_FMU_INTEGERS))) {
        return -1;
    }
    return (int)(reference - first);
}

gt_fmu_result gt_fmu_get_integers(gt_fmu *f, const unsigned int *references, size_t n, int *values)
{
    size_t k;

    if ((n > 0U) && ((references == NULL) || (values == NULL))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "GetInt32", "a pointer is NULL");
    }
    for (k = 0U; k < n; k++) {
        if (place_of(references[k]) < 0) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "GetInt32", "no integer has this value reference");
        }
    }
    if ((GT_FMU_HOLD != 0) && (f->data.mode != (int)GT_FMU_INSTANTIATED) && (n > 0U)) {
        (void)fresh(f, "GetInt32");
    }
    for (k = 0U; k < n; k++) {
        values[k] = f->data.n[place_of(references[k])];
    }
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_set_integers(gt_fmu *f, const unsigned int *references, size_t n, const int *values)
{
    size_t k;

    if ((n > 0U) && ((references == NULL) || (values == NULL))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "SetInt32", "a pointer is NULL");
    }
    for (k = 0U; k < n; k++) {
        if (place_of(references[k]) < 0) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetInt32", "no integer has this value reference");
        }
        if (settable(f, gt_fmu_kinds[references[k]]) == 0) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, "SetInt32", "this variable cannot be set, or not in this mode");
        }
    }
    for (k = 0U; k < n; k++) {
        f->data.n[place_of(references[k])] = values[k];
        f->data.stale = 1;
    }
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_set_time(gt_fmu *f, double time)
{
    if (gt_fmu_in(f, (int)GT_FMU_CONTINUOUS + (int)GT_FMU_EVENT, "SetTime") != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    if (!(fabs(time) <= DBL_MAX)) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "SetTime", gt_status_sentence(GT_NOT_FINITE));
    }
    f->data.v[0] = time;
    f->data.stale = 1;
    return GT_FMU_OK;
}

/* GT_FMU_ERROR unless there is a place for all continuous states. */
static gt_fmu_result counted(const gt_fmu *f, const double *x, size_t n, const char *call)
{
    if ((n != (size_t)GT_FMU_STATES) || ((x == NULL) && (n > 0U))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "the number of continuous states is another one");
    }
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_set_states(gt_fmu *f, const double *x, size_t n)
{
    if ((gt_fmu_in(f, (int)GT_FMU_CONTINUOUS, "SetContinuousStates") != GT_FMU_OK) ||
        (counted(f, x, n, "SetContinuousStates") != GT_FMU_OK)) {
        return GT_FMU_ERROR;
    }
    if (gt_all_finite(x, (int)n) == 0) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "SetContinuousStates", gt_status_sentence(GT_NOT_FINITE));
    }
    gt_fmu_scatter(f->data.v, x);
    f->data.stale = 1;
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_get_states(const gt_fmu *f, double *x, size_t n)
{
    if (counted(f, x, n, "GetContinuousStates") != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    gt_fmu_gather(f->data.v, x);
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_get_derivatives(gt_fmu *f, double *dx, size_t n)
{
    gt_fmu_result result;

    if ((gt_fmu_in(f, (int)GT_FMU_INITIALIZATION + GT_FMU_RUNNING, "GetContinuousStateDerivatives") != GT_FMU_OK) ||
        (counted(f, dx, n, "GetContinuousStateDerivatives") != GT_FMU_OK)) {
        return GT_FMU_ERROR;
    }
    result = fresh(f, "GetContinuousStateDerivatives");
    if (result == GT_FMU_OK) {
        gt_fmu_rates(f->data.v, dx);
    }
    return result;
}

gt_fmu_result gt_fmu_get_nominals(const gt_fmu *f, double *x, size_t n)
{
    if (counted(f, x, n, "GetNominalsOfContinuousStates") != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    gt_copy(x, gt_fmu_nominals, (int)n);
    return GT_FMU_OK;
}

gt_fmu_result gt_fmu_completed(gt_fmu *f)
{
    gt_fmu_result result = gt_fmu_in(f, (int)GT_FMU_CONTINUOUS, "CompletedIntegratorStep");

    if ((result == GT_FMU_OK) && (GT_FMU_REMEMBERS != 0)) {
        result = fresh(f, "CompletedIntegratorStep");
        if (result == GT_FMU_OK) {
            f->data.kept = f->data.tried;
        }
    }
    return result;
}

gt_fmu_result gt_fmu_slope(gt_fmu *f, const unsigned int *unknowns, size_t n, const unsigned int *knowns, size_t m,
                           const double *seed, double *result, int adjoint)
{
    static const char call[] = "GetDirectionalDerivative";
    double given[GT_FMU_REALS] = {0.0};
    double made[GT_FMU_REALS] = {0.0};
    const unsigned int *const from = (adjoint != 0) ? unknowns : knowns;
    const unsigned int *const to = (adjoint != 0) ? knowns : unknowns;
    const size_t froms = (adjoint != 0) ? n : m;
    const size_t tos = (adjoint != 0) ? m : n;
    gt_fmu_result good;
    size_t k;

    if (((n > 0U) && (unknowns == NULL)) || ((m > 0U) && (knowns == NULL)) || ((froms > 0U) && (seed == NULL)) ||
        ((tos > 0U) && (result == NULL))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "a pointer is NULL");
    }
    if (GT_FMU_SLOPES == 0) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "this model has no derivatives");
    }
    if (gt_fmu_in(f, (int)GT_FMU_INITIALIZATION + GT_FMU_RUNNING, call) != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    for (k = 0U; k < n; k++) {
        if ((unknowns[k] >= (unsigned int)GT_FMU_REALS) || (gt_fmu_rate[unknowns[k]] == 0U)) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, call, "an unknown is not computed");
        }
    }
    for (k = 0U; k < m; k++) {
        if ((knowns[k] >= (unsigned int)GT_FMU_REALS) || (gt_fmu_kinds[knowns[k]] == GT_FMU_COMPUTED)) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, call, "a known is computed");
        }
    }
    for (k = 0U; k < froms; k++) {
        if (!(fabs(seed[k]) <= DBL_MAX)) {
            return gt_fmu_refuse(f, GT_FMU_ERROR, call, gt_status_sentence(GT_NOT_FINITE));
        }
        given[from[k]] += seed[k];
    }
    good = fresh(f, call);
    if ((good == GT_FMU_OK) && (f->data.last != (int)GT_OK)) {
        return gt_fmu_refuse(f, GT_FMU_DISCARD, call, "there is no derivative where outputs are held");
    }
    if (good == GT_FMU_OK) {
        good = judged(f, gt_fmu_along(&f->data.tried, f->data.v, given, made, adjoint), call);
    }
    for (k = 0U; (k < tos) && (good == GT_FMU_OK); k++) {
        result[k] = made[to[k]];
    }
    return good;
}

/* FNV-1a, of a saved state: bytes that were changed must not come back as values. */
static void check_sum(const unsigned char *bytes, size_t n, unsigned char *sum)
{
    unsigned long hash = 2166136261UL;
    size_t k;

    for (k = 0U; k < n; k++) {
        hash = ((hash ^ (unsigned long)bytes[k]) * 16777619UL) & 0xFFFFFFFFUL;
    }
    for (k = 0U; k < SUM_BYTES; k++) {
        sum[k] = (unsigned char)((hash >> (8U * k)) & 0xFFUL);
    }
}

gt_fmu_result gt_fmu_restore(gt_fmu *f, const gt_fmu_data *data)
{
    const int other = (f->co_simulation != 0) ? (int)GT_FMU_EVENT + (int)GT_FMU_CONTINUOUS : (int)GT_FMU_STEPPING;

    if ((data->mode & other) != 0) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, "SetFMUState", "this state is one of the other interface");
    }
    (void)memcpy(&f->data, data, sizeof(gt_fmu_data));
    return GT_FMU_OK;
}

size_t gt_fmu_bytes(void)
{
    return TOKEN_BYTES + sizeof(gt_fmu_data) + SUM_BYTES;
}

void gt_fmu_pack(const gt_fmu_data *data, unsigned char *bytes)
{
    (void)memcpy(bytes, GT_FMU_TOKEN, TOKEN_BYTES);
    (void)memcpy(&bytes[TOKEN_BYTES], data, sizeof(gt_fmu_data));
    check_sum(bytes, TOKEN_BYTES + sizeof(gt_fmu_data), &bytes[TOKEN_BYTES + sizeof(gt_fmu_data)]);
}

gt_fmu_result gt_fmu_unpack(const gt_fmu *f, const unsigned char *bytes, size_t n, gt_fmu_data *data)
{
    static const char call[] = "DeserializeFMUState";
    gt_fmu_data there;
    unsigned char sum[SUM_BYTES];

    if ((n != gt_fmu_bytes()) || (memcmp(bytes, GT_FMU_TOKEN, TOKEN_BYTES) != 0)) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "these bytes are no state of this model");
    }
    (void)memcpy(&there, &bytes[TOKEN_BYTES], sizeof(there));
    check_sum(bytes, n - SUM_BYTES, sum);
    if ((memcmp(sum, &bytes[n - SUM_BYTES], SUM_BYTES) != 0) || (gt_all_finite(there.v, GT_FMU_REALS) == 0) ||
        (there.mode < (int)GT_FMU_INSTANTIATED) || (there.mode > (int)GT_FMU_TERMINATED) || ((there.mode & (there.mode - 1)) != 0)) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "these bytes are a broken state");
    }
#ifdef GT_FMU_PARAMETERS
    {
        unsigned int k;

        for (k = 0U; k < (unsigned int)GT_FMU_REALS; k++) {
            if (gt_fmu_within(k, there.v[k]) == 0) {
                return gt_fmu_refuse(f, GT_FMU_ERROR, call, "a parameter in this state is outside of its limits");
            }
        }
    }
#endif /* GT_FMU_PARAMETERS */
    *data = there;
    return GT_FMU_OK;
}
