/* How often a time fell between two powers of two of a microsecond. */
#ifndef GT_HISTOGRAM_H
#define GT_HISTOGRAM_H

#include <stdint.h>

#define GT_BUCKETS 24U

typedef struct gt_histogram {
    uint64_t count[GT_BUCKETS]; /* bucket n: below 2^n us; the last one: all above */
    int64_t worst_ns;
} gt_histogram;

static inline void gt_histogram_add(gt_histogram *histogram, int64_t ns)
{
    uint32_t n = 0U;

    while ((n < (GT_BUCKETS - 1U)) && (ns >= (((int64_t)1000) << n))) {
        n++;
    }
    histogram->count[n]++;
    if (ns > histogram->worst_ns) {
        histogram->worst_ns = ns;
    }
}

#endif
