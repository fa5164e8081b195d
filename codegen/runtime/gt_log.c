/* gt_log: see gt_log.h. */
#include "gt_log.h"

#include "gt_guard.h"

#include <string.h>

/* C99 has no atomics: the compiler's own, or a plain access where one thread does both ends. */
#if defined(__GNUC__)
#define GT_ACQUIRE(place) __atomic_load_n((place), __ATOMIC_ACQUIRE)
#define GT_RELEASE(place, value) __atomic_store_n((place), (value), __ATOMIC_RELEASE)
#elif defined(GT_LOG_ONE_THREAD)
#define GT_ACQUIRE(place) (*(place))
#define GT_RELEASE(place, value) (*(place) = (value))
#else
#error "define GT_LOG_ONE_THREAD, or GT_ACQUIRE and GT_RELEASE for this compiler"
#endif

int gt_log_init(gt_log *log, double *records, uint32_t capacity, uint32_t columns)
{
    log->records = records;
    log->capacity = capacity;
    log->columns = columns;
    log->put = 0U;
    log->taken = 0U;
    log->dropped = 0U;
    return (capacity > 0U) && ((capacity & (capacity - 1U)) == 0U) && (columns > 0U);
}

static double *gt_log_place(const gt_log *log, uint32_t number)
{
    return &log->records[(size_t)(number & (log->capacity - 1U)) * log->columns];
}

int gt_log_has_room(const gt_log *log)
{
    return (log->put - GT_ACQUIRE(&log->taken)) < log->capacity;
}

int gt_log_put(gt_log *log, const double *record)
{
    if (!gt_log_has_room(log)) {
        log->dropped++;
        return 0;
    }
    gt_copy(gt_log_place(log, log->put), record, (int)log->columns);
    GT_RELEASE(&log->put, log->put + 1U);
    return 1;
}

int gt_log_take(gt_log *log, double *record)
{
    if (GT_ACQUIRE(&log->put) == log->taken) {
        return 0;
    }
    gt_copy(record, gt_log_place(log, log->taken), (int)log->columns);
    GT_RELEASE(&log->taken, log->taken + 1U);
    return 1;
}

void gt_log_bytes(double number, uint8_t *bytes)
{
    uint64_t bits;
    uint32_t n;

    (void)memcpy(&bits, &number, sizeof(bits));
    for (n = 0U; n < 8U; n++) {
        bytes[n] = (uint8_t)((bits >> (8U * n)) & 0xFFU);
    }
}
