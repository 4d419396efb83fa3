# SPDX-License-Identifier: MIT
"""`dahl monitor`: the numbers of --json, the picture without a terminal, and the screen of
terminals of any size.
"""

import contextlib
import json
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from bus_frames import ANGLE, ERRORS, frames, new_channel, sending
from dahl import Node, Plan, codec
from identify_tools import complaint

OK = {"State": "OK", "TorqueRatio": 0.5}
Sent = tuple[str, float, dict[str, Any]]


@pytest.fixture
def monitor(dahl, dbc):
    """Call the monitor on a bus with these frames alone; returns its output."""

    def run(sent: Iterable[can.Message | Sent], *words: object, before_last=lambda: None) -> str:
        messages = [one if isinstance(one, can.Message) else next(frames(dbc, one)) for one in sent]
        channel = new_channel()
        bus = ("-i", "virtual", "-c", channel, "--frames", len(messages), "--seconds", 120)
        with sending(channel, messages, before_last=before_last):
            done = dahl("monitor", *bus, *words)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    return run


@pytest.fixture
def seen(monitor):
    def run(sent: Iterable[can.Message | Sent], *words: object) -> dict[str, Any]:
        return json.loads(monitor(sent, "--json", *words))

    return run


def row_of(shown: str, name: str) -> list[int]:
    found = re.search(rf"^ *{name} +(\d+) +(\d+) +(\d+) +(\d+)\b", shown, re.MULTILINE)
    return [int(number) for number in found.groups()]


# --- counts ---------------------------------------------------------------------------------------


def spoiled_frames() -> list[can.Message]:
    """Three bad EncoderStates, a bad FrictionTorque, and four other frames."""
    short = [{"data": data, "arbitration_id": 0x100} for data in (b"\x01", bytes(7), bytes(8))]
    more = [{"arbitration_id": 0x110}, {"arbitration_id": 0x7DF}]
    more += [{"arbitration_id": 0x100, "is_extended_id": True}]
    more += [{"arbitration_id": 0x100, "is_remote_frame": True, "data": None}]
    more += [{"arbitration_id": 0x100, "is_error_frame": True}]
    plain = {"is_extended_id": False, "data": bytes(8)}
    return [can.Message(**plain | one) for one in (*short, *more)]


NOT_SEEN = {"frames": 0, "per_s": 0, "missing": 0, "bad": 0, "last": {}}


def test_good_bad_and_other_frames_are_counted(monitor, seen, dbc, monkeypatch):
    sent = [*frames(
        dbc,
        ("EncoderState", 0.000, {"Counter": 14, "Valid": 1, "Count": -7}),
        ("FrictionTorque", 0.0001, {"Counter": 0, "EchoCounter": 14, **OK}),
        ("EncoderState", 0.002, {"Counter": 0, "Valid": 1, "Count": 8}),
        ("FrictionTorque", 0.0021, {"Counter": 1, "EchoCounter": 0, **OK}),
    )]  # fmt: skip
    fd = can.Message(arbitration_id=0x110, data=sent[-1].data, is_fd=True, is_extended_id=False)
    known = seen([*sent, *spoiled_frames(), fd])
    angle = {"Crc": sent[2].data[0], "Counter": 0, "Valid": "Valid", "Count": 8}
    torque = {"Crc": sent[3].data[0], "Counter": 1, "State": "OK", "EchoCounter": 0}
    messages = dict.fromkeys(("Status", "ParamWrite", "ParamReply", "Reset"), NOT_SEEN)
    both, often = {"frames": 2, "per_s": pytest.approx(500)}, known.pop("most_behind_s")
    messages["EncoderState"] = both | {"missing": 1, "bad": 3, "last": angle}
    messages["FrictionTorque"] = both | {"missing": 0, "bad": 2}
    messages["FrictionTorque"] |= {"last": torque | {"TorqueRatio": 0.5}}
    numbers = {"frames": 13, "other_frames": 4, "Fc": None, "states": {"OK": 2}}
    assert 0 <= known.pop("behind_s") <= often
    assert known == numbers | {"messages": messages}
    monkeypatch.setenv("COLUMNS", "100")
    shown = monitor([*sent, *spoiled_frames(), fd])
    assert row_of(shown, "EncoderState") == [2, 500, 1, 3]
    assert row_of(shown, "Status") == [0, 0, 0, 0] and "ParamReply" not in shown
    assert re.search(r"^EncoderState +Valid Valid +Count 8 ", shown, re.MULTILINE)
    for words in ("F/Fc over counts", "TorqueRatio 0.500000", "OK 2", "other frames  4"):
        assert words in shown
    assert "\x1b" not in shown
    monkeypatch.setenv("COLUMNS", "200")
    assert "message frames 1/s missing bad last" in " ".join(monitor(sent).split())


@pytest.mark.parametrize(
    ("counters", "period", "missing"),
    [
        ([14, 15, 0, 1], 0.001, 0),
        ([0, 1, 9], 0.001, 7),
        ([0, 1, 1, 2], 0.001, 0),  # repeated
        ([0, 1, 3, 2, 4], 0.001, 1),  # late
        ([0, 1, 1, 2], 0.005, 0),  # repeated, at any period
        ([0, 2, 1], 0.005, 15),
    ],
)
def test_repeated_and_late_frames_are_no_gap(seen, counters, period, missing):
    sent = [("EncoderState", n * period, ANGLE | {"Counter": c}) for n, c in enumerate(counters)]
    known = seen(sent)["messages"]["EncoderState"]
    assert [known[name] for name in ("frames", "missing", "bad")] == [len(counters), missing, 0]
    assert known["last"]["Counter"] == counters[-1]


def test_gaps_are_counted_only_for_consecutive_counters(seen, dbc, tmp_path):
    """The counter of a ParamReply is that of the request. Another DBC may have none."""
    reply = {"Param": "Fc", "Result": "Done", "Fc": 1}
    sent = [("ParamReply", n, reply | {"Counter": c}) for n, c in enumerate((0, 0, 7, 3))]
    sent += [("EncoderState", 9, ANGLE | {"Counter": c}) for c in (15, 0, 3)]
    known = seen(sent)["messages"]
    assert [known[name]["missing"] for name in ("EncoderState", "ParamReply")] == [2, 0]
    own = tmp_path / "other.dbc"
    own.write_text(dbc.read_text().replace(" SG_ Counter", " SG_ Tick"))
    known = seen(sent, "--dbc", own)["messages"]["EncoderState"]
    assert (known["frames"], known["missing"]) == (3, 0)


def test_a_restarted_node_has_lost_nothing(seen):
    """By Reset or by power: its counters begin at 0."""
    sent, plan = [], Plan(100.0, 0.5, 1e-3)
    restart = codec.pack(codec.Reset(codec.What.RESTART))
    for one in (node := Node(plan), node, Node(plan)):
        angles = [codec.pack(codec.EncoderState(5, counter)) for counter in range(3)]
        for message in (restart, *angles):
            sent += [answer for answer in (one.receive(message), one.tick()) if answer]
    for n, message in enumerate(sent):
        message.timestamp = n / 100
    known = seen(sent)["messages"]
    assert [known[name]["missing"] for name in ("FrictionTorque", "Status")] == [0, 0]
    assert min(known[name]["frames"] for name in ("FrictionTorque", "Status")) > 2


OWN = "[friction]\nmodel = asymmetric\nnode = 3\nsigma0 = 1\nFc = 0.5 1\ntheta_per_count = 1\n"


@pytest.mark.parametrize(
    ("words", "number"),
    [
        ((), 0),
        (("--node", 15, "--dbc", "all.dbc"), 15),
        (("--scene", "own.ini", "--dbc", "all.dbc"), 3),
        (("--scene", "own.ini", "--node", 15), 15),
        (("--scene", "own.ini", "--node", 0), 0),
    ],
)
def test_the_node_of_the_option_or_else_of_the_scene_is_shown(seen, dahl, dbc, words, number):
    """One node of three; frames of the others count as other frames, also if a DBC describes them.
    Fc is the larger limit of the scene.
    """
    Path("own.ini").write_text(OWN)
    if "all.dbc" in words:
        assert dahl("dbc", "--nodes", 16, "-o", "all.dbc").returncode == 0
    sent = []
    for node in (0, 3, 15):
        sent += frames(dbc, ("EncoderState", 0.0, ANGLE | {"Counter": 1, "Count": 10 + node}))
        sent[-1].arbitration_id += node
    known = seen(sent, *words)
    shown = known["messages"]["EncoderState"]
    assert (shown["last"]["Count"], shown["frames"]) == (10 + number, 1)
    assert (known["Fc"], known["other_frames"]) == (1 if "own.ini" in words else None, 2)


def test_a_description_may_have_the_identifiers_of_another_node(seen, dbc):
    text = re.sub(r"(?<=_ )\d+", lambda one: str(int(one[0]) + 3), dbc.read_text())
    text = text.replace("Count : 16|32@1- (1,0)", "Count : 16|32@1- (2,0)")
    other = 'BO_ 1537 Other: 8 Encoder\n SG_ X : 0|8@1+ (1,0) [0|255] "" FrictionNode\n\n'
    Path("three.dbc").write_text(text.replace("BO_ 259", other + "BO_ 259", 1))
    (message,) = frames(dbc, ("EncoderState", 0.0, ANGLE | {"Counter": 1, "Count": 7}))
    message.arbitration_id = 0x103
    known = seen([message], "--dbc", "three.dbc")["messages"]
    assert known["EncoderState"]["last"]["Count"] == 14 and "Other" in known


def test_answers_before_the_first_angle_are_counted_and_not_drawn(monitor, seen):
    sent = [
        ("FrictionTorque", n, {"Counter": n, "EchoCounter": 0, "TorqueRatio": 0.5, "State": s})
        for n, s in enumerate(["Init", "OK", "OK"])
    ]
    assert [*seen(sent)["states"].items()] == [("OK", 2), ("Init", 1)]
    assert not re.search("[⠁-⣿]", monitor(sent))


# --- curves ---------------------------------------------------------------------------------------


def assert_axes_hold(lines: list[str], *spans: tuple[float, float]) -> None:
    """The axes of the first panel cover each span with even round ticks, at most one beyond."""
    end = next(n for n, line in enumerate(lines) if "└" in line)
    across = [float(word) for word in lines[end + 1].split()]
    up = [float(line.partition("┤")[0]) for line in lines[:end] if "┤" in line][::-1]
    for ticks, (low, high) in zip((across, up), spans, strict=True):
        steps = np.diff(ticks)
        assert len(ticks) >= 2 and steps == pytest.approx(steps[0]), ticks
        assert float(f"{steps[0]:.6e}"[:8].rstrip("0e")) in (1, 2, 5), ticks
        if low == high:
            assert ticks[0] < low < ticks[-1], ticks
        else:
            assert low - steps[0] < ticks[0] <= low and high <= ticks[-1] < high + steps[0], ticks


@pytest.mark.parametrize(
    ("low", "step", "ratio"),
    [(5000, 100, 0.25), (-370_000, 1, -0.5), (0, 111_111, 0), (7, 0, 0.5), (0, 0, 0)],
)
def test_each_curve_has_its_own_axes(monitor, monkeypatch, low, step, ratio):
    sent: list[Sent] = []
    rise = 0.25 if step else 0.0
    for n in range(-5, 10):
        both, moment = {"Counter": n % 16, "EchoCounter": n % 16, "Valid": 1}, 100 + n / 10
        torque = both | {"State": "OK", "TorqueRatio": ratio + rise * n / 9}
        sent.append(("EncoderState", moment, both | {"Count": low + step * n}))
        sent.append(("FrictionTorque", moment, torque))
    monkeypatch.setenv("COLUMNS", "100")
    lines = monitor(sent, "--window", 10).splitlines()
    top, below = (n for n, line in enumerate(lines) if "F/Fc over" in line)
    counts, ratios, seconds = (low, low + 9 * step), (ratio, ratio + rise), (0, 0.9)
    assert "counts" in lines[top] and "counts over s" in lines[below][50:]
    assert_axes_hold(lines[top:], counts, ratios)
    assert_axes_hold([line[:50] for line in lines[below:]], seconds, ratios)
    assert_axes_hold([line[50:] for line in lines[below:]], seconds, counts)


def in_trouble(dbc) -> list[can.Message]:
    """Ticks of a node in trouble with each error seen; 12 Status frames are missing."""
    status = {"State": "Stale", "Lost": 90, "Corrupt": 34, "OutOfStep": 43, "Timeout": 100}
    status |= {f"Error{name}": 1 for name in ERRORS} | {"VersionMajor": 0, "VersionMinor": 2}
    sent: list[Sent] = []
    for n in range(90):
        counter = {"Counter": n % 16, "EchoCounter": n % 16}
        torque = counter | {"State": "Lost", "TorqueRatio": np.sin(n / 9)}
        angle = counter | {"Valid": 1, "Count": -(10**9) + 12345 * n}
        sent += [("EncoderState", n / 1000, angle), ("FrictionTorque", n / 1000, torque)]
        sent += [("Status", n / 1000, counter | status)] * (not 40 <= n < 52)
    return [*frames(dbc, *sent), can.Message(arbitration_id=0x120, is_extended_id=False)]


def test_a_torque_has_a_unit_if_fc_is_known(monitor, seen, dbc, tmp_path):
    (tmp_path / "own.ini").write_text(
        "[friction]\nsigma0 = 1\nFc = 2\ntheta_per_count = 1\n"
        "[measured]\nlabel_torque = force [N]\n"
    )
    sent, last = in_trouble(dbc), f"{2 * np.sin(89 / 9):+.6f}"
    assert "F/Fc over counts" in monitor(sent)
    for words, unit in ((("--fc", 2), "N m"), (("--scene", "own.ini"), "N")):
        shown = monitor(sent, *words)
        assert f"F [{unit}] over counts" in shown and f"{last} {unit} " in shown
    reply = {"Counter": 0, "Result": "Done", "Param": "Fc", "Fc": 4.5}
    other = {"Counter": 1, "Result": "Done", "Param": "Sigma0", "Sigma0": 7}
    sent += frames(dbc, ("ParamReply", 0.0, reply), ("ParamReply", 1.0, other))
    assert seen(sent)["Fc"] == 4.5 and "F [N m] over counts" in monitor(sent)


@pytest.mark.parametrize(
    ("changed", "missing"),
    [("FrictionTorque", "'State'"), ("TorqueRatio", "'TorqueRatio'"), ("Count ", "'Count'")],
)
def test_a_dbc_without_a_shown_signal_is_refused(dahl, dbc, tmp_path, changed, missing):
    (tmp_path / "other.dbc").write_text(dbc.read_text().replace(changed, "Other "))
    code, said = complaint(dahl("monitor", "-i", "virtual", "-c", "x", "--dbc", "other.dbc"))
    assert code == 2 and said.startswith("other.dbc: ") and missing in said


# --- on a terminal --------------------------------------------------------------------------------

SHOWN = {"EncoderState", "FrictionTorque", "Status", "node states", "over counts"}
COMMAND = re.compile(r"\x1b\[[?\d;]*[A-Za-z]")


@pytest.fixture
def screen(monitor, monkeypatch):
    def run(sent: Iterable[can.Message | Sent], width: int, height: int) -> tuple[list[str], str]:
        for name, value in (("FORCE_COLOR", 1), ("COLUMNS", width), ("LINES", height)):
            monkeypatch.setenv(name, str(value))
        monkeypatch.setenv("TERM", "xterm")
        written = monitor(sent, before_last=lambda: time.sleep(0.4))
        live = written.partition("\x1b[?1049h")[2].partition("\x1b[?1049l")[0]
        last = COMMAND.sub("", live.split("\x1b[H")[-1])
        return last.rstrip("\n").splitlines(), written

    return run


@pytest.mark.parametrize(
    ("width", "height", "is_well"),
    [(40, 16, True), (60, 18, False), (80, 24, True), (70, 50, False), (140, 45, False)],
)
def test_the_screen_fits_small_and_large_terminals(screen, dbc, width, height, is_well):
    quiet = [("EncoderState", 0.0, ANGLE | {"Counter": 1})] * 2
    lines, _ = screen(quiet if is_well else in_trouble(dbc), width, height)
    assert max(map(len, lines)) <= width and len(lines) <= height
    first = {name: n for n, line in enumerate(lines) for name in SHOWN if name in line}
    assert first.keys() == SHOWN
    assert first["EncoderState"] < first["node states"] < first["over counts"]
    axes = [line for line in lines if "└" in line]
    assert axes and min(len(line.rstrip()) for line in axes) > 0.9 * min(width, 80)
    assert any("over s" in line for line in lines) == (width >= 70)


def test_errors_have_colour_on_a_terminal(screen, dbc):
    """The screen is live. The result that stays has both curves over time."""
    lines, written = screen(in_trouble(dbc), 80, 24)
    left = written.partition("\x1b[?1049l")[2]
    assert "Lost 90" in " ".join(lines) and "counts over s" not in " ".join(lines)
    assert "counts over s" in left
    yellow, red = (re.findall(rf"\x1b\[{n}m *(.*?) *\x1b", left) for n in (33, 31))
    yellow = [words for words in yellow if "at most" not in words]  # this process may be late
    seen = f"seen: {' '.join(ERRORS)}"
    assert yellow == ["12", "State Lost", "State Stale", seen, "Lost 90"] and red == ["1"]
    assert re.search("\x1b\\[3[68][^m]*m[⠁-⣿]", left), "the curve is coloured"


def test_frames_before_the_end_of_the_bus_are_shown(dahl, dbc, monkeypatch):
    ticks = [*frames(dbc, ("EncoderState", 1.0, {"Counter": 3, "Valid": 1, "Count": 77}))]

    class Going:
        def recv(self, _: float) -> can.Message:
            if not ticks:
                raise can.CanOperationError("cable out")
            return ticks.pop()

    monkeypatch.setattr(can, "Bus", lambda **_: contextlib.nullcontext(Going()))
    done = dahl("monitor", "-i", "virtual", "-c", "x")
    code, said = complaint(done)
    assert code == 1 and said.endswith("cable out")
    assert row_of(done.stdout, "EncoderState") == [1, 0, 0, 0] and "Count 77" in done.stdout
    assert row_of(done.stdout, "FrictionTorque") == [0, 0, 0, 0]
    assert re.search(r"^ ?node states +none yet *$", done.stdout, re.M)
