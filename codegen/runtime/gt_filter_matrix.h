/* Products of sparse matrices with dense ones, and the factors of the covariance, for gt_filter.h. */
#ifndef GT_FILTER_MATRIX_H
#define GT_FILTER_MATRIX_H

#include "gt_filter_types.h"

/* The entries of a matrix: constant ones, and those that a kernel gave. */
static GT_SHARED void gt_filter_fill(const gt_filter_matrix *matrix, const double *changing, double *value)
{
    int k;

    for (k = 0; k < matrix->entries; k++) {
        value[k] = matrix->value[k];
    }
    for (k = 0; k < matrix->changing; k++) {
        value[matrix->place[k]] = changing[k];
    }
}

static GT_FILTER_OFTEN void gt_filter_multiply(const gt_filter_product *product, const double *left,
                                               const double *right, double *result)
{
    int n;
    int k = 0;

    for (n = 0; n < product->entries; n++) {
        const int end = product->start[n + 1];
        double sum = 0.0;

        for (; k < end; k++) {
            sum += left[product->left[k]] * right[product->right[k]];
        }
        result[n] = sum;
    }
}

/* to + the sum of `terms` vectors of `from`, each times a factor and a scale; of so many pairs of numbers. They begin
 * at these offsets, the factors lie `apart`. Three terms are added in one pass, one after the other. */
static GT_FILTER_OFTEN void gt_filter_sum(double *to, size_t pairs, const double *from, const int *offset,
                                          const double *factor, ptrdiff_t apart, const double *scale, int terms)
{
    const double *own = factor;
    size_t j;
    int k = 0;

    for (; (k + 2) < terms; k += 3) {
        const double *first = &from[offset[k]];
        const double *second = &from[offset[k + 1]];
        const double *third = &from[offset[k + 2]];
        const double a = own[0] * scale[k];
        const double b = own[apart] * scale[k + 1];
        const double c = own[2 * apart] * scale[k + 2];

        for (j = 0U; j < pairs; j++) {
            const size_t n = 2U * j;
            const double left = ((to[n] + (a * first[n])) + (b * second[n])) + (c * third[n]);
            const double right = ((to[n + 1U] + (a * first[n + 1U])) + (b * second[n + 1U])) + (c * third[n + 1U]);

            to[n] = left;
            to[n + 1U] = right;
        }
        own = &own[3 * apart];
    }
    for (; k < terms; k++) {
        const double *only = &from[offset[k]];
        const double a = own[0] * scale[k];

        for (j = 0U; j < pairs; j++) {
            const double left = to[2U * j] + (a * only[2U * j]);
            const double right = to[(2U * j) + 1U] + (a * only[(2U * j) + 1U]);

            to[2U * j] = left;
            to[(2U * j) + 1U] = right;
        }
        own = &own[apart];
    }
}

/* to = matrix from, row by row of so many pairs of numbers; the columns of the matrix tell where a row begins. */
static GT_FILTER_ONCE void gt_filter_rows(const gt_filter_matrix *matrix, size_t pairs, const double *value,
                                          const double *from, double *to)
{
    static const double one = 1.0;
    double *row = to;
    size_t n;
    int i;

    for (i = 0; i < matrix->rows; i++) {
        const int first = matrix->start[i];

        for (n = 0U; n < pairs; n++) {
            row[2U * n] = 0.0;
            row[(2U * n) + 1U] = 0.0;
        }
        gt_filter_sum(row, pairs, from, &matrix->column[first], &one, 0, &value[first], matrix->start[i + 1] - first);
        row = &row[2U * pairs];
    }
}

/* U D U' = F U D U' F' + Q, from the last column to the first. GT_NOT_FINITE or GT_SINGULAR where the sum is not
 * positive: a number of D is no more than round-off can make of the variance that it belongs to. */
static GT_FILTER_OFTEN gt_status gt_filter_spread(const gt_filter *f, const gt_filter_belief *belief,
                                                 const gt_filter_work *work)
{
    const gt_filter_matrix *matrix = &f->transition; /* column after column, without ones on the diagonal */
    const int last = f->errors - 1;
    const int stride = f->stride;
    double *moved = work->square; /* F U */
    double *before = work->vectors; /* D, then -D of what is made, both from the last one */
    double *after = &before[stride];
    double *to = moved;
    const double *from = belief->factor;
    gt_status status = GT_OK;
    size_t n;
    int i;
    int j;
    int k;

    for (j = 0; j <= last; j++) {
        for (n = 0U; n < ((size_t)stride / 2U); n++) {
            const double left = f->same[2U * n] * from[2U * n];
            const double right = f->same[(2U * n) + 1U] * from[(2U * n) + 1U];

            to[2U * n] = left;
            to[(2U * n) + 1U] = right;
        }
        i = 0;
        for (k = 0; k <= j; k++) {
            const double factor = from[k];

            for (; i < matrix->start[k + 1]; i++) {
                to[matrix->column[i]] += work->transition[i] * factor;
            }
        }
        before[last - j] = belief->diagonal[j];
        from = &from[stride];
        to = &to[stride];
    }
    moved = &moved[last * stride];
    for (j = last; (j >= 0) && (status == GT_OK); j--) {
        const size_t pairs = ((size_t)j / 2U) + 1U;
        double variance;
        double inverse;

        to = &belief->factor[j * stride];
        for (n = 0U; n < pairs; n++) {
            to[2U * n] = 0.0;
            to[(2U * n) + 1U] = 0.0;
        }
        for (i = f->noise.start[j]; i < f->noise.start[j + 1]; i++) {
            to[f->noise.column[i]] = work->noise[i];
        }
        gt_filter_sum(to, pairs, moved, f->back, &moved[j], -stride, before, f->reached[j]);
        variance = to[j];
        gt_filter_sum(to, pairs, &belief->factor[last * stride], f->back, &belief->factor[(last * stride) + j], -stride,
                      after, last - j);
        belief->diagonal[j] = to[j];
        after[last - j] = -to[j];
        inverse = 1.0 / to[j];
        if (!(fabs(to[j]) <= DBL_MAX)) {
            status = GT_NOT_FINITE;
        } else if (!(to[j] > (f->pivot * variance))) {
            status = GT_SINGULAR;
        } else {
            for (n = 0U; n < pairs; n++) {
                const double left = to[2U * n] * inverse;
                const double right = to[(2U * n) + 1U] * inverse;

                to[2U * n] = left;
                to[(2U * n) + 1U] = right;
            }
            to[(2U * pairs) - 1U] = 0.0;
            to[j] = 1.0;
        }
    }
    return status;
}

#endif
