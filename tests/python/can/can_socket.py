# SPDX-License-Identifier: MIT
"""dahl-loop on a CAN socket that is a socketpair, for a kernel without CAN."""

import os
import socket
import struct
import subprocess
from pathlib import Path

from loop_tools import SCENES, command

STEERING = SCENES / "steering.ini"
EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29  # linux/can.h
BUS_OFF = 0x40
CAN = """
#define _GNU_SOURCE
#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>
static int has_stamps, has_waited;
int socket(int domain, int type, int protocol)
{
    const char *refused = getenv("CAN_NONE");
    (void)type, (void)protocol;
    errno = refused != 0 ? atoi(refused) : EINVAL;
    return domain == PF_CAN && refused == 0 ? atoi(getenv("CAN_SOCKET")) : -1;
}
int setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
    const char *refused = getenv("CAN_REFUSES");
    if (refused != 0 && level == SOL_CAN_RAW && name == atoi(refused)) {
        errno = EINVAL;
        return -1;
    }
    has_stamps |= level == SOL_SOCKET && name == SO_TIMESTAMP;
    if (level == SOL_CAN_RAW && name == CAN_RAW_FILTER) {
        send(fd, value, size, 0); /* the bus gets the filter of the kernel */
    }
    return 0;
}
int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    (void)fd, (void)address, (void)size;
    return 0;
}
unsigned if_nametoindex(const char *name) { (void)name; return 1; }
/* An echo comes only after a wait, which has no time limit: a slow test does not end it. */
int ppoll(struct pollfd *ready, nfds_t count, const struct timespec *wait, const sigset_t *mask)
{
    struct timespec limit = *wait;
    const int is_limited = getenv("CAN_ECHO") == 0;
    has_waited = 1;
    return syscall(SYS_ppoll, ready, count, is_limited ? &limit : 0, mask, sizeof(long));
}
ssize_t recvmsg(int fd, struct msghdr *message, int flags)
{
    const char *fails = getenv("CAN_RECEIVE_FAILS"), *stamp = getenv("CAN_STAMP");
    struct iovec *part = message->msg_iov;
    message->msg_controllen = 0;
    if (stamp != 0 && has_stamps) {
        struct timeval when = {atol(stamp), 654321};
        struct cmsghdr *told = message->msg_control;
        *told = (struct cmsghdr){CMSG_LEN(sizeof when), SOL_SOCKET, SO_TIMESTAMP};
        memcpy(CMSG_DATA(told), &when, sizeof when);
        message->msg_controllen = CMSG_SPACE(sizeof when);
    }
    message->msg_flags = getenv("CAN_ECHO") != 0 ? MSG_CONFIRM : 0;
    if (fails != 0) {
        errno = atoi(fails);
        return -1;
    }
    if (getenv("CAN_ECHO") != 0 && !has_waited) {
        errno = EAGAIN;
        return -1;
    }
    has_waited = 0;
    return recv(fd, part->iov_base, part->iov_len, flags);
}
"""


def build_can_library(folder: Path) -> Path:
    """Build the library that replaces calls of the kernel (LD_PRELOAD)."""
    path = folder / "can.so"
    words = ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(path)]
    subprocess.run(words, input=CAN, text=True, check=True, timeout=60)
    return path


def joined(
    folder: Path, planted: Path, *options: str, log: bool = True, scene: Path = STEERING
) -> tuple[subprocess.Popen, socket.socket]:
    bus, inner = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    inner.setblocking(False)
    inner.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16384)
    bus.settimeout(10)
    folder.mkdir(exist_ok=True)
    words = command(folder, scene, "--bus", "socketcan:can0", *options)
    at = words.index("--log")
    process = subprocess.Popen(
        words if log else words[:at] + words[at + 2 :],
        env={**os.environ, "LD_PRELOAD": str(planted), "CAN_SOCKET": str(inner.fileno())},
        pass_fds=[inner.fileno()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    inner.close()
    return process, bus


def frame(identifier: int, data: bytes) -> bytes:
    return struct.pack("=IB3x8s", identifier, len(data), data)
