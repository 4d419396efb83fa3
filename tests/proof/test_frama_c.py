# SPDX-License-Identifier: MIT
"""Frama-C over the real sources: frames without end.

    tools/test.sh --full -k frama

Eva analyses an endless loop of any frames by intervals; 0 alarms prove that no undefined behaviour
can occur.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from conftest import need
from sources import INCLUDES, NODE, as_one

HERE = Path(__file__).parent


def preprocessor(frama_c: str, folder: Path) -> str:
    """Plain C without GNU extensions, so without assembly."""
    share = frama(frama_c, "-print-share-path").strip()
    as_one(folder)
    as_one(folder, NODE, "node_library.c")
    words = [
        "-U__GNUC__",
        *INCLUDES,
        *(f"-I{path}" for path in (folder, HERE, Path(share, "libc"))),
    ]
    return "-cpp-extra-args=" + " ".join(words)


def frama(*command: str) -> str:
    done = subprocess.run(
        list(command),
        capture_output=True,
        text=True,
        timeout=1700,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def alarms(folder: Path) -> list[str]:
    """The alarms of Eva, a line each. CBMC proves the postconditions."""
    frama_c = need("frama-c", "no undefined behaviour in a node that hears any frames")
    flags = [preprocessor(frama_c, folder), "-warn-special-float", "none", "-eva"]
    flags += ["-eva-split-return", "full", "-eva-precision", "1", "-main", "main"]
    said = frama(frama_c, *flags, str(HERE / "frama_node.c"))
    assert "functions analyzed" in said
    found = re.findall(r"^\[eva:alarm\] (.*(?:\n  .*)*)", said, re.MULTILINE)
    return [" ".join(each.split()) for each in found if "postcondition got status" not in each]


@pytest.mark.long
def test_frames_without_end(tmp_path: Path) -> None:
    assert alarms(tmp_path) == []
