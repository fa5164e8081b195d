/* Vectors of three numbers: sums over x, y, z in this order, so that another language that keeps it has the same bits. */
#ifndef GT_VECTOR_H
#define GT_VECTOR_H

#include "gt_guard.h"

#include <math.h>

typedef struct gt_vector {
    double x;
    double y;
    double z;
} gt_vector;

static inline gt_vector gt_vector_of(double x, double y, double z)
{
    gt_vector v;

    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}

static inline gt_vector gt_vector_at(const double *numbers)
{
    return gt_vector_of(numbers[0], numbers[1], numbers[2]);
}

static inline void gt_vector_to(double *numbers, gt_vector a)
{
    numbers[0] = a.x;
    numbers[1] = a.y;
    numbers[2] = a.z;
}

static inline double gt_dot(gt_vector a, gt_vector b)
{
    return ((a.x * b.x) + (a.y * b.y)) + (a.z * b.z);
}

static inline double gt_length(gt_vector a)
{
    return sqrt(gt_dot(a, a));
}

/* a + by b */
static inline gt_vector gt_plus(gt_vector a, double by, gt_vector b)
{
    return gt_vector_of(a.x + (by * b.x), a.y + (by * b.y), a.z + (by * b.z));
}

static inline gt_vector gt_divided(gt_vector a, double by)
{
    return gt_vector_of(a.x / by, a.y / by, a.z / by);
}

/* a, made shorter where it is longer than `most` */
static inline gt_vector gt_limited(gt_vector a, double most)
{
    const double size = gt_length(a);
    gt_vector kept = a;

    if (!(size <= most)) {
        const double by = most / size;

        kept = gt_vector_of(by * a.x, by * a.y, by * a.z);
    }
    return kept;
}

static inline gt_vector gt_cross(gt_vector a, gt_vector b)
{
    return gt_vector_of((a.y * b.z) - (a.z * b.y), (a.z * b.x) - (a.x * b.z), (a.x * b.y) - (a.y * b.x));
}

static inline int gt_vector_finite(gt_vector a)
{
    return (fabs(a.x) <= DBL_MAX) && (fabs(a.y) <= DBL_MAX) && (fabs(a.z) <= DBL_MAX);
}

/* 1 for a vector of length 1. */
static inline int gt_is_direction(gt_vector a)
{
    return fabs(gt_length(a) - 1.0) <= 1e-9;
}

/* Within +-limit. */
static inline double gt_clamped_to(double value, double limit)
{
    const double above = (-limit > value) ? -limit : value;

    return (limit < above) ? limit : above;
}

/* Matrices row by row: M a, and M' a. */
static inline gt_vector gt_turned(const double *m, gt_vector a)
{
    return gt_vector_of(((m[0] * a.x) + (m[1] * a.y)) + (m[2] * a.z), ((m[3] * a.x) + (m[4] * a.y)) + (m[5] * a.z),
                        ((m[6] * a.x) + (m[7] * a.y)) + (m[8] * a.z));
}

static inline gt_vector gt_turned_back(const double *m, gt_vector a)
{
    return gt_vector_of(((m[0] * a.x) + (m[3] * a.y)) + (m[6] * a.z), ((m[1] * a.x) + (m[4] * a.y)) + (m[7] * a.z),
                        ((m[2] * a.x) + (m[5] * a.y)) + (m[8] * a.z));
}

/* 1 for the rows of a rotation matrix: R R' = I within a tolerance, det R > 0. */
static inline int gt_is_turn(const double *m, double within)
{
    const gt_vector x = gt_vector_at(m);
    const gt_vector y = gt_vector_at(&m[3]);
    const gt_vector z = gt_vector_at(&m[6]);
    const int one = (fabs(gt_dot(x, x) - 1.0) <= within) && (fabs(gt_dot(y, y) - 1.0) <= within) &&
                    (fabs(gt_dot(z, z) - 1.0) <= within);
    const int across = (fabs(gt_dot(x, y)) <= within) && (fabs(gt_dot(y, z)) <= within) &&
                       (fabs(gt_dot(z, x)) <= within);

    return one && across && (gt_dot(gt_cross(x, y), z) > 0.0);
}

#endif
