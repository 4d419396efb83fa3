# SPDX-License-Identifier: MIT
"""shellcheck accepts each shell script."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, need

SCRIPTS = sorted(
    path for part in ("tools", "tests", "port") for path in ROOT.glob(f"{part}/**/*.sh")
)
SOURCED = (
    "common.sh",
    "needs.sh",
    "packages.sh",
    "fetched.sh",
    "python.sh",
)  # checked with the scripts that source them


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("script", [s for s in SCRIPTS if s.name not in SOURCED], ids=name_of)
def test_shellcheck_finds_nothing(script: Path) -> None:
    tool = need("shellcheck", "no common mistake in a script")
    words = [tool, "--check-sourced", "--external-sources", script]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
