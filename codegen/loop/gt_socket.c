/* gt_socket: see gt_socket.h. */
#ifndef _DEFAULT_SOURCE
#define _DEFAULT_SOURCE 1 /* ioctl */
#endif

#include "gt_socket.h"

#include "gt_clock.h"

#include <arpa/inet.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#ifdef __linux__
#include <linux/sockios.h>
#endif

#define GT_SECOND_NS 1000000000

static int gt_on_loopback(struct in_addr address)
{
    return (ntohl(address.s_addr) >> 24) == 127U;
}

int gt_is_loopback(const char *address)
{
    struct in_addr parsed;

    return (inet_pton(AF_INET, address, &parsed) == 1) && gt_on_loopback(parsed);
}

/* By the clock that may be set: an age that cannot be is none. */
static int64_t gt_age_ns(const gt_socket *s)
{
    int64_t age = 0;
#ifdef SIOCGSTAMPNS
    struct timespec got;

    if (ioctl(s->file, SIOCGSTAMPNS, &got) == 0) {
        age = gt_clock_wall_ns() - gt_clock_in_ns(&got);
    }
#else
    (void)s;
#endif
    return ((age > 0) && (age < GT_SECOND_NS)) ? age : 0;
}

int gt_socket_open(gt_socket *s, const char *address, uint16_t port, const char *allowed)
{
    struct sockaddr_in here;
    socklen_t size = (socklen_t)sizeof(here);

    (void)memset(s, 0, sizeof(*s));
    (void)memset(&here, 0, sizeof(here));
    here.sin_family = AF_INET;
    here.sin_port = htons(port);
    s->file = -1;
    if ((inet_pton(AF_INET, address, &here.sin_addr) != 1) || (inet_pton(AF_INET, allowed, &s->allowed) != 1)) {
        return 0;
    }
    s->file = socket(AF_INET, SOCK_DGRAM, 0);
    if ((s->file < 0) || (bind(s->file, (const struct sockaddr *)&here, size) != 0) ||
        (getsockname(s->file, (struct sockaddr *)&here, &size) != 0)) {
        gt_socket_close(s);
        return 0;
    }
    s->port = ntohs(here.sin_port);
    (void)gt_age_ns(s); /* the first question starts the stamps */
    return 1;
}

int gt_socket_wait(gt_socket *s, int timeout_ms)
{
    struct pollfd one;

    one.fd = s->file;
    one.events = POLLIN;
    one.revents = 0;
    return poll(&one, 1U, timeout_ms) > 0;
}

static int gt_is_robot(const gt_socket *s, const struct sockaddr_in *source)
{
    if (s->kept != 0) {
        return (source->sin_addr.s_addr == s->robot.sin_addr.s_addr) && (source->sin_port == s->robot.sin_port);
    }
    return (source->sin_addr.s_addr == s->allowed.s_addr) ||
           (gt_on_loopback(s->allowed) && gt_on_loopback(source->sin_addr));
}

int32_t gt_socket_take(gt_socket *s, uint8_t *data, uint32_t capacity)
{
    struct sockaddr_in source;
    socklen_t size = (socklen_t)sizeof(source);
    const ssize_t length = recvfrom(s->file, data, (size_t)capacity, MSG_DONTWAIT, (struct sockaddr *)&source, &size);
    int32_t taken = GT_SOCKET_EMPTY;

    if ((length >= 0) && gt_is_robot(s, &source)) {
        s->robot = source;
        taken = (int32_t)length;
    } else if (length >= 0) {
        s->foreign++;
        taken = GT_SOCKET_FOREIGN;
    } else {
        /* nothing there */
    }
    return taken;
}

void gt_socket_keep(gt_socket *s)
{
    s->kept = 1;
}

int64_t gt_socket_age_ns(const gt_socket *s)
{
    return gt_age_ns(s);
}

void gt_socket_send(gt_socket *s, const uint8_t *data, uint32_t length)
{
    (void)sendto(s->file, data, (size_t)length, 0, (const struct sockaddr *)&s->robot, (socklen_t)sizeof(s->robot));
}

void gt_socket_close(gt_socket *s)
{
    if (s->file >= 0) {
        (void)close(s->file);
        s->file = -1;
    }
}
