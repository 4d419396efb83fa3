# SPDX-License-Identifier: MIT
"""The README's page from bench to firmware works as typed, and its numbers are the command's."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

README = (Path(__file__).resolve().parents[2] / "README.md").read_text()
PAGE = README.partition("## From bench to firmware")[2].partition("\n## ")[0]
BLOCK = re.search(r"<!-- identify -->\n```sh\n(.*?)```", PAGE, re.S)[1]


def test_the_page_as_typed(root, measured_file, tmp_path):
    measured_file("tribometer", "reciprocating.tsv")
    output = root / "build" / "identify"
    # demo.sh sets up and builds before it calls the command that is called here
    own = f"build/venv/bin/dahl demo --seconds 5 --output {tmp_path}"
    for line in BLOCK.replace("tools/demo.sh", own).splitlines():
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=root,
            capture_output=True,
            text=True,
            timeout=250,
            check=False,
            env=os.environ,
        )
        assert done.returncode == 0, line + done.stderr
    found = json.loads((output / "rig.json").read_text())
    ends = found["ci95"]
    assert f"**sigma0 {found['sigma0']:.0f} N/m**" in PAGE
    assert f"(95 %: {ends['sigma0'][0]:.0f} to {ends['sigma0'][1]:.0f})" in PAGE
    assert f"**Fc {found['Fc']:.3f} N** ({ends['Fc'][0]:.3f} to {ends['Fc'][1]:.3f})" in PAGE
    assert f"R² {found['r2']:.3f}" in PAGE
    assert f"*{found['verdict']}*" in " ".join(PAGE.split())
    assert f"Coulomb alone {found['r2_coulomb']:.3f}" in " ".join(PAGE.split())
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["r2_measured"] > 0.98


def test_the_firmware_snippet_compiles(root, tmp_path):
    from dahl.core import Plan
    from dahl.identify import header

    code = re.search(r"```c\n(.*?)```", PAGE, re.S)[1]
    (tmp_path / "dahl_plan_rig.h").write_text(header.text("rig", Plan(37349, 2.666, 1e-7), ["rig"]))
    (tmp_path / "tick.c").write_text(code)
    command = [
        "cc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-c",
        "-I",
        tmp_path,
        "-I",
        root / "lib" / "include",
        tmp_path / "tick.c",
        "-o",
        tmp_path / "tick.o",
    ]
    subprocess.run(list(map(str, command)), check=True, timeout=60)
