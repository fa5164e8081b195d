/* Decimal numbers in text, the same in every locale. */
#ifndef GT_DECIMAL_H
#define GT_DECIMAL_H

#include "gt_wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Reads bytes `at` to `end` of `data` as [+-]digits[.digits][e[+-]digits]. 1 and the value, or 0 for anything else.
 * Digits of the fraction beyond eighteen in all are cut off; more digits before the point, and a power of ten outside
 * -22 .. 22 after the point is moved out, are refused. */
int gt_read_decimal(const uint8_t *data, uint32_t at, uint32_t end, double *value);

/* 1 and the value of one to nineteen digits, or 0. */
int gt_read_digits(const uint8_t *data, uint32_t at, uint32_t end, uint64_t *value);

/* Writes the value with six digits after the point, rounded half up in magnitude; a fault unless |value| < 1e9. */
void gt_write_decimal(gt_writer *writer, double value);

#ifdef __cplusplus
}
#endif

#endif
