/* gt_table: see gt_table.h. */
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif

#include "gt_table.h"

#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define GT_TABLE_HEAD 32U
#define GT_TABLE_MOST 16777216U /* rows and columns */

static int gt_table_read(gt_table *table)
{
    uint64_t head[4]; /* the word, rows, columns, step */

    if (table->size < GT_TABLE_HEAD) {
        return 0;
    }
    (void)memcpy(head, table->memory, sizeof(head));
    if ((memcmp(table->memory, "GTTABLE1", 8U) != 0) || (head[1] > GT_TABLE_MOST) || (head[2] > GT_TABLE_MOST) ||
        (head[3] > GT_TABLE_MOST) || ((head[1] * head[2]) != ((table->size - GT_TABLE_HEAD) / sizeof(double)))) {
        return 0;
    }
    table->traj.rows = (const double *)table->memory + (GT_TABLE_HEAD / sizeof(double));
    table->traj.count = (uint32_t)head[1];
    table->traj.columns = (uint32_t)head[2];
    table->traj.step_ms = (uint32_t)head[3];
    return 1;
}

int gt_table_open(gt_table *table, const char *path)
{
    struct stat about;
    const int file = open(path, O_RDONLY);

    (void)memset(table, 0, sizeof(*table));
    if (file < 0) {
        return 0;
    }
    if ((fstat(file, &about) == 0) && (about.st_size > 0)) {
        table->size = (size_t)about.st_size;
        table->memory = mmap(NULL, table->size, PROT_READ, MAP_PRIVATE, file, 0);
        if (table->memory == MAP_FAILED) {
            table->memory = NULL;
        }
    }
    (void)close(file);
    return (table->memory != NULL) && gt_table_read(table);
}

void gt_table_close(gt_table *table)
{
    if (table->memory != NULL) {
        (void)munmap(table->memory, table->size);
        table->memory = NULL;
    }
}
