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

/* to + the sum of `terms` vectors of `from`, each times a factor and a scale; of `width` numbers, an even one. They begin
 * at these offsets, the factors lie `apart`. Three terms are added in one pass, one after the other. */
static GT_FILTER_OFTEN void gt_filter_sum(double *to, size_t width, const double *from, const int *offset,
                                          const double *factor, int apart, const double *scale, int terms)
{
    size_t j;
    int k = 0;

    for (; (k + 2) < terms; k += 3) {
        const double *first = &from[offset[k]];
        const double *second = &from[offset[k + 1]];
        const double *third = &from[offset[k + 2]];
        const double a = factor[k * apart] * scale[k];
        const double b = factor[(k + 1) * apart] * scale[k + 1];
        const double c = factor[(k + 2) * apart] * scale[k + 2];

        for (j = 0U; j < width; j += 2U) {
            const double left = ((to[j] + (a * first[j])) + (b * second[j])) + (c * third[j]);
            const double right = ((to[j + 1U] + (a * first[j + 1U])) + (b * second[j + 1U])) + (c * third[j + 1U]);

            to[j] = left;
            to[j + 1U] = right;
        }
    }
    for (; k < terms; k++) {
        const double *only = &from[offset[k]];
        const double a = factor[k * apart] * scale[k];

        for (j = 0U; j < width; j += 2U) {
            const double left = to[j] + (a * only[j]);
            const double right = to[j + 1U] + (a * only[j + 1U]);

            to[j] = left;
            to[j + 1U] = right;
        }
    }
}

/* to = matrix from, row by row of `width` numbers, an even one; the columns of the matrix tell where a row begins. */
static GT_FILTER_ONCE void gt_filter_rows(const gt_filter_matrix *matrix, int width, const double *value,
                                          const double *from, double *to)
{
    static const double one = 1.0;
    double *row = to;
    int i;
    int j;

    for (i = 0; i < matrix->rows; i++) {
        const int first = matrix->start[i];

        for (j = 0; j < width; j++) {
            row[j] = 0.0;
        }
        gt_filter_sum(row, (size_t)width, from, &matrix->column[first], &one, 0, &value[first],
                      matrix->start[i + 1] - first);
        row = &row[width];
    }
}

/* U D U' = F U D U' F' + Q, from the last column to the first. GT_NOT_FINITE or GT_SINGULAR where the sum is not
 * positive: a number of D is no more than round-off can make of the variance that it belongs to. */
static GT_FILTER_ONCE gt_status gt_filter_spread(const gt_filter *f, const gt_filter_belief *belief,
                                                 const gt_filter_work *work)
{
    const gt_filter_matrix *matrix = &f->transition; /* column after column */
    const int last = f->errors - 1;
    const int stride = f->stride;
    double *moved = work->square; /* F U */
    double *before = work->vectors; /* D, then -D of what is made, both from the last one */
    double *after = &before[stride];
    double *to = moved;
    const double *from = belief->factor;
    gt_status status = GT_OK;
    int i;
    int j;
    int k;

    for (j = 0; j <= last; j++) {
        for (i = 0; i < stride; i++) {
            to[i] = 0.0;
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
        const size_t width = (size_t)j + 2U - ((size_t)j % 2U);
        double variance;
        double inverse;
        size_t n;

        to = &belief->factor[j * stride];
        for (n = 0U; n < width; n++) {
            to[n] = 0.0;
        }
        for (i = f->noise.start[j]; i < f->noise.start[j + 1]; i++) {
            to[f->noise.column[i]] = work->noise[i];
        }
        gt_filter_sum(to, width, moved, f->back, &moved[j], -stride, before, f->reached[j]);
        variance = to[j];
        gt_filter_sum(to, width, &belief->factor[last * stride], f->back, &belief->factor[(last * stride) + j], -stride,
                      after, last - j);
        belief->diagonal[j] = to[j];
        after[last - j] = -to[j];
        inverse = 1.0 / to[j];
        if (!(fabs(to[j]) <= DBL_MAX)) {
            status = GT_NOT_FINITE;
        } else if (!(to[j] > (f->pivot * variance))) {
            status = GT_SINGULAR;
        } else {
            for (n = 0U; n < width; n += 2U) {
                const double left = to[n] * inverse;
                const double right = to[n + 1U] * inverse;

                to[n] = left;
                to[n + 1U] = right;
            }
            to[width - 1U] = 0.0;
            to[j] = 1.0;
        }
    }
    return status;
}

#endif
