/* One number of a reading, for gt_filter.h: the columns of the covariance that it reaches, its gain, its gate. */
#ifndef GT_FILTER_NUMBER_H
#define GT_FILTER_NUMBER_H

#include "gt_filter_matrix.h"

/* Column c of the covariance, of which the lower triangle is given. */
static inline void gt_filter_column(const gt_filter *f, const double *covariance, int c, double *column)
{
    int i;

    const double *from = &covariance[c * f->stride];

    column[f->stride - 1] = 0.0;
    for (i = 0; i < c; i += 2) {
        const double first = from[i];
        const double second = from[i + 1];

        column[i] = first;
        column[i + 1] = second;
    }
    from = &from[c];
    for (i = c; i < f->errors; i++) {
        column[i] = *from;
        from = &from[f->stride];
    }
}

/* b = P h' for one row of an H; the columns of P that it takes stay in work->columns. */
static GT_FILTER_OFTEN void gt_filter_reach(const gt_filter *f, const double *covariance, const int *column, const double *value,
                                   int entries, double *b, const gt_filter_work *work)
{
    int j;
    int k;

    for (k = 0; k < entries; k++) {
        gt_filter_column(f, covariance, column[k], &work->columns[k * f->stride]);
    }
    for (j = 0; j < f->stride; j += 2) {
        const double first = value[0] * work->columns[j];
        const double second = value[0] * work->columns[j + 1];

        b[j] = first;
        b[j + 1] = second;
    }
    for (k = 1; k < entries; k++) {
        const double *own = &work->columns[k * f->stride];
        const double factor = value[k];

        for (j = 0; j < f->stride; j += 2) {
            const double first = b[j] + (factor * own[j]);
            const double second = b[j + 1] + (factor * own[j + 1]);

            b[j] = first;
            b[j + 1] = second;
        }
    }
}

/* 1 if the gate of a sensor is closed: its normalised innovation squared, alone and before any other reading is used,
 * lies above the limit, or is no number. */
static GT_FILTER_ONCE int gt_filter_gated(const gt_filter *f, const gt_filter_sensor *sensor, const double *covariance,
                                  const double *lever, const double *residual, const gt_filter_work *work)
{
    const gt_filter_matrix *matrix = &sensor->jacobian;
    const int m = matrix->rows;
    double *spread = work->square; /* m by m, then Cholesky's factor */
    double *white = work->other;
    double *b = work->vectors;
    double nis = 0.0;
    int i;
    int j;
    int k;

    for (i = 0; i < m; i++) {
        const int first = matrix->start[i];

        gt_filter_reach(f, covariance, &matrix->column[first], &lever[first], matrix->start[i + 1] - first, b, work);
        for (j = 0; j <= i; j++) {
            double sum = (j == i) ? sensor->variance[i] : 0.0;

            for (k = matrix->start[j]; k < matrix->start[j + 1]; k++) {
                sum += lever[k] * b[matrix->column[k]];
            }
            spread[(i * m) + j] = sum;
        }
    }
    for (i = 0; i < m; i++) {
        double sum;

        for (j = 0; j < i; j++) {
            sum = spread[(i * m) + j];
            for (k = 0; k < j; k++) {
                sum -= spread[(i * m) + k] * spread[(j * m) + k];
            }
            spread[(i * m) + j] = sum / spread[(j * m) + j];
        }
        sum = spread[(i * m) + i];
        for (k = 0; k < i; k++) {
            sum -= spread[(i * m) + k] * spread[(i * m) + k];
        }
        spread[(i * m) + i] = sqrt(fabs(sum));
        sum = residual[i];
        for (k = 0; k < i; k++) {
            sum -= spread[(i * m) + k] * white[k];
        }
        white[i] = sum / spread[(i * m) + i];
        nis += white[i] * white[i];
    }
    return (nis <= sensor->gate) ? 0 : 1;
}

/* One number of a reading: the error and the covariance after it. Returns its share of the normalised innovation
 * squared. */
static GT_FILTER_OFTEN double gt_filter_use(const gt_filter *f, const int *column, const double *value, int entries,
                                   double variance, double residual, double *covariance, double *error,
                                   const gt_filter_work *work)
{
    double *b = work->vectors;
    double *gain = &b[f->stride];
    double *rest = &gain[f->stride];
    double s = variance;
    double inverse;
    size_t m;
    size_t n;
    int j;
    int k;

    gt_filter_reach(f, covariance, column, value, entries, b, work);
    for (k = 0; k < entries; k++) {
        s += value[k] * b[column[k]];
        residual -= value[k] * error[column[k]];
    }
    inverse = 1.0 / s;
    for (j = 0; j < f->stride; j += 2) {
        const double first = b[j] * inverse;
        const double second = b[j + 1] * inverse;

        gain[j] = first;
        gain[j + 1] = second;
        rest[j] = variance * first;
        rest[j + 1] = variance * second;
    }
    for (k = 0; k < entries; k++) {
        const double *own = &work->columns[k * f->stride];
        const double factor = value[k];
        const double reach = b[column[k]];

        for (j = 0; j < f->stride; j += 2) {
            const double first = rest[j] - (factor * (own[j] - (gain[j] * reach)));
            const double second = rest[j + 1] - (factor * (own[j + 1] - (gain[j + 1] * reach)));

            rest[j] = first;
            rest[j + 1] = second;
        }
    }
    for (j = 0; j < f->stride; j += 2) {
        const double first = error[j] + (gain[j] * residual);
        const double second = error[j + 1] + (gain[j + 1] * residual);

        error[j] = first;
        error[j + 1] = second;
    }
    for (n = 0U; n < (size_t)f->errors; n++) {
        double *row = &covariance[n * (size_t)f->stride];
        const double left = gain[n];
        const double right = rest[n];

        for (m = 0U; m <= n; m += 2U) {
            const double first = (row[m] - (left * b[m])) + (right * gain[m]);
            const double second = (row[m + 1U] - (left * b[m + 1U])) + (right * gain[m + 1U]);

            row[m] = first;
            row[m + 1U] = second;
        }
    }
    return (residual * residual) * inverse;
}

#endif
