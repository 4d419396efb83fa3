# SPDX-License-Identifier: MIT
"""`dahl identify --follow`: on a live bus, again and again, until both parameters are known.

tests/python/cli/test_verbs.py has the limits --within and --frames.
"""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import pytest
from dahl import paths
from dahl.identify.follow import is_known
from dahl.identify.result import Parameter
from identify_tools import FC, SIGMA0, complaint
from log_reading import signals
from loop_tools import serving

pytestmark = pytest.mark.usefixtures("library")


@pytest.mark.parametrize(
    ("claimed", "halves", "known"),
    [
        ((True, True), (0.02, 0.01), True),
        ((True, True), (0.021, 0.01), False),
        ((True, True), (0.01, 0.021), False),
        ((True, False), (0.01, 0.01), False),
        ((False, True), (0.01, 0.01), False),
    ],
)
def test_both_parameters_must_be_claimed_and_narrow(claimed, halves, known):
    sigma0, Fc = (Parameter(1.0, 1 - w, 1 + w, True, "noise") for w in halves)  # noqa: N806
    result = SimpleNamespace(claimed=claimed, sigma0=sigma0, Fc=Fc)
    assert is_known(result, 0.0201) is known


def test_following_needs_signals_and_ends_after_its_time(dahl_here, tmp_path):
    silent = ("identify", "--follow", "-i", "virtual", "-c", "silent", "--seconds", "0.3")
    for words, said in ((signals(tmp_path), "0 valid frames"), ((), "--dbc")):
        code, line = complaint(dahl_here(*silent, *words))
        assert code == 2 and said in line


def test_following_a_running_loop(tmp_path, dahl_here):
    """The torque of a node is in Fc, so Fc is 1 and sigma0 is the scene's a.

    Each estimate has a quarter more rows; the last one has the numbers of the JSON.
    """
    guess = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384", "--within", "0.5")
    assert dahl_here("excite", *guess, "--name", "loop", "-o", tmp_path).returncode == 0
    words = ("--angle", "Count", "--angle-unit", "counts", "--counts-per-turn", "16384")
    pace = ("--wait-clients", "1", "--virtual")  # its clock has no gaps, however busy the machine
    with serving(tmp_path / "run", tmp_path / "loop.ini", *pace) as (_, port):
        bus = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", port)
        named = ("--dbc", paths.DBC, *words, "--torque", "TorqueRatio", "--torque-unit", "Nm")
        out = ("--within", "2", "--seconds", "60", "-o", tmp_path / "out", "--name", "live")
        done = dahl_here("identify", "--follow", *bus, *named, *out)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "live.json").read_text())
    looks = [line.split(" rows: ", 1) for line in done.stderr.splitlines()]
    rows = [int(row) for row, _ in looks]
    assert rows[0] == 500 and rows[1:] == [int(row * 1.25) for row in rows[:-1]]
    assert found["logs"] == ["bus"] and found["rows"] == rows[-1] < 30_000
    assert looks[-1][1].endswith(found["verdict"])
    widths = [float(width) for width in re.findall(r"within (\S+) %", looks[-1][1])][:2]
    for name, truth, width in zip(("sigma0", "Fc"), (SIGMA0 / FC, 1), widths, strict=True):
        low, high = found["ci95"][name]
        assert found["identifiable"][name] and found[name] == pytest.approx(truth, rel=0.005)
        assert f"{name} {found[name]:.5g} (" in looks[-1][1]
        assert width == pytest.approx(50 * (high - low) / found[name], rel=0.05) and width <= 2
