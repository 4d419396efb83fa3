# SPDX-License-Identifier: MIT
"""tools/demo.sh --target m4f: the main job with the torque from firmware on an emulated core."""

from __future__ import annotations

import json

import pytest
from conftest import need

pytestmark = pytest.mark.checks


@pytest.fixture(autouse=True)
def tools() -> None:
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        need(program, "the demo runs with firmware on an emulated core")


def test_demo_on_target(run_dahl, library, dahl_loop, tmp_path) -> None:
    """Each angle is answered, exactly, however slow this machine emulates: the encoder waits."""
    done = run_dahl(
        "demo", "--scene", "steering", "--seconds", "4", "--target", "m4f", "--output", tmp_path
    )
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert numbers["target"] == "m4f" and numbers["ticks"] == 4000
    assert (numbers["frames_answered"], numbers["frames_lost"]) == (4000, 0)
    assert numbers["node"] == {} and numbers["max_error_ulp_Fc"] <= 0.52
    assert (tmp_path / "loop.png").stat().st_size > 10000


@pytest.mark.parametrize("number", [3, 15])
def test_the_firmware_has_the_number_of_the_scenes_node(
    run_dahl, root, library, dahl_loop, tmp_path, number
) -> None:
    """Also where it is that which else serves the bus."""
    text = (root / "host_sim" / "scenes" / "segments.ini").read_text()
    (path := tmp_path / "own.ini").write_text(
        text.replace("[friction]", f"[friction]\nnode = {number}")
    )
    words = ("--scene", path, "--seconds", "0.3", "--target", "m4f", "--output", tmp_path / "run")
    done = run_dahl("demo", *words)
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (numbers["frames_answered"], numbers["frames_lost"]) == (300, 0)
