# SPDX-License-Identifier: MIT
"""Reports on runs with known result: the ticks that are used, a gap, a lost record, a wrong torque,
the fit, and the page. Most tests call dahl.report.traces, since `dahl demo` gets only sound frames.
"""

import base64
import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bus_runs import FC, SIGMA0, THETA, Run
from dahl import Friction, Loaded, Plan
from dahl.binding import models
from dahl.codec import EncoderState, FrictionTorque, Param, ParamWrite, Reset, What
from dahl.report import traces
from dahl.sim import scene
from dahl.sim.replay import Recorded
from dahl.sim.scene import Measured, Scene
from hypothesis import given
from hypothesis import strategies as st
from log_reading import run as command
from model_examples import THETA as THETA_OF_MODELS
from model_examples import keys, made

SCENE = Scene(Path("a/b.ini"), "t", "dahl", ((SIGMA0, FC),), THETA)
BOUND, BOUND_PARTS = 0.52, 0.55  # ulp of Fc


def summed(run: Run, scene: Scene = SCENE, recorded: Recorded | None = None, **loop) -> dict:
    return traces.summary(scene, traces.trace_of(run.frames), recorded, loop)


def ticks_of(run: Run) -> tuple[list[int], list[int]]:
    trace = traces.trace_of(run.frames)
    return trace.row.tolist(), (trace.count - trace.count[0]).tolist()


def error_of(run: Run, scene: Scene = SCENE) -> float:
    """Error of the torque on the bus in ulp of Fc."""
    return summed(run, scene)["max_error_ulp_Fc"]


@pytest.fixture
def run(library) -> Run:
    """A run of three ticks. The first tick is a new start."""
    begun = Run()
    begun.tick(0, -500, state=6, used=False)
    begun.tick(1, -480)
    begun.tick(2, -470)
    return begun


# --- ticks that are used --------------------------------------------------------------------------


class History:
    """A run, and the ticks that its report must find: row, path in counts, new start, relaxed."""

    def __init__(self) -> None:
        self.run, self.row, self.path, self.sent = Run(), 0, 0, 0
        self.run.answers = 0
        self.found: list[tuple[int, int, bool, bool]] = []
        self.times: list[float] = []
        self.answer(*self.angle(0), STATES["init"])

    def angle(self, move: int, valid: bool = True) -> tuple[int, int, float]:
        """Send an angle; return its row, path and time."""
        self.path += move
        self.run.send(self.row, wrapped(self.path), valid)
        self.sent += valid
        self.row += 1
        return self.row - 1, self.path, self.run.frames[-1].timestamp

    def answer(self, row: int, path: int, time: float, state: int = 0, relaxes=False) -> None:
        starts = state in NEW_STARTS
        self.run.answer(row, wrapped(path), state, used=not starts)
        self.found.append((row, path, starts, relaxes))
        self.times.append(time)

    def play(self, event: str, ticks: int, move: int) -> None:
        """Each event ends with an answered tick."""
        self.row += ticks * (event == "gap")
        for _ in range(ticks * UNANSWERED.get(event, 0)):
            self.angle(move)
        for asked in [self.angle(move) for _ in range(ticks * (event == "late"))]:
            self.answer(*asked)
        if event == "disowned":
            self.angle(move, valid=False)
        if event in RESETS:
            self.run.add(Reset(RESETS[event]))
        if event == "restart":
            self.run.bearing = Friction(Plan(SIGMA0, FC, THETA))
        if event in FOREIGN:
            self.add_foreign(event)
        self.answer(*self.angle(move), STATES.get(event, 0), event == "restart")

    def add_foreign(self, kind: str) -> None:
        """Add an angle and its answer that the report must leave out."""
        counter = self.row % 16
        self.run.add(EncoderState(7, counter))
        self.run.add(FrictionTorque(0, 0, 0, counter))
        for frame in self.run.frames[-2:]:
            frame.arbitration_id += kind == "node"
            frame.data[0] ^= kind == "crc"
            if kind.startswith("is_"):
                setattr(frame, kind, True)


def wrapped(path: int) -> int:
    """The 32-bit count of an encoder that starts just below its highest count."""
    return (path + 2**31 - 600 + 2**31) % 2**32 - 2**31


NEW_STARTS = (3, 5, 6)  # states of a node that starts anew at the count
STATES = {"gap": 2, "wrong sequence": 3, "stale": 5, "init": 6, "restart": 6}  # of the answer
UNANSWERED = {"unanswered": 1, "wrong sequence": 8, "stale": 8, "init": 8}  # angles for each tick
RESETS = {"errors": What.ERRORS, "restart": What.RESTART}
FOREIGN = ("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd", "node", "crc")
KINDS = sorted({*STATES, *UNANSWERED, *RESETS, *FOREIGN, "late", "disowned"})
MOVES = st.sampled_from([0, 1, -3, 40, -700, 9000, 2**24])
EVENTS = st.lists(st.tuples(st.sampled_from(KINDS), st.integers(1, 7), MOVES), max_size=12)


@given(EVENTS)
def test_a_report_uses_each_answered_tick_as_the_node_did(library, events):
    """Travel over lost and unanswered frames counts. A new start adds none; a restart relaxes."""
    history = History()
    for event in events:
        history.play(*event)
    for node in (0, 5):
        for frame in history.run.frames:
            frame.arbitration_id += node
        trace = traces.trace_of(history.run.frames, node)
        path = trace.count - trace.count[0]
        columns = (column.tolist() for column in (trace.row, path, trace.fresh, trace.relaxed))
        assert [*zip(*columns, strict=True)] == history.found
        assert trace.time.tolist() == history.times
        assert (trace.recorded, trace.missing) == (history.sent, history.row - history.sent)
        assert trace.not_recorded == 0 and traces.max_error_ulp(SCENE, trace) <= BOUND


def test_a_load_holds_from_the_frame_that_writes_it(library):
    """Up to 1. A read, a held value, a value beyond 1 and other parameters change no load."""
    run, gear, load = Run(), Loaded(Plan(SIGMA0, FC, THETA)), 1.0
    run.bearing = SimpleNamespace(step_counts_q30=lambda move: gear.step_counts_q30(move, load))
    run.tick(0, 0, state=6, used=False)
    steps = [(ParamWrite(Param.LOAD, 2**14, 1), 0.25), (ParamWrite(Param.LOAD, 2**16, 1), 1.0)]
    steps += [
        (ParamWrite(Param.LOAD, 2**14, 1), 0.25),
        (ParamWrite(Param.LOAD, 2**16 + 1, 1), 0.25),
    ]
    steps += [(ParamWrite(Param.LOAD, 9, 0), 0.25), (ParamWrite(Param.LOAD, 9, 2), 0.25)]
    steps += [(ParamWrite(Param.LOAD, 49152, 1), 0.75), (ParamWrite(Param.FC, 5, 1), 0.75)]
    for number, (write, load) in enumerate(steps, start=1):  # noqa: B007 (run's bearing has it)
        run.add(write)
        run.tick(number, 70 * number)
    scene = Scene(SCENE.path, "t", "loaded", SCENE.elements, THETA)
    assert error_of(run, scene) <= BOUND


@pytest.mark.parametrize("name", [name for name in models.table() if name != "loaded"])
def test_the_answers_of_each_model_are_compared_with_its_exact_torque(library, tmp_path, name):
    model, run = models.table()[name], Run()
    head = f"[friction]\n{keys(model)}theta_per_count = {THETA_OF_MODELS}\n"
    (tmp_path / "model.ini").write_text(head)
    played = scene.read(tmp_path / "model.ini")
    run.bearing = Friction(made(model)) if name == "dahl" else made(model)
    run.tick(0, 0, state=6, used=False)
    for number, count in enumerate((300, 290, 9000, 8700, 8702, -9000, -8960), start=1):
        run.tick(number, count)
    bound = BOUND if name == "dahl" else BOUND_PARTS
    assert error_of(run, played) <= bound


def test_an_error_of_the_node_is_seen(run):
    """A travel that it left out in spite of its state, and one unit of 2^-16 of Fc."""
    run.tick(3, 500, state=0, used=False)
    assert error_of(run) > 1000
    del run.frames[-2:]
    run.count = -470
    run.send(3, -470)
    run.add(FrictionTorque(run.ratio + 2**14, echo=3))
    assert error_of(run) > 100


@pytest.mark.parametrize(
    ("step", "pause", "taken"),
    [(7, 0, True), (8, 0, True), (9, 0, False), (9, 0.0035, False), (9, 0.0045, True)],
)
def test_a_frame_ahead_is_a_gap_and_a_later_one_is_late(run, step, pause, taken):
    """As in the node: DAHL_NODE_GAP_MAX_STEP is 8. After a pause of 5 ms no frame is late."""
    run.pause = pause
    run.tick(2 + step, -450, used=taken)
    assert ticks_of(run)[0] == [0, 1, 2] + [2 + step] * taken
    assert summed(run)["frames_not_recorded"] == (step - 1) * taken


@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize(
    ("lost", "compared"),
    [
        ((), True),
        (range(2), False),
        (range(60, 70), False),
        (range(61, 62), False),  # an answer
        (range(60, 61), False),  # an angle with its answer
        (range(194, 200), None),  # where the recorder has ended
    ],
)
def test_a_run_with_missing_records_is_not_compared(library, lost, compared, interrupted):
    """The shaft turns back in them. The end of an interrupted run may be missing."""
    run = Run()
    run.answers = 7
    for number in range(100):
        run.tick(number, 900 * (number % 7) - 300, state=6 * (number == 0), used=number > 0)
    run.frames = [frame for number, frame in enumerate(run.frames) if number not in lost]
    loop = {"frames_sent": 100, "frames_answered": 100, "interrupted": interrupted}
    measured = Recorded(np.arange(100.0), None, 100)
    numbers = summed(run, recorded=measured, **loop)
    wanted = interrupted if compared is None else compared
    if wanted:
        assert numbers["max_error_ulp_Fc"] <= BOUND and numbers["r2_measured"] is not None
    else:
        assert numbers["max_error_ulp_Fc"] is None and numbers["r2_measured"] is None
        assert numbers["frames_not_recorded"] > 0


# --- numbers --------------------------------------------------------------------------------------


def fitted(run: Run, torque, **measured) -> tuple[float | None, float | None]:
    scene = Scene(SCENE.path, "t", "dahl", SCENE.elements, THETA)
    scene.measured = Measured(torque="T", **measured)
    found = summed(run, scene, Recorded(np.array(torque), None, len(torque)))
    return found["rmse_measured"], found["r2_measured"]


def test_rmse_and_r2_follow_their_definitions(run):
    """Without rows before `settle` and rows without an answer, with offset and spring. None if
    there are no rows or no spread.
    """
    run.send(3, -460)  # not answered
    run.tick(4, -440, state=2)
    bearing = Friction(Plan(SIGMA0, FC, THETA))
    torque = np.array([bearing.step_counts(move) for move in (0, 20, 10, 30)])
    shown = torque + 0.25 + [9, 0.1, -0.3, 0]
    rmse, r2 = fitted(run, [*shown[:3], 99, shown[3]], offset=0.25, settle=1)
    assert rmse == pytest.approx((0.1 / 3) ** 0.5, rel=1e-4)
    assert r2 == pytest.approx(1 - 0.1 / (3 * np.var(shown[1:])), rel=1e-4)
    springy = torque + 7 * THETA * np.array([0, 20, 30, 60])
    rmse, _ = fitted(run, [*springy[:3], 99, springy[3]], spring=7.0)
    assert rmse == pytest.approx(0, abs=1e-5)
    assert fitted(run, [1, 2, 3, 4, 5], settle=5) == (None, None)
    assert fitted(run, [1] * 5)[1] is None


def test_the_summary_describes_the_record(run):
    run.send(3, -460)  # not answered
    run.tick(6, -450, state=2)
    mix = models.with_key("kinds").name
    scene = Scene(SCENE.path, "t", mix, SCENE.elements, THETA, measured=Measured(settle=2))
    scene.own = ("dahl",)
    numbers = summed(run, scene, ticks=7)
    wanted = {
        "ticks": 7,
        "scene": "b",
        "title": "t",
        "frames_recorded": 5,
        "frames_not_recorded": 2,
        "answers_by_state": {"OK": 2, "Lost": 1, "Init": 1},
        "model": mix,
        "elements": [{"sigma0": SIGMA0, "Fc": FC}],
        "kinds": ["dahl"],
        "units": {"sigma0": "N m/rad", "Fc": "N m", "theta_per_count": "rad"},
        "parameters": {"sigma0": SIGMA0, "Fc": FC, "theta_per_count": THETA},
        "compared_from_row": 2,
        "scene_file": str(Path.cwd() / "a/b.ini"),
        "rmse_measured": None,
        "r2_measured": None,
    }
    assert 0 < numbers.pop("max_error_ulp_Fc") <= BOUND
    assert numbers == wanted


def page_of(folder: Path, numbers: dict) -> tuple[list[str], str]:
    (folder / "loop.png").touch()
    (folder / "summary.json").write_text(json.dumps({"scene_file": "x.ini"} | numbers))
    assert command("report", folder).returncode == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    return re.findall("<td>(.*?)</td>", page), page


@pytest.mark.parametrize(("force", "slope"), [("N", "N/m"), ("N m", "N m/rad")])
def test_the_page_shows_each_number_in_its_unit(force, slope, tmp_path):
    latency = {"p50": 100.0, "p99": 1000.0, "max": 10000.4}
    numbers = {"title": "x", "ticks": 800, "max_error_ulp_Fc": 0.51}
    numbers |= {"bus": "a bus", "time": "real", "frames_sent": 11, "frames_lost": 0}
    numbers |= {"deadline_misses": 13, "late_ticks": 4, "late_answers": 9, "frames_answered": 10}
    numbers |= {"rmse_measured": 0.0123456, "r2_measured": 0.98765}
    numbers |= {"realtime_factor": 3.21, "parameters": {"sigma0": 12.5}, "node": {"jumps": 1234567}}
    numbers |= {"latency_us": latency, "jitter_us": dict.fromkeys(latency, 0.0)}
    numbers |= {"units": {"sigma0": slope, "Fc": force, "theta_per_count": "rad"}}
    cells, _ = page_of(tmp_path, numbers | {"answers_by_state": {"OK": 790}})
    shown = f"a bus;real;800;11;0;0.510 ulp of Fc;0.01235 {force};0.9877;3.2"
    shown += f";9 of 10;4 of 800;p50 100, p99 1000, max 10000 µs;12.5 {slope};790;1234567"
    assert cells[1::2] == shown.split(";")
    assert cells[-6:] == ["sigma0", f"12.5 {slope}", "OK", "790", "jumps", "1234567"]
    cells, page = page_of(tmp_path, {"version": "9"})
    assert "simulated" not in page and "<section" not in page
    assert cells == [] and "dahl 9" in page and "a run" in page


RATIOS = {"none": {"ratio": 1.0}, "dahl": {"ratio": 0.0625}, "sign": {"ratio": 2}}
RATIOS |= {"tanh": {"ratio": 0.5}}
STEERED = {"width_Nm": 1, "drag_Nm": 2, "largest_hand_Nm": 3, "hand_J": 4, "tyres_J": 5}
SIMULATED = [  # summary, head and first rows of the table
    (
        {"scene": "compensation", "position": {"fine": RATIOS}, "hand": {"slow": RATIOS}},
        ["axis", "case", "dahl", "best other law", "its ratio"],
        ["position", "fine", "0.062", "tanh", "0.500", "hand", "slow", "0.062", "tanh", "0.500"],
    ),
    (
        {"scene": "park-steer"}
        | {name: STEERED | {"assist_J": k} for k, name in enumerate(("without", "with"))},
        ["one cycle of the hand wheel", "without assist", "with assist"],
        ["width of the hysteresis loop [N m]", "1.00", "1.00"],
    ),
]


@pytest.mark.parametrize(("numbers", "head", "first"), SIMULATED)
def test_the_page_of_a_simulated_scene_has_its_table(tmp_path, numbers, head, first):
    (tmp_path / "summary.json").write_text(json.dumps(numbers))
    (tmp_path / f"{numbers['scene']}.png").write_bytes(b"a picture")
    assert command("report", tmp_path).returncode == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall("<th>(.*?)</th>", page) == head
    cells = re.findall("<td>(.*?)</td>", page)
    assert cells[: len(first)] == first and len(cells) in (len(first), 6 * len(head))
    assert base64.b64encode(b"a picture").decode() in page and numbers["scene"] in page


def test_the_page_marks_a_wrong_counter(tmp_path):
    faults = {"injected": {"bad_crc": 4}, "expected": {"crc": 4, "lost": 2}}
    numbers = {"faults": faults, "node": {"crc": 4, "lost": 9}, "control": {"max_error_rad": 0.5}}
    _, page = page_of(tmp_path, numbers)
    assert re.findall(r'class="wrong">(.*?)<', page) == ["9"]
    cells = [re.sub("<.*?>", "", cell) for cell in re.findall("<td>(.*?)</td>", page, re.DOTALL)]
    assert [cell.strip() for cell in cells] == (
        ["bad crc", "4", "crc", "4", "4", "lost", "2", "9", "max error rad", "0.5"]
        + ["crc", "4", "lost", "9"]
    )
    _, page = page_of(tmp_path, numbers | {"node": {"crc": 4, "lost": 2}})
    assert 'class="wrong"' not in page
    assert not re.findall(r'(?:src|href)="(?!data:)', page)  # it needs no other file
