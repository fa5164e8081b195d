/* gt_realtime: see gt_realtime.h. */
#ifndef _DEFAULT_SOURCE
#define _DEFAULT_SOURCE 1 /* mlockall and the scheduler */
#endif

#include "gt_realtime.h"

#include <errno.h>
#include <sched.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#define GT_STACK 1048576U
#define GT_PAGE 1024U

static void gt_realtime_touch_stack(void)
{
    volatile unsigned char stack[GT_STACK];
    size_t n;

    for (n = 0U; n < sizeof(stack); n += GT_PAGE) {
        stack[n] = 0U;
    }
}

gt_realtime gt_realtime_ask(int priority)
{
    gt_realtime granted;
    struct sched_param parameters;

    gt_realtime_touch_stack();
    granted.locked = (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) ? 1 : 0;
    if (!granted.locked) {
        (void)fprintf(stderr, "not real-time: memory is not locked (mlockall: %s)\n", strerror(errno));
    }
    (void)memset(&parameters, 0, sizeof(parameters));
    parameters.sched_priority = priority;
    granted.fifo = (sched_setscheduler(0, SCHED_FIFO, &parameters) == 0) ? 1 : 0;
    if (!granted.fifo) {
        (void)fprintf(stderr, "not real-time: other work may delay the loop (SCHED_FIFO: %s)\n", strerror(errno));
    }
    return granted;
}
