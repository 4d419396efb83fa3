# SPDX-License-Identifier: MIT
"""Every shell script parses: bash -n."""

from __future__ import annotations

from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT

SCRIPTS = sorted(path for part in ("tools", "tests") for path in ROOT.glob(f"{part}/**/*.sh"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: static.name_of(str(path)))
def test_script_parses(script: Path) -> None:
    static.clean("bash", "-n", script)
