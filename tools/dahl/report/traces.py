# SPDX-License-Identifier: MIT
"""Compute the numbers of a run from its recorded frames: error, fit to the measurement, summary."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dahl import paths
from dahl.binding import models
from dahl.can import codec
from dahl.can.counters import Sequence
from dahl.can.missing import Missing
from dahl.errors import InputError, RunError
from dahl.sim import reference
from dahl.sim.replay import Recorded
from dahl.sim.scene import Measured, Scene

if TYPE_CHECKING:
    import can
    import cantools

BOUND_ULP = 0.52  # of Fc: bound of the error of the torque (DAHL_ULP_COUNTS)
BOUND_ULP_PARTS = 0.55  # the same for the other models (DAHL_ULP_PARTS)
FULL_LOAD = round(1 / codec.UNITS[codec.Param.LOAD])  # raw load of 1, at which Fc holds
UNCOMPENSATED = "uncompensated.csv"  # trace of the same rotor with gain 0
FAULTLESS = "faultless.log"  # frames of the same run without faults
# States of FrictionTorque in which the count is a new starting point and no travel is integrated.
NEW_START = {"Init", "Stale", "WrongSequence"}


@dataclass
class Trace:
    """The answered ticks of a run, in the order of the bus. All arrays have shape (n,)."""

    row: np.ndarray  # index of the tick in the motion, from the 4-bit counter; int
    time: np.ndarray  # s, of the EncoderState frame
    count: np.ndarray  # encoder counts, unwrapped, int
    ratio: np.ndarray  # F/Fc in Q30, int
    fresh: np.ndarray  # True if this count is a new starting point
    relaxed: np.ndarray  # True if a Reset relaxed the bristle just before
    states: dict[str, int]  # number of answers by state
    recorded: int  # EncoderState frames in the log
    missing: int  # EncoderState frames missing by their counter
    load: np.ndarray | None = None  # last load sent, of FULL_LOAD; None: always 1
    not_recorded: int = 0  # least number of frames on the bus that the log lacks

    def angle(self, scene: Scene) -> np.ndarray:
        """Return the angle from the start in rad (m), shape (n,)."""
        angle: np.ndarray = (self.count - self.count[0]) * float(np.float32(scene.theta_per_count))
        return angle

    def moves(self) -> np.ndarray:
        """Return the counts that the node integrated at each tick, shape (n,)."""
        moves: np.ndarray = np.diff(self.count, prepend=self.count[:1])
        moves[self.fresh] = 0
        return moves

    def torque(self, scene: Scene) -> np.ndarray:
        """Return the torque of a receiver in N m (N), float32, shape (n,)."""
        return reference.received_torque(self.ratio, scene.Fc)


@cache
def database() -> cantools.database.Database:
    """Return the database of dahl.dbc."""
    import cantools

    try:
        return cast("cantools.database.Database", cantools.database.load_file(paths.DBC))
    except OSError as error:
        raise RunError(f"{paths.DBC}: {error.strerror}") from None


def _states() -> Mapping[int, object]:
    message = database().get_message_by_name("FrictionTorque")
    return message.get_signal_by_name("State").choices or {}


def state_counts(states: np.ndarray) -> dict[str, int]:
    """Return how often each state of FrictionTorque occurs, by its name in the DBC."""
    choices = _states()
    values, counts = np.unique(states, return_counts=True)
    named = ((str(choices.get(int(v), v)), int(n)) for v, n in zip(values, counts, strict=True))
    return dict(named)


def new_start_states() -> set[int]:
    return {value for value, name in _states().items() if str(name) in NEW_START}


class Pairing:
    """Match each FrictionTorque with the EncoderState that it echoes.

    An answer belongs to the first waiting frame with its counter, as in the encoder of dahl-loop.
    After a new start the node has skipped frames, so the answer belongs to the newest frame.
    """

    def __init__(self, node: int = 0) -> None:
        self._node = node
        names = ("EncoderState", "FrictionTorque", "Reset", "ParamWrite")
        self.messages = {
            database().get_message_by_name(name).frame_id + node: name for name in names
        }
        self.ticks: list[tuple[int, float, int, int]] = []  # row, time, count, load
        self.load = FULL_LOAD
        self.answers: dict[int, tuple[int, int]] = {}  # index in ticks -> ratio, state
        self.waiting: deque[tuple[int, int]] = deque()  # counter, index in ticks
        self.relaxed: set[int] = set()  # indices in ticks
        self.restarted = False
        self.new_start = new_start_states()
        self.channels: set[str] = set()  # of the frames
        self.row = -1
        self._sequence, self._missing = Sequence(), Missing()

    def feed(self, frame: can.Message) -> None:
        """Process one frame; other messages are ignored."""
        if frame.arbitration_id in self.messages:
            self._missing.feed(frame)
        name = self.messages.get(frame.arbitration_id)
        if name is None or frame.is_error_frame or frame.is_extended_id or frame.is_remote_frame:
            return
        if frame.is_fd or not codec.is_whole(frame.arbitration_id, frame.data):
            return
        self.channels.add(str(frame.channel))
        message = database().get_message_by_name(name)
        signals = message.decode_simple(bytes(frame.data), decode_choices=False, scaling=False)
        if name == "FrictionTorque":
            self._answer(signals)
        elif name == "Reset":
            self.restarted |= signals["What"] == codec.What.RESTART
        elif name == "ParamWrite":
            self._store_load(signals)
        elif signals["Valid"]:
            self._tick(signals, frame.timestamp)

    def _store_load(self, signals: dict[str, Any]) -> None:
        load = signals.get("Load", FULL_LOAD + 1)
        if signals["Write"] == codec.Write.WRITE and load <= FULL_LOAD:
            self.load = load

    def _tick(self, signals: dict[str, Any], time: float) -> None:
        counter = signals["Counter"]
        gap = self._sequence.gap(counter, time)
        if gap is None:  # repeated or late: no node accepts it
            return
        self.row += gap.least + 1
        self.waiting.append((counter, len(self.ticks)))
        self.ticks.append((self.row, time, signals["Count"], self.load))

    def _answer(self, signals: dict[str, Any]) -> None:
        index = self._find_echo(signals["EchoCounter"], signals["State"] in self.new_start)
        if index is None:
            return
        while self.waiting and self.waiting[0][1] <= index:
            self.waiting.popleft()
        self.answers[index] = (signals["TorqueRatio"], signals["State"])
        if self.restarted:
            self.relaxed.add(index)
            self.restarted = False

    def _find_echo(self, counter: int, starts: bool) -> int | None:
        """Return the index of the frame with this counter among the first 16 waiting frames, after
        a new start among the last 16.
        """
        skipped = max(len(self.waiting) - codec.COUNTERS, 0) if starts else 0
        near = islice(self.waiting, skipped, skipped + codec.COUNTERS)
        return next((index for known, index in near if known == counter), None)

    def trace(self) -> Trace:
        """Return the answered ticks so far. Raises dahl.Error if there is no answer."""
        if not self.answers:
            raise InputError(
                f"no EncoderState of node {self._node} (that of the scene) with its FrictionTorque"
                " among the recorded frames"
            )
        answered = sorted(self.answers)
        row, time, count, load = (
            np.array(column) for column in zip(*(self.ticks[i] for i in answered), strict=True)
        )
        ratio, state = (
            np.array(column) for column in zip(*(self.answers[i] for i in answered), strict=True)
        )
        return Trace(
            row,
            time,
            _unwrap(count),
            ratio,
            np.isin(state, list(self.new_start)),
            np.isin(answered, list(self.relaxed)),
            state_counts(state),
            len(self.ticks),
            self.row + 1 - len(self.ticks),
            load,
            self._missing.proved().least,
        )


def _unwrap(count: np.ndarray) -> np.ndarray:
    """Return 32-bit readings as a continuous path."""
    whole: np.ndarray = count.astype(np.int64)
    steps: np.ndarray = np.diff(whole, prepend=whole[:1])
    path: np.ndarray = count[0] + np.cumsum((steps + 2**31) % 2**32 - 2**31)
    return path


def trace_of(frames: Iterable[can.Message], node: int = 0) -> Trace:
    """Return the answered ticks among recorded frames."""
    pairing = Pairing(node)
    for frame in frames:
        pairing.feed(frame)
    return pairing.trace()


def max_error_ulp(scene: Scene, trace: Trace) -> float | None:
    """Return the largest error of the received torque against the exact solution, in ulp of Fc;
    None if the node answers with a part of the torque, or if frames were not recorded.
    """
    if scene.compensates or trace.not_recorded:
        return None
    load = np.full(len(trace.row), FULL_LOAD) if trace.load is None else trace.load
    apart = np.flatnonzero(trace.relaxed)
    parts = zip(np.split(trace.moves(), apart), np.split(load, apart), strict=True)
    exact = [
        ratio
        for moves, raw in parts
        for ratio in reference.EXACT[scene.model](
            scene, moves, (Fraction(int(one), FULL_LOAD) for one in raw)
        )
    ]
    return float(reference.error_in_ulp(trace.torque(scene), exact, scene.Fc).max())


def words(name: str) -> str:
    """Return a key of a summary as words."""
    return name.replace("_", " ")


def disagreements(numbers: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Return the counters of the node that differ from the injected faults: (counted, expected)."""
    expected, counted = numbers["faults"]["expected"], numbers.get("node", {})
    pairs = {name: (counted.get(name, 0), due) for name, due in expected.items()}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def format_late(numbers: dict[str, Any]) -> dict[str, str]:
    """Return the answers and ticks of a run that came later than a period, with their totals."""
    totals = {"answers": "frames_answered", "ticks": "ticks"}
    pairs = {name: (numbers.get(f"late_{name}"), numbers.get(totals[name])) for name in totals}
    return {name: f"{k:.0f} of {n:.0f}" for name, (k, n) in pairs.items() if None not in (k, n)}


def modelled_torque(scene: Scene, trace: Trace) -> np.ndarray:
    """Return received torque + spring*angle + offset in N m (N), shape (n,)."""
    measured: Measured = scene.measured
    return (
        trace.torque(scene).astype(float) + measured.spring * trace.angle(scene) + measured.offset
    )


def fit(scene: Scene, trace: Trace, recorded: Recorded | None) -> dict[str, float | None]:
    """Return rmse_measured in N m (N) and r2_measured; both None without a measurement."""
    use = trace.row >= scene.measured.settle
    if recorded is None or recorded.torque is None or trace.not_recorded or not use.any():
        return {"rmse_measured": None, "r2_measured": None}
    truth = recorded.torque[trace.row[use]]
    residual = truth - modelled_torque(scene, trace)[use]
    spread = float(np.sum((truth - truth.mean()) ** 2))
    r2 = 1 - float(np.sum(residual**2)) / spread if spread > 0 else None
    return {"rmse_measured": float(np.sqrt(np.mean(residual**2))), "r2_measured": r2}


def _not_recorded_at_ends(trace: Trace, loop: dict[str, Any]) -> int:
    """Return how many answers the log lacks at its ends, which the counters do not show: the first
    answer of a node must be a new start, and dahl-loop counts the answers it receives.
    """
    if "faults" in loop or loop.get("interrupted"):  # the counts of dahl-loop then differ
        return int(loop.get("recorder_dropped", False) or not trace.fresh[0])
    return max(int(loop.get("frames_answered", 0)) - len(trace.row), 0)


def summary(
    scene: Scene, trace: Trace, recorded: Recorded | None, loop: dict[str, Any]
) -> dict[str, Any]:
    """Return all numbers of a run; `loop` has the counts of dahl-loop."""
    trace.not_recorded = max(trace.not_recorded, _not_recorded_at_ends(trace, loop))
    return {
        **loop,
        "scene": scene.name,
        "title": scene.title,
        "frames_recorded": trace.recorded,
        "frames_not_recorded": max(trace.missing, trace.not_recorded),
        "answers_by_state": trace.states,
        "max_error_ulp_Fc": max_error_ulp(scene, trace),
        **fit(scene, trace, recorded),
        "compared_from_row": scene.measured.settle,
        "model": scene.model,
        "elements": [{"sigma0": sigma0, "Fc": torque} for sigma0, torque in scene.elements],
        **_own_key(scene),
        "parameters": {name: getattr(scene, name) for name in ("sigma0", "Fc", "theta_per_count")},
        "units": scene.measured.units,
        "scene_file": str(scene.path.resolve()),
    }


def _own_key(scene: Scene) -> dict[str, Any]:
    """Return the model's own key with its value, {} if it has none."""
    own = list(scene.own) if isinstance(scene.own, tuple) else scene.own
    return {models.table()[scene.model].key: own} if own else {}
