# SPDX-License-Identifier: MIT
"""Scenes of every friction model: each answer on the bus against the equation of the model in
64-bit floats, and the summary of a demo.
"""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from dahl.binding import models
from loop_model import Q30_BOUND, travel_per_count
from loop_tools import Logged, counts_of, read_log, run, setting, torques_of

THETA = 3.8e-4
STEERING = """[motion]
kind = steering
amplitude = 900
sweep_s = 0.7
hold_s = 0.1
tremor = 20
tremor_s = 0.05
seconds = 3
"""


def toward(end: float, w: float, travel: float) -> float:
    """Dahl: the distance to the end decays with the travel."""
    return end - (end - w) * np.exp(-travel)


def dahl(moves: np.ndarray, a: float) -> Iterator[float]:
    w = 0.0
    for move in moves:
        w = toward(np.sign(move), w, a * abs(move)) if move else w
        yield w


def slip(moves: np.ndarray, a: float) -> Iterator[float]:
    w = 0.0
    for move in moves:
        w = min(1.0, max(-1.0, w + a * move))
        yield w


def asymmetric(moves: np.ndarray, forward: float, backward: float) -> Iterator[float]:
    """In parts of the larger Fc."""
    forward, backward = (float(np.float32(end)) for end in (forward, backward))
    most, f = max(forward, backward), 0.0
    for move in moves:
        end = forward if move > 0 else -backward
        f = toward(end, f, travel_per_count(100, abs(end), THETA) * abs(move)) if move else f
        yield f / most


def spring_then_dahl(moves: np.ndarray, a: float, breakaway: float) -> Iterator[float]:
    """A spring up to breakaway, and beyond it what is left falls off the quicker."""
    w = 0.0
    for move in moves:
        side, u = np.sign(move), a * abs(move)
        elastic = max(0.0, min(u, breakaway - side * w))
        rest = (u - elastic) / (1 - breakaway)
        w = side * toward(1, side * w + elastic, rest) if move else w
        yield w


def mixed(moves: np.ndarray, *parts: tuple[Callable, float, float]) -> np.ndarray:
    """Parallel elements (kind, sigma0, Fc), in parts of the sum of Fc."""
    limits = [float(np.float32(Fc)) for *_, Fc in parts]
    ratios = [[*of(moves, travel_per_count(sigma0, Fc, THETA))] for of, sigma0, Fc in parts]
    return np.array(limits) @ np.array(ratios) / sum(limits)


BREAKAWAY = models.with_key("breakaway").name
B = float(np.float32(0.6))
RATIOS = {
    "dahl": lambda moves: mixed(moves, (dahl, 100, 0.7)),
    "slip": lambda moves: mixed(moves, (slip, 100, 0.2), (slip, 30, 0.7)),
    "parallel": lambda m: mixed(m, (dahl, 100, 0.2), (slip, 30, 0.7), (dahl, 50, 0.05)),
    "asymmetric": lambda m: np.array([*asymmetric(m, 0.2, 0.7)]),
    BREAKAWAY: lambda m: np.array([*spring_then_dahl(m, travel_per_count(100, 0.7, THETA), B)]),
}
KEYS = {
    "dahl": "sigma0 = 100\nFc = 0.7",
    "slip": "sigma0 = 100 30\nFc = 0.2 0.7",
    "parallel": "kinds = dahl slip dahl\nsigma0 = 100 30 50\nFc = 0.2 0.7 0.05",
    "asymmetric": "sigma0 = 100\nFc = 0.2 0.7",
    BREAKAWAY: "sigma0 = 100\nFc = 0.7\nbreakaway = 0.6",
}


def scene(folder: Path, model: str, *parts: str) -> Path:
    path = folder / "model.ini"
    head = f"[friction]\nmodel = {model}\n{KEYS[model]}\ntheta_per_count = {THETA}\n"
    path.write_text(head + "".join(parts or (STEERING,)))
    return path


def q30(log: list[Logged]) -> np.ndarray:
    return np.array([ratio for _, ratio in torques_of(log)]) / 2**30


EXACT = [(model, (), ratios) for model, ratios in RATIOS.items()]
FORWARD = setting("friction.Fc=0.7 0.2")  # the larger one
EXACT += [("asymmetric", FORWARD, lambda m: np.array([*asymmetric(m, 0.7, 0.2)]))]


@pytest.mark.parametrize(("model", "sets", "ratios"), EXACT)
def test_every_model_is_exact_over_the_bus(tmp_path, model, sets, ratios):
    result = run(tmp_path, scene(tmp_path, model), "--virtual", *sets)
    assert (result.code, result.err) == (0, "")
    log = read_log(result.log)
    moves = np.diff(counts_of(log), prepend=0)
    answers = q30(log)
    assert len(answers) == 3000 and np.ptp(answers) > 1
    assert np.abs(answers - ratios(moves)).max() < 2 * Q30_BOUND


SUMMARIES = {  # elements and kinds in the summary of a demo
    "slip": ([[100, 0.2], [30, 0.7]], None),
    "parallel": ([[100, 0.2], [30, 0.7], [50, 0.05]], ["dahl", "slip", "dahl"]),
    BREAKAWAY: ([[100, 0.7]], None),
}


@pytest.mark.parametrize("model", SUMMARIES)
@pytest.mark.usefixtures("library", "dahl_loop")
def test_the_summary_of_a_demo_has_model_and_error(tmp_path, dahl_here, model):
    path = scene(tmp_path, model)
    words = ("--scene", path, "--seconds", 0.3, "--bus", "socketcand", "--output", tmp_path / "out")
    done = dahl_here("demo", *words)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    elements, kinds = SUMMARIES[model]
    assert (told["model"], told.get("kinds")) == (model, kinds)
    assert np.allclose([[e["sigma0"], e["Fc"]] for e in told["elements"]], elements)
    assert 0 < told["max_error_ulp_Fc"] <= 0.55


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

KEYS["loaded"] = "sigma0 = 100\nFc = 0.7"


def loaded(moves: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Fc and sigma0 in proportion to the load. F stays if the load grows, F/(c Fc) if it falls."""
    ratios, w, before, a = [], 0.0, 0.0, travel_per_count(100, 0.7, THETA)
    for move, load in zip(moves, loads, strict=True):
        w = w * before / load if load > before else w
        w = toward(np.sign(move), w, a * abs(move)) if move else w
        ratios.append(w * load)
        before = load
    return np.array(ratios)


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


def check_loaded(log: list[Logged], loads: np.ndarray) -> None:
    moves = np.diff(counts_of(log), prepend=counts_of(log)[0])
    assert np.abs(q30(log) - loaded(moves, loads / 65536)).max() < 2 * Q30_BOUND
    assert np.abs(q30(log) - loaded(moves, np.ones(len(moves)))).max() > 1e-3


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
        check_loaded(log, force)
        told = np.diff(force, prepend=65536) != 0
        told[999::1000] = True
        assert writes == force[told].tolist()


def test_friction_follows_the_torque_of_the_motor(tmp_path, dbc):
    """Also the friction of the shaft itself."""
    load, shaft = (
        "[load]\nfull = 4\nrest = 0.25\n",
        "[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = 0.7\n",
    )
    motor = "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n"
    path = scene(tmp_path, "loaded", load, shaft, motor)
    result = run(tmp_path, path, "--virtual", "--trace", tmp_path / "trace.csv")
    assert (result.code, result.err) == (0, "")
    log = read_log(result.log)
    force, _ = loads_of(log, dbc)
    check_loaded(log, force)
    table = np.loadtxt(tmp_path / "trace.csv", delimiter=",", skiprows=1, usecols=(4, 5))
    motor_torque, friction = table.T
    carried = 0.25 + np.abs(motor_torque) / 4
    assert np.abs(force / 65536 - carried).max() <= 0.5 / 65536 + 1e-9
    assert np.abs(friction[1:]).max() < 0.7 * 0.76
    assert (np.abs(friction[2:]) <= 0.7 * (carried[1:-1] + 1 / 65536)).all()
    assert (np.abs(friction) > 0.7 * 0.7).any()
