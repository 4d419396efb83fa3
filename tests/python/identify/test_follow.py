# SPDX-License-Identifier: MIT
"""`dahl identify --follow`: on a live bus, again and again, until both parameters are known.

tests/python/cli/test_verbs.py has the limits --within and --frames.
"""

import json
import re
from types import SimpleNamespace

import can
import log_writers
import numpy as np
import pytest
from dahl import Error, paths
from dahl.identify import Log, Source, follow
from dahl.identify.result import Parameter
from identify_tools import FC, SIGMA0, complaint
from log_reading import signals
from loop_tools import serving

LOOKS = [  # rows of each estimate; which parameters it claims, and their half widths
    (500, None, None),  # no estimate yet
    (625, (True, False), (0.01, 0.01)),
    (781, (False, True), (0.01, 0.01)),
    (976, (True, True), (0.021, 0.01)),
    (1220, (True, True), (0.01, 0.021)),
    (1525, (True, True), (0.02, 0.01)),
]
LAST = (1000, (False, False), (1.0, 1.0))


@pytest.mark.parametrize(("rows", "looks"), [(2000, LOOKS), (1000, [*LOOKS[:4], LAST])])
def test_estimates_are_shown_until_both_parameters_are_claimed_and_narrow(
    rows, looks, tmp_path, monkeypatch
):
    """Each has a quarter more rows. If the frames end before, the result has all of them."""
    log_writers.frames(tmp_path / "x.log", *(np.arange(rows) * step for step in (1e-3, 1, 1)))
    (tmp_path / "bus.dbc").write_text(log_writers.DBC)
    expected, shown = iter(looks), []

    def identify(logs: list[Log], options: object) -> SimpleNamespace:
        (log,), (rows, claimed, halves) = logs, next(expected)
        assert (log.name, log.rows, options) == ("bus", rows, "options")
        if claimed is None:
            raise Error("at rest")
        sigma0, Fc = (Parameter(1.0, 1 - w, 1 + w, True, "noise") for w in halves)  # noqa: N806
        return SimpleNamespace(claimed=claimed, sigma0=sigma0, Fc=Fc, verdict=f"of {rows}")

    monkeypatch.setattr(follow, "identify", identify)
    source = Source("Angle", "Torque", dbc=tmp_path / "bus.dbc")
    with can.LogReader(tmp_path / "x.log") as frames:
        result = follow.follow(frames, source, "options", 0.0201, lambda *one: shown.append(one))
    assert shown[0] == (500, None, "at rest") and result.verdict == f"of {looks[-1][0]}"
    for (row, found, why), (wanted, *_) in zip(shown[1:], LOOKS[1:], strict=False):
        assert row == wanted and found.verdict == why == f"of {wanted}"
    assert len(shown) == len([look for look in looks if look is not LAST])


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
