/* Products of sparse matrices with dense ones, and Cholesky's factor, for gt_filter.h. */
#ifndef GT_FILTER_MATRIX_H
#define GT_FILTER_MATRIX_H

#include "gt_filter_types.h"

/* Where a kernel is to write the changing entries of a matrix: in place where all of them change. */
static GT_SHARED double *gt_filter_target(const gt_filter_matrix *matrix, double *changing, double *value)
{
    return (matrix->changing == matrix->entries) ? value : changing;
}

/* The entries of a matrix: constant ones, and those that a kernel gave. */
static GT_FILTER_OFTEN void gt_filter_fill(const gt_filter_matrix *matrix, const double *changing, double *value)
{
    int k;

    if (matrix->changing < matrix->entries) {
        for (k = 0; k < matrix->entries; k++) {
            value[k] = matrix->value[k];
        }
        for (k = 0; k < matrix->changing; k++) {
            value[matrix->place[k]] = changing[k];
        }
    }
}

static GT_FILTER_OFTEN void gt_filter_multiply(const gt_filter_product *product, const double *left, const double *right,
                                         double *result)
{
    const int *a = product->left;
    const int *b = product->right;
    int n;

    for (n = 0; n < product->entries; n++) {
        const int *end = &product->left[product->start[n + 1]];
        double sum = 0.0;

        while (a < end) {
            sum += left[*a] * right[*b];
            a++;
            b++;
        }
        result[n] = sum;
    }
}

/* to = matrix from, row by row of `stride` numbers, an even one; `lower`: of each row no more than what stands up to its
 * diagonal. */
static GT_FILTER_OFTEN void gt_filter_rows(const gt_filter_matrix *matrix, int stride, const double *value,
                                           const double *from, double *to, int lower)
{
    size_t i;
    size_t j;
    int k = 0;

    for (i = 0U; i < (size_t)matrix->rows; i++) {
        const size_t width = (lower != 0) ? (i + 1U) : (size_t)stride;
        const int end = matrix->start[i + 1U];
        double *row = &to[i * (size_t)stride];

        if (k < end) {
            const double *other = &from[matrix->column[k] * stride];
            const double factor = value[k];

            for (j = 0U; j < width; j += 2U) {
                const double first = factor * other[j];
                const double second = factor * other[j + 1U];

                row[j] = first;
                row[j + 1U] = second;
            }
            k++;
        } else {
            for (j = 0U; j < width; j++) {
                row[j] = 0.0;
            }
        }
        /* two terms in one pass */
        for (; (k + 1) < end; k += 2) {
            const double *other = &from[matrix->column[k] * stride];
            const double *next = &from[matrix->column[k + 1] * stride];
            const double factor = value[k];
            const double second = value[k + 1];

            for (j = 0U; j < width; j += 2U) {
                const double a = (row[j] + (factor * other[j])) + (second * next[j]);
                const double b = (row[j + 1U] + (factor * other[j + 1U])) + (second * next[j + 1U]);

                row[j] = a;
                row[j + 1U] = b;
            }
        }
        if (k < end) {
            const double *other = &from[matrix->column[k] * stride];
            const double factor = value[k];

            for (j = 0U; j < width; j += 2U) {
                const double a = row[j] + (factor * other[j]);
                const double b = row[j + 1U] + (factor * other[j + 1U]);

                row[j] = a;
                row[j + 1U] = b;
            }
            k++;
        }
    }
}

/* P = F P F' + Q, both triangles given, the lower one made. */
static GT_FILTER_OFTEN void gt_filter_spread(const gt_filter *f, double *covariance, const gt_filter_work *work)
{
    const int stride = f->stride;
    double *half = work->square;
    double *turned = work->other;
    int i;
    int j;

    gt_filter_rows(&f->transition, stride, work->transition, covariance, half, 0);
    for (i = 0; i < f->errors; i++) {
        const double *from = &half[i * stride];
        double *to = &turned[i];

        turned[(i * stride) + stride - 1] = 0.0;
        for (j = 0; j < f->errors; j++) {
            *to = from[j];
            to = &to[stride];
        }
    }
    gt_filter_rows(&f->transition, stride, work->transition, turned, covariance, 1);
    for (i = 0; i < f->noise.entries; i++) {
        covariance[f->noise.column[i]] += work->noise[i];
    }
}

/* The lower triangle copied into the upper one. */
static GT_FILTER_OFTEN void gt_filter_mirror(const gt_filter *f, double *covariance)
{
    int i;
    int j;

    for (i = 0; i < f->errors; i++) {
        for (j = 0; j < i; j++) {
            covariance[(j * f->stride) + i] = covariance[(i * f->stride) + j];
        }
        for (j = f->errors; j < f->stride; j++) {
            covariance[(i * f->stride) + j] = 0.0;
        }
    }
}

/* GT_OK where the covariance is positive, GT_SINGULAR or GT_NOT_FINITE where not: whether Cholesky's factor exists of
 * its lower triangle with each variance made smaller by what round-off can do, which proves it. Rump 2006, BIT 46. */
static GT_FILTER_OFTEN gt_status gt_filter_positive(const gt_filter *f, const double *covariance, const gt_filter_work *work)
{
    const size_t n = (size_t)f->errors;
    const size_t stride = (size_t)f->stride;
    const double *from = covariance; /* then what is left of it */
    double *rest = work->square;
    double *one = work->vectors;
    double *two = &one[stride];
    gt_status status = GT_OK;
    size_t i;
    size_t j;
    size_t k;

    for (k = 0U; k < stride; k++) {
        one[k] = 0.0;
        two[k] = 0.0;
    }
    /* two columns at a time */
    for (k = 0U; (k < n) && (status == GT_OK); k += 2U) {
        const double *row = &from[k * stride];
        const double *next = (k + 1U < n) ? &row[stride] : row;
        const double *given = &covariance[k * (stride + 1U)];
        const double pivot = row[k] - (f->pivot * given[0]);
        const double scale = 1.0 / sqrt(fabs(pivot));
        const double below = next[k] * scale;
        const double second =
            (k + 1U < n) ? ((next[k + 1U] - (below * below)) - (f->pivot * given[stride + 1U])) : pivot;
        const double inverse = 1.0 / sqrt(fabs(second));

        if (!(fabs(pivot) <= DBL_MAX)) {
            status = GT_NOT_FINITE;
        } else if (!(pivot > 0.0)) {
            status = GT_SINGULAR;
        } else if (!(fabs(second) <= DBL_MAX)) {
            status = GT_NOT_FINITE;
        } else if (!(second > 0.0)) {
            status = GT_SINGULAR;
        } else {
            for (i = k + 2U; i < n; i++) {
                const double *own = &from[i * stride];
                double *to = &rest[i * stride];
                const double left = own[k] * scale;
                const double right = (own[k + 1U] - (left * below)) * inverse;

                one[i] = left;
                two[i] = right;
                for (j = k + 2U; j <= i; j += 2U) {
                    const double a = (own[j] - (left * one[j])) - (right * two[j]);
                    const double b = (own[j + 1U] - (left * one[j + 1U])) - (right * two[j + 1U]);

                    to[j] = a;
                    to[j + 1U] = b;
                }
            }
        }
        from = rest;
    }
    return status;
}

#endif
