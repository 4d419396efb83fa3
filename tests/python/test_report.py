# SPDX-License-Identifier: MIT
"""What the demo says about a run is judged on runs whose answer is known: a fit, a gap, a lost
record, a torque that is wrong.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import can
import cantools
import numpy as np
import pytest
from crccheck.crc import Crc8Autosar
from dahl import Error, Friction, Loaded, Plan, html_report, report
from dahl.scene import Measured, Recorded, Scene

SIGMA0, FC, THETA = 50.0, 0.5, 1e-4
SCENE = Scene(None, "test", "dahl", ((SIGMA0, FC),), THETA)
KINDS = {"EncoderState": 0x3, "FrictionTorque": 0xC, "Reset": 0xA, "ParamWrite": 0x6}
BOUND = 0.52  # ulp of Fc


class Run:
    """Frames of a run, as a recorder of the bus writes them; the torque is the library's."""

    def __init__(self, dbc) -> None:
        self.database = cantools.database.load_file(dbc)
        self.bearing = Friction(Plan(SIGMA0, FC, THETA))
        self.frames: list[can.Message] = []
        self.count = self.ratio = 0
        self.pause = 0.0  # s, before the next frame

    def add(self, name: str, **signals) -> None:
        message = self.database.get_message_by_name(name)
        data = bytearray(message.encode({"Crc": 0, **signals}, scaling=False, strict=False))
        data[0] = Crc8Autosar.calc(data[1:] + bytes([KINDS[name] << 4 | data[1] & 15]))
        self.frames.append(
            can.Message(
                timestamp=len(self.frames) / 2000 + self.pause,
                arbitration_id=message.frame_id,
                data=data,
                is_extended_id=False,
            )
        )

    def send(self, counter: int, count: int, valid: int = 1) -> None:
        self.add("EncoderState", Counter=counter % 16, Valid=valid, Count=count)

    def answer(self, counter: int, count: int, state: int = 0, used: bool = True) -> None:
        """The node integrates the travel since the last answer, or takes the count as a start."""
        move = (count - self.count + 2**31) % 2**32 - 2**31 if used else 0
        self.ratio = self.bearing.step_counts_q30(move)
        self.count = count
        self.add(
            "FrictionTorque",
            Counter=0,
            State=state,
            EchoCounter=counter % 16,
            TorqueRatio=self.ratio,
        )

    def tick(self, counter: int, count: int, state: int = 0, used: bool = True) -> None:
        self.send(counter, count)
        self.answer(counter, count, state, used)

    def trace(self) -> report.Trace:
        return report.trace_of(self.frames)


@pytest.fixture
def run(library, dbc) -> Run:
    """A run that has begun: three ticks, the first of which is a start."""
    begun = Run(dbc)
    begun.tick(0, -500, state=6, used=False)
    begun.tick(1, -480)
    begun.tick(2, -470)
    return begun


@pytest.mark.parametrize("state", [3, 5, 6], ids=["WrongSequence", "Stale", "Init"])
def test_a_new_start_in_the_middle_moves_nothing(run, state):
    """The node integrates no travel there, so neither may the reference."""
    run.tick(3, 4000, state=state, used=False)
    run.tick(4, 4010)
    trace = run.trace()
    assert trace.moves().tolist() == [0, 20, 10, 0, 10]
    assert report.max_error_ulp(SCENE, trace) <= BOUND


@pytest.mark.parametrize("state", [0, 2], ids=["OK", "Lost"])
def test_travel_over_lost_frames_counts(run, state):
    run.send(3, -460)  # not answered
    run.send(4, 77, valid=0)  # disowned by the encoder itself
    run.tick(5, -400, state=state)
    trace = run.trace()
    assert trace.moves().tolist() == [0, 20, 10, 70]
    assert trace.row.tolist() == [0, 1, 2, 5]
    assert (trace.recorded, trace.missing) == (5, 1)
    assert report.max_error_ulp(SCENE, trace) <= BOUND


def test_a_restart_behind_frames_that_were_not_recorded_relaxes_its_own_tick(run):
    """Two records are lost before the Reset, and one answer behind it."""
    run.tick(5, -440, state=2)
    run.add("Reset", Counter=0, What=2)
    run.bearing = Friction(Plan(SIGMA0, FC, THETA))
    run.tick(6, -400, state=6, used=False)
    run.tick(7, 300)
    trace = run.trace()
    assert trace.row.tolist() == [0, 1, 2, 5, 6, 7]
    assert trace.relaxed.tolist() == [False] * 4 + [True, False]
    assert report.max_error_ulp(SCENE, trace) <= BOUND


def test_a_reset_of_the_errors_alone_relaxes_nothing(run):
    run.add("Reset", Counter=0, What=1)
    run.tick(3, -400)
    trace = run.trace()
    assert not trace.relaxed.any() and report.max_error_ulp(SCENE, trace) <= BOUND


def test_a_load_holds_from_the_frame_that_writes_it(run):
    """Up to 1; what is read, held or of another parameter is none."""
    raw = {"Counter": 0, "Write": 1, "Param": 10, "Load": 2**14}
    changes = ({"Load": 2**16}, {"Load": 2**16 + 1}, {"Write": 0}, {"Write": 2})
    for n, change in enumerate(({}, *changes), start=3):
        run.add("ParamWrite", **raw | change)
        run.tick(n, -400 + n)
    run.add("ParamWrite", Counter=0, Write=1, Param=1, Fc=5)
    run.tick(8, 0)
    assert run.trace().load.tolist() == [2**16] * 3 + [2**14] + [2**16] * 5


def test_the_exact_torque_follows_the_load_that_was_told(library, dbc):
    run, gear, load = Run(dbc), Loaded(Plan(SIGMA0, FC, THETA)), 1.0
    run.bearing = SimpleNamespace(step_counts_q30=lambda move: gear.step_counts_q30(move, load))
    run.tick(0, 0, state=6, used=False)
    for n, load in enumerate((1.0, 0.25, 0.25, 0.75), start=1):  # noqa: B007 (run's bearing has it)
        run.add("ParamWrite", Counter=0, Write=1, Param=10, Load=int(load * 2**16))
        run.tick(n, 70 * n)
    scene = Scene(None, "test", "loaded", ((SIGMA0, FC),), THETA)
    assert report.max_error_ulp(scene, run.trace()) <= BOUND


def test_a_travel_that_the_node_left_out_is_an_error(run):
    """The state says that it was used, the torque says that it was not."""
    run.tick(3, 500, state=0, used=False)
    assert report.max_error_ulp(SCENE, run.trace()) > 1000


def test_one_unit_of_the_ratio_is_seen(run):
    """2^-16 of Fc is 256 ulp of it and more."""
    run.send(3, -460)
    run.bearing.step_counts_q30(10)
    run.add("FrictionTorque", Counter=0, State=0, EchoCounter=3, TorqueRatio=run.ratio + 2**14)
    assert report.max_error_ulp(SCENE, run.trace()) > 100


@pytest.mark.parametrize("kind", ["is_extended_id", "is_error_frame", "is_fd", "node", "crc"])
def test_frames_that_only_look_like_the_nodes_are_left_out(run, kind):
    before = run.trace()
    run.tick(3, 7000)
    for frame in run.frames[-2:]:
        frame.arbitration_id += kind == "node"
        frame.data[0] ^= kind == "crc"
        setattr(frame, kind, True) if kind.startswith("is_") else None
    after = run.trace()
    assert (after.count.tolist(), after.recorded) == (before.count.tolist(), before.recorded)


def test_the_node_that_is_asked_for_is_read(run):
    for frame in run.frames:
        frame.arbitration_id += 3
    assert report.trace_of(run.frames, 3).count.tolist() == [-500, -480, -470]
    with pytest.raises(Error, match="no EncoderState with its FrictionTorque"):
        run.trace()


def test_a_count_that_wraps_is_one_path(library, dbc):
    run = Run(dbc)
    run.tick(0, 2**31 - 5, state=6, used=False)
    run.tick(1, -(2**31) + 5)
    trace = run.trace()
    assert trace.moves().tolist() == [0, 10]
    assert report.max_error_ulp(SCENE, trace) <= BOUND
    assert trace.angle(SCENE) == pytest.approx([0, 10e-4], rel=1e-6)


def test_frames_that_the_recorder_missed_are_counted(run):
    run.tick(9, -450)
    assert run.trace().missing == 6
    assert run.trace().row.tolist() == [0, 1, 2, 9]


@pytest.mark.parametrize(
    ("step", "pause", "taken"),
    [(7, 0, True), (8, 0, True), (9, 0, False), (9, 0.0035, False), (9, 0.0045, True)],
)
def test_a_frame_ahead_is_a_gap_and_a_later_one_is_late(run, step, pause, taken):
    """As the node has it: DAHL_NODE_GAP_MAX_STEP is 8; after 5 ms, here 1 ms and the pause, none
    is late.
    """
    run.pause = pause
    run.tick(2 + step, -450, used=taken)
    assert run.trace().row.tolist() == [0, 1, 2] + [2 + step] * taken


def test_an_answer_goes_to_the_frame_that_it_echoes(run):
    """Two frames, then their answers: as a burst comes over a busy bus."""
    run.send(3, -460)
    run.send(4, -400)
    run.answer(3, -460)
    run.answer(4, -400)
    again = {"Counter": 0, "State": 0, "EchoCounter": 4}
    run.add("FrictionTorque", **again, TorqueRatio=-run.ratio)  # a second answer is none
    assert run.trace().count.tolist() == [-500, -480, -470, -460, -400]
    assert report.max_error_ulp(SCENE, run.trace()) <= BOUND


def test_answers_that_come_many_beats_late_are_still_their_frames(run):
    """A node that stalls answers a burst then; the 4-bit echo alone would point to newer frames."""
    counts = [-470 + 3 * i * (-1) ** i for i in range(3, 60)]
    for counter, count in enumerate(counts, start=3):
        run.send(counter, count)
    for counter, count in enumerate(counts, start=3):
        run.answer(counter, count)
    trace = run.trace()
    assert trace.count.tolist() == [-500, -480, -470, *counts]
    assert report.max_error_ulp(SCENE, trace) <= BOUND


def test_after_a_gap_a_new_start_answers_the_newest_frame(run):
    for counter in range(3, 60):
        run.send(counter, 100 * counter)
    run.answer(59, 5900, state=5, used=False)
    run.tick(60, 5910)
    trace = run.trace()
    assert trace.row.tolist() == [0, 1, 2, 59, 60]
    assert trace.moves().tolist() == [0, 20, 10, 0, 10]
    assert report.max_error_ulp(SCENE, trace) <= BOUND


def fitted(run: Run, torque, **measured) -> dict:
    scene = Scene(
        None, "t", "dahl", ((SIGMA0, FC),), THETA, measured=Measured(torque="T", **measured)
    )
    return report.fit(scene, run.trace(), Recorded(np.array(torque), None, len(torque)))


def test_fit_is_the_textbooks(run):
    """rmse and R2 from their definitions; rows before `settle` and those without an answer are left
    out, offset and spring in.
    """
    run.send(3, -460)  # not answered
    run.tick(4, -440, state=2)
    torque = run.trace().torque(SCENE).astype(float)
    shown = torque + 0.25 + [9, 0.1, -0.3, 0]
    found = fitted(run, [*shown[:3], 99, shown[3]], offset=0.25, settle=1)
    spread = 3 * np.var(shown[1:])
    assert found["rmse_measured"] == pytest.approx((0.1 / 3) ** 0.5, rel=1e-6)
    assert found["r2_measured"] == pytest.approx(1 - 0.1 / spread, rel=1e-6)
    springy = torque + 7 * THETA * np.array([0, 20, 30, 60])
    found = fitted(run, [*springy[:3], 99, springy[3]], spring=7.0)
    assert found["rmse_measured"] == pytest.approx(0, abs=1e-9)


def test_no_fit_without_rows_or_without_spread(run):
    assert fitted(run, [1, 2, 3], settle=3) == {"rmse_measured": None, "r2_measured": None}
    assert fitted(run, [1, 1, 1])["r2_measured"] is None


def test_the_summary_is_what_was_recorded(run):
    run.send(3, -460)  # not answered
    run.tick(6, -450, state=2)
    scene = Scene(Path("a/b.ini"), "t", "dahl", ((SIGMA0, FC),), THETA, measured=Measured(settle=2))
    scene.kinds, scene.breakaway = ("dahl",), 0.25
    numbers = report.summary(scene, run.trace(), None, {"ticks": 7})
    assert (numbers["ticks"], numbers["scene"], numbers["title"]) == (7, "b", "t")
    assert (numbers["frames_recorded"], numbers["frames_not_recorded"]) == (5, 2)
    assert numbers["answers_by_state"] == {"OK": 2, "Lost": 1, "Init": 1}
    assert numbers["elements"] == [{"sigma0": SIGMA0, "Fc": FC}]
    assert (numbers["kinds"], numbers["breakaway"]) == (["dahl"], 0.25)
    assert numbers["units"] == {"sigma0": "N m/rad", "Fc": "N m", "theta_per_count": "rad"}
    assert numbers["parameters"] == {"sigma0": SIGMA0, "Fc": FC, "theta_per_count": THETA}
    assert (numbers["compared_from_row"], numbers["scene_file"]) == (2, str(Path.cwd() / "a/b.ini"))
    assert 0 < numbers["max_error_ulp_Fc"] <= BOUND


def test_the_page_shows_each_number_in_its_unit():
    numbers = {"title": "x", "ticks": 800, "bus_load": 0.2434, "max_error_ulp_Fc": 0.51}
    numbers |= {"bus": "a bus", "time": "real", "frames_sent": 11, "frames_lost": 12}
    numbers |= {"deadline_misses": 13, "rmse_measured": 0.0123456, "r2_measured": 0.98765}
    numbers |= {"realtime_factor": 3.21, "parameters": {"sigma0": 12.5}, "node": {"jumps": 1234567}}
    page = html_report.page({**numbers, "answers_by_state": {"OK": 790}}, b"")
    cells = re.findall("<td>(.*?)</td>", page)
    shown = "a bus, real, 800, 11, 12, 13, 0.510 ulp of Fc, 0.01235, 0.9877, 24.3%, 3.2, 12.5"
    assert cells[1::2] == [*shown.split(", "), "790", "1234567"]
    assert cells[-6:] == ["sigma0", "12.5", "OK", "790", "jumps", "1234567"]


def test_the_page_tells_latencies_where_time_was_measured():
    latency = {"p50": 100.0, "p99": 1000.0, "max": 10000.4}
    still = dict.fromkeys(latency, 0.0)
    page = html_report.page({"latency_us": latency, "jitter_us": still}, b"")
    assert "<td>p50 100, p99 1000, max 10000 us</td>" in page
    assert ", dahl" not in html_report.page({"version": "9"}, b"")
    assert "change of it" not in page
