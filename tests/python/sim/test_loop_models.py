# SPDX-License-Identifier: MIT
"""Scenes of every friction model: dahl-loop answers with the bits of a dahl.Node of the same scene,
and so does `dahl node`. The summary of a demo.
"""

from __future__ import annotations

import json
import os
import signal
import threading
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from dahl.binding import models
from loop_tools import Logged, check_node, read_log, run
from model_examples import FC, OWN, THETA, keys, numbers

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

STEERING = """[motion]
kind = steering
amplitude = 900
sweep_s = 0.7
hold_s = 0.1
tremor = 20
tremor_s = 0.05
seconds = 3
"""

SETTINGS = "gain = 0.91\nlimit = 0.85\nramp_ms = 300\nmax_step = 5000\n"
STATUS = "[status]\nperiod_ms = 70\n"
TABLE = models.table()
RATIOS = [name for name in TABLE if name != "loaded"]  # models whose torque needs no load


def scene(folder: Path, model: str, *parts: str) -> Path:
    path = folder / "model.ini"
    head = f"[friction]\n{keys(TABLE[model])}theta_per_count = {THETA}\n"
    path.write_text(head + "".join(parts or (STEERING,)))
    return path


@pytest.mark.parametrize("model", RATIOS)
def test_every_model_has_the_bits_of_its_node(tmp_path, model):
    path = scene(tmp_path, model, SETTINGS, STEERING, STATUS)
    result = run(tmp_path, path, "--virtual")
    assert (result.code, result.err) == (0, "")
    assert len({data for _, data in check_node(result, path)}) > 200


@pytest.mark.parametrize(
    ("model", "key"), [("slip", ""), ("parallel", ""), ("dahl", "ramp_ms = 100\n")]
)
def test_the_summary_of_a_demo_has_model_and_error(tmp_path, dahl_here, model, key):
    """A scaled torque is not compared."""
    path = scene(tmp_path, model, key, STEERING)
    words = ("--scene", path, "--seconds", 0.2, "--bus", "socketcand", "--output", tmp_path / "out")
    done = dahl_here("demo", *words)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    kinds = OWN["kinds"] if TABLE[model].key == "kinds" else None
    assert (summary["model"], summary.get("kinds")) == (model, kinds)
    elements = [[one["sigma0"], one["Fc"]] for one in summary["elements"]]
    assert np.allclose(elements, np.transpose(numbers(TABLE[model])))
    error = summary["max_error_ulp_Fc"]
    assert error is None if key else 0 < error <= 0.55


def ask_and_end(channel: str, angles: list[Logged], answers: list[bytes]) -> None:
    with can.Bus(interface="virtual", channel=channel) as bus:
        while bus.recv(20).arbitration_id != 0x120:
            pass
        for angle in angles:
            bus.send(can.Message(arbitration_id=0x100, data=angle.data, is_extended_id=False))
            while (message := bus.recv(20)).arbitration_id != 0x110:
                pass
            answers.append(bytes(message.data))
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("model", RATIOS)
def test_the_command_node_gives_the_bits_of_dahl_loop(tmp_path, dahl_here, model):
    path = scene(tmp_path, model, "timeout_ms = 60000\n", STEERING)
    log = read_log(run(tmp_path, path, "--virtual", "--seconds", "0.4").log)
    angles, answers = [frame for frame in log if frame.id == 0x100], []
    client = threading.Thread(target=ask_and_end, args=(model, angles, answers))
    client.start()
    done = dahl_here("node", "--scene", path, "-i", "virtual", "-c", model)
    client.join()
    assert done.returncode == 0, done.stderr
    assert answers == [frame.data for frame in log if frame.id == 0x110]


# --- a load ---------------------------------------------------------------------------------------


def writes_of(log: list[Logged], dbc: Path, number: int = 0) -> dict[int, int]:
    """Raw parameter Load of each ParamWrite, by the number of ticks before it."""
    kinds, writes, ticks = cantools.database.load_file(dbc), {}, 0
    for frame in log:
        ticks += frame.id == 0x100 | number
        if frame.id == 0x130 | number:
            line = kinds.decode_message("ParamWrite", frame.data, scaling=False)
            assert (line["Counter"], str(line["Param"])) == (len(writes) % 16, "Load")
            writes[ticks] = line["Load"]
    return writes


def check_writes(log: list[Logged], dbc: Path, share: np.ndarray, number: int = 0) -> None:
    """The load is sent in the tick in which it changes, and once a second."""
    raw = np.floor(share * 65536 + 0.5).astype(int)
    changed = np.diff(raw, prepend=65536) != 0
    changed[999::1000] = True
    assert writes_of(log, dbc, number) == {int(k): int(raw[k]) for k in np.flatnonzero(changed)}


def test_friction_follows_a_load_of_the_log(tmp_path, dbc):
    ticks = np.arange(1500)
    load = 3 + 5 * np.cos(ticks / 91)
    load[900:] = 0
    angle = np.round(400 * np.sin(ticks / 57))
    rows = [f"{a:.0f},{c:.9f}" for a, c in zip(angle, load, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["angle,carried", *rows]) + "\n")
    replay = "[motion]\nkind = log\nfile = log.csv\nangle = angle\ncounts_per_unit = 1\n"
    path = scene(tmp_path, "loaded", "[load]\ncolumn = carried\nfull = 5\nrest = 0.125\n", replay)
    result = run(tmp_path, path, "--virtual")
    assert (result.code, result.err) == (0, "")
    share = np.minimum(1, 0.125 + np.abs(load) / 5)
    check_writes(read_log(result.log), dbc, share)
    assert len({data for _, data in check_node(result, path)}) > 1000
    both = read_log(run(tmp_path / "two", path, "--virtual", "--nodes", "2").log)
    for number in (0, 1):
        check_writes(both, dbc, share, number)


def test_friction_follows_the_torque_of_the_motor(tmp_path, dbc):
    shaft = f"[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = {FC[0]}\n"
    motor = "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n"
    load = "[load]\nfull = 4\nrest = 0.25\n"
    path = scene(tmp_path, "loaded", SETTINGS, load, shaft, motor, STATUS)
    result = run(tmp_path, path, "--virtual", "--trace", tmp_path / "trace.csv")
    assert (result.code, result.err) == (0, "")
    table = np.loadtxt(tmp_path / "trace.csv", delimiter=",", skiprows=1, usecols=(4, 5))
    motor_torque, friction = table.T
    carried = 0.25 + np.abs(motor_torque) / 4
    check_writes(read_log(result.log), dbc, carried)
    check_node(result, path)
    assert (np.abs(friction[2:]) <= FC[0] * (carried[1:-1] + 1 / 65536)).all()
    assert (np.abs(friction) > FC[0] * 0.7).any()
