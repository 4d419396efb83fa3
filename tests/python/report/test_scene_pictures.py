# SPDX-License-Identifier: MIT
"""Pictures of the scenes commission, compensation and park-steer: their curves, dots, bands and
bars. The table that park-steer prints.
"""

import json
import re
from itertools import combinations
from types import SimpleNamespace

import can
import numpy as np
import pytest
from dahl.report import commission_plot, compensation, park_steer
from dahl.sim import axis as simulation
from dahl.sim import park_steer as steering
from dahl.sim.compensation import LAWS, SHOWN_HAND, SHOWN_POSITION, laws_of
from dahl.sim.compensation_axis import PERIOD_S
from log_reading import drawing
from log_reading import run as command
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.transforms import Bbox

RANDOM = np.random.default_rng(1)
PANELS = [  # of compensation: title, and the ends of the labels of x and y
    (f"Position loop: {SHOWN_POSITION.name}", "time [s]", "error [mrad]"),
    ("Position loop: a wrong Fc", "Fc [%]", "ratio"),
    (f"Hand: {SHOWN_HAND.name}", "time [s]", "torque of the hand [N m]"),
    ("Hand: motor torque, each tick", "time [s]", "torque [N m]"),
    ("", "position: error over that without compensation", ""),
    ("", "hand: error over that without compensation", ""),
]
PLACES = {"position": (0, 1e3), "hand": (2, 1.0)}  # panel of the errors, scale
WRONG_FC = {-30: "Fc 30 % low", -10: "Fc 10 % low", 0: "17 bits"}
WRONG_FC |= {10: "Fc 10 % high", 30: "Fc 30 % high"}


def assert_apart(figure: Figure, *legends: Legend) -> None:
    """No panel, legend or title lies over another or beyond the edge of the picture."""
    figure.draw(renderer := FigureCanvasAgg(figure).get_renderer())
    parts = [*legends, *figure.texts]
    for axes in figure.axes:
        labels = (axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label)
        parts += [axes, *(text for text in labels if text.get_text())]
        parts += [axes.get_legend()] * (axes.get_legend() is not None)
    boxes = [part.get_window_extent(renderer) for part in parts]
    assert [box for box in boxes if Bbox.intersection(box, figure.bbox).bounds != box.bounds] == []
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


def assert_labels(panels: list[Axes], wanted: list[tuple[str, str, str]]) -> None:
    for axes, (title, x, y) in zip(panels, wanted, strict=True):
        assert axes.get_title(loc="left") == title
        for label, end in ((axes.get_xlabel(), x), (axes.get_ylabel(), y)):
            assert label.endswith(end) and bool(label) == bool(end), label


def traces(*names: str) -> SimpleNamespace:
    return SimpleNamespace(**{name: RANDOM.normal(size=round(4 / PERIOD_S)) for name in names})


def random_ratios(axis: str, cases: tuple[str, ...]) -> dict:
    return {
        case: {law: {"ratio": RANDOM.uniform(0.1, 2)} for law in laws_of(axis)} for case in cases
    }


def assert_dots(panel: Axes, shown: dict, law_of: dict[str, str]) -> None:
    """Each law has a dot for each case, at its ratio."""
    assert [label.get_text() for label in panel.get_yticklabels()] == [*shown]
    dots = {law_of[line.get_color()]: line for line in panel.lines}
    assert {*dots} == {law for laws in shown.values() for law in laws}
    assert [*dots.pop("none").get_xdata()] == [1, 1]
    for law, line in dots.items():
        assert [*line.get_ydata()] == [*range(len(shown))]
        assert [*line.get_xdata()] == [laws[law]["ratio"] for laws in shown.values()]


def test_each_law_has_its_curves_and_dots(tmp_path) -> None:
    """Means of 20 ms from 1 s to 3.5 s without bands, some ticks, and the ratio of each case."""
    runs = {axis: {law: traces("error", "motor") for law in laws_of(axis)} for axis in PLACES}
    numbers = {"position": random_ratios("position", (*WRONG_FC.values(), "b"))}
    numbers |= {"hand": random_ratios("hand", ("c", "d"))}
    with drawing(rendered=False) as figures:
        compensation.draw(tmp_path / "x.png", SimpleNamespace(**runs, numbers=numbers))
    panels = figures[0].axes
    assert_labels(panels, PANELS)
    assert not any(panel.collections for panel in panels)
    (legend,) = figures[0].subfigs[0].legends
    assert_apart(figures[0], legend)
    assert legend.get_title().get_text()
    names = [text.get_text().removesuffix("(v)") for text in legend.get_texts()]
    assert names == list(LAWS)  # the order of the tables
    shown = zip(legend.get_texts(), legend.get_lines(), strict=True)
    law_of = {line.get_color(): text.get_text().removesuffix("(v)") for text, line in shown}
    for name, (place, scale) in PLACES.items():
        assert {"none", "dahl"} < {law_of[line.get_color()] for line in panels[place].lines}
        for line in panels[place].lines:
            trace = runs[name][law_of[line.get_color()]].error * scale
            bins = trace[round(1 / PERIOD_S) : round(3.5 / PERIOD_S)].reshape(125, -1)
            assert line.get_xdata() == pytest.approx(1.01 + 0.02 * np.arange(125))
            assert line.get_ydata() == pytest.approx(bins.mean(axis=1))
    for line in panels[3].lines:
        ticks = np.round(line.get_xdata() / PERIOD_S).astype(int)
        assert [*np.diff(ticks)] == [1] * (len(ticks) - 1)
        assert [*line.get_ydata()] == [*runs["hand"][law_of[line.get_color()]].motor[ticks]]
    for line in panels[1].lines:
        assert [*line.get_xdata()] == [*WRONG_FC]
        law = law_of[line.get_color()]
        due = [numbers["position"][case][law]["ratio"] for case in WRONG_FC.values()]
        assert [*line.get_ydata()] == due
    for panel, cases in zip(panels[4:], numbers.values(), strict=True):
        assert_dots(panel, cases, law_of)


def test_the_hand_is_drawn_without_and_with_compensation(tmp_path) -> None:
    """Its torque over its angle in degrees, and with compensation all torques over time."""
    plain, assisted = (traces("hand_angle", "hand", "tyres", "assist", "time") for _ in range(2))
    for run, torque in ((plain, 12.34), (assisted, 5.678)):
        run.numbers = lambda torque=torque: {"largest_hand_Nm": torque}
    with drawing(rendered=False) as figures:
        park_steer.draw(tmp_path / "x.png", plain, assisted)
    assert re.findall(r"[\d.]+", figures[0].get_suptitle()) == ["12.3", "5.68"]
    assert_apart(figures[0])
    loops, torques = figures[0].axes
    ends = [("", "[deg]", "torque of the hand [N m]"), ("", "time [s]", "compensation [N m]")]
    assert_labels([loops, torques], ends)
    for axes in (loops, torques):
        shown = [text.get_text() for text in axes.get_legend().get_texts()]
        assert shown == [line.get_label() for line in axes.lines]
    for line, run in zip(loops.lines, (plain, assisted), strict=True):
        assert line.get_xdata() == pytest.approx(np.degrees(run.hand_angle))
        assert line.get_ydata() == pytest.approx(run.hand)
    assert [line.get_label().split()[0] for line in loops.lines] == ["without", "with"]
    assert [line.get_label() for line in torques.lines] == ["tyres", "assist", "hand"]
    for line in torques.lines:
        assert line.get_xdata() == pytest.approx(assisted.time)
        assert line.get_ydata() == pytest.approx(getattr(assisted, line.get_label()))


def test_the_demo_of_park_steer_prints_the_numbers_of_its_summary(tmp_path, monkeypatch) -> None:
    """In the column of its run, also with --json. The summary has the same numbers."""
    names = ("width_Nm", "drag_Nm", "largest_hand_Nm", "hand_J", "tyres_J", "assist_J")
    columns = {gain: dict(zip(names, RANDOM.uniform(1, 9, 6), strict=True)) for gain in (0, 1)}
    frame = can.Message(arbitration_id=5, is_extended_id=False, data=b"ab")

    def simulate(gain: float, progress) -> SimpleNamespace:
        progress()
        return SimpleNamespace(
            **vars(traces("hand_angle", "hand", "tyres", "assist", "time")),
            frames=[frame] * bool(gain),
            numbers=lambda: columns[gain > 0],
        )

    monkeypatch.setattr(steering, "simulate", simulate)
    for words in ((), ("--json",)):
        with drawing(rendered=False):
            done = command("demo", "--scene", "park-steer", "-o", tmp_path, *words)
        summary = json.loads((tmp_path / "summary.json").read_text())
        assert summary["without"] == columns[0] and summary["with"] == columns[1]
        assert done.returncode == 0 and (not words or json.loads(done.stdout) == summary)
        shown = done.stderr if words else done.stdout
        cells = [re.split(r" *│ *", line)[1:4] for line in shown.splitlines() if "│" in line]
        rows = [[f"{columns[gain][name]:.2f}" for gain in (0, 1)] for name in names]
        assert [row[1:] for row in cells] == rows
        for name, (meaning, *_) in zip(names, cells, strict=True):
            assert meaning.endswith("[J]" if name.endswith("_J") else "[N m]")
        assert "without" in shown and str(tmp_path / "run.log") in shown
    assert (tmp_path / "run.log").read_text().endswith(" 005#6162\n")


@pytest.fixture(scope="module")
def commissioned() -> simulation.Commissioned:
    return simulation.commission(simulation.simulated(), simulation.Shaft())


def curves(panel: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {line.get_label(): (line.get_xdata(), line.get_ydata()) for line in panel.lines}


def test_a_commissioning_has_its_motion_friction_turn_kicks_and_tracking(
    commissioned: simulation.Commissioned, tmp_path
) -> None:
    tracking = tuple(simulation.track(commissioned.axis, is_on) for is_on in (False, True))
    with drawing() as drawn:
        commission_plot.draw(tmp_path / "all.png", commissioned, tracking)
    motion, by_angle, by_speed, turn, kicks, errors = drawn[0].axes
    assert_apart(drawn[0])
    rms = [f"{1e3 * one.rms:.3g}" for one in reversed(tracking)]
    assert re.findall(r"[\d.]+", drawn[0].get_suptitle()) == rms
    assert [*curves(motion)] == list(simulation.STAGES)
    found = curves(by_angle)
    assert found["friction"][1] == pytest.approx(simulation.FC, rel=0.05)
    assert found["load"][1] == pytest.approx(
        simulation.GRAVITY * np.cos(found["load"][0]), abs=0.02
    )
    speed, friction = curves(by_speed)["measured"]
    assert friction == pytest.approx(simulation.FC + simulation.VISCOUS * speed, rel=0.03)
    travel, torque = curves(turn)["measured"]  # a ramp to the breakaway
    assert travel[-1] > 50 and max(torque) == pytest.approx(simulation.FC, rel=0.1)  # mrad
    assert len(kicks.lines) == 8  # both ways, 4 at the largest gain
    ends = [line.get_ydata()[-1] for line in kicks.lines]
    assert [end > 0 for end in ends] == [True, False] * 4
    assert [max(np.abs(line.get_ydata())) > 10 for line in errors.lines] == [True, False]


def test_a_refused_axis_has_the_panels_of_its_data(tmp_path) -> None:
    """The load of this one falls after the sweeps, or at once."""
    for until, panels in ((11.0, 3), (0.3, 1)):
        shaft, ticks = simulation.Shaft(), []

        def fall(_: object, shaft=shaft, ticks=ticks, until=until) -> None:
            ticks.append(0)
            shaft.hand = 3 * simulation.FC * (len(ticks) > until / simulation.PERIOD_S)

        refused = simulation.commission(simulation.simulated(), shaft, watch=fall)
        assert refused.axis.refusal_code
        with drawing(rendered=False) as drawn:
            commission_plot.draw(tmp_path / "part.png", refused)
        assert len(drawn[0].axes) == panels
