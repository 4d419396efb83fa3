# SPDX-License-Identifier: MIT
"""Scenes of every friction model: dahl-loop answers with the bits of a dahl.Node of the scene, and
sends the load that the friction follows.
"""

from pathlib import Path

import cantools
import numpy as np
import pytest
from dahl.binding import models
from loop_tools import Logged, check_node, read_log, run
from model_examples import THETA, keys

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
