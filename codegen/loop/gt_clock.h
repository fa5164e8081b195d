/* The loop's clock: monotonic, never set back. For time-outs and histograms; motions follow the robot's. */
#ifndef GT_CLOCK_H
#define GT_CLOCK_H

#include <stdint.h>
#include <time.h>

static inline int64_t gt_clock_in_ns(const struct timespec *time)
{
    return ((int64_t)time->tv_sec * 1000000000) + (int64_t)time->tv_nsec;
}

/* Nanoseconds since some instant in the past. The file that includes this asks for POSIX. */
static inline int64_t gt_clock_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return gt_clock_in_ns(&now);
}

/* By the clock of the day, which stamps datagrams. */
static inline int64_t gt_clock_wall_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_REALTIME, &now);
    return gt_clock_in_ns(&now);
}

#endif
