/* Tables of numbers in files, such as references: "GTTABLE1", rows, columns, step_ms as 64-bit integers, then doubles.
 *
 * Mapped into memory, not copied; little-endian, as the machines are that this loop runs on.
 */
#ifndef GT_TABLE_H
#define GT_TABLE_H

#include "gt_traj.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_table {
    void *memory;
    size_t size;
    gt_traj traj;
} gt_table;

/* 0 if the file is not there, is no table, or is cut. */
int gt_table_open(gt_table *table, const char *path);

void gt_table_close(gt_table *table);

#ifdef __cplusplus
}
#endif

#endif
