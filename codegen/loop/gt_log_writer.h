/* The thread that writes the log, so that the loop waits for no file. */
#ifndef GT_LOG_WRITER_H
#define GT_LOG_WRITER_H

#include "gt_log.h"

#include <pthread.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_log_writer {
    gt_log *log;
    FILE *file;
    int end;     /* the loop asks for the end */
    int failed;  /* the file took less than it was given */
    pthread_t thread;
} gt_log_writer;

/* Starts writing `log` to the new file `path`; 0 and errno if there is one, or if file or thread cannot be made. */
int gt_log_writer_start(gt_log_writer *writer, gt_log *log, const char *path);

/* Writes what is left and closes the file; 0 if anything could not be written. */
int gt_log_writer_stop(gt_log_writer *writer);

#ifdef __cplusplus
}
#endif

#endif
