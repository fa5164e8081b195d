/* See gt_fmu.h: the step of co-simulation, and samples.
 *
 * Continuous states go on by the classical method of Runge and Kutta in equal parts no longer than GT_FMU_STEP; samples
 * are taken at the start and one period after the other, each with the inputs that are there then.
 */
#include "gt_fmu.h"

#include "gt_guard.h"

#include <math.h>

#define WIDTH (GT_FMU_STATES + 1)
/* More parts than this in one call are a mistake in the units of time. */
#define MOST_PARTS 1e7
/* Two times that differ by less than this, over their size or one second, are the same. */
#define SAME_TIME 1e-9
/* and less than this of a step, as of one that was left out late in a run; but for a few roundings of the time. */
#define SAME_STEP 1e-3
#define ROUNDED (4.0 * DBL_EPSILON)
/* A step that ends within this part of a period, or half its length, behind a sample ends at it: what an importer adds
 * up is off by up to n^2 h 1e-16 behind n steps h. */
#define SAME_SAMPLE 1e-3

/* Rates of the states at x; `tried` begins with what is remembered. */
static gt_status rates(const gt_fmu_data *d, double *v, const double *x, double *dx, gt_fmu_memory *tried)
{
    gt_status status;

    *tried = d->kept;
    gt_fmu_scatter(v, x);
    status = gt_fmu_compute(tried, v);
    if (status == GT_OK) {
        gt_fmu_rates(v, dx);
    }
    return status;
}

/* Brings the outputs to a time; what led there is remembered. All is written with GT_OK only. */
static gt_status current(gt_fmu_data *d, double time)
{
    gt_fmu_memory tried = d->kept;
    const double before = d->v[0];
    gt_status status;

    if ((d->stale == 0) && (GT_FMU_TIMED == 0)) {
        d->kept = d->tried;
        d->v[0] = time;
        return GT_OK;
    }
    d->v[0] = time;
    status = gt_fmu_compute(&tried, d->v);
    if (status == GT_OK) {
        d->tried = tried;
        d->kept = tried;
        d->stale = 0;
    } else {
        d->v[0] = before;
    }
    return status;
}

#ifdef GT_FMU_PARAMETERS
/* No status of a function: a part that is too long. */
#define TOO_LONG ((gt_status)100)

#endif /* GT_FMU_PARAMETERS */
/* One part of length h from a point whose outputs are up to date; all is written with GT_OK only. */
static gt_status moved(gt_fmu_data *d, double h, double end)
{
    double v[GT_FMU_REALS];
    double x[WIDTH];
    double y[WIDTH];
    double k[4][WIDTH];
    gt_fmu_memory tried = d->tried;
    const double begin = d->v[0];
    gt_status status;
    int i;

    gt_copy(v, d->v, GT_FMU_REALS);
    gt_fmu_gather(v, x);
    gt_fmu_rates(v, k[0]);
    for (i = 0; i < GT_FMU_STATES; i++) {
        y[i] = x[i] + ((0.5 * h) * k[0][i]);
    }
    v[0] = begin + (0.5 * h);
    status = rates(d, v, y, k[1], &tried);
    if (status != GT_OK) {
        return status;
    }
    for (i = 0; i < GT_FMU_STATES; i++) {
        y[i] = x[i] + ((0.5 * h) * k[1][i]);
    }
    status = rates(d, v, y, k[2], &tried);
    if (status != GT_OK) {
        return status;
    }
    for (i = 0; i < GT_FMU_STATES; i++) {
        y[i] = x[i] + (h * k[2][i]);
    }
    v[0] = end;
    status = rates(d, v, y, k[3], &tried);
    if (status != GT_OK) {
        return status;
    }
    for (i = 0; i < GT_FMU_STATES; i++) {
        y[i] = x[i] + ((h / 6.0) * ((k[0][i] + k[3][i]) + (2.0 * (k[1][i] + k[2][i]))));
    }
    if (gt_all_finite(y, GT_FMU_STATES) == 0) {
        return GT_NOT_FINITE;
    }
    status = rates(d, v, y, k[0], &tried);
    if (status == GT_OK) {
        gt_copy(d->v, v, GT_FMU_REALS);
        d->kept = tried;
        d->tried = tried;
        d->stale = 0;
    }
    return status;
}

#ifdef GT_FMU_PARAMETERS
/* Whether a part went wrong: where a state, over its size or one, ends farther than GT_FMU_PART_ERROR from where two
 * halves do. The longest part was chosen at the start values of parameters; rates within one part do not tell of a
 * friction that turns in its first half. */
static int is_rough(gt_fmu_data halves, const gt_fmu_data *whole, double h, double end)
{
    double x[WIDTH];
    double y[WIDTH];
    int rough = 0;
    int i;

    if ((moved(&halves, 0.5 * h, halves.v[0] + (0.5 * h)) != GT_OK) || (moved(&halves, 0.5 * h, end) != GT_OK)) {
        return 1;
    }
    gt_fmu_gather(whole->v, x);
    gt_fmu_gather(halves.v, y);
    for (i = 0; i < GT_FMU_STATES; i++) {
        rough |= (fabs(x[i] - y[i]) <= (GT_FMU_PART_ERROR * fmax(1.0, fabs(y[i])))) ? 0 : 1;
    }
    return rough;
}

#endif /* GT_FMU_PARAMETERS */
/* The same, and not too long. */
static gt_status part(gt_fmu_data *d, double h, double end)
{
#ifdef GT_FMU_PARAMETERS
    const gt_fmu_data before = *d;
#endif /* GT_FMU_PARAMETERS */
    const gt_status status = moved(d, h, end);

#ifdef GT_FMU_PARAMETERS
    if ((status == GT_OK) && (is_rough(before, d, h, end) != 0)) {
        *d = before;
        return TOO_LONG;
    }
#endif /* GT_FMU_PARAMETERS */
    return status;
}

/* Instant of a sample. */
static double instant(const gt_fmu_data *d)
{
    return d->began + ((double)d->samples * GT_FMU_PERIOD);
}

/* The sample that is due; what it writes it writes with GT_OK only. */
static gt_status sample(gt_fmu_data *d)
{
    gt_fmu_memory kept = d->kept;
    const gt_status status = gt_fmu_sample(&kept, d->v, d->n);

    if (status == GT_OK) {
        d->kept = kept;
        d->tried = kept;
        d->samples++;
    }
    return status;
}

/* How far apart two times may be that are meant to be the same, between steps of length h. */
static double slack(double time, double h)
{
    return fmax(fmin(SAME_TIME * fmax(1.0, fabs(time)), SAME_STEP * h), ROUNDED * fabs(time));
}

static gt_fmu_result ended(const gt_fmu *f, gt_status status, const char *call)
{
    return (status == GT_OK) ? GT_FMU_OK : gt_fmu_refuse(f, GT_FMU_DISCARD, call, gt_status_sentence(status));
}

gt_fmu_result gt_fmu_update(gt_fmu *f, int *defined, double *next)
{
    gt_fmu_data *const d = &f->data;
    const double near = SAME_TIME * GT_FMU_PERIOD;
    gt_fmu_result result = gt_fmu_in(f, (int)GT_FMU_EVENT, "UpdateDiscreteStates");

    *defined = 0;
    *next = 0.0;
    if ((result != GT_FMU_OK) || !(GT_FMU_PERIOD > 0.0)) {
        return result;
    }
    if (d->v[0] >= (instant(d) - near)) {
        result = ended(f, sample(d), "UpdateDiscreteStates");
    }
    *defined = (result == GT_FMU_OK) ? 1 : 0;
    *next = instant(d);
    return result;
}

/* Samples up to the end of the step, which itself belongs to the next one. */
static gt_status sampled(gt_fmu_data *d, double h, double end, double *reached)
{
    const double near = fmin(SAME_SAMPLE * GT_FMU_PERIOD, 0.5 * h);

    while (instant(d) < (end - near)) {
        const double due = instant(d);
        gt_status status;

        if (due > d->v[0]) {
            d->v[0] = due;
        }
        status = sample(d);
        *reached = d->v[0];
        if (status != GT_OK) {
            return status;
        }
    }
    d->v[0] = end;
    return GT_OK;
}

gt_fmu_result gt_fmu_advance(gt_fmu *f, double from, double h, double *reached)
{
    static const char call[] = "DoStep";
    gt_fmu_data *const d = &f->data;
    const double start = d->v[0];
    const double finest = (GT_FMU_PERIOD > 0.0) ? GT_FMU_PERIOD : GT_FMU_STEP;
    gt_status status = GT_OK;

    if (gt_fmu_in(f, (int)GT_FMU_STEPPING, call) != GT_FMU_OK) {
        return GT_FMU_ERROR;
    }
    if (!(h > 0.0) || !(h <= (MOST_PARTS * finest))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "the length of the step is not positive, or far too large");
    }
    if (!(fabs(from - start) <= slack(start, h)) || !((from + h) > start)) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "the step does not begin where the last one ended");
    }
    if (!((from + h) <= (d->stop + slack(d->stop, h)))) {
        return gt_fmu_refuse(f, GT_FMU_ERROR, call, "the step ends past the stop time");
    }
    *reached = start;
    if (GT_FMU_PERIOD > 0.0) {
        status = sampled(d, h, from + h, reached);
    } else if (GT_FMU_HOLD != 0) {
        d->kept = (d->stale == 0) ? d->tried : d->kept;
        d->v[0] = from + h;
        d->stale = 1;
    } else if (GT_FMU_STATES == 0) {
        status = current(d, from + h);
    } else {
        const int parts = (int)fmax(1.0, ceil((h / GT_FMU_STEP) * (1.0 - SAME_TIME)));
        int n;

        status = current(d, start);
        for (n = 0; (n < parts) && (status == GT_OK); n++) {
            const double end = (n == (parts - 1)) ? (from + h) : (from + ((h * (double)(n + 1)) / (double)parts));

            status = part(d, h / (double)parts, end);
            *reached = d->v[0];
        }
    }
#ifdef GT_FMU_PARAMETERS
    if (status == TOO_LONG) {
        d->last = (int)GT_NOT_CONVERGED;
        d->reached = *reached;
        d->stuck = (*reached > start) ? 0 : 1;
        return gt_fmu_refuse(f, GT_FMU_DISCARD, call,
                             "the step inside is too long for these parameters or inputs; take shorter steps");
    }
#endif /* GT_FMU_PARAMETERS */
    d->last = (int)status;
    if (status == GT_OK) {
        *reached = d->v[0];
    }
    d->reached = *reached;
    d->stuck = (*reached > start) ? 0 : 1;
    return ended(f, status, call);
}
