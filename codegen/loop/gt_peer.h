/* Between the protocols and the laws: a datagram as feedback, a command as the answer to it. Carts are in mm outside and
 * joints in degrees; inside, positions are in m, or in rad. */
#ifndef GT_PEER_H
#define GT_PEER_H

#include "gt_law.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum gt_protocol { GT_PEER_EGM = 0, GT_PEER_RSI = 1 } gt_protocol;

typedef struct gt_peer {
    gt_protocol protocol;
    uint32_t axes;           /* carts, or joints, that the robot has to report */
    uint32_t cycle_ms;       /* 4, or 12 for RSI */
    int reads_wrenches;      /* 1: those of the datagrams are read */
    double start_m[GT_AXES]; /* RSI corrections count from here */
    int joints;              /* 1: the axes are the joints of an arm, 0: carts, which are external axes */
} gt_peer;

/* 1 and `feedback`, or 0 for a datagram that is not of this protocol, lacks a cart, or names another type of message
 * than a robot's data (EGM). A robot whose motors are off does not run; one that does not say may. Wrenches that are wanted and not
 * there leave has_wrenches at 0. */
int gt_peer_read(const gt_peer *peer, const uint8_t *data, uint32_t length, gt_feedback *feedback);

/* Corrections count from this feedback on. */
void gt_peer_begin(gt_peer *peer, const gt_feedback *first);

/* The answer to `feedback`; returns its length, 0 if it cannot be written. */
uint32_t gt_peer_write(const gt_peer *peer, const gt_feedback *feedback, const gt_command *command, uint8_t *data,
                       uint32_t capacity);

#ifdef __cplusplus
}
#endif

#endif
