/* The UDP socket of the loop. Only datagrams of the allowed address are taken, and of one robot there: the first that
 * is kept. The rest are counted. */
#ifndef GT_SOCKET_H
#define GT_SOCKET_H

#include <netinet/in.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gt_socket {
    int file;
    uint16_t port;            /* where it listens */
    struct in_addr allowed;   /* the robot's address; on loopback every loopback address */
    struct sockaddr_in robot; /* source of the last datagram taken; answers go there */
    int kept;                 /* no other source is taken any more */
    uint64_t foreign;         /* datagrams from elsewhere */
} gt_socket;

#define GT_SOCKET_EMPTY (-1)
#define GT_SOCKET_FOREIGN (-2)

/* 1 if the text is an IPv4 address of the loopback network. */
int gt_is_loopback(const char *address);

/* Listens at `address`, port 0 for any free one; 0 if it cannot. */
int gt_socket_open(gt_socket *s, const char *address, uint16_t port, const char *allowed);

/* Waits until a datagram is there; 0 after timeout_ms without one (negative: no time-out). */
int gt_socket_wait(gt_socket *s, int timeout_ms);

/* Length of the next datagram, at most `capacity` bytes of which are kept, without waiting; GT_SOCKET_EMPTY if there is
 * none, GT_SOCKET_FOREIGN for one from elsewhere. */
int32_t gt_socket_take(gt_socket *s, uint8_t *data, uint32_t capacity);

/* From now on only the source of the last datagram taken is the robot. */
void gt_socket_keep(gt_socket *s);

/* Nanoseconds since the system got the last datagram taken; 0 where it does not say. */
int64_t gt_socket_age_ns(const gt_socket *s);

/* To the source of the last datagram taken. */
void gt_socket_send(gt_socket *s, const uint8_t *data, uint32_t length);

void gt_socket_close(gt_socket *s);

#ifdef __cplusplus
}
#endif

#endif
