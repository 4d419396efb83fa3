# SPDX-License-Identifier: MIT
"""Instructions of absent parts, counted by callgrind in the files of each part."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from conftest import need
from loop_tools import SCENES, program

pytestmark = pytest.mark.checks

PARTS = {
    "faults": {"faults.c"},
    "rotor": {"rotor.c", "plant.c"},
    "bitrate": {"frame_bits.c"},
}
ABSENT = set.union(*PARTS.values())


def instructions(folder: Path, scene: str, *options: str, seconds: str = "0.5") -> Counter:
    need("valgrind", "an absent part costs no instruction")
    folder.mkdir(exist_ok=True)
    out = folder / "callgrind.out"
    words = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", program()]
    words += ["--scene", str(SCENES / scene), "--virtual", "--seconds", seconds, *options]
    subprocess.run(words, capture_output=True, timeout=250, check=True)
    words = ["callgrind_annotate", "--threshold=100", "--show-percs=no", out]
    table = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found: Counter = Counter()
    for cost, name in re.findall(r"^\s*([\d,]+) +(\S+\.[ch]):\S+ \[", table, re.MULTILINE):
        found[Path(name).name] += int(cost.replace(",", ""))
    return found


def test_an_absent_part_costs_no_instruction(tmp_path):
    """Neither at the start nor in a tick. Node and encoder are there as a check."""
    seen = instructions(tmp_path, "steering.ini")
    assert seen["node.c"] > 500 * 20
    assert seen["encoder_node.c"] > 500 * 20
    assert {name: seen[name] for name in ABSENT if seen[name]} == {}


@pytest.mark.parametrize(
    ("part", "scene", "options"),
    [
        ("faults", "fault-storm.ini", ()),
        ("rotor", "creep.ini", ()),
        ("bitrate", "steering.ini", ("--bitrate", "500000")),
    ],
)
def test_a_part_costs_instructions_in_its_own_files_only(tmp_path, part, scene, options):
    seen = instructions(tmp_path, scene, *options)
    assert all(seen[name] > 500 for name in PARTS[part]), seen
    assert {name: seen[name] for name in ABSENT - PARTS[part] if seen[name]} == {}


def test_instructions_grow_linearly_with_ticks(tmp_path):
    half, whole, double = (
        sum(instructions(tmp_path / s, "steering.ini", seconds=s).values())
        for s in ("0.5", "1", "2")
    )
    assert (double - whole) / (2 * (whole - half)) == pytest.approx(1, abs=0.1)
