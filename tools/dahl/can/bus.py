# SPDX-License-Identifier: MIT
"""Buses: any that python-can opens, and which one is best here."""

from __future__ import annotations

import argparse
import errno
import logging
import queue
import re
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Generator, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.errors import BusError, Error, InputError, Timeout, hide
from dahl.io import candump

if TYPE_CHECKING:
    import can

    from dahl.interrupt import Stop

__tracebackhide__ = hide
VCAN, candump_line = candump.VCAN, candump.candump_line  # public names
WHICH = "which bus? Name it with -i and -c, or in python-can's own settings"
FLAGS = {  # options of a bus, by their names in python-can
    "interface": "-i",
    "channel": "-c",
    "bitrate": "-b",
    "fd": "--fd",
    "data_bitrate": "--data-bitrate",
    "timing": "--timing",
    "host": "--host",
    "port": "--port",
    "bus_kwargs": "--bus-kwargs",
}
SERVED = "serve a bus by `dahl node` without -i, and join it with -i socketcand"
NO_CAN = f"this kernel has no CAN; {SERVED}, or use tools/vm.sh"
SOCKETCAN_HINTS = {
    errno.EAFNOSUPPORT: NO_CAN,
    errno.EPROTONOSUPPORT: NO_CAN,
    errno.ENODEV: f"create it as root with `ip link add NAME type vcan`, or {SERVED}",
}
NO_SERVER = "no server answers there; `dahl node --port N` starts one"
QUIET_S = 0.05  # without a frame; then the iterator yields None
NOTICEABLE_LAG_S = 0.5  # behind the bus; a busy machine alone causes less
MAX_CLASSIC_BYTES = 8  # a longer frame is CAN FD
GONE = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)  # an interface is down, or unplugged
SO_MEMINFO = 55  # linux/socket.h; the last of its 9 numbers counts discarded frames


def named(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the bus among the arguments."""
    return {key: value for key in FLAGS if (value := getattr(args, key, None)) is not None}


def keywords(options: dict[str, Any]) -> dict[str, Any]:
    """Return keywords of can.Bus from options of named(). Raises dahl.Error for one given twice."""
    more: dict[str, Any] = options.get("bus_kwargs", {})
    first = {key: value for key, value in options.items() if key != "bus_kwargs"}
    for key, value in more.items():
        if key in first:
            raise InputError(f"--bus-kwargs {key}={value}: {FLAGS[key]} {first[key]} is given too")
    return first | more


def words(options: dict[str, Any]) -> list[str]:
    """Return options of named() as words of a command line."""
    found = []
    for key, value in options.items():
        found.append(FLAGS[key])
        if isinstance(value, Mapping):
            found += [f"{name}={one}" for name, one in value.items()]
        elif key != "fd":  # a flag
            found.append(str(value))
    return found


def open_from(args: argparse.Namespace) -> can.BusABC:
    """Open the bus that the arguments name. Raises dahl.Error as open_bus() does."""
    import can.cli

    options = keywords(named(args))
    server = {key: options[key] for key in ("host", "port") if key in options}
    try:
        return can.cli.create_bus_from_namespace(args, **tuned_for(options), **server)
    except argparse.ArgumentError as error:
        raise _not_open(named(args), error.__cause__) from None


def open_bus(patience: float = 0.0, **settings: Any) -> can.BusABC:
    """Open a python-can bus, trying again for `patience` seconds. Raises BusError in one line
    whatever the interface.
    """
    import can

    logging.getLogger("can.interfaces.socketcand.socketcand").addFilter(_is_news)
    until = time.monotonic() + patience
    while True:
        try:
            return can.Bus(**tuned_for(settings) | settings)
        except Exception as error:  # each interface of python-can has its own kinds
            if time.monotonic() >= until:
                raise _not_open(settings, error) from None
        time.sleep(0.05)


def _is_news(record: logging.LogRecord) -> bool:
    """Return whether a warning of python-can is worth logging: not one of thousands of attempts to
    connect, and not a frame that arrives in two pieces.
    """
    text = str(record.msg)
    return not text.startswith(("Failed to connect to server", "Got incomplete message"))


def tuned_for(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings that an interface needs: a socketcand client must send each frame at once. Its
    kernel would hold short frames back, and discard them if the bus is closed with unread frames.
    """
    return {"tcp_tune": True} if settings.get("interface") == "socketcand" else {}


def _not_open(settings: dict[str, Any], error: object) -> Error:
    if "interface" not in settings and "Unknown interface type" in str(error):
        return InputError(WHICH)
    hint = ""
    if settings.get("interface", "socketcan") == "socketcan":
        hint = SOCKETCAN_HINTS.get(getattr(error, "errno", None) or 0, "")
    elif settings["interface"] == "socketcand" and "Failed to connect" in str(error):
        hint = NO_SERVER
    return BusError(f"cannot open the bus ({shown(settings)}): {error}" + f" ({hint})" * bool(hint))


def shown(settings: dict[str, Any]) -> str:
    """Return a bus in the words of messages."""
    return " ".join(f"{key}={value}" for key, value in settings.items()) or "of your settings"


def silent(args: argparse.Namespace, seconds: float) -> Timeout:
    """Return the error for a bus without frames."""
    return Timeout(
        f"no frame on the bus ({shown(named(args))}) in {seconds:.1f} s:"
        " is a node there, at this bit rate?"
    )


class Reception:
    """Yield each frame, or None after QUIET_S without one, until stop, finish() or a limit. Frames
    that arrived before that moment are still yielded. Raises dahl.BusError if the bus is lost.

    lag_s is the delay of reading: the age of a frame, minus the age of frames that were waited
    for. If the bus is lost, the error names the longest one: a server drops a slow client.
    """

    def __init__(
        self, bus: can.BusABC, stop: Stop, seconds: float | None = None, frames: int | None = None
    ) -> None:
        self._bus, self._stop, self._frames = bus, stop, frames
        self._end = time.monotonic() + seconds if seconds else float("inf")
        self._least_delay: float | None = None
        self.lag_s = self.most_lag_s = 0.0

    def finish(self) -> None:
        """Stop after the frames that have arrived by now."""
        self._end = min(self._end, time.monotonic())

    def __iter__(self) -> Iterator[can.Message | None]:
        count = 0
        while count != self._frames:
            if self._stop.asked:
                self.finish()
            has_ended = time.monotonic() >= self._end
            try:
                message = self._next(0.0 if has_ended else QUIET_S)
            except BusError as error:
                raise BusError(f"{error}{self._lag_text()}") from None
            if has_ended and (message is None or self._is_after_end()):
                return
            count += message is not None
            yield message

    def _next(self, seconds: float) -> can.Message | None:
        waits_since = time.monotonic()
        message = receive(self._bus, 0.0)
        has_waited = message is None
        if message is None and seconds:
            message = receive(self._bus, seconds)
        now = time.monotonic()
        is_prompt = has_waited and now - waits_since < 2 * QUIET_S  # this process was not stopped
        if message is not None:
            self._measure(now - message.timestamp, is_prompt)
        elif is_prompt:
            self.lag_s = 0.0
        return message

    def _measure(self, delay: float, is_prompt: bool) -> None:
        if is_prompt or self._least_delay is None:
            self._least_delay = delay
        self._least_delay = min(delay, self._least_delay)
        self.lag_s = delay - self._least_delay
        self.most_lag_s = max(self.most_lag_s, self.lag_s)

    def _lag_text(self) -> str:
        if self.most_lag_s <= NOTICEABLE_LAG_S:
            return ""
        reason = ": a server closes the connection of a slow reader" * _hung_up(self._bus)
        return f", and reading was up to {self.most_lag_s:.1f} s late{reason}"

    def _is_after_end(self) -> bool:
        return time.monotonic() - self.lag_s > self._end


def lost_in_kernel(bus: can.BusABC) -> int:
    """Return the number of frames that the kernel discarded because the receive buffer of this
    SocketCAN bus was full; 0 for another interface.
    """
    link = getattr(bus, "socket", None)
    if not isinstance(link, socket.socket):
        return 0
    try:
        numbers = struct.unpack("9I", link.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 36))
    except (OSError, struct.error):  # older than Linux 4.12
        return 0
    return int(numbers[8])


def read_ahead(frames: Iterable[can.Message | None]) -> Generator[can.Message | None, None, None]:
    """Yield the same frames, read by a separate thread: a server drops a slow client."""
    taken: queue.SimpleQueue[can.Message | None | BaseException] = queue.SimpleQueue()
    enough = threading.Event()

    def take() -> None:
        try:
            for frame in frames:
                taken.put(frame)
                if enough.is_set():
                    return
            taken.put(StopIteration())
        except BaseException as error:  # who waits for frames raises it
            taken.put(error)

    reader = threading.Thread(target=take, daemon=True)
    reader.start()
    try:
        while not isinstance(frame := taken.get(), BaseException):
            yield frame
        if not isinstance(frame, StopIteration):
            raise frame
    finally:
        enough.set()
        reader.join()


def receive(bus: can.BusABC, seconds: float) -> can.Message | None:
    """Return the next frame, None after `seconds`. Raises dahl.BusError if the bus is lost.
    socketcand does not mark CAN FD, so a frame of more than 8 bytes is marked here.
    """
    import can

    try:
        message = bus.recv(seconds)
    except (can.CanError, OSError) as error:
        raise BusError(f"the bus has gone: {error}") from None
    if message is None and _hung_up(bus):
        raise BusError("the bus has gone: its server has closed the connection")
    if message is not None and len(message.data) > MAX_CLASSIC_BYTES:
        message.is_fd = True
    return message


def transmit(bus: can.BusABC, message: can.Message, frame: object) -> None:
    """Send a message. `frame` names it in the dahl.BusError of a bus that does not take it."""
    import can

    try:
        bus.send(message)
    except (can.CanError, OSError) as error:
        raise BusError(f"the bus does not take {frame}: {error}") from None


def is_gone(error: BaseException) -> bool:
    """Return whether an error of send() means that the bus is lost, such as an interface that is
    down. The kernel reports that once, to the next call, which may be a send.
    """
    cause = error if isinstance(error, OSError) else error.__cause__
    return isinstance(cause, OSError) and cause.errno in GONE


def _hung_up(bus: can.BusABC) -> bool:
    """Return whether the socketcand server closed the connection. python-can does not notice it,
    and its socket is not public.
    """
    link = getattr(bus, "_SocketCanDaemonBus__socket", None)
    try:
        return link is not None and link.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def has_socketcan() -> bool:
    """Return whether the kernel supports CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (AttributeError, OSError):
        return False
    return True


def vcan_is_up(name: str = VCAN) -> bool:
    """Return whether the interface is up. Create it if that is possible (as root)."""
    if not Path(f"/sys/class/net/{name}").exists() and shutil.which("ip"):
        subprocess.run(
            ["ip", "link", "add", "dev", name, "type", "vcan"], capture_output=True, check=False
        )
        subprocess.run(["ip", "link", "set", name, "up"], capture_output=True, check=False)
    try:
        return bool(int(Path(f"/sys/class/net/{name}/flags").read_text(), 16) & 1)
    except (OSError, ValueError):
        return False


def choose(wanted: str | None) -> tuple[str, str]:
    """Return the bus of a demo, 'socketcan:vcan0' or 'socketcand', and the reason as a sentence."""
    if wanted:
        if not re.fullmatch(r"socketcand(:\d+)?|socketcan:[^\s:/]+", wanted):
            raise InputError(
                f"--bus {wanted}: socketcan:INTERFACE, socketcand or socketcand:PORT was expected"
            )
        return wanted, "as asked for"
    if not has_socketcan():
        return (
            "socketcand",
            "this kernel has no SocketCAN, so the loop serves socketcand on a local TCP port",
        )
    if not vcan_is_up():
        return (
            "socketcand",
            f"no interface {VCAN} is up (ip link add dev {VCAN} type vcan), so socketcand",
        )
    return f"socketcan:{VCAN}", "the kernel has SocketCAN"
