# SPDX-License-Identifier: MIT
"""Scenes of every friction model: each answer on the bus against the exact torque of the model, and
the summary of a demo.
"""

from __future__ import annotations

import json
import os
import re
import signal
import threading
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from dahl.binding import models
from dahl.sim.reference import EXACT
from dahl.sim.scene import read
from loop_model import Q30_BOUND
from loop_tools import Logged, counts_of, read_log, run, setting, torques_of
from model_examples import FC, OWN, THETA, keys, numbers

STEERING = """[motion]
kind = steering
amplitude = 900
sweep_s = 0.7
hold_s = 0.1
tremor = 20
tremor_s = 0.05
seconds = 3
"""


TABLE = models.table()
RATIOS = [name for name in TABLE if name != "loaded"]  # models whose torque needs no load


def scene(folder: Path, model: str, *parts: str) -> Path:
    path = folder / "model.ini"
    head = f"[friction]\n{keys(TABLE[model])}theta_per_count = {THETA}\n"
    path.write_text(head + "".join(parts or (STEERING,)))
    return path


def q30(log: list[Logged]) -> np.ndarray:
    return np.array([ratio for _, ratio in torques_of(log)]) / 2**30


FORWARD = setting("friction.Fc=0.7 0.2")  # the larger one
CASES = [(name, (), "") for name in RATIOS]
CASES += [(name, FORWARD, "Fc = 0.7 0.2") for name in RATIOS if TABLE[name].has_directions]


@pytest.mark.parametrize(("model", "sets", "line"), CASES)
def test_every_model_is_exact_over_the_bus(tmp_path, model, sets, line):
    path = scene(tmp_path, model)
    result = run(tmp_path, path, "--virtual", *sets)
    assert (result.code, result.err) == (0, "")
    log = read_log(result.log)
    if line:
        path.write_text(re.sub(r"^Fc = .*$", line, path.read_text(), flags=re.MULTILINE))
    moves = np.diff(counts_of(log), prepend=0)
    answers, exact = q30(log), EXACT[model](read(path), moves, ())
    assert len(answers) == 3000 and np.ptp(answers) > 1
    assert np.abs(answers - np.array(exact, float)).max() < 2 * Q30_BOUND


@pytest.mark.parametrize("model", RATIOS)
@pytest.mark.usefixtures("library", "dahl_loop")
def test_the_summary_of_a_demo_has_model_and_error(tmp_path, dahl_here, model):
    path = scene(tmp_path, model)
    words = ("--scene", path, "--seconds", 0.3, "--bus", "socketcand", "--output", tmp_path / "out")
    done = dahl_here("demo", *words)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    sigma0, torques = numbers(TABLE[model])
    kinds = OWN["kinds"] if TABLE[model].key == "kinds" else None
    assert (summary["model"], summary.get("kinds")) == (model, kinds)
    if not TABLE[model].has_directions:
        elements = [[one["sigma0"], one["Fc"]] for one in summary["elements"]]
        assert np.allclose(elements, np.transpose([sigma0, torques]))
    assert 0 < summary["max_error_ulp_Fc"] <= 0.55


@pytest.mark.parametrize("key", ["gain = 0.9", "limit = 0.9", "ramp_ms = 100"])
@pytest.mark.usefixtures("library", "dahl_loop")
def test_a_demo_does_not_compare_a_scaled_torque(tmp_path, dahl_here, key):
    path = scene(tmp_path, "dahl", f"{key}\n", STEERING)
    words = ("--scene", path, "--seconds", 0.2, "--bus", "socketcand", "--output", tmp_path / "out")
    done = dahl_here("demo", *words)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["max_error_ulp_Fc"] is None


def ask_node(channel: str, angles: list[Logged], answers: list[bytes]) -> None:
    """Send these angles to a node after its first Status; collect its answers."""
    with can.Bus(interface="virtual", channel=channel) as bus:
        while (message := bus.recv(5)) is not None and message.arbitration_id != 0x120:
            pass
        for angle in angles:
            bus.send(can.Message(arbitration_id=0x100, data=angle.data, is_extended_id=False))
            while (message := bus.recv(5)) is not None and message.arbitration_id != 0x110:
                pass
            answers.append(b"" if message is None else bytes(message.data))


def ask_node_and_end_it(*words: object) -> None:
    """The same, then Ctrl-C for the node if it still runs."""
    ask_node(*words)
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("model", RATIOS)
@pytest.mark.usefixtures("library")
def test_the_command_node_gives_the_bits_of_dahl_loop(tmp_path, dahl_here, model):
    path = scene(tmp_path, model, "timeout_ms = 60000\n", STEERING)
    log = read_log(run(tmp_path, path, "--virtual", "--seconds", "0.4").log)
    angles, answers = [frame for frame in log if frame.id == 0x100], []
    client = threading.Thread(target=ask_node_and_end_it, args=(model, angles, answers))
    client.start()
    done = dahl_here("node", "--scene", path, "-i", "virtual", "-c", model, "--seconds", 30)
    client.join()
    assert done.returncode == 0, done.stderr
    assert len(set(answers)) > 100
    assert answers == [frame.data for frame in log if frame.id == 0x110]


# --- a load ---------------------------------------------------------------------------------------


def loads_of(log: list[Logged], dbc: Path) -> tuple[np.ndarray, list[int]]:
    """Raw parameter Load at each answer, and of each ParamWrite; each write is accepted."""
    kinds = cantools.database.load_file(dbc)
    force, writes, at_answers = 65536, [], []
    for frame in log:
        if frame.id == 0x130:
            line = kinds.decode_message("ParamWrite", frame.data, scaling=False)
            assert line["Counter"] == len(writes) % 16
            force = line["Load"]
            writes.append(force)
        elif frame.id == 0x140:
            line = kinds.decode_message("ParamReply", frame.data, scaling=False)
            assert (str(line["Result"]), line["Load"]) == ("Done", force)
        elif frame.id == 0x110:
            at_answers.append(force)
    return np.array(at_answers), writes


def check_loaded(log: list[Logged], loads: np.ndarray, path: Path) -> None:
    moves = np.diff(counts_of(log), prepend=counts_of(log)[0])
    for given, is_exact in ((loads, True), (np.full_like(loads, 65536), False)):
        shares = [Fraction(int(load), 65536) for load in given]
        exact = np.array(EXACT["loaded"](read(path), moves, shares), float)
        error = np.abs(q30(log) - exact).max()
        assert error < 2 * Q30_BOUND if is_exact else error > 1e-3


def test_friction_follows_a_load_of_the_log(tmp_path, dbc):
    """Its size counts, clamped to 1. It is sent when it changes and once a second, to each of two
    nodes.
    """
    ticks = np.arange(1500)
    load = 3 + 5 * np.cos(ticks / 91)
    load[900:] = 0
    angle = np.round(400 * np.sin(ticks / 57))
    rows = [f"{a:.0f},{c:.9f}" for a, c in zip(angle, load, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["angle,carried", *rows]) + "\n")
    replay = "[motion]\nkind = log\nfile = log.csv\nangle = angle\ncounts_per_unit = 1\n"
    path = scene(tmp_path, "loaded", "[load]\ncolumn = carried\nfull = 5\nrest = 0.125\n", replay)
    result = run(tmp_path, path, "--virtual", "--nodes", "2")
    assert (result.code, result.err) == (0, "")
    share = np.minimum(1, 0.125 + np.abs(load) / 5)
    for number in (0, 1):
        log = [replace(f, id=f.id & ~15) for f in read_log(result.log) if f.id & 15 == number]
        force, writes = loads_of(log, dbc)
        assert np.abs(force / 65536 - share).max() <= 0.5 / 65536 + 1e-9
        check_loaded(log, force, path)
        told = np.diff(force, prepend=65536) != 0
        told[999::1000] = True
        assert writes == force[told].tolist()


def test_friction_follows_the_torque_of_the_motor(tmp_path, dbc):
    """Also the friction of the shaft itself."""
    load, shaft = (
        "[load]\nfull = 4\nrest = 0.25\n",
        f"[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = {FC[0]}\n",
    )
    motor = "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n"
    path = scene(tmp_path, "loaded", load, shaft, motor)
    result = run(tmp_path, path, "--virtual", "--trace", tmp_path / "trace.csv")
    assert (result.code, result.err) == (0, "")
    log = read_log(result.log)
    force, _ = loads_of(log, dbc)
    check_loaded(log, force, path)
    table = np.loadtxt(tmp_path / "trace.csv", delimiter=",", skiprows=1, usecols=(4, 5))
    motor_torque, friction = table.T
    carried = 0.25 + np.abs(motor_torque) / 4
    assert np.abs(force / 65536 - carried).max() <= 0.5 / 65536 + 1e-9
    assert np.abs(friction[1:]).max() < FC[0] * 0.76
    assert (np.abs(friction[2:]) <= FC[0] * (carried[1:-1] + 1 / 65536)).all()
    assert (np.abs(friction) > FC[0] * 0.7).any()
