/* gt_log_writer: see gt_log_writer.h. */
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif

#include "gt_log_writer.h"

#include "gt_clock.h"
#include "gt_loop.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#define GT_PAUSE_NS 2000000

/* All records that are there. */
static void gt_log_writer_drain(gt_log_writer *writer)
{
    double record[GT_RECORD_COLUMNS];
    uint8_t bytes[8U * GT_RECORD_COLUMNS];
    uint32_t n;

    while (gt_log_take(writer->log, record) != 0) {
        for (n = 0U; n < GT_RECORD_COLUMNS; n++) {
            gt_log_bytes(record[n], &bytes[8U * n]);
        }
        if (fwrite(bytes, 1U, sizeof(bytes), writer->file) != sizeof(bytes)) {
            writer->failed = 1;
        }
    }
}

static void *gt_log_writer_run(void *given)
{
    gt_log_writer *writer = (gt_log_writer *)given;
    struct timespec pause;

    pause.tv_sec = 0;
    pause.tv_nsec = GT_PAUSE_NS;
    while (!__atomic_load_n(&writer->end, __ATOMIC_ACQUIRE)) {
        gt_log_writer_drain(writer);
        (void)nanosleep(&pause, NULL);
    }
    gt_log_writer_drain(writer);
    return NULL;
}

int gt_log_writer_start(gt_log_writer *writer, gt_log *log, const char *path)
{
    int made;
    int refused;

    writer->log = log;
    writer->end = 0;
    writer->failed = 0;
    made = open(path, O_WRONLY | O_CREAT | O_EXCL, S_IRUSR | S_IWUSR | S_IRGRP | S_IROTH);
    if (made < 0) {
        return 0;
    }
    writer->file = fdopen(made, "wb");
    if (writer->file == NULL) {
        (void)close(made);
        return 0;
    }
    refused = pthread_create(&writer->thread, NULL, gt_log_writer_run, writer);
    if (refused != 0) {
        (void)fclose(writer->file);
        errno = refused;
    }
    return (refused == 0) ? 1 : 0;
}

int gt_log_writer_stop(gt_log_writer *writer)
{
    __atomic_store_n(&writer->end, 1, __ATOMIC_RELEASE);
    (void)pthread_join(writer->thread, NULL);
    if (fclose(writer->file) != 0) {
        writer->failed = 1;
    }
    return !writer->failed;
}
