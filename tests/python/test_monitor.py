# SPDX-License-Identifier: MIT
"""The monitor and the recorder as an outsider runs them: on a served bus, with a terminal and
without.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import pty
import re
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from crccheck.crc import Crc8Autosar
from dahl import Error, Node, Plan, codec, logs, report
from dahl.commands.dbc import describe
from dahl.monitor_curves import even_ticks
from dahl.monitor_view import View
from identify_tools import caller
from loop_tools import SCENES, serving, wait_until
from rich.screen import Screen

KINDS = {"EncoderState": 0x3, "FrictionTorque": 0xC, "Status": 0x5, "ParamReply": 0x9}


def words_of(port: int) -> list[str]:
    """Options that name a served bus."""
    return ["-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", str(port)]


@pytest.fixture
def served(tmp_path):
    limits = ("--wait-clients", "1", "--seconds", "20")
    with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (_, port):
        yield words_of(port)


def frames(dbc, *messages):
    """python-can messages of (name, time, signals), encoded by cantools, protected by crccheck."""
    import can
    import cantools

    database = cantools.database.load_file(dbc)
    for name, moment, signals in messages:
        message = database.get_message_by_name(name)
        data = bytearray(message.encode({"Crc": 0, **signals}, strict=False))
        data[0] = Crc8Autosar.calc(data[1:] + bytes([KINDS[name] << 4 | data[1] & 15]))
        yield can.Message(
            timestamp=moment, arbitration_id=message.frame_id, data=data, is_extended_id=False
        )


def text_of(view: View | Screen, width: int = 100, height: int = 40) -> str:
    from rich.console import Console

    console = Console(width=width, height=height, record=True, file=io.StringIO())
    console.print(view, height=height)
    return console.export_text()


def test_view_counts_what_it_sees(dbc):
    import can

    view = View()
    answer = {"State": "OK", "TorqueRatio": 0.5}
    for frame in frames(
        dbc,
        ("EncoderState", 0.000, {"Counter": 14, "Valid": 1, "Count": -7}),
        ("FrictionTorque", 0.0001, {"Counter": 0, "EchoCounter": 14, **answer}),
        ("EncoderState", 0.002, {"Counter": 0, "Valid": 1, "Count": 8}),
        ("FrictionTorque", 0.0021, {"Counter": 1, "EchoCounter": 0, **answer}),
    ):
        view.feed(frame)
    frame.is_fd = True  # a bad one, as the node counts it: no message of it is CAN FD
    view.feed(frame)
    for data in (b"\x01", bytes(7), bytes(8)):
        view.feed(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
    view.feed(can.Message(arbitration_id=0x110, data=bytes(8), is_extended_id=False))
    view.feed(can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=True))
    view.feed(can.Message(arbitration_id=0x7DF, data=bytes(8), is_extended_id=False))
    view.feed(can.Message(arbitration_id=0x100, is_remote_frame=True, is_extended_id=False))
    view.feed(can.Message(arbitration_id=0x100, is_error_frame=True, is_extended_id=False))
    encoder = view.names["EncoderState"]
    assert (encoder.frames, encoder.missing, encoder.wrong) == (2, 1, 3)
    assert (view.others, view.frames) == (4, 13)
    assert view.names["FrictionTorque"].wrong == 2
    told = view.as_dict()["messages"]["EncoderState"]
    assert [told[name] for name in ("frames", "missing", "bad")] == [2, 1, 3]
    assert encoder.rate() == pytest.approx(1 / 0.002)
    assert list(view.count) == [-7, 8]
    assert list(view.ratio) == pytest.approx([0.5, 0.5])
    shown = text_of(view)
    assert "F/Fc over counts" in shown
    assert re.search(r"^message +frames +1/s +missing +bad *$", shown, re.MULTILINE)
    assert "message frames 1/s missing bad last" in " ".join(text_of(view, 200).split())
    assert re.search(r"^EncoderState +2 +500 +1 +3$", shown.replace(" \n", "\n"), re.MULTILINE)
    assert re.search(r"^EncoderState +Valid Valid +Count 8 ", shown, re.MULTILINE)
    assert "TorqueRatio 0.500000 " in shown
    assert "OK 2" in shown


@pytest.mark.parametrize(
    ("counters", "period", "missing"),
    [
        ([14, 15, 0, 1], 0.001, 0),
        ([0, 1, 3, 4], 0.001, 1),
        ([0, 1, 9], 0.001, 7),
        ([0, 1, 1, 2], 0.001, 0),  # repeated
        ([0, 1, 3, 2, 4], 0.001, 1),  # late
        ([0, 1, 1, 2], 0.005, 15),  # a gap of a whole round
        ([0, 2, 1], 0.005, 15),
    ],
)
def test_frames_that_no_node_uses_leave_no_gap(dbc, counters, period, missing):
    """As `dahl plot` and the node have it: what is repeated or late is not followed by a gap."""
    view, angle = View(), {"Valid": 1, "Count": 0}
    sent = [("EncoderState", n * period, angle | {"Counter": c}) for n, c in enumerate(counters)]
    for frame in frames(dbc, *sent):
        view.feed(frame)
    seen = view.names["EncoderState"]
    assert (seen.frames, seen.missing, seen.wrong) == (len(counters), missing, 0)
    assert seen.last["Counter"] == counters[-1]


def test_frames_are_missing_only_where_the_counter_goes_up_by_one(dbc):
    """That of a ParamReply is the asker's own, whatever it is."""
    replies = [("ParamReply", n, {"Param": "Fc", "Result": "Done", "Fc": 1, "Counter": counter})
               for n, counter in enumerate((0, 0, 7, 3))]  # fmt: skip
    angles = [("EncoderState", 9, {"Valid": 1, "Count": 0, "Counter": counter})
              for counter in (15, 0, 3)]  # fmt: skip
    view = View()
    for frame in frames(dbc, *replies, *angles):
        view.feed(frame)
    seen = view.as_dict()["messages"]
    assert (seen["ParamReply"]["frames"], seen["ParamReply"]["missing"]) == (4, 0)
    assert (seen["EncoderState"]["frames"], seen["EncoderState"]["missing"]) == (3, 2)
    rows = re.findall(r"^([A-Z]\w+) +(\d+) +\d+ +(\d+) ", text_of(view), re.MULTILINE)
    assert rows == [
        ("EncoderState", "3", "2"),
        ("FrictionTorque", "0", "0"),
        ("Status", "0", "0"),
        ("ParamReply", "4", "0"),
    ]


def test_a_node_that_begins_anew_has_lost_nothing(library):
    """By a Restart, and by power: its counters begin at 0."""
    view, plan = View(), Plan(100.0, 0.5, 1e-3)
    restart = codec.pack(codec.Reset(codec.What.RESTART))
    for one in (node := Node(plan), node, Node(plan)):
        angles = [codec.pack(codec.EncoderState(5, counter)) for counter in range(3)]
        for message in (restart, *angles):
            for answer in (one.receive(message), one.tick()):
                if answer is not None:
                    answer.timestamp = view.frames / 100
                    view.feed(answer)
    seen = view.as_dict()["messages"]
    assert [(name, seen[name]["missing"]) for name in seen if seen[name]["frames"] > 2] == [
        ("FrictionTorque", 0),
        ("Status", 0),
    ]


def test_answers_count_before_the_first_angle_but_are_no_point_of_a_curve(dbc):
    view = View()
    answer = {"Counter": 0, "EchoCounter": 0, "TorqueRatio": 0.5}
    states = ["Init", "OK", "OK"]
    for frame in frames(
        dbc, *[("FrictionTorque", n, answer | {"State": s}) for n, s in enumerate(states)]
    ):
        view.feed(frame)
    assert [*view.as_dict()["states"].items()] == [("OK", 2), ("Init", 1)]
    assert (list(view.ratio), view.frames, view.others) == ([], 3, 0)


@pytest.mark.parametrize("shown", [0, 1, 15])
def test_a_description_of_many_nodes_shows_each_by_its_number(dbc, tmp_path, shown):
    """That of `dahl dbc --nodes 16`: no frame of one stands in the row of another."""
    (path := tmp_path / "all.dbc").write_text(describe(16))
    for view in (View(node=shown), View(node=shown, dbc=path)):
        for node in range(16):
            angle = {"Counter": 1, "Valid": 1, "Count": 10 + node}
            (frame,) = frames(dbc, ("EncoderState", 0.0, angle))
            frame.arbitration_id += node
            view.feed(frame)
        assert view.names.keys() == View().names.keys()
        assert view.names["EncoderState"].last["Count"] == 10 + shown
        assert (view.names["EncoderState"].frames, view.others) == (1, 15)


def test_messages_of_one_node_may_have_its_own_ids_in_the_description(dbc, tmp_path):
    """And others of the bus may be described, whatever their ids."""
    text = re.sub(r"(?<=_ )\d+", lambda one: str(int(one[0]) + 3), dbc.read_text())
    other = 'BO_ 1537 Other: 8 Encoder\n SG_ X : 0|8@1+ (1,0) [0|255] "" FrictionNode\n\n'
    (path := tmp_path / "three.dbc").write_text(text.replace("BO_ 259", other + "BO_ 259", 1))
    view = View(dbc=path)
    assert {0x103, 0x113, 0x601} <= view.seen.keys()


def test_each_curve_has_its_own_axes(dbc):
    """Counts from 5000 to 5900, F/Fc from 0.25 to 0.5, over 0.9 s; only the window is drawn."""
    view, moments = View(window=10), range(-5, 10)
    for n in moments:
        counter = {"Counter": n % 16}
        torque = {"EchoCounter": n % 16, "State": "OK", "TorqueRatio": 0.25 + 0.25 * n / 9}
        for frame in frames(
            dbc,
            ("EncoderState", 100 + n / 10, {**counter, "Valid": 1, "Count": 5000 + 100 * n}),
            ("FrictionTorque", 100 + n / 10, {**counter, **torque}),
        ):
            view.feed(frame)
    lines = text_of(view, 100, 40).splitlines()
    top, low = (n for n, line in enumerate(lines) if "F/Fc over" in line)
    counts, ratio, seconds = (5000, 5900), (0.25, 0.5), (0, 0.9)
    assert "counts" in lines[top] and "counts over s" in lines[low][50:]
    assert axes_hold(lines[top:], counts, ratio)
    assert axes_hold([line[:50] for line in lines[low:]], seconds, ratio)
    assert axes_hold([line[50:] for line in lines[low:]], seconds, counts)


def axes_hold(lines: list[str], *spans: tuple[float, float]) -> bool:
    """Whether the x axis and the y axis of the first panel in these lines hold each span, with even
    ticks, and no more than a tick on either side is empty.
    """
    end = next(n for n, line in enumerate(lines) if "└" in line)
    across = [float(word) for word in lines[end + 1].split()]
    up = [float(line.partition("┤")[0]) for line in lines[:end] if "┤" in line][::-1]
    for ticks, (low, high) in zip((across, up), spans, strict=True):
        steps = np.diff(ticks)
        assert steps == pytest.approx(steps[0]), ticks
        assert float(f"{steps[0]:.6e}"[:8].rstrip("0e")) in (1, 2, 5), ticks
        assert low - steps[0] < ticks[0] <= low and high <= ticks[-1] < high + steps[0], ticks
    return True


@pytest.mark.parametrize("low", [-3.7e5, -1.0, 0.0, 0.123, 7e8])
@pytest.mark.parametrize("span", [0.0, 0.003, 0.3, 99.0, 1e6])
@pytest.mark.parametrize("most", [1, 3, 17])
def test_ticks_are_round_numbers_around_what_there_is(low, span, most):
    ticks = even_ticks(low, low + span, most)
    step = ticks[1] - ticks[0]
    slack = 1e-6 * (step + span) + 1e-9 * abs(low)
    assert ticks[0] <= low + slack and low + span <= ticks[-1] + slack
    assert np.diff(ticks) == pytest.approx(step, rel=1e-3)
    assert 2 <= len(ticks) <= most + 3


def spoiled_run(dbc, view: View) -> View:
    """Some ticks of a node in trouble, all messages, each error seen."""
    errors = ("Format", "Repeated", "Lost", "Sequence", "Crc", "Stale", "Invalid", "Jump")
    status = {"State": "Stale", "Lost": 90, "Corrupt": 34, "OutOfStep": 43, "Timeout": 100}
    status |= {f"Error{name}": 1 for name in errors} | {"VersionMajor": 0, "VersionMinor": 2}
    for n in range(90):
        counter = {"Counter": n % 16}
        torque = {"EchoCounter": n % 16, "State": "Lost", "TorqueRatio": np.sin(n / 9)}
        angle = {"Valid": 1, "Count": -(10**9) + 12345 * n}
        for frame in frames(
            dbc,
            ("EncoderState", n / 1000, counter | angle),
            ("FrictionTorque", n / 1000, counter | torque),
            ("Status", n / 1000, counter | status),
        ):
            view.feed(frame)
    return view


@pytest.mark.parametrize(("width", "height"), [(40, 16), (60, 18), (80, 24), (70, 50), (200, 60)])
@pytest.mark.parametrize("made", [lambda _: View(), lambda dbc: spoiled_run(dbc, View())])
def test_view_fits_small_and_large_terminals(dbc, width, height, made):
    """Counters above all else, and a curve below them."""
    view = made(dbc)
    view.fills_screen = True
    shown = text_of(Screen(view), width, height).rstrip("\n")  # as rich's Live draws it
    lines = shown.splitlines()
    assert max(map(len, lines)) <= width
    assert len(lines) <= height
    first = {name: n for n, line in enumerate(lines) for name in SHOWN if name in line}
    assert first.keys() == SHOWN
    assert first["EncoderState"] < first["node states"] < first["over counts"]
    axes = [line for line in lines if "└" in line]
    assert axes and min(len(line.rstrip()) for line in axes) > 0.9 * min(width, 80)
    assert ("over s" in shown) == (width >= 70)


@pytest.mark.parametrize("made", [lambda _: View(), lambda dbc: spoiled_run(dbc, View())])
def test_the_curve_is_there_from_six_rows_on(dbc, made):
    """That the counters leave it, whole; in fewer none is begun."""
    view = made(dbc)
    view.fills_screen = True
    shown = (text_of(Screen(view), 80, height).splitlines() for height in range(4, 25))
    lines = next(lines for lines in shown if any("over counts" in line for line in lines))
    begin = next(n for n, line in enumerate(lines) if "over counts" in line)
    assert len(lines[begin:]) == 6 and any("└" in line for line in lines[begin:])


def test_a_status_without_errors_fits_80_columns(dbc):
    """All that it says, the timeout too."""
    view = View()
    errors = ("Format", "Repeated", "Lost", "Sequence", "Crc", "Stale", "Invalid", "Jump")
    status = {"Counter": 1, "State": "OK", "Lost": 90, "Corrupt": 34, "OutOfStep": 43}
    status |= {f"Error{name}": 0 for name in errors}
    status |= {"Timeout": 1000, "VersionMajor": 0, "VersionMinor": 2}
    for frame in frames(dbc, ("Status", 0.0, status)):
        view.feed(frame)
    view.fills_screen = True
    shown = text_of(Screen(view), 80, 24)
    assert "OutOfStep 43  Timeout 1000  Version 0.2" in shown and "…" not in shown


SHOWN = {"EncoderState", "FrictionTorque", "Status", "node states", "over counts"}


def test_a_torque_is_in_its_unit_where_fc_is_known(dbc, tmp_path):
    """By the caller, or by a reply of the node itself."""
    assert "F/Fc over counts" in text_of(spoiled_run(dbc, View()))
    view = spoiled_run(dbc, View(Fc=2.0, unit="N"))
    shown = text_of(view)
    assert "F [N] over counts" in shown
    assert f"{2 * np.sin(89 / 9):+.6f} N " in shown
    heard = View()
    reply = {"Counter": 0, "Result": "Done", "Param": "Fc", "Fc": 4.5}
    other = {"Counter": 1, "Result": "Done", "Param": "Sigma0", "Sigma0": 7}
    for frame in frames(dbc, ("ParamReply", 0.0, reply), ("ParamReply", 1.0, other)):
        heard.feed(frame)
    assert heard.Fc == 4.5
    assert "F [N m] over counts" in text_of(heard)


def test_what_is_wrong_has_colour_on_a_terminal(dbc):
    from rich.console import Console

    out = io.StringIO()
    console = Console(width=80, height=24, file=out, force_terminal=True, color_system="standard")
    view = spoiled_run(dbc, View())
    view.names["Status"].missing, view.names["Status"].wrong = 12, 34
    console.print(view)
    yellow, red = (re.findall(rf"\x1b\[{n}m *(.*?) *\x1b", out.getvalue()) for n in (33, 31))
    seen = "seen: Format Repeated Lost Sequence Crc Stale Invalid Jump"
    assert yellow == ["12", "State Lost", "State Stale", seen, "Lost 90"] and red == ["34"]
    assert re.search("\x1b\\[3[68][^m]*m[⠁-⣿]", out.getvalue()), "the curve is coloured"


def test_json_holds_the_same_numbers(dbc):
    known = json.loads(json.dumps(spoiled_run(dbc, View(Fc=2.0)).as_dict()))
    encoder, status = known["messages"]["EncoderState"], known["messages"]["Status"]
    assert (known["frames"], known["other_frames"], known["Fc"]) == (270, 0, 2.0)
    assert known["states"] == {"Lost": 90}
    assert (encoder["frames"], encoder["missing"], encoder["bad"]) == (90, 0, 0)
    assert encoder["per_s"] == pytest.approx(1000)
    assert encoder["last"]["Count"] == -(10**9) + 12345 * 89
    assert (status["last"]["State"], status["last"]["ErrorJump"]) == ("Stale", "Seen")


def test_monitor_prints_json_when_it_is_asked_to(served, dahl_here):
    done = dahl_here("monitor", *served, "--frames", "100", "--json", "--scene", "steering")
    assert (done.returncode, done.stderr) == (0, "")
    known = json.loads(done.stdout)
    assert (known["frames"], known["Fc"]) == (100, 1.8)


def test_monitor_without_a_terminal_prints_one_picture(served, run_dahl):
    done = run_dahl("monitor", *served, "--frames", "500")
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout
    assert done.stdout.count("F/Fc over counts") == 1
    rows = re.findall(
        r"^ *(?:EncoderState|FrictionTorque) +(\d+) +(\d+) +0 +0\s", done.stdout, re.MULTILINE
    )
    assert len(rows) == 2, done.stdout
    rates = [int(rate) for _, rate in rows]
    assert [int(frames) for frames, _ in rows] == pytest.approx([250, 250], abs=20)
    assert all(100 < rate < 2000 for rate in rates)  # 1000, by the clock of a host that may be busy
    assert rates[0] == pytest.approx(rates[1], rel=0.05)


def test_monitor_draws_live_in_a_terminal(served, root):
    """And leaves the whole of what it saw, though the terminal is low."""
    terminal, inner = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "20"}
    command = [sys.executable, "-m", "dahl", "monitor", *served, "--seconds", "2"]
    process = subprocess.Popen(
        command, stdin=inner, stdout=inner, stderr=inner, cwd=root, env=environment
    )
    os.close(inner)
    seen = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # Linux says so when the other end has gone
            break
        if not part:
            break
        seen += part
    assert process.wait(10) == 0
    assert seen.count(b"F/Fc over counts") >= 3
    assert b"\x1b[?1049h" in seen  # the other screen, so that the shell's text comes back
    live, left, after = seen.partition(b"\x1b[?1049l")
    assert left and b"counts over s" in after and b"counts over s" not in live


def test_record_writes_what_canplayer_can_replay(served, dahl_here, tmp_path):
    done = dahl_here("record", *served, "-o", tmp_path / "run.log", "--frames", "400")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"400 frames in {tmp_path / 'run.log'}\n"
    messages = logs.read_candump(tmp_path / "run.log")
    assert len(messages) == 400
    trace = report.trace_of(messages)
    assert trace.missing == 0 and trace.recorded - len(trace.row) in (0, 1)
    assert re.fullmatch(
        r"\(\d{10}\.\d{6}\) vcan0 1[012]0#[0-9A-F]{16}( R)?",
        (tmp_path / "run.log").read_text().splitlines()[0],
    )


def test_ctrl_c_leaves_a_whole_record(served, root, tmp_path):
    command = [sys.executable, "-m", "dahl", "record", *served, "-o", str(tmp_path / "run.log")]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True)
    while not (tmp_path / "run.log").exists() or (tmp_path / "run.log").stat().st_size < 5000:
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(2)
    assert process.wait(10) == 130
    assert (tmp_path / "run.log").read_text().endswith("\n")
    assert logs.read_candump(tmp_path / "run.log")


@pytest.mark.parametrize(
    "ending",
    [
        ".asc",
        *(pytest.param(one, marks=pytest.mark.checks) for one in (".blf", ".LOG", ".mf4", ".trc")),
    ],
)
def test_plot_draws_whatever_record_writes(served, dahl_here, tmp_path, ending):
    log = tmp_path / f"run{ending}"
    done = dahl_here("record", *served, "-o", log, "--frames", "400")
    assert (done.returncode, done.stderr) == (0, "")
    trace = report.trace_of(logs.frames_of(log))
    assert len(trace.row) >= 190
    assert np.diff(trace.time).min() >= 0
    assert np.median(np.diff(trace.time)) == pytest.approx(0.001, abs=0.0005)
    done = dahl_here("plot", log, "--scene", "segments", "-o", tmp_path / "loop.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "loop.png").stat().st_size > 10_000


@contextlib.contextmanager
def sending(channel: str, messages, ready, after=lambda: None):
    """Send frames over python-can's own bus of this process once a client is ready."""
    import can

    def send() -> None:
        with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus:
            wait_until(ready)
            *first, last = messages
            for message in first:
                bus.send(message)
            after()
            bus.send(last)

    sender = threading.Thread(target=send)
    sender.start()
    yield
    sender.join()


def test_a_record_holds_each_frame_as_soon_as_it_has_come(dbc, capsys, tmp_path):
    """Whole lines at any moment: it may be killed at the next."""
    log = tmp_path / "run.log"
    angle = {"Valid": 1, "Count": 5}
    sent = [("EncoderState", 1e9 + n, {**angle, "Counter": n}) for n in range(4)]
    lines = []

    def look() -> None:
        wait_until(lambda: log.read_text().count("\n") == 3)
        lines.append(log.read_text())

    with sending("lines", frames(dbc, *sent), log.exists, look):
        words = ("-i", "virtual", "-c", "lines", "--frames", 4, "-o", log)
        done = caller(capsys)("record", *words)
    assert (done.returncode, done.stdout) == (0, f"4 frames in {log}\n")
    assert log.read_text().startswith(lines[0])
    assert [message.timestamp for message in logs.read_candump(log)] == [1e9 + n for n in range(4)]


@pytest.mark.parametrize(
    ("number", "words", "title"),
    [
        (0, ("--node", 3), "F/Fc"),
        (0, ("--node", 3, "--fc", 1), "F [N m]"),
        (3, ("--scene", "own.ini"), "F [N]"),
        (7, ("--scene", "own.ini", "--node", 3), "F [N]"),
    ],
)
def test_the_monitor_shows_what_its_options_say(dbc, dahl, tmp_path, number, words, title):
    """Node 3 of three, decoded by a DBC of one's own, and no more ticks than the window holds."""
    from can.interfaces.virtual import channels

    measured = "[measured]\nlabel_torque = force [N]\n"
    (tmp_path / "own.ini").write_text(
        f"[friction]\nnode = {number}\nsigma0 = 1\nFc = 1\n{measured}"
    )
    own = dbc.read_text().replace("Count : 16|32@1- (1,0)", "Count : 16|32@1- (2,0)")
    (tmp_path / "own.dbc").write_text(own)
    sent = []
    for tick in range(6):
        torque = {"EchoCounter": tick, "State": "OK", "TorqueRatio": 0.5}
        for node, speed in ((0, 1), (3, 1000), (7, 2)):
            angle = {"Valid": 1, "Count": speed * tick}
            both = (("EncoderState", angle), ("FrictionTorque", torque))
            for frame in frames(dbc, *((one, tick, {"Counter": tick, **s}) for one, s in both)):
                frame.arbitration_id += node
                sent.append(frame)
    bus = ("-i", "virtual", "-c", "nodes", "--window", 2, "--frames", len(sent))
    with sending("nodes", sent, lambda: len(channels["nodes"]) == 2):
        done = dahl("monitor", *bus, *words, "--dbc", "own.dbc")
    assert done.returncode == 0, done.stderr
    assert re.search(r"EncoderState +6 +1 +0 +0\s", done.stdout)
    assert re.search(r"EncoderState .*Count 10000\s", done.stdout)
    assert re.search(r"other frames +24\s", done.stdout)
    assert f" {title} over counts" in done.stdout
    assert axes_hold(done.stdout.splitlines(), (8000, 10000), (0.45, 0.55))


def test_a_record_is_not_overwritten_without_being_told(served, dahl_here, tmp_path):
    log = tmp_path / "run.log"
    log.write_text("mine")
    done = dahl_here("record", *served, "-o", log, "--frames", "10")
    assert (done.returncode, log.read_text()) == (2, "mine")
    assert done.stderr == f"error: {log}: there already; --force overwrites it\n"
    assert dahl_here("record", *served, "-o", log, "--frames", "10", "--force").returncode == 0
    assert len(logs.read_candump(log)) == 10


def test_a_full_disk_is_told_with_the_name_of_the_record(served, dahl_here, tmp_path):
    log = tmp_path / "run.log"
    log.symlink_to("/dev/full")
    done = dahl_here("record", *served, "-o", log, "--frames", "10", "--force")
    assert (done.returncode, done.stderr) == (1, f"error: {log}: No space left on device\n")


@pytest.mark.parametrize("name", ["run.txt", "run", "run.log.gz"])
def test_an_ending_that_plot_cannot_read_is_refused(dahl_here, tmp_path, name):
    done = dahl_here("record", "-i", "virtual", "-c", "x", "-o", tmp_path / name)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert ".asc, .blf, .log, .mf4, .trc was expected" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["record", "monitor"])
def test_a_silent_bus_is_one_line_and_leaves_nothing(dahl_here, tmp_path, command):
    words = ["-o", tmp_path / "run.log"] if command == "record" else []
    done = dahl_here(command, "-i", "virtual", "-c", "quiet", "--seconds", "0.3", *words)
    assert (done.returncode, done.stdout) == (1, "")
    begin = "error: no frame on the bus (interface=virtual channel=quiet) in 0."
    assert done.stderr.startswith(begin) and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("old", ["an old run", ""])
def test_a_silent_bus_takes_nothing_away(dahl_here, tmp_path, old):
    log = tmp_path / "run.log"
    log.write_text(old)
    words = ["-i", "virtual", "-c", "quiet", "--seconds", "0.3", "-o", log, "--force"]
    assert dahl_here("record", *words).returncode == 1
    assert log.read_text() == old


def special_frames() -> list:
    """CAN FD, remote and error frames, which a .trc cannot hold."""
    import can

    kinds = ("is_fd", "is_remote_frame", "is_error_frame")
    return [
        can.Message(timestamp=1e9 + n, arbitration_id=0x100, is_extended_id=False, **{kind: True})
        for n, kind in enumerate(kinds)
    ]


@pytest.mark.parametrize(("ending", "held"), [(".TRC", 2), (".asc", 5)])
def test_frames_that_a_format_cannot_hold_are_not_counted_as_recorded(
    dbc, capsys, tmp_path, ending, held
):
    from can.interfaces.virtual import channels

    angle = ("EncoderState", 1e9 + 5, {"Valid": 1, "Count": 5, "Counter": 1})
    (plain,), log = frames(dbc, angle), tmp_path / f"run{ending}"
    sent = [plain, *special_frames(), plain]
    words = ("-i", "virtual", "-c", "mixed", "--frames", 5, "-o", log)
    with sending("mixed", sent, lambda: len(channels["mixed"]) == 2):
        done = caller(capsys)("record", *words)
    left_out = "3 frames that .trc cannot hold were left out; .blf holds them\n"
    said = f"{held} frames in {log}\n" + left_out * (ending == ".TRC")
    assert (done.returncode, done.stderr, done.stdout) == (0, "", said)
    assert len(list(logs.frames_of(log))) == held


def test_a_trc_that_would_hold_no_frame_takes_nothing_away(capsys, tmp_path):
    """Nor is one begun on a bus that is said to be CAN FD."""
    from can.interfaces.virtual import channels

    (log := tmp_path / "run.TRC").write_text("an old run")
    words = ("-i", "virtual", "-c", "special", "--frames", 3, "-o", log, "--force")
    with sending("special", special_frames(), lambda: len(channels["special"]) == 2):
        done = caller(capsys)("record", *words)
    said = f"error: {log}: 3 frames that .trc cannot hold were left out; .blf holds them\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", said)
    done = caller(capsys)("record", *words, "--fd")
    said = f"error: {log}: .trc holds no CAN FD frames, so it does not go with --fd; .blf does\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)
    assert log.read_text() == "an old run"


def test_record_says_that_it_waits(dahl_here, tmp_path):
    words = ["-i", "virtual", "-c", "quiet", "--seconds", "4", "-o", tmp_path / "run.blf"]
    done = dahl_here("record", *words)
    first, second = done.stderr.splitlines()
    assert first == "no frame so far, still waiting; Ctrl-C ends"
    assert second.startswith("error: no frame on the bus")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", "1"],
            "error: cannot open the bus (interface=socketcand",
        ),
        (["-i", "nothing", "-c", "x"], "error: argument -i/--interface: invalid choice: 'nothing'"),
    ],
)
def test_a_bus_that_is_not_there_is_one_line(capsys, monkeypatch, arguments, words):
    """python-can tries for ten seconds, which pass quickly here."""
    ticks = itertools.count()
    quick = SimpleNamespace(time=lambda: next(ticks), sleep=time.sleep)
    monkeypatch.setattr("can.interfaces.socketcand.socketcand.time", quick)
    done = caller(capsys)("monitor", *arguments)
    assert done.returncode == (2 if "nothing" in arguments else 1)
    assert done.stderr.startswith(words)
    assert done.stderr.count("\n") == 1


def test_no_bus_named_is_one_line(run_dahl, tmp_path):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("CAN_")}
    done = run_dahl("monitor", env={**environment, "HOME": str(tmp_path)})
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("error: which bus? Name it with -i and -c")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ("FrictionTorque", "no signal 'State' in a message 'FrictionTorque'"),
        ("TorqueRatio", "no signal 'TorqueRatio' in a message 'FrictionTorque'"),
        ("Count ", "no signal 'Count' in a message 'EncoderState'"),
    ],
)
def test_a_dbc_without_what_is_shown_is_refused(dbc, tmp_path, changed, words):
    (tmp_path / "other.dbc").write_text(dbc.read_text().replace(changed, "Other "))
    with pytest.raises(Error, match=words):
        View(dbc=tmp_path / "other.dbc")


def test_frames_without_a_counter_are_shown(dbc, tmp_path):
    (tmp_path / "other.dbc").write_text(dbc.read_text().replace(" SG_ Counter", " SG_ Tick"))
    view = View(dbc=tmp_path / "other.dbc")
    signals = {"Counter": 3, "Valid": 1, "Count": 5}
    for frame in frames(dbc, *[("EncoderState", 0.001 * n, signals) for n in range(3)]):
        view.feed(frame)
    assert (view.names["EncoderState"].frames, view.names["EncoderState"].missing) == (3, 0)


def test_a_server_that_goes_away_is_one_line_and_the_file_is_whole(dahl_here, tmp_path):
    """python-can itself would go on asking a dead connection as fast as it can."""
    limits = ("--wait-clients", "1", "--seconds", "0.3")
    with serving(tmp_path / "loop", SCENES / "segments.ini", *limits) as (_, port):
        done = dahl_here("record", *words_of(port), "-o", tmp_path / "run.log")
    assert done.returncode == 1
    assert done.stderr == "error: the bus has gone: its server has closed the connection\n"
    assert len(logs.read_candump(tmp_path / "run.log")) >= 600


def test_the_monitor_shows_a_storm(run_dahl, tmp_path):
    """States of the answers, counters of the node as its Status has them, and what was spoiled."""
    kept = ("--set", "faults.restart=0")  # a restart would clear the sticky errors
    limits = ("--wait-clients", "1", "--virtual", "--seconds", "20", *kept)
    with serving(tmp_path, SCENES / "fault-storm.ini", *limits) as (_, port):
        done = run_dahl("monitor", *words_of(port), "--frames", "30000")
    assert done.returncode == 0, done.stderr
    states = re.search(r"node states +(.*)", done.stdout)[1]
    assert re.match(r"OK \d{4,}, Lost \d{3,}", states), states
    bad = re.search(r"^ *EncoderState +\d+ +\d+ +\d+ +(\d+)\s", done.stdout, re.MULTILINE)
    assert int(bad[1]) > 200
    shown = " ".join(done.stdout.split())
    seen = re.search(r"seen: ([A-Z][a-z]+(?: [A-Z][a-z]+)*)", shown)[1].split()
    assert {"Crc", "Jump", "Lost"} <= set(seen)
    for word in ("Corrupt", "OutOfStep"):
        assert re.search(rf"{word} \d+", shown)
