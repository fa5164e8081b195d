/* The UDP socket of the loop. Only datagrams of the allowed address are taken; the rest are counted. */
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
    uint64_t foreign;         /* datagrams from elsewhere */
} gt_socket;

/* 1 if the text is an IPv4 address of the loopback network. */
int gt_is_loopback(const char *address);

/* Listens at `address`, port 0 for any free one; 0 if it cannot. */
int gt_socket_open(gt_socket *s, const char *address, uint16_t port, const char *allowed);

/* Waits until a datagram is there; 0 after timeout_ms without one (negative: no time-out). */
int gt_socket_wait(gt_socket *s, int timeout_ms);

/* Length of the next datagram, at most `capacity` bytes of which are kept, without waiting; -1 if there is none. */
int32_t gt_socket_take(gt_socket *s, uint8_t *data, uint32_t capacity);

/* To the source of the last datagram taken. */
void gt_socket_send(gt_socket *s, const uint8_t *data, uint32_t length);

void gt_socket_close(gt_socket *s);

#ifdef __cplusplus
}
#endif

#endif
