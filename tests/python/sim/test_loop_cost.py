# SPDX-License-Identifier: MIT
"""Instructions of absent parts, counted by callgrind in the files of each part."""

from __future__ import annotations

import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from loop_tools import SCENES, program

pytestmark = pytest.mark.checks

PARTS = {
    "faults": {"faults.c"},
    "rotor": {"rotor.c", "plant.c"},
    "bitrate": {"frame_bits.c"},
}
ABSENT = set.union(*PARTS.values())


def instructions(folder: Path, scene: str, *options: str, seconds: str = "0.5") -> Counter:
    """Instructions by source file, of a run in virtual time."""
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed (tools/setup.sh installs it where it can)")
    folder.mkdir(exist_ok=True)
    out = folder / "callgrind.out"
    words = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", program()]
    words += ["--scene", str(SCENES / scene), "--virtual", "--seconds", seconds, *options]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return by_file(out.read_text().splitlines())


def by_file(lines: list[str]) -> Counter:
    """Self cost by file: `fl=`, `fi=`, `fe=` set the file; the line after `calls=` is the callee's.

    A name is written once, as `(id) name`, and then as `(id)`; `cfi=` and `cfl=` share the ids.
    """
    names: dict[str, str] = {}
    found: Counter = Counter()
    here, inclusive = "", False
    for line in lines:
        key, _, value = line.partition("=")
        if key in {"fl", "fi", "fe", "cfi", "cfl"}:
            number, _, name = value.partition(" ")
            names.setdefault(number, Path(name).name)
            here = here if key[0] == "c" else names[number]
        elif key == "calls":
            inclusive = True
        elif line[:1] in "0123456789+-*" and line:
            found[here] += 0 if inclusive else int(line.split()[1])
            inclusive = False
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
