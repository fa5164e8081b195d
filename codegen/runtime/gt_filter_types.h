/* What a filter of gt_filter.h is made of: tables that do not change, memory of the caller. */
#ifndef GT_FILTER_TYPES_H
#define GT_FILTER_TYPES_H

#include "gt_float.h"
#include "gt_guard.h"
#include "gt_status.h"

#include <math.h>
#include <stddef.h>

/* Terms of the series of exp(A s) in the covariance of the noise, and nodes of Gauss on a step. */
#define GT_FILTER_TERMS 6
#define GT_FILTER_NODES 3
/* A measured or given quaternion is of unit length where its square is this near to one. */
#define GT_FILTER_UNIT 2e-6
/* Where counters end. */
#define GT_FILTER_MOST 1000000000

/* What runs once in a cycle is compiled for size, the loops in it for speed. */
#if defined(__GNUC__)
#define GT_FILTER_ONCE __attribute__((noinline, cold))
#define GT_FILTER_OFTEN __attribute__((noinline, hot))
#else
#define GT_FILTER_ONCE
#define GT_FILTER_OFTEN
#endif

/* A generated kernel. It needs no scratch. */
typedef int (*gt_filter_kernel)(const double **arg, double **res, long long int *iw, double *w, int mem);

/* A matrix by the entries that are not zero, row after row. */
typedef struct gt_filter_matrix {
    int rows;
    int entries;
    const int *start; /* rows + 1 numbers: the first entry of each row */
    const int *column;
    const double *value; /* of the entries that are constant; 0 where a kernel gives all */
    int changing;
    const int *place; /* the other entries, in the order of what gives them; 0 where a kernel gives all */
} gt_filter_matrix;

/* C = A B: each entry of C is a sum over terms, an entry of A times one of B. */
typedef struct gt_filter_product {
    int entries;
    const int *start; /* entries + 1 numbers: the first term of each entry */
    const int *left;
    const int *right;
} gt_filter_product;

/* A process in continuous time: Runge and Kutta's fourth order, and the derivative of that very step. A path is how x
 * follows the error at the begin, a response how the error follows noise: what moves, then what is fixed. */
typedef struct gt_filter_motion {
    gt_filter_kernel rates; /* (t, x, u) -> rates of x, their Jacobian J */
    gt_filter_kernel frame; /* (x) -> S, how x follows its error; 0 without one */
    gt_filter_kernel noise; /* (t, x, u) -> A, the rates of errors, and G; 0 without them */
    gt_filter_matrix jacobian; /* of the rows that move; the columns tell where rows of a path begin */
    gt_filter_matrix frames; /* S; the columns tell where an entry stands in a path */
    gt_filter_matrix arrival; /* E, how the error at the end follows x; columns as those of J */
    gt_filter_matrix drift;
    gt_filter_matrix drive; /* G; the columns tell where an entry stands in a response */
    gt_filter_product response; /* A times a response to noise */
    gt_filter_product spread; /* a response times its transpose: Q */
    int width; /* of the rows of a path, even */
    int values; /* the most entries of J, S, A with G, or E */
    int changing; /* the most entries of E or F that change */
    int fixed_paths; /* numbers of the rows that do not move, behind those that do */
    const double *fixed_path; /* at four stages and at the end */
    const int *picked; /* where the changing entries of F stand in E times a path */
    int fixed_responses;
    const double *fixed_response; /* of each power of A */
    const double *fixed_total; /* of each node */
    const double *weights; /* of the nodes, times the length of a step */
    const double *powers; /* s^k / k! of each node for k from 1 */
    const int *power; /* where a response times A^k begins, for k from 1 */
} gt_filter_motion;

/* What is measured. */
typedef struct gt_filter_sensor {
    int numbers; /* of a reading */
    int first; /* where its numbers begin among those of all sensors */
    int delay; /* cycles by which a reading is late */
    int quaternion; /* 1 where it is of unit length */
    int stale; /* cycles without a reading that are too many, 0 for none */
    int closed; /* readings in a row that its gate left out and that are too many, 0 for none */
    double gate; /* largest normalised innovation squared, 0 without a gate */
    gt_filter_kernel kernel; /* (t, x, u, z) -> residual, H */
    gt_filter_matrix jacobian;
    const double *variance;
    const double *limit; /* how large a number may be: there round-off reaches its deviation */
} gt_filter_sensor;

/* All that does not change. */
typedef struct gt_filter {
    int size; /* numbers of x */
    int errors; /* degrees of freedom n */
    int stride; /* n, or n + 1 where n is odd: of the columns of the factor, which are taken in pairs */
    int inputs; /* numbers of u */
    int numbers; /* of the readings of all sensors */
    int sensors;
    int depth; /* the longest delay */
    int parts; /* equal steps of the process in a cycle */
    double step; /* their length */
    gt_filter_kernel given; /* (t, x, u0, u1) -> x, changing entries of F; 0 where there is a motion */
    const gt_filter_motion *motion;
    gt_filter_kernel unit; /* (quaternion) -> one of unit length, how its error follows the given one; 0 without */
    int quaternions;
    const int *turned; /* of each its place in x and in an error */
    const int *error_of; /* of each number of x its place in an error, -1 in quaternions */
    gt_filter_matrix transition; /* F', so column after column, without what `same` holds */
    gt_filter_matrix noise; /* Q, lower triangle */
    const double *same; /* stride: 1 where a constant 1 stands on the diagonal of F, else 0 */
    const int *reached; /* of each row of F, from the last column back to its first entry */
    const int *back; /* where columns of the factor begin from the last one, which is 0 */
    const gt_filter_sensor *sensor;
    double pivot; /* share of each variance that its number of D must exceed */
} gt_filter;

/* What is known at an instant, in the caller's memory. The covariance is U D U'. */
typedef struct gt_filter_belief {
    double *time;
    double *mean;
    double *factor; /* stride * n: U, upper triangular and 1 on its diagonal, column after column */
    double *diagonal; /* n: D */
    int *closed; /* of each sensor, readings in a row that its gate left out */
} gt_filter_belief;

/* What is remembered beside the belief: the readings of the last instants, in a ring of depth + 1. The belief is that
 * of the oldest one that is complete. */
typedef struct gt_filter_memory {
    gt_filter_belief belief;
    double *before; /* known inputs at the belief's time */
    double *inputs; /* of each instant of the ring */
    double *readings;
    int *present;
    int *place; /* of the newest instant */
    int *begun; /* cycles since the start, at most depth + 1 */
    int *age; /* of each sensor, cycles since its last reading came */
} gt_filter_memory;

/* What the readings of an instant came to. */
typedef struct gt_filter_outcome {
    double *nis;
    int *count;
    int *gated; /* of each sensor */
} gt_filter_outcome;

/* Memory of a call. */
typedef struct gt_filter_work {
    double *square; /* stride * n */
    double *other; /* stride * n */
    double *vectors; /* 2 stride */
    double *error; /* stride */
    double *variance; /* stride: of the newest instant */
    double *residual; /* numbers */
    double *lever; /* entries of all H */
    double *transition; /* entries of F */
    double *noise; /* entries of Q */
    double *values; /* of the motion */
} gt_filter_work;

#endif
