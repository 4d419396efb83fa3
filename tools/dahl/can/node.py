# SPDX-License-Identifier: MIT
"""The friction node of the firmware, on any bus that python-can opens.

Node answers frames. It has no bus and no clock. run() serves nodes on a bus, Listener does so in a
can.Notifier, serve() in asyncio. ask() and expect_silence() test a node from the other end.

>>> import dahl
>>> from dahl import codec
>>> friction = dahl.Node(dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=1e-3))
>>> for counter, count in enumerate((0, 5)):
...     answer = friction.receive(codec.pack(codec.EncoderState(count, counter)))
>>> codec.unpack(answer, codec.FrictionTorque).ratio
0.6321205766871572
"""

from __future__ import annotations

import asyncio
import copy
import functools
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, overload

from dahl.binding import checks, models
from dahl.binding.checks import INT32_MAX, UINT32_MAX
from dahl.binding.copies import Copied, content
from dahl.binding.friction import Friction, Plan
from dahl.binding.library import c
from dahl.binding.loaded import Loaded
from dahl.binding.slip import SLIP_MAX, Parallel, Slip
from dahl.binding.state_element import StateElement
from dahl.can import codec
from dahl.can.bus import is_gone, receive, transmit
from dahl.errors import BusError, Error, InputError, RunError, Timeout, hide

if TYPE_CHECKING:
    import can

__tracebackhide__ = hide
__all__ = ["Counts", "Listener", "Node", "Traffic", "ask", "expect_silence", "run", "serve"]

TICK_PERIOD_S = 0.005  # at most, between two calls of tick()
ONE = 65536  # DAHL_NODE_ONE: gain and limit of 1
BUS_OFF = 0x40  # DAHL_CAN_ERROR_BUS_OFF
ANSWERS = (codec.FrictionTorque.base, codec.Status.base, codec.ParamReply.base)
MAX_PARAM_S = 60.0  # the longest time that a parameter on the bus can hold
MAX_TIME_S = 1e300  # before and after 0; in us it is still a float
MAX_PAUSE_S = 1000.0  # without a call: longer than any timeout, shorter than 2^31 us

Model: TypeAlias = Plan | Slip | Parallel | StateElement | Loaded


@dataclass(frozen=True)
class Counts:
    """Frames since the node was created, by result (dahl_node_counts_t)."""

    ok: int
    repeated: int
    lost: int
    wrong_sequence: int
    crc: int
    format: int
    invalid: int
    jump: int
    stale: int
    rearm: int
    ignored: int
    params: int
    resets: int
    bus_off: int


COUNTS = tuple(Counts.__dataclass_fields__)


class Node(Copied):
    """A friction node (dahl_node_t): frames in, frames out.

    friction       a Plan, a Slip, or the object of another model; the node copies its parameters,
                   not its state. Parameter Load sets the load of a Loaded, 0 .. 1; 1 at first
    number         0 .. 15, the low 4 bits of its ids
    gain           fraction of the torque that is answered, 0 .. 1
    limit          fraction of Fc that the answer is clamped to, 0 .. 1
    ramp           s that the gain needs from 0 to 1, 0 .. 60
    timeout        s without a good EncoderState after which it is stale, 0.001 .. 60
    max_step       counts per ms; a faster count is a jump. 0: no limit
    status_period  s from one Status to the next, 0 .. 60; 0: only after an event

    The caller gives `now` in s, on any clock. A call without it uses the last `now`, 0 at first.
    docs/loop.md shows how the node reacts to each frame. Cost: 2 us a frame.
    """

    _derived_fields = frozenset({"_node", "_kept", "_in", "_out"})

    def __init__(
        self,
        friction: Model,
        number: int = 0,
        *,
        gain: float = 1.0,
        limit: float = 1.0,
        ramp: float = 0.0,
        timeout: float = 0.1,
        max_step: int = 0,
        status_period: float = 0.1,
    ) -> None:
        self._now, self._us = 0.0, 0  # s, and on the clock of the C
        self._friction = copy.deepcopy(friction) if _use_of(friction) else friction
        self._begin(codec.number_of(number, "number"))
        self._node.gain = round(_within("gain", gain, 0, 1, "") * ONE)
        self._node.limit = round(_within("limit", limit, 0, 1, "") * ONE)
        self._node.ramp_us = _us(_within("ramp", ramp, 0, MAX_PARAM_S, "s"))
        self._node.timeout_us = _us(_within("timeout", timeout, 0.001, MAX_PARAM_S, "s"))
        self._node.max_step = checks.whole("max_step", max_step, 0, INT32_MAX)
        self._node.status_us = _us(_within("status_period", status_period, 0, MAX_PARAM_S, "s"))
        self._node.gain_now = 0 if self._node.ramp_us else self._node.gain

    def _begin(self, number: int) -> None:
        """Call dahl_node_init, and dahl_node_use if the model is no Plan."""
        use = _use_of(self._friction)
        if use is None:
            known = ", ".join(models.class_of(row).__name__ for row in models.table().values())
            raise TypeError(f"friction = {checks.shown(self._friction)} is none of {known}")
        given = use(self._friction)
        first = Plan(given.sigma0[0], given.Fc[0], given.theta_per_count)
        first._need_counts()
        self._node, self._kept = c.new("dahl_node_t *"), None
        self._in, self._out = codec.RawFrame(), codec.RawFrame()
        failed = c.dahl_node_init(self._node, first._params(), number)
        if given.name != "dahl" and not failed:
            self._kept = c.new(f"dahl_node_{given.name}_t *")
            storage = c.addressof(self._kept[0], "model")
            calls = c.addressof(getattr(c, f"dahl_model_{given.name}_q30"))
            failed = c.dahl_node_use(self._node, storage, calls, given.params())
        if failed:
            raise InputError(f"friction = {self._friction!r} is refused by the node")

    @property
    def friction(self) -> Model:
        """The model of __init__(); a ParamWrite may have changed the node since."""
        return self._friction

    @property
    def number(self) -> int:
        """0 .. 15."""
        return int(self._node.number)

    @property
    def state(self) -> codec.State:
        """State of the receiver."""
        return codec.State(self._node.state)

    @property
    def errors(self) -> codec.Errors:
        """Sticky bits of Status."""
        return codec.Errors(self._node.errors)

    @property
    def counts(self) -> Counts:
        """Frames by result."""
        return Counts(*(getattr(self._node.counts, name) for name in COUNTS))

    def receive(self, message: can.Message, now: float | None = None) -> can.Message | None:
        """Process one frame of any kind. Return the answer to send at once, if there is one: a
        FrictionTorque to an EncoderState, a ParamReply to a ParamWrite, a Status to a Reset.
        """
        moment = self._us if now is None else self._at(now)
        self._in.read(message)
        if message.is_error_frame and not self._in.c.id & BUS_OFF:
            return None  # an event of the controller that does not concern the encoder
        if c.dahl_node_receive(self._node, self._in.c, moment, self._out.c):
            return self._out.message()
        return None

    def tick(self, now: float | None = None) -> can.Message | None:
        """Check the clock; call it every few ms. Return a Status to send if one is due, as in the
        first call, unless a Reset has been answered before.
        """
        moment = self._us if now is None else self._at(now)
        return self._out.message() if c.dahl_node_tick(self._node, moment, self._out.c) else None

    def _at(self, now: float) -> int:
        """Set the time to a new `now`, and return it on the clock of the C."""
        if type(now) is not float or not abs(now) <= MAX_TIME_S:
            now = _within("now", now, -MAX_TIME_S, MAX_TIME_S, "s")
        if now - self._now > MAX_PAUSE_S:
            self._age(now)
        self._now, self._us = now, round(now * 1e6) & UINT32_MAX
        return self._us

    def _age(self, moment: float) -> None:
        """Handle a pause so long that the clock of the C, which wraps after 71 minutes, could read
        it as a short one: ages end at its beginning, and a Status is due at its end.
        """
        counter = self._node.status_counter
        if c.dahl_node_tick(self._node, _clock(self._now + MAX_PAUSE_S), self._out.c):
            self._node.status_counter, self._node.urgent = counter, 1
        self._node.bus_off_us = _clock(moment - MAX_PAUSE_S)

    def __getstate__(self) -> dict[str, Any]:
        """All fields without addresses."""
        node = c.new("dahl_node_t *", self._node[0])
        node.model = c.NULL
        kept = content(self._kept)[c.sizeof("dahl_node_model_t") :] if self._kept else b""
        return {**super().__getstate__(), "_node": content(node), "_kept": kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._begin(0)  # with the library of this process
        model = self._node.model
        c.memmove(self._node, state["_node"], len(state["_node"]))
        self._node.model = model
        if self._kept:
            c.buffer(self._kept)[c.sizeof("dahl_node_model_t") :] = state["_kept"]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Node):
            return NotImplemented
        return self._comparable() == other._comparable()

    def _comparable(self) -> tuple[Any, ...]:
        """All but addresses, and padding that C leaves as it is."""
        first, last = (c.offsetof("dahl_node_t", name) for name in ("params", "urgent"))
        state = self.__getstate__()
        return type(self._friction), state["_node"][first : last + 1], state["_kept"]

    __hash__ = None  # type: ignore[assignment]  # it changes with each frame

    def __repr__(self) -> str:
        return (
            f"<Node {self._friction!r}, number={self.number}, state={self.state.name},"
            f" ok={self._node.counts.ok}>"
        )


def _within(name: str, value: float, least: float, most: float, unit: str) -> float:
    number = checks.finite(name, value, unit or "a part")
    if not least <= number <= most:
        raise InputError(f"{name} = {number:g} is outside {least:g} .. {most:g} {unit}".rstrip())
    return number


def _us(seconds: float) -> int:
    return round(seconds * 1e6)


def _clock(seconds: float) -> int:
    """Return this time on the clock of the C: us, modulo 2^32."""
    return _us(seconds) & UINT32_MAX


# --- models ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Given:
    """Name and parameters of a model (dahl_model_params_t)."""

    name: str
    sigma0: Sequence[float]
    Fc: Sequence[float]
    theta_per_count: float
    slips: int = 0
    own: float = 0.0

    def params(self) -> Any:
        each = len(self.Fc), self.theta_per_count, list(self.sigma0), list(self.Fc)
        return c.new("dahl_model_params_t *", (each, self.slips, self.own))


def _use_plan(plan: Plan, name: str = "dahl") -> Given:
    return Given(name, [plan.sigma0], [plan.Fc], plan.theta_per_count)


def _use_slip(slip: Slip) -> Given:
    return Given("slip", slip.sigma0, slip.Fc, slip.theta_per_count)


def _use_element(one: StateElement) -> Given:
    """Use a model of one sigma0, one Fc or two, theta_per_count, and perhaps its own key."""
    row, values = models.table()[one._kind.removesuffix("_")], list(one._values.values())
    own = one._values[row.key] if row.key else 0.0
    theta = one._values["theta_per_count"]
    return Given(row.name, values[:1], values[1 : 1 + row.Fcs], theta, own=own)


def _use_loaded(one: Loaded) -> Given:
    if one.fixed_stiffness:
        raise InputError("friction = a Loaded with fixed_stiffness steps by angle; a node counts")
    return _use_plan(one.plan, "loaded")


def _use_parallel(mix: Parallel) -> Given:
    elements = [element for part in mix.parts for element in _elements(part)]
    if not 1 <= len(elements) <= SLIP_MAX:
        raise InputError(f"friction has {len(elements)} elements, 1 to {SLIP_MAX} were expected")
    sigma0, torques, thetas, slips = zip(*elements, strict=True)
    if len(set(thetas)) > 1:
        raise InputError(
            f"friction has theta_per_count {thetas[0]:g} and others; one encoder has one"
        )
    bits = sum(is_slip << k for k, is_slip in enumerate(slips))
    return Given("parallel", sigma0, torques, thetas[0], bits)


def _elements(part: Friction | Slip) -> list[tuple[float, float, float, bool]]:
    """Return sigma0, Fc, theta_per_count, and whether it slips, of each element of a part."""
    if isinstance(part, Slip):
        pairs = zip(part.sigma0, part.Fc, strict=True)
        return [(sigma0, torque, part.theta_per_count, True) for sigma0, torque in pairs]
    return [(part.plan.sigma0, part.plan.Fc, part.plan.theta_per_count, False)]


USES: dict[type, Callable[[Any], Given]] = {
    Plan: _use_plan,
    Slip: _use_slip,
    Parallel: _use_parallel,
    StateElement: _use_element,
    Loaded: _use_loaded,
}


def _use_of(friction: object) -> Callable[[Any], Given] | None:
    """Return the entry of its class or of a base class, or None."""
    return next((USES[kind] for kind in type(friction).__mro__ if kind in USES), None)


# --- on a bus -------------------------------------------------------------------------------------


@dataclass
class Traffic:
    """Frames of a served bus: received; answers and Status frames sent; refused by the bus."""

    received: int = 0
    sent: int = 0
    refused: int = 0


class Listener:
    """Nodes on a bus, as a can.Listener for a can.Notifier. A thread calls tick() until stop(),
    which the Notifier calls. `traffic` counts frames.

        notifier = can.Notifier(bus, [Listener(bus, node)])
    """

    def __init__(self, bus: can.BusABC, *nodes: Node) -> None:
        codec.python_can().Listener.register(type(self))
        self._link = _Link(bus, nodes)
        self._ended = threading.Event()
        self._clock = threading.Thread(target=self._tick, name="dahl.node", daemon=True)
        self._clock.start()

    @property
    def traffic(self) -> Traffic:
        """Frames so far."""
        return self._link.traffic

    def on_message_received(self, msg: can.Message) -> None:
        """Answer one frame."""
        self._link.receive(msg)

    def __call__(self, msg: can.Message) -> None:
        """Answer one frame: a Notifier calls its listeners."""
        self._link.receive(msg)

    def on_error(self, exc: Exception) -> None:
        """The Notifier keeps it as its `exception`."""

    def stop(self) -> None:
        """Stop the thread."""
        self._ended.set()
        if threading.current_thread() is not self._clock:
            self._clock.join()

    def _tick(self) -> None:
        while not self._ended.is_set():
            self._link.tick()
            self._ended.wait(TICK_PERIOD_S)


def run(
    bus: can.BusABC,
    *nodes: Node,
    seconds: float | None = None,
    ended: Callable[[], bool] = lambda: False,
) -> Traffic:
    """Serve nodes on a bus until `ended()` is true, which is checked every few ms, or for
    `seconds`. Return the counts of frames. Raises dahl.RunError if the bus fails.
    """
    check_bus(bus, "send", "recv")
    link = _Link(bus, nodes)
    end = time.monotonic() + (float("inf") if seconds is None else check_span("seconds", seconds))
    if not callable(ended):
        raise TypeError(f"ended = {checks.shown(ended)} cannot be called")
    while not ended() and time.monotonic() < end:
        link.tick()
        link.check()
        message = receive(bus, TICK_PERIOD_S)
        if message is not None:
            link.receive(message)
    return link.traffic


async def serve(bus: can.BusABC, *nodes: Node) -> None:
    """Serve nodes on a bus in a thread, until the task is cancelled. Raises dahl.RunError if the
    bus fails. No other code may receive from this bus; if it has a can.Notifier, use a Listener.
    """
    ended = threading.Event()
    thread = ThreadPoolExecutor(1)  # the threads of asyncio are few, and belong to the caller
    work = functools.partial(run, bus, *nodes, ended=ended.is_set)
    served = asyncio.get_running_loop().run_in_executor(thread, work)
    try:
        await asyncio.shield(served)
    finally:
        ended.set()
        await asyncio.wait([served])
        thread.shutdown(wait=False)


def check_timeout(timeout: float) -> float:
    """Return a time in s, 0 .. 60. Raises dahl.Error."""
    return _within("timeout", timeout, 0, MAX_PARAM_S, "s")


def check_span(name: str, value: float) -> float:
    """Return a time in s, 0 to infinity. Raises dahl.Error."""
    number = checks.real(name, value, "a number of s, 0 or above,")
    if not number >= 0:
        raise InputError(f"{name} = {number:g} is not a number of s, 0 or above")
    return number


@overload
def ask(
    bus: can.BusABC, frame: codec.EncoderState, node: int = 0, timeout: float = 1.0
) -> codec.FrictionTorque: ...
@overload
def ask(
    bus: can.BusABC, frame: codec.ParamWrite, node: int = 0, timeout: float = 1.0
) -> codec.ParamReply: ...
@overload
def ask(
    bus: can.BusABC, frame: codec.Reset, node: int = 0, timeout: float = 1.0
) -> codec.Status: ...
def ask(bus: can.BusABC, frame: codec.Frame, node: int = 0, timeout: float = 1.0) -> codec.Frame:
    """Send a frame to a node and return its answer: FrictionTorque to an EncoderState, ParamReply
    to a ParamWrite, the next Status to a Reset. Frames that wait on the bus are dropped first.
    Raises dahl.Timeout if no answer comes within `timeout` s, with the state that the node reports.
    If that is STALE, send a Reset(What.RESTART) first. Raises dahl.BusError if the bus is lost or
    refuses the frame.

    Threads that ask on one bus take turns; `timeout` begins with the turn. Other code that receives
    from this bus, such as a can.Notifier, would take the answers: give it a bus of its own.
    """
    kind = ANSWER_KINDS.get(type(frame))
    if kind is None:
        raise TypeError(f"frame = {checks.shown(frame)} is none that a node answers")
    check_bus(bus, "send", "recv")
    timeout, node = check_timeout(timeout), codec.number_of(node)
    message, why = codec.pack(frame, node), ""
    with turn_of(bus):
        until = time.monotonic() + timeout
        _drop_waiting(bus, until)
        transmit(bus, message, frame)
        while (left := until - time.monotonic()) > 0:
            received = receive(bus, left)
            answer = _answer_in(received, kind.base + node)
            if isinstance(answer, kind) and _answers(answer, frame):
                return answer
            if status := _answer_in(received, codec.Status.base + node):
                why = _why_silent(status, frame)
    raise Timeout(f"no {kind.__name__} of node {node} in {timeout:g} s, to {frame}{why}")


def expect_silence(
    bus: can.BusABC,
    frame: codec.Frame | can.Message | None = None,
    node: int = 0,
    seconds: float = 0.1,
) -> None:
    """Send a frame that a node must not answer, and wait. A can.Message, for example with a wrong
    CRC, is sent as it is; None sends no frame. Frames that wait on the bus are dropped first.
    Raises dahl.RunError if the node sends a FrictionTorque or ParamReply within `seconds`.
    """
    check_bus(bus, "send", "recv")
    seconds, node = _within("seconds", seconds, 0, MAX_PARAM_S, "s"), codec.number_of(node)
    message = None if frame is None else _message_of(frame, node)
    with turn_of(bus):
        _drop_waiting(bus, time.monotonic() + seconds)
        begin = time.monotonic()
        if message is not None:
            transmit(bus, message, frame)
        while (left := begin + seconds - time.monotonic()) > 0:
            received = receive(bus, left)
            for kind in (codec.FrictionTorque, codec.ParamReply):
                if answer := _answer_in(received, kind.base + node):
                    after = f"after {time.monotonic() - begin:.3f} s"
                    raise RunError(f"node {node} must be silent, but sent {answer} {after}")


def turn_of(bus: can.BusABC) -> threading.RLock:
    """Return the lock of a bus, so that threads that ask on it take turns."""
    held = getattr(bus, "__dict__", _WITHOUT_DICTIONARY)
    return held.setdefault("_dahl_turn", threading.RLock())  # type: ignore[no-any-return]


_WITHOUT_DICTIONARY: dict[str, Any] = {}  # such buses have one lock in common


def _drop_waiting(bus: can.BusABC, until: float) -> None:
    """Drop the frames that wait on the bus, until this time at the latest."""
    while receive(bus, 0) is not None and time.monotonic() < until:
        pass


def send(bus: can.BusABC, frame: codec.Frame | can.Message, node: int) -> None:
    """Send a frame to a node, or a message as it is. Raises dahl.BusError if the bus refuses it."""
    message = _message_of(frame, node)
    transmit(bus, message, frame)


def _message_of(frame: codec.Frame | can.Message, node: int) -> can.Message:
    """Return the message of a frame, or a message itself. Raises TypeError for anything else."""
    message = codec.pack(frame, node) if isinstance(frame, codec.Frame) else frame
    codec.RawFrame().read(message)
    return message


ANSWER_KINDS: dict[type[codec.Frame], type[codec.Frame]] = {
    codec.EncoderState: codec.FrictionTorque,
    codec.ParamWrite: codec.ParamReply,
    codec.Reset: codec.Status,
}


def _answer_in(message: can.Message | None, identifier: int) -> codec.Frame | None:
    """Return the frame in a message, or None if it has another id or is damaged."""
    if message is None or message.arbitration_id != identifier:
        return None
    try:
        return codec.unpack(message)
    except Error:
        return None


def _why_silent(status: codec.Frame, frame: codec.Frame) -> str:
    """Return the reason why a node did not answer, "" if its Status does not show one."""
    if not isinstance(status, codec.Status) or status.state == codec.State.OK:
        return ""
    reason = f"; its Status says {status.state.name}"
    if status.state in (codec.State.STALE, codec.State.WRONG_SEQUENCE):
        reason += "; after a Reset with What.RESTART it answers"
    if isinstance(frame, codec.EncoderState) and codec.Errors.REPEATED in status.errors:
        reason += "; REPEATED is among its errors: each EncoderState has a counter one higher"
    return reason


def _answers(answer: codec.Frame, frame: codec.Frame) -> bool:
    """Return whether an answer repeats counter and parameter of the frame. Status has neither."""
    if isinstance(answer, codec.FrictionTorque) and isinstance(frame, codec.EncoderState):
        return answer.echo == frame.counter
    if isinstance(answer, codec.ParamReply) and isinstance(frame, codec.ParamWrite):
        known = answer.value if answer.param == codec.Param.NONE else answer.param
        return (answer.counter, known) == (frame.counter, frame.param)
    return True


def check_bus(bus: can.BusABC, *calls: str) -> None:
    """Raise TypeError if a bus lacks one of these methods."""
    if not all(callable(getattr(bus, name, None)) for name in calls):
        raise TypeError(f"bus = {checks.shown(bus)} is not a bus of python-can")


class _Link:
    """Nodes and the bus that they answer on, from any thread."""

    def __init__(self, bus: can.BusABC, nodes: tuple[Node, ...]) -> None:
        check_bus(bus, "send")
        if not nodes:
            raise InputError("no node to serve")
        self._nodes = [checks.instance(f"nodes[{k}]", node, Node) for k, node in enumerate(nodes)]
        if len({node.number for node in nodes}) < len(nodes):
            raise InputError("two nodes of one number on one bus")
        self._bus, self._lock, self.traffic = bus, threading.Lock(), Traffic()
        self._lost: str | None = None  # why the bus is lost
        self._refusals = (codec.python_can().CanError, OSError)

    def check(self) -> None:
        """Raise dahl.BusError if a send has found that the bus is lost."""
        if self._lost is not None:
            raise BusError(f"the bus has gone: {self._lost}")

    def receive(self, message: can.Message) -> None:
        self.check()
        with self._lock:
            self.traffic.received += 1
            for node in self._nodes:
                if self._is_for(node, message):
                    self._send(node.receive(message, time.monotonic()))

    def tick(self) -> None:
        with self._lock:
            for node in self._nodes:
                self._send(node.tick(time.monotonic()))

    def _is_for(self, node: Node, message: can.Message) -> bool:
        """Return whether a node must receive a frame. Several nodes receive by number."""
        if message.is_error_frame:
            return True
        own = not message.is_rx and message.arbitration_id & ~15 in ANSWERS
        return not own and (len(self._nodes) == 1 or message.arbitration_id & 15 == node.number)

    def _send(self, message: can.Message | None) -> None:
        if message is None:
            return
        try:
            self._bus.send(message)
            self.traffic.sent += 1
        except self._refusals as error:  # its queue is full, or it is lost
            self.traffic.refused += 1
            if is_gone(error):
                self._lost = str(error)
