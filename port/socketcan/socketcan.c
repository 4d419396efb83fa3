/* SPDX-License-Identifier: MIT */
/* If the transmit queue is full (ENOBUFS, EAGAIN), send again for a fraction of a tick, then drop
 * and count the frame. A bus that is too slow must not delay the ticks. */
#define _GNU_SOURCE
#include "socketcan.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

enum { SEND_TRIES = 5, RETRY_NS = 100000, FILTERS_MAX = 64 };

typedef union {
    struct cmsghdr aligned;
    char bytes[CMSG_SPACE(sizeof(struct timeval)) + CMSG_SPACE(sizeof(uint32_t))];
} control_t;

static void to_wire(struct can_frame *wire, const dahl_can_frame_t *frame)
{
    memset(wire, 0, sizeof *wire);
    wire->can_id = frame->id;
    if ((frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0) {
        wire->can_id |= CAN_EFF_FLAG;
    }
    if ((frame->flags & DAHL_CAN_FRAME_REMOTE) != 0) {
        wire->can_id |= CAN_RTR_FLAG;
    }
    wire->can_dlc = frame->length;
    memcpy(wire->data, frame->data, sizeof wire->data);
}

static uint8_t flag_if(uint32_t condition, uint8_t flag)
{
    return condition != 0 ? flag : 0;
}

static uint32_t fd_flags(const struct canfd_frame *wire)
{
    return DAHL_CAN_FRAME_FD | flag_if(wire->flags & CANFD_BRS, DAHL_CAN_FRAME_BRS) |
           flag_if(wire->flags & CANFD_ESI, DAHL_CAN_FRAME_ESI) | flag_if(wire->len > 8, DAHL_CAN_FRAME_CUT);
}

/* The layout of a classic frame is the start of that of a CAN FD frame. */
static void from_wire(dahl_can_frame_t *frame, const struct canfd_frame *wire)
{
    memset(frame, 0, sizeof *frame);
    frame->flags = (uint8_t)(flag_if(wire->can_id & CAN_EFF_FLAG, DAHL_CAN_FRAME_EXTENDED) |
                             flag_if(wire->can_id & CAN_RTR_FLAG, DAHL_CAN_FRAME_REMOTE) |
                             flag_if(wire->can_id & CAN_ERR_FLAG, DAHL_CAN_FRAME_ERROR));
    frame->id = wire->can_id & ((wire->can_id & CAN_EFF_FLAG) != 0 ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame->length = wire->len <= 8 ? wire->len : 8;
    memcpy(frame->data, wire->data, frame->length);
}

static dahl_can_result_t outcome(void)
{
    return errno == EAGAIN || errno == ENOBUFS || errno == EINTR ? DAHL_CAN_BUS_BUSY : DAHL_CAN_BUS_GONE;
}

static dahl_can_result_t write_once(int fd, const struct can_frame *wire)
{
    return write(fd, wire, sizeof *wire) == (ssize_t)sizeof *wire ? DAHL_CAN_BUS_OK : outcome();
}

static dahl_can_result_t socketcan_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    const socketcan_t *self = (const socketcan_t *)bus;
    struct can_frame wire;
    to_wire(&wire, frame);
    dahl_can_result_t result = write_once(self->fd, &wire);
    for (int i = 0; result == DAHL_CAN_BUS_BUSY && i < SEND_TRIES; i++) {
        struct timespec nap = {.tv_nsec = RETRY_NS};
        nanosleep(&nap, NULL);
        bus->counts.retries++;
        result = write_once(self->fd, &wire);
    }
    bus->counts.dropped += result == DAHL_CAN_BUS_BUSY ? 1u : 0u;
    return result;
}

static uint64_t stamp_of(struct msghdr *message, const dahl_can_clock_t *clock)
{
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c != NULL; c = CMSG_NXTHDR(message, c)) {
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_TIMESTAMP) {
            struct timeval when;
            memcpy(&when, CMSG_DATA(c), sizeof when);
            return (uint64_t)when.tv_sec * 1000000u + (uint64_t)when.tv_usec;
        }
    }
    return dahl_can_clock_now_us(clock);
}

static dahl_can_result_t read_one(socketcan_t *self, dahl_can_frame_t *frame)
{
    struct canfd_frame wire;
    control_t control;
    struct iovec part = {.iov_base = &wire, .iov_len = sizeof wire};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t n = recvmsg(self->fd, &message, 0);
    if (n < 0) {
        return outcome() == DAHL_CAN_BUS_BUSY ? DAHL_CAN_BUS_NONE : DAHL_CAN_BUS_GONE;
    }
    if (n != (ssize_t)CAN_MTU && n != (ssize_t)CANFD_MTU) {
        self->bus.counts.garbage++;
        return DAHL_CAN_BUS_NONE;
    }
    from_wire(frame, &wire);
    frame->time_us = stamp_of(&message, &self->bus.clock);
    frame->flags = (uint8_t)(frame->flags | flag_if((uint32_t)message.msg_flags & MSG_CONFIRM, DAHL_CAN_FRAME_OWN) |
                             (n == (ssize_t)CANFD_MTU ? fd_flags(&wire) : 0));
    return DAHL_CAN_BUS_OK;
}

static dahl_can_result_t socketcan_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    socketcan_t *self = (socketcan_t *)bus;
    dahl_can_result_t result = read_one(self, frame);
    if (result != DAHL_CAN_BUS_NONE || timeout_us == 0) {
        return result;
    }
    struct pollfd ready = {.fd = self->fd, .events = POLLIN};
    struct timespec wait = {.tv_sec = (time_t)(timeout_us / 1000000u), .tv_nsec = (long)(timeout_us % 1000000u) * 1000};
    if (ppoll(&ready, 1, &wait, NULL) <= 0) {
        return DAHL_CAN_BUS_NONE;
    }
    return read_one(self, frame);
}

static uint32_t socketcan_peers(const dahl_can_bus_t *bus)
{
    (void)bus;
    return 0;
}

static void socketcan_close(dahl_can_bus_t *bus)
{
    close(((socketcan_t *)bus)->fd);
}

static const dahl_can_bus_ops_t socketcan_ops = {socketcan_send, socketcan_receive, socketcan_peers, socketcan_close};

static dahl_can_result_t bind_to(int fd, const char *interface)
{
    const int on = 1;
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(interface)};
    if (address.can_ifindex == 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    const can_err_mask_t errors = CAN_ERR_MASK;
    if (setsockopt(fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on) != 0 ||
        setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) != 0 ||
        setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) != 0 ||
        setsockopt(fd, SOL_SOCKET, SO_TIMESTAMP, &on, sizeof on) != 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    return bind(fd, (const struct sockaddr *)&address, sizeof address) == 0 ? DAHL_CAN_BUS_OK : DAHL_CAN_BUS_ERROR;
}

dahl_can_result_t socketcan_open(socketcan_t *self, const char *interface, dahl_can_clock_t clock)
{
    self->bus = (dahl_can_bus_t){.ops = &socketcan_ops, .clock = clock};
    self->fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (self->fd < 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    dahl_can_result_t result = bind_to(self->fd, interface);
    if (result != DAHL_CAN_BUS_OK) {
        int why = errno;
        close(self->fd);
        errno = why;
    }
    return result;
}

dahl_can_result_t socketcan_filter(socketcan_t *self, const uint32_t *ids, size_t count)
{
    struct can_filter filters[FILTERS_MAX];
    size_t used = count < FILTERS_MAX ? count : FILTERS_MAX;
    for (size_t i = 0; i < used; i++) {
        filters[i] = (struct can_filter){.can_id = ids[i], .can_mask = CAN_SFF_MASK};
    }
    socklen_t size = (socklen_t)(used * sizeof filters[0]);
    return setsockopt(self->fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, size) == 0 ? DAHL_CAN_BUS_OK : DAHL_CAN_BUS_ERROR;
}
