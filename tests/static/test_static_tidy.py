# SPDX-License-Identifier: MIT
"""clang-tidy 19 accepts the C: bugprone, cert, clang-analyzer, misc, performance, portability, and
functions of at most 40 lines and complexity 8. clang-tidy.yaml has a reason for each check that
is off.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import static_tools as static
from conftest import need

CONFIG = Path(__file__).parent / "clang-tidy.yaml"


def tidy(files: list[Path]) -> tuple[int, str]:
    tool = need("clang-tidy-19", "clang-tidy finds nothing")
    words = ["--quiet", "--warnings-as-errors=*", f"--config-file={CONFIG}"]
    return static.call(tool, *words, *files, "--", *static.PLAIN)


def test_firmware_sources_are_tidy() -> None:
    status, text = tidy(static.FIRMWARE)
    assert status == 0, text


@pytest.mark.long
def test_desk_sources_are_tidy() -> None:
    status, text = tidy(static.DESK)
    assert status == 0, text
