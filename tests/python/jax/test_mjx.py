# SPDX-License-Identifier: MIT
"""The example of MJX: 1000 joints under half of Fc hold with dahl.jax and creep otherwise."""

import re
import sys
from pathlib import Path

import pytest
from programs import run


def test_a_thousand_joints_hold_and_those_of_frictionloss_creep(root: Path) -> None:
    pytest.importorskip("mujoco.mjx", reason="unproven: examples/mjx: mujoco-mjx is missing")
    printed = run(sys.executable, root / "examples/mjx/hold_many.py")
    rows = re.findall(r"(\S+): (\d+) of (\d+) joints hold, drift (\S+) rad", printed)
    assert [row[:3] for row in rows] == [
        ("dahl.jax", "1000", "1000"),
        ("frictionloss", "0", "1000"),
    ]
    assert float(rows[0][3]) < 1e-7 and float(rows[1][3]) > 0.1
