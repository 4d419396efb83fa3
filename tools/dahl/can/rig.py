# SPDX-License-Identifier: MIT
"""A node on a rig, for tests of a dahl.Node: the same properties, read over the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

from dahl.binding.friction import Plan
from dahl.can import bus as buses
from dahl.can import codec
from dahl.can.codec import Errors, Param, ParamWrite, Result, State, Write
from dahl.can.node import COUNTS, Counts, Node, ask, turn_of
from dahl.errors import BusError, Error, RunError, Timeout, hide

if TYPE_CHECKING:
    import can

    from dahl.can.frame_log import FrameLog

__tracebackhide__ = hide
READ_PERIOD_S = 0.02
EACH_TICK = ParamWrite(Param.STATUS, 1, Write.WRITE)  # a Status every ms
MODEL = (Param.SIGMA0, Param.FC, Param.THETA)
# Sums in Status, and the error bit of each summand: if it is clear, the summand is 0.
CORRUPT = {"crc": Errors.CRC, "format": Errors.FORMAT}
OUT_OF_STEP = {
    "repeated": Errors.REPEATED,
    "wrong_sequence": Errors.WRONG_SEQUENCE,
    "jump": Errors.JUMP,
    "stale": Errors.STALE,
    "bus_off": Errors.STALE,
}


class NoRig(BusError):
    """The bus of a rig does not open."""


def open_rig(settings: dict[str, Any], timeout: float) -> can.BusABC:
    """Open the bus of a rig within `timeout` s. Raises NoRig if it is absent, BusError for wrong
    settings.
    """
    try:
        if settings["interface"] == "socketcand":
            return _open_in_time(settings, timeout)
        return buses.open_bus(**settings)
    except RunError as error:
        if isinstance(error.__context__, (codec.python_can().CanInitializationError, OSError)):
            raise NoRig(str(error)) from None
        raise


def _open_in_time(settings: dict[str, Any], timeout: float) -> can.BusABC:
    """Open a bus within `timeout` s: python-can tries for 10 s to reach a socketcand server."""
    opened: Future[can.BusABC] = Future()

    def work() -> None:
        try:
            opened.set_result(buses.open_bus(**settings))
        except RunError as error:
            opened.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return opened.result(timeout)
    except TimeoutError:
        opened.add_done_callback(_close)
        why = f"in {timeout:g} s ({buses.NO_SERVER}; --dahl-answer-timeout waits longer)"
        raise NoRig(f"cannot open the bus ({buses.shown(settings)}) {why}") from None


def _close(opened: Future[can.BusABC]) -> None:
    if opened.exception() is None:
        opened.result().shutdown()


def _refuse(name: str, why: str) -> NoReturn:
    raise RunError(f"dahl_node.{name}: a node on a rig does not have it: {why}")


class RigCounts:
    """node.Counts of a node on a rig, as far as its answers and its Status give them.

    ok is the number of its torques since the test began. The others are since the last Reset,
    modulo 256. Raises dahl.RunError for a number that Status does not determine.
    """

    def __init__(self, ok: int, status: codec.Status) -> None:
        self._ok, self._status = ok, status

    def __getattr__(self, name: str) -> int:
        if name not in COUNTS:
            raise AttributeError(f"Counts have no '{name}'; they have {', '.join(COUNTS)}")
        if name == "ok":
            return self._ok
        if name == "lost":
            return self._status.lost
        if name in CORRUPT:
            return self._share(name, CORRUPT, self._status.corrupt)
        if name in OUT_OF_STEP:
            return self._share(name, OUT_OF_STEP, self._status.out_of_step)
        if name == "invalid" and Errors.INVALID not in self._status.errors:
            return 0
        _refuse(f"counts.{name}", "no frame carries it")

    def _share(self, name: str, kinds: Mapping[str, Errors], total: int) -> int:
        """Return one summand of a sum: known if its error bit is clear, or the only one set."""
        possible = [kind for kind, error in kinds.items() if error in self._status.errors]
        if name not in possible:
            return 0
        if possible != [name]:
            _refuse(f"counts.{name}", f"Status has {' + '.join(possible)} = {total}")
        return total

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, (Counts, RigCounts)):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in COUNTS)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<RigCounts ok={self._ok}, {self._status}>"


class RigNode:
    """A node on a rig, with the properties of dahl.Node. It must answer each frame within `timeout`
    s.

    Reading `state`, `errors` or `counts` makes it send a Status; `friction` reads its parameters.
    A property that no frame carries raises dahl.RunError.
    """

    def __init__(self, bus: can.BusABC, frames: FrameLog, number: int, timeout: float) -> None:
        self._bus, self._frames, self._number, self._timeout = bus, frames, number, timeout
        self._ok, self._counter = 0, 0
        self._own = [codec.ParamReply.base]
        self._statuses: list[codec.Status] = []
        self._replies: list[codec.ParamReply] = []
        self._before: list[list[ParamWrite]] = []
        frames.listeners.append(self._listen)

    def restart(self) -> None:
        """Reset the node, and count from here. Raises dahl.Timeout if it does not answer."""
        ask(self._bus, codec.Reset(codec.What.RESTART), self._number, timeout=self._timeout)
        self._ok = 0

    def configure(self, wanted: Node) -> None:
        """Write the settings and the Plan of a node if they differ from those of the rig. Raises
        dahl.RunError for one that the rig refuses.
        """
        for asked in _settings(wanted):
            self._change([asked])
        plan = wanted.friction
        if not isinstance(plan, Plan):
            _refuse("friction", f"its model is fixed, and cannot become {plan!r}")
        values = (plan.sigma0, plan.Fc, plan.theta_per_count)
        how = (Write.HOLD, Write.HOLD, Write.WRITE)
        self._change(list(map(ParamWrite.of_si, MODEL, values, how)))

    def restore(self) -> None:
        """Write back the parameters that configure() changed."""
        while self._before:
            self._write(self._before.pop())

    @property
    def plan(self) -> Plan:
        """sigma0, Fc and theta_per_count of the node; of several elements those of the first."""
        return Plan(*(self._ask(ParamWrite(param)).si for param in MODEL))

    @property
    def friction(self) -> Plan:
        """The Plan of the node. Raises dahl.RunError if its model is not Dahl's."""
        if model := self._ask(ParamWrite(Param.MODEL)).value:
            _refuse("friction", f"its parameter Model is {model}, which is not Dahl's")
        return self.plan

    @property
    def number(self) -> int:
        """0 .. 15."""
        return self._number

    @property
    def state(self) -> State:
        """State of its input."""
        return self._next_status().state

    @property
    def errors(self) -> Errors:
        """Sticky bits of Status."""
        return self._next_status().errors

    @property
    def counts(self) -> RigCounts:
        """Frame counts by outcome."""
        status = self._next_status()
        return RigCounts(self._ok, status)

    def receive(self, message: can.Message, now: float | None = None) -> NoReturn:
        """Raise dahl.RunError: the node of a rig receives from its bus."""
        _refuse("receive()", "it receives from its bus; send on dahl_bus")

    def tick(self, now: float | None = None) -> NoReturn:
        """Raise dahl.RunError: the node of a rig has a clock."""
        _refuse("tick()", "it has its own clock")

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        _refuse("copy", "its state cannot be read")

    def __eq__(self, other: object) -> bool:
        if self is not other and isinstance(other, (Node, RigNode)):
            _refuse("==", "its state cannot be read")
        return self is other

    __hash__ = None  # type: ignore[assignment]  # as dahl.Node

    def __repr__(self) -> str:
        return f"<RigNode number={self._number} on {self._bus.channel_info}>"

    def _listen(self, message: can.Message) -> None:
        if message.arbitration_id & 15 != self._number or message.is_extended_id:
            return
        try:
            frame = codec.unpack(message)
        except Error:
            return
        if isinstance(frame, codec.FrictionTorque):  # WRONG_SEQUENCE: answered, but not as ok
            self._ok += frame.state != State.WRONG_SEQUENCE
        elif isinstance(frame, codec.Status):
            self._statuses.append(frame)
        elif isinstance(frame, codec.ParamReply):
            self._replies.append(frame)

    def _next_status(self) -> codec.Status:
        """Return a Status that covers all frames that the node has received so far. It comes at
        once, since its period is short until then.
        """
        with turn_of(self._bus):
            period = self._ask(ParamWrite(Param.STATUS)).value
            self._own = [codec.ParamReply.base, codec.Status.base]
            self._write([EACH_TICK])
            self._statuses.clear()
            try:
                self._wait(lambda: bool(self._statuses), "Status")
                return self._statuses[0]
            finally:
                self._write([replace(EACH_TICK, value=period)])
                self._own = [codec.ParamReply.base]

    def _ask(self, asked: ParamWrite) -> codec.ParamReply:
        with turn_of(self._bus):
            self._counter = (self._counter + 1) % codec.COUNTERS
            asked = replace(asked, counter=self._counter)
            self._replies.clear()
            self._bus.send(codec.pack(asked, self._number))

            def found() -> list[codec.ParamReply]:
                return [one for one in self._replies if one.counter == asked.counter]

            self._wait(lambda: bool(found()), f"ParamReply to {asked}")
            return found()[0]

    def _wait(self, done: Callable[[], bool], what: str) -> None:
        """Read ahead until done(). Drop frames of the ids in _own, which answer this object; keep
        all others for the test.
        """
        own = [base + self._number for base in self._own]
        until = time.monotonic() + self._timeout
        while not done():
            if time.monotonic() > until:
                raise Timeout(f"node {self._number} of the rig: no {what} in {self._timeout:g} s")
            self._frames.read_ahead(READ_PERIOD_S, lambda message: message.arbitration_id in own)

    def _change(self, wanted: list[ParamWrite]) -> None:
        """Write a set of parameters unless the node has them, and keep the earlier values."""
        had = [replace(one, value=self._ask(ParamWrite(one.param)).value) for one in wanted]
        if had != wanted:
            self._write(wanted)  # a refusal changes no parameter
            self._before.append(had)

    def _write(self, writes: list[ParamWrite]) -> None:
        for asked in writes:
            reply = self._ask(asked)
            if reply.result != Result.DONE:
                raise RunError(
                    f"node {self._number} of the rig refuses {Param(asked.param).name} ="
                    f" {asked.si:g} ({reply.result.name}); it keeps {reply.si:g}"
                )


def _settings(node: Node) -> Iterator[ParamWrite]:
    """Yield the writes that give another node the settings of this one."""
    held = node._node
    yield ParamWrite(Param.GAIN, held.gain, Write.WRITE)
    yield ParamWrite(Param.LIMIT, held.limit, Write.WRITE)
    yield ParamWrite(Param.STEP, held.max_step, Write.WRITE)
    yield ParamWrite.of_si(Param.RAMP, held.ramp_us * 1e-6)
    yield ParamWrite.of_si(Param.TIMEOUT, held.timeout_us * 1e-6)
    yield ParamWrite.of_si(Param.STATUS, held.status_us * 1e-6)
