/* A ring of records between the loop, which puts them in, and another thread, which takes them out and writes them.
 *
 * One producer, one consumer, no locks: the loop never waits for a file. A full ring drops the record and counts it.
 */
#ifndef GT_LOG_H
#define GT_LOG_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_log {
    double *records;    /* capacity * columns numbers, the caller's */
    uint32_t capacity;  /* records; a power of two */
    uint32_t columns;   /* numbers of a record */
    uint32_t put;       /* records put in so far, modulo 2^32; the producer's */
    uint32_t taken;     /* records taken out so far; the consumer's */
    uint64_t dropped;   /* records that found the ring full; the producer's */
} gt_log;

/* An empty ring; 0 if the capacity is not a power of two or nothing fits. */
int gt_log_init(gt_log *log, double *records, uint32_t capacity, uint32_t columns);

/* Copies one record in; 0 if the ring is full. */
int gt_log_put(gt_log *log, const double *record);

/* Copies the oldest record out; 0 if there is none. */
int gt_log_take(gt_log *log, double *record);

/* 1 if a record would find room. */
int gt_log_has_room(const gt_log *log);

/* A number as eight bytes, lowest first, whatever the machine. */
void gt_log_bytes(double number, uint8_t *bytes);

#ifdef __cplusplus
}
#endif

#endif
