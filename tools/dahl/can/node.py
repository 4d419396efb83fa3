# SPDX-License-Identifier: MIT
"""The friction node in Python: lib/node as a firmware links it, on any bus that python-can opens.

Node decides, bit for bit as the firmware does, and has no bus and no clock. run() serves nodes on a
bus until it is stopped, Listener does so in a can.Notifier, serve() in asyncio; ask() and
expect_silence() are the other end.

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
import ctypes
import functools
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, overload

from dahl.binding import checks, core, models, parts, variants
from dahl.binding.copies import Copied
from dahl.can import codec
from dahl.can.bus import receive
from dahl.errors import Error, RunError, Timeout

if TYPE_CHECKING:
    import can

    from dahl.binding.models import Friction

__all__ = ["Counts", "Listener", "Node", "Traffic", "ask", "expect_silence", "run", "serve"]

PERIOD = 0.005  # s at most from one look at the clock to the next
ONE = 65536  # DAHL_NODE_ONE: gain and limit of 1
MODEL_BYTES = 24  # of a dahl_node_model_t, which every kept model begins with
KEPT_ROOM = 512  # 8-byte words for what a model keeps (346 are used at most)
BUS_OFF = 0x40  # DAHL_CAN_ERROR_BUS_OFF
ANSWERS = (codec.FrictionTorque.base, codec.Status.base, codec.ParamReply.base)
LONG, INT32_MAX = 60.0, 2**31 - 1  # s; what a parameter on the bus can say
LEAP = 1000.0  # s without a call: longer than any timeout, shorter than what 32 bits of us tell


@dataclass(frozen=True)
class Counts:
    """Frames by what became of them, since the node was made; lost ones never came in time."""

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
SETTINGS = ("gain", "limit", "load", "ramp_us", "timeout_us", "max_step", "status_us")
TIMES = ("gain_now", "gain_rest", "count", "good_us", "sent_us", "bus_off_us")
BYTES = (
    *("number", "state", "errors", "counter", "good_in_a_row", "candidate", "bus_off_count"),
    *("torque_counter", "status_counter"),
    *("cleared_lost", "cleared_corrupt", "cleared_out_of_step", "primed", "silenced", "urgent"),
)


class NodeStructure(ctypes.Structure):
    """dahl_node_t; a test holds both together."""

    _fields_: ClassVar[list[tuple[str, Any]]] = [
        ("plan", ctypes.c_uint64 * 39),
        ("parameters", core._Params),  # `params` in C, as one of the counts is too
        ("held", core._Params),
        ("bearing", core.State),
        ("model", ctypes.c_void_p),
        *((name, ctypes.c_uint32) for name in (*COUNTS, *SETTINGS, *TIMES)),
        *((name, ctypes.c_uint8) for name in BYTES),
    ]


class _ParallelParams(ctypes.Structure):
    _fields_ = [
        ("elements", ctypes.c_uint32),
        ("slips", ctypes.c_uint32),
        ("theta_per_count", ctypes.c_float),
        ("sigma0", ctypes.c_float * parts.SLIP_MAX),
        ("Fc", ctypes.c_float * parts.SLIP_MAX),
    ]


@checks.calls_checked
class Node(Copied):
    """A friction node (dahl_node_t): frames in, frames out, relaxed and unaware at first.

    friction       a Plan, or the object of another model, such as a Slip; only its parameters are
                   used. Parameter Load sets the load of a Loaded, 0 .. 1; 1 at first
    number         0 .. 15, the low 4 bits of its ids
    gain           part of the torque that is answered, 0 .. 1
    limit          part of Fc that the answer is clamped to, 0 .. 1
    ramp           s that the gain needs from 0 to 1, 0 .. 60
    timeout        s without a good EncoderState after which it is stale, 0.001 .. 60
    max_step       counts per ms; what is faster is not believed. 0: no limit known
    status_period  s from one Status to the next, 0 .. 60; 0: only after an event

    Like the C, it has no clock: `now` is the caller's, in s, on any clock; a call without it is
    at the last `now` that was given, 0 at first. Every frame is welcome, whatever it is; what
    becomes of it is one table in docs/loop.md. Comparable, picklable; a copy goes its own way. One
    thread at a time. About 10 us a frame. Raises dahl.Error naming the argument, its value and its
    limit.
    """

    _made_again = frozenset({"_node", "_kept"})

    def __init__(
        self,
        friction: Friction,
        number: int = 0,
        *,
        gain: float = 1.0,
        limit: float = 1.0,
        ramp: float = 0.0,
        timeout: float = 0.1,
        max_step: int = 0,
        status_period: float = 0.1,
    ) -> None:
        self._now = 0.0
        self._node = NodeStructure()
        self._kept = (ctypes.c_uint64 * KEPT_ROOM)()
        self._friction = copy.deepcopy(friction) if _use_of(friction) else friction
        self._begin(codec.number_of(number, "number"))
        self._node.gain = round(_within("gain", gain, 0, 1, "") * ONE)
        self._node.limit = round(_within("limit", limit, 0, 1, "") * ONE)
        self._node.ramp_us = _us(_within("ramp", ramp, 0, LONG, "s"))
        self._node.timeout_us = _us(_within("timeout", timeout, 0.001, LONG, "s"))
        self._node.max_step = checks.whole("max_step", max_step, 0, INT32_MAX)
        self._node.status_us = _us(_within("status_period", status_period, 0, LONG, "s"))
        self._node.gain_now = 0 if self._node.ramp_us else self._node.gain

    def _begin(self, number: int) -> None:
        """dahl_node_init, and dahl_node_use_NAME where it is no Plan."""
        use = _use_of(self._friction)
        if use is None:
            known = ", ".join(models.class_of(row).__name__ for row in models.table().values())
            raise Error(f"friction = {checks.shown(self._friction)} is none of {known}")
        first, name, arguments = use(self._friction)
        first._need_counts()
        params = core._Params(first.sigma0, first.Fc, first.theta_per_count)
        lib, node = core.library(), ctypes.byref(self._node)
        failed = lib.dahl_node_init(node, ctypes.byref(params), number)
        if name and not failed:
            failed = getattr(lib, f"dahl_node_use_{name}")(node, self._kept, *arguments)
        if failed:
            raise Error(f"friction = {self._friction!r} is refused by the node")

    @property
    def friction(self) -> Friction:
        """What it was made of; a ParamWrite may have changed the node since."""
        return self._friction

    @property
    def number(self) -> int:
        """0 .. 15."""
        return int(self._node.number)

    @property
    def state(self) -> codec.State:
        """What it thinks of its input."""
        return codec.State(self._node.state)

    @property
    def errors(self) -> codec.Errors:
        """Sticky bits of Status."""
        return codec.Errors(self._node.errors)

    @property
    def counts(self) -> Counts:
        """Frames by what became of them."""
        return Counts(*(getattr(self._node, name) for name in COUNTS))

    def receive(self, message: can.Message, now: float | None = None) -> can.Message | None:
        """Take one frame, any frame; returns the answer to send at once, None where there is none:
        to the counts of an EncoderState a FrictionTorque, to a ParamWrite a ParamReply, to a Reset
        a Status. `now` in s. Raises dahl.Error for what is no can.Message, and for a `now` that is
        no finite number.
        """
        moment, frame = self._at(now), codec.raw_of(message)
        if message.is_error_frame and not frame.id & BUS_OFF:
            return None  # an event of the controller that says nothing of the encoder
        out = codec.CanFrame()
        answers = core.library().dahl_node_receive(
            ctypes.byref(self._node), ctypes.byref(frame), moment, ctypes.byref(out)
        )
        return codec.message_of(out) if answers & 1 else None

    def tick(self, now: float | None = None) -> can.Message | None:
        """Look at the clock, every few ms; returns a Status, with its counts of frames, to send,
        None where none is due. The first call gives one at once. `now` in s. Raises dahl.Error for
        a `now` that is no finite number.
        """
        moment, out = self._at(now), codec.CanFrame()
        due = core.library().dahl_node_tick(ctypes.byref(self._node), moment, ctypes.byref(out))
        return codec.message_of(out) if due & 1 else None

    def _at(self, now: float | None) -> ctypes.c_uint32:
        if now is not None:
            moment = checks.finite("now", now, "s")
            if moment - self._now > LEAP:
                self._age(moment)
            self._now = moment
        return _clock(self._now)

    def _age(self, moment: float) -> None:
        """A time went by without a call that the C, whose clock wraps after 71 minutes, could take
        for a short one: what is too old is so at its beginning, and a Status is due at its end.
        """
        counter, out = self._node.status_counter, codec.CanFrame()
        due = core.library().dahl_node_tick(
            ctypes.byref(self._node), _clock(self._now + LEAP), ctypes.byref(out)
        )
        if due & 1:
            self._node.status_counter, self._node.urgent = counter, 1
        self._node.bus_off_us = _clock(moment - LEAP)

    def __getstate__(self) -> dict[str, Any]:
        """All that it is made of, but for addresses."""
        node = NodeStructure.from_buffer_copy(self._node)
        node.model = None
        kept = bytes(self._kept)[MODEL_BYTES:]
        return {**super().__getstate__(), "_node": bytes(node), "_kept": kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._node, self._kept = NodeStructure(), (ctypes.c_uint64 * KEPT_ROOM)()
        self._begin(0)  # of the library that is there now
        model = self._node.model
        self._node = NodeStructure.from_buffer_copy(state["_node"])
        self._node.model = model
        kept = state["_kept"]
        ctypes.memmove(ctypes.addressof(self._kept) + MODEL_BYTES, kept, len(kept))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Node):
            return NotImplemented
        return self._compared() == other._compared()

    def _compared(self) -> tuple[Any, ...]:
        """All but addresses, and padding that C leaves as it is."""
        first, last = NodeStructure.parameters.offset, NodeStructure.urgent.offset
        state = self.__getstate__()
        return type(self._friction), state["_node"][first : last + 1], state["_kept"]

    __hash__ = None  # type: ignore[assignment]  # it changes with each frame

    def __repr__(self) -> str:
        return (
            f"<Node {self._friction!r}, number={self.number}, state={self.state.name},"
            f" ok={self._node.ok}>"
        )


def _within(name: str, value: float, least: float, most: float, unit: str) -> float:
    number = checks.finite(name, value, unit or "a part")
    if not least <= number <= most:
        raise Error(f"{name} = {number:g} is outside {least:g} .. {most:g} {unit}".rstrip())
    return number


def _us(seconds: float) -> int:
    return round(seconds * 1e6)


def _clock(seconds: float) -> ctypes.c_uint32:
    """The clock of the C at this time: us, modulo 2^32."""
    return ctypes.c_uint32(_us(seconds) & core.UINT32_MAX)


# --- models: a Plan of the first element, the call, and its arguments -----------------------------


def _use_plan(plan: core.Plan) -> tuple[core.Plan, str, tuple[Any, ...]]:
    return plan, "", ()


def _use_slip(slip: parts.Slip) -> tuple[core.Plan, str, tuple[Any, ...]]:
    params = parts._SlipParams(len(slip.sigma0), slip.theta_per_count)
    params.sigma0[: params.elements], params.Fc[: params.elements] = slip.sigma0, slip.Fc
    first = core.Plan(slip.sigma0[0], slip.Fc[0], slip.theta_per_count)
    return first, "slip", (ctypes.byref(params),)


def _use_bristle(one: variants._Bristle) -> tuple[core.Plan, str, tuple[Any, ...]]:
    """Its values are sigma0, one or two Fc, theta_per_count, and that of its own key if any."""
    params = one._values[:-1] if models.table()[one._kind].key else one._values
    first = core.Plan(params[0], params[1], params[-1])
    more = map(ctypes.c_float, one._values[len(params) :])
    return first, one._kind, ((ctypes.c_float * len(params))(*params), *more)


def _use_loaded(one: variants.Loaded) -> tuple[core.Plan, str, tuple[Any, ...]]:
    plan = one.plan
    if one.fixed_stiffness:
        raise Error("friction = a Loaded with fixed_stiffness steps by angle; a node counts")
    params = (ctypes.c_float * 3)(plan.sigma0, plan.Fc, plan.theta_per_count)
    return plan, "loaded", (params,)


def _use_parallel(mix: parts.Parallel) -> tuple[core.Plan, str, tuple[Any, ...]]:
    elements = [element for part in mix.parts for element in _elements(part)]
    if not 1 <= len(elements) <= parts.SLIP_MAX:
        raise Error(f"friction has {len(elements)} elements, 1 to {parts.SLIP_MAX} were expected")
    sigma0, torques, thetas, slips = zip(*elements, strict=True)
    if len(set(thetas)) > 1:
        raise Error(f"friction has theta_per_count {thetas[0]:g} and others; one encoder has one")
    bits = sum(is_slip << k for k, is_slip in enumerate(slips))
    params = _ParallelParams(len(elements), bits, thetas[0])
    params.sigma0[: len(elements)], params.Fc[: len(elements)] = sigma0, torques
    return core.Plan(sigma0[0], torques[0], thetas[0]), "parallel", (ctypes.byref(params),)


def _elements(part: core.Friction | parts.Slip) -> list[tuple[float, float, float, bool]]:
    """sigma0, Fc, theta_per_count, and whether it slips, of each element of a part."""
    if isinstance(part, parts.Slip):
        pairs = zip(part.sigma0, part.Fc, strict=True)
        return [(sigma0, torque, part.theta_per_count, True) for sigma0, torque in pairs]
    return [(part.plan.sigma0, part.plan.Fc, part.plan.theta_per_count, False)]


USES: dict[type, Callable[[Any], tuple[core.Plan, str, tuple[Any, ...]]]] = {
    core.Plan: _use_plan,
    parts.Slip: _use_slip,
    parts.Parallel: _use_parallel,
    variants._Bristle: _use_bristle,
    variants.Loaded: _use_loaded,
}


def _use_of(friction: object) -> Callable[[Any], tuple[core.Plan, str, tuple[Any, ...]]] | None:
    """Also of a subclass."""
    return next((USES[kind] for kind in type(friction).__mro__ if kind in USES), None)


# --- on a bus -------------------------------------------------------------------------------------


@dataclass
class Traffic:
    """What a served bus has seen: frames that came, answers and Status frames that went, and those
    of them that the bus did not take.
    """

    received: int = 0
    sent: int = 0
    refused: int = 0


class Listener:
    """Nodes on a bus, for a can.Notifier: it hands over the frames, their clock is a thread of its
    own until stop(), which the Notifier calls. A can.Listener. `traffic` counts.

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
        """What has come and gone so far."""
        return self._link.traffic

    def on_message_received(self, msg: can.Message) -> None:
        """Answer one frame."""
        self._link.take(msg)

    def __call__(self, msg: can.Message) -> None:
        """The same."""
        self._link.take(msg)

    def on_error(self, exc: Exception) -> None:
        """The Notifier keeps it as its `exception`."""

    def stop(self) -> None:
        """No Status from now on."""
        self._ended.set()
        if threading.current_thread() is not self._clock:
            self._clock.join()

    def _tick(self) -> None:
        while not self._ended.is_set():
            self._link.tick()
            self._ended.wait(PERIOD)


@checks.names_checked
def run(
    bus: can.BusABC,
    *nodes: Node,
    seconds: float | None = None,
    ended: Callable[[], bool] = lambda: False,
) -> Traffic:
    """Serve nodes on a bus until `ended()`, asked every few ms, or for `seconds`; without either
    for ever. Returns what came and went. Raises dahl.RunError where the bus goes away.
    """
    _checked_bus(bus, "send", "recv")
    link = _Link(bus, nodes)
    end = time.monotonic() + (float("inf") if seconds is None else _span("seconds", seconds))
    if not callable(ended):
        raise Error(f"ended = {checks.shown(ended)} cannot be called")
    while not ended() and time.monotonic() < end:
        link.tick()
        message = receive(bus, PERIOD)
        if message is not None:
            link.take(message)
    return link.traffic


async def serve(bus: can.BusABC, *nodes: Node) -> None:
    """Serve nodes on a bus within asyncio, until the task is cancelled; run() does it in a thread.
    Raises dahl.RunError where the bus goes away. Nobody else receives from this bus; where it has a
    can.Notifier, give that a Listener.
    """
    ended = threading.Event()
    thread = ThreadPoolExecutor(1)  # its own: asyncio's are few, and the caller's
    work = functools.partial(run, bus, *nodes, ended=ended.is_set)
    served = asyncio.get_running_loop().run_in_executor(thread, work)
    try:
        await asyncio.shield(served)
    finally:
        ended.set()
        await asyncio.wait([served])
        thread.shutdown(wait=False)


def _span(name: str, value: float) -> float:
    """A time in s, also an infinite one."""
    number = checks.real(name, value, "a number of s, 0 or above,")
    if not number >= 0:
        raise Error(f"{name} = {number:g} is not a number of s, 0 or above")
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
@checks.names_checked
def ask(bus: can.BusABC, frame: codec.Frame, node: int = 0, timeout: float = 1.0) -> codec.Frame:
    """Send a frame to a node, wait for the answer to it and return that: FrictionTorque to an
    EncoderState, ParamReply to a ParamWrite, to a Reset the next Status. Frames that wait on the
    bus are dropped first, and others than the answer are passed over. Raises dahl.Timeout if none
    comes within `timeout` s, with the state that the node reports, such as STALE after a pause:
    then send a Reset(What.RESTART) first. Raises dahl.RunError if the bus does not take the frame.
    """
    kind = ASKED.get(type(frame))
    if kind is None:
        raise Error(f"frame = {checks.shown(frame)} is none that a node answers")
    _checked_bus(bus, "send", "recv")
    timeout, node = _within("timeout", timeout, 0, LONG, "s"), codec.number_of(node)
    until, why = time.monotonic() + timeout, ""
    _drop_waiting(bus, until)
    _send(bus, codec.pack(frame, node), frame)
    while (left := until - time.monotonic()) > 0:
        told = receive(bus, left)
        answer = _answer_in(told, kind.base + node)
        if isinstance(answer, kind) and _answers(answer, frame):
            return answer
        if status := _answer_in(told, codec.Status.base + node):
            why = _why_silent(status, frame)
    raise Timeout(f"no {kind.__name__} of node {node} in {timeout:g} s, to {frame}{why}")


@checks.names_checked
def expect_silence(
    bus: can.BusABC,
    frame: codec.Frame | can.Message | None = None,
    node: int = 0,
    seconds: float = 0.1,
) -> None:
    """Send a frame that a node must not answer, and wait. A can.Message is sent as it is, such as
    one with a wrong CRC; without a frame nothing is sent. Frames that wait on the bus are dropped
    first. Raises dahl.RunError for a FrictionTorque or ParamReply of the node within `seconds`;
    Status does not count, since a node sends it unasked.
    """
    _checked_bus(bus, "send", "recv")
    seconds, node = _within("seconds", seconds, 0, LONG, "s"), codec.number_of(node)
    message = codec.pack(frame, node) if isinstance(frame, codec.Frame) else frame
    if message is not None:
        codec.raw_of(message)  # refuses what is no can.Message
    _drop_waiting(bus, time.monotonic() + seconds)
    begin = time.monotonic()
    if message is not None:
        _send(bus, message, frame)
    while (left := begin + seconds - time.monotonic()) > 0:
        received = receive(bus, left)
        for kind in (codec.FrictionTorque, codec.ParamReply):
            if answer := _answer_in(received, kind.base + node):
                after = f"after {time.monotonic() - begin:.3f} s"
                raise RunError(f"node {node} must be silent, but sent {answer} {after}")


def _drop_waiting(bus: can.BusABC, until: float) -> None:
    """Drop the frames that wait on the bus, until this time at the latest."""
    while receive(bus, 0) is not None and time.monotonic() < until:
        pass


def _send(bus: can.BusABC, message: can.Message, frame: object) -> None:
    try:
        bus.send(message)
    except (codec.python_can().CanError, OSError) as error:
        raise RunError(f"the bus does not take {frame}: {error}") from None


ASKED: dict[type[codec.Frame], type[codec.Frame]] = {
    codec.EncoderState: codec.FrictionTorque,
    codec.ParamWrite: codec.ParamReply,
    codec.Reset: codec.Status,
}


def _answer_in(message: can.Message | None, identifier: int) -> codec.Frame | None:
    """The frame in a message of this id; None where it is none or not whole."""
    if message is None or message.arbitration_id != identifier:
        return None
    try:
        return codec.unpack(message)
    except Error:
        return None


def _why_silent(status: codec.Frame, frame: codec.Frame) -> str:
    """What a Status says of a node that did not answer, and what it waits for; else nothing."""
    if not isinstance(status, codec.Status) or status.state == codec.State.OK:
        return ""
    said = f"; its Status says {status.state.name}"
    if status.state in (codec.State.STALE, codec.State.WRONG_SEQUENCE):
        said += "; after a Reset with What.RESTART it answers"
    if isinstance(frame, codec.EncoderState) and codec.Errors.REPEATED in status.errors:
        said += "; REPEATED is among its errors: each EncoderState has a counter one higher"
    return said


def _answers(answer: codec.Frame, frame: codec.Frame) -> bool:
    """Whether it repeats the counter, and the parameter, of what was asked; Status has none."""
    if isinstance(answer, codec.FrictionTorque) and isinstance(frame, codec.EncoderState):
        return answer.echo == frame.counter
    if isinstance(answer, codec.ParamReply) and isinstance(frame, codec.ParamWrite):
        known = answer.value if answer.param == codec.Param.NONE else answer.param
        return (answer.counter, known) == (frame.counter, frame.param)
    return True


def _checked_bus(bus: can.BusABC, *calls: str) -> None:
    if not all(callable(getattr(bus, name, None)) for name in calls):
        raise Error(f"bus = {checks.shown(bus)} is not a bus of python-can")


class _Link:
    """Nodes and the bus that they answer on, from any thread."""

    def __init__(self, bus: can.BusABC, nodes: tuple[Node, ...]) -> None:
        _checked_bus(bus, "send")
        if not nodes:
            raise Error("no node to serve")
        self._nodes = [checks.instance(f"nodes[{k}]", node, Node) for k, node in enumerate(nodes)]
        if len({node.number for node in nodes}) < len(nodes):
            raise Error("two nodes of one number on one bus")
        self._bus, self._lock, self.traffic = bus, threading.Lock(), Traffic()
        self._refusals = (codec.python_can().CanError, OSError)

    def take(self, message: can.Message) -> None:
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
        """Not what nodes themselves have sent; of several nodes each sees what has its number."""
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
        except self._refusals:  # its queue is full, or it has gone: who receives will know
            self.traffic.refused += 1
