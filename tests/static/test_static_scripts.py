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


def test_planted_open_quote_does_not_parse(tmp_path: Path) -> None:
    planted = tmp_path / "setup.sh"
    planted.write_text((ROOT / "tools/setup.sh").read_text() + 'say "done\n')
    assert static.call("bash", "-n", planted)[0] != 0
