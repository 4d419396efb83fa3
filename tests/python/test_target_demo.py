# SPDX-License-Identifier: MIT
"""tools/demo.sh --target m4f: the main job with the torque from firmware on an emulated core."""

from __future__ import annotations

import json
import shutil

import pytest

pytestmark = pytest.mark.checks


def need_tools() -> None:
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            pytest.skip(
                f"{program} is not installed (tools/setup.sh installs it where Debian has it)"
            )


def test_demo_on_target(run_dahl, library, dahl_loop, tmp_path) -> None:
    """Each angle is answered, exactly, however slow this machine emulates: the encoder waits."""
    need_tools()
    done = run_dahl(
        "demo", "--scene", "steering", "--seconds", "4", "--target", "m4f", "--output", tmp_path
    )
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert numbers["target"] == "m4f" and numbers["ticks"] == 4000
    assert (numbers["frames_answered"], numbers["frames_lost"]) == (4000, 0)
    assert numbers["node"] == {} and numbers["max_error_ulp_Fc"] <= 0.52
    assert (tmp_path / "loop.png").stat().st_size > 10000
