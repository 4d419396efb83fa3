# SPDX-License-Identifier: MIT
"""The other end of a node, for a script: Client counts the shaft and the frames.

>>> import can, dahl
>>> from dahl import node
>>> with can.Bus("doc", interface="virtual") as bus, can.Bus("doc", interface="virtual") as other:
...     friction = dahl.Node(dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=1e-3))
...     notifier = can.Notifier(other, [node.Listener(other, friction)], timeout=0.01)
...     client = dahl.Client(bus)
...     answer = client.move(5)
...     notifier.stop()
>>> answer.ratio, round(client.torque, 6)
(0.6321205766871572, 0.31606)
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from dahl.binding import checks
from dahl.can import codec
from dahl.can.codec import EncoderState, FrictionTorque, Param, ParamWrite, Reset, Result, What
from dahl.can.node import ask, check_bus, check_timeout, send, turn_of
from dahl.errors import InputError, hide

if TYPE_CHECKING:
    import can

__all__ = ["Client"]
__tracebackhide__ = hide
REARM = 3  # DAHL_NODE_REARM: good frames in a row after which a silent node answers


class Client:
    """An encoder and a user of one node: moves go to the node, its torque comes back.

    bus      a bus of python-can; no other code may receive from it
    number   of the node, 0 .. 15
    timeout  s that each answer may take, 0 .. 60

    The first move() restarts the node. If the node stays silent for `timeout`, move(), read() and
    write() raise dahl.Timeout, a TimeoutError; if the bus is lost, dahl.BusError, a
    ConnectionError. The counts go on: just call again. Threads may share a client.

    A node that restarts by itself answers the next move with state INIT: its bristle has relaxed,
    and this move is lost.
    """

    def __init__(self, bus: can.BusABC, number: int = 0, timeout: float = 1.0) -> None:
        check_bus(bus, "send", "recv")
        self._bus, self._number = bus, codec.number_of(number, "number")
        self._timeout = check_timeout(timeout)
        self._count, self._counter, self._param_counter = 0, 0, 0  # of the frames to come
        self._ratio, self._Fc = 0.0, 0.0
        self._is_started, self._is_answered = False, False
        self._sent_s, self._silence_s = 0.0, 0.0  # time of the last frame; timeout of the node

    @property
    def number(self) -> int:
        """0 .. 15."""
        return self._number

    @property
    def count(self) -> int:
        """The sum of all moves in counts, which wraps at 32 bits."""
        return self._count

    @property
    def torque(self) -> float:
        """F in N m of the last answer, 0 before the first: its ratio times parameter FC of the
        node, which has steps of 2^-20 N m. FC is read at a restart and after each write().
        """
        return self._ratio * self._Fc

    def move(self, dcounts: int) -> FrictionTorque:
        """Move by dcounts, a whole number within int32, and return the answer, whose `ratio` is
        F/Fc. The move counts even if the answer is missing.

        A node that hears nothing for its timeout becomes STALE. It then answers the third good
        frame in a row, and takes its count as a new starting point with the torque of before. So
        after such a pause, and after a dahl.Timeout, this call first sends the count before the
        move three times. If the node still does not answer, for example after four bus-offs,
        restart() is needed.
        """
        moved = checks.counts(dcounts)
        with turn_of(self._bus):
            if not self._is_started:
                self.restart()
            if not self._is_answered or time.monotonic() - self._sent_s > self._silence_s / 2:
                for _ in range(REARM - 1):
                    send(self._bus, self._next_state(), self._number)
                self._ask_torque()
            self._count = (self._count + moved + 2**31) % 2**32 - 2**31
            return self._ask_torque()

    def restart(self) -> None:
        """Restart the node: its bristle relaxes, and the present count is its starting point."""
        with turn_of(self._bus):
            ask(self._bus, Reset(What.RESTART), self._number, self._timeout)
            self._silence_s = self.read(Param.TIMEOUT)  # Status has it in steps of 10 ms
            self._Fc = self.read(Param.FC)
            self._ask_torque()
            self._is_started = True

    def read(self, param: int) -> float:
        """Return a parameter in N m/rad, N m, rad per count, s, counts per ms, or a fraction."""
        return self._ask_param(ParamWrite(param))

    def write(self, param: int, value: float) -> float:
        """Set a parameter, in the unit of read(), and return the value that the node has now: the
        nearest step, of large values the nearest float (24 bits). Raises dahl.InputError if the
        node refuses it. node.ask() with Write.HOLD changes several at once.
        """
        with turn_of(self._bus):
            kept = self._ask_param(ParamWrite.of_si(param, value))
            if param == Param.TIMEOUT:
                self._silence_s = kept
            if self._is_started:
                self._Fc = self.read(Param.FC)
            return kept

    def _next_state(self) -> EncoderState:
        frame = EncoderState(self._count, self._counter)
        self._counter = (self._counter + 1) % codec.COUNTERS
        self._sent_s = time.monotonic()
        return frame

    def _ask_torque(self) -> FrictionTorque:
        self._is_answered = False
        answer = ask(self._bus, self._next_state(), self._number, self._timeout)
        self._is_answered, self._ratio = True, answer.ratio
        return answer

    def _ask_param(self, frame: ParamWrite) -> float:
        with turn_of(self._bus):
            self._param_counter = (self._param_counter + 1) % codec.COUNTERS
            asked = ParamWrite(frame.param, frame.value, frame.write, self._param_counter)
            reply = ask(self._bus, asked, self._number, self._timeout)
        name = getattr(asked.param, "name", asked.param)
        if reply.result == Result.UNKNOWN:
            raise InputError(f"param = {name}: node {self._number} does not have it")
        if reply.result != Result.DONE:
            raise InputError(
                f"value = {asked.si:g} of parameter {name} is refused by node {self._number}, which"
                f" keeps {reply.si:g}"
            )
        return reply.si

    def __repr__(self) -> str:
        return f"<Client number={self._number}, count={self._count}, torque={self.torque:g} N m>"
