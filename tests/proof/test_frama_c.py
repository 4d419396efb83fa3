# SPDX-License-Identifier: MIT
"""Frama-C over the real sources: frames without end, and what a product of words is.

    tools/test.sh -k frama

Eva follows an endless loop of any frames by intervals; 0 alarms means that no undefined behaviour
can come of it, ever. WP proves by Z3, over the integers, what the checks by CBMC take for known
of a product.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
from conftest import need
from sources import INCLUDES, NODE, as_one

HERE = Path(__file__).parent


def preprocessor(frama_c: str, folder: Path) -> str:
    """Plain C, without what is particular to GNU: no assembler."""
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
        timeout=590,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def alarms(folder: Path) -> list[str]:
    """What Eva cannot exclude, in its own words, a line each. Postconditions are CBMC's to show."""
    frama_c = need("frama-c", "no undefined behaviour in a node that hears any frames")
    flags = [preprocessor(frama_c, folder), "-warn-special-float", "none", "-eva"]
    flags += ["-eva-split-return", "full", "-eva-precision", "1", "-main", "main"]
    said = frama(frama_c, *flags, str(HERE / "frama_node.c"))
    assert "functions analyzed" in said
    found = re.findall(r"^\[eva:alarm\] (.*(?:\n  .*)*)", said, re.MULTILINE)
    return [" ".join(each.split()) for each in found if "postcondition got status" not in each]


@pytest.mark.long
@pytest.mark.timeout(600)
def test_frames_without_end(tmp_path: Path) -> None:
    assert alarms(tmp_path) == []


def wp_goals(folder: Path) -> str:
    claim = "what the checks by CBMC take for known of a product"
    frama_c, why3 = need("frama-c", claim), need("why3", claim)
    need("z3", claim)
    config = folder / "why3.conf"
    subprocess.run(
        [why3, "config", "detect", "-C", str(config)], capture_output=True, check=True, timeout=60
    )
    command = [
        frama_c,
        preprocessor(frama_c, folder),
        *("-wp", "-wp-rte", "-wp-fct", "dahl_mul", "-wp-cache", "none"),
        *("-wp-prover", "z3", "-wp-timeout", "10", str(HERE / "frama_products.c")),
    ]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=True,
        timeout=200,
        env={**os.environ, "WHY3CONFIG": str(config)},
    )
    found = re.search(r"Proved goals:\s+(\d+) / (\d+)", done.stdout)
    assert found is not None and int(found[2]) >= 3, done.stdout
    return "all" if found[1] == found[2] else f"{found[1]} of {found[2]}"


def test_frama_c_knows_what_a_product_is(tmp_path: Path) -> None:
    assert wp_goals(tmp_path) == "all"
