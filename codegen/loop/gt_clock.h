/* The one clock of the loop: monotonic, never set back. For time-outs and histograms; motions follow the robot's. */
#ifndef GT_CLOCK_H
#define GT_CLOCK_H

#include <stdint.h>
#include <time.h>

/* Nanoseconds since some instant in the past. The file that includes this asks for POSIX. */
static inline int64_t gt_clock_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((int64_t)now.tv_sec * 1000000000) + (int64_t)now.tv_nsec;
}

#endif
