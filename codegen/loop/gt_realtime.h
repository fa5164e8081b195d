/* Memory that stays and a priority above other work, where the system allows them. */
#ifndef GT_REALTIME_H
#define GT_REALTIME_H

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_realtime {
    int locked;   /* memory is locked */
    int fifo;     /* SCHED_FIFO was granted */
} gt_realtime;

/* Touches the stack, locks all memory, asks for SCHED_FIFO; says on stderr what was refused. */
gt_realtime gt_realtime_ask(int priority);

#ifdef __cplusplus
}
#endif

#endif
