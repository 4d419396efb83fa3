# SPDX-License-Identifier: MIT
"""The page and the examples of friction compensation: their torques are those of dahl.Compensator,
within limit and slew, in the units that they promise.
"""

from __future__ import annotations

import ctypes
import math
import re
import subprocess
from pathlib import Path

import dahl
import numpy as np
import pytest
from dahl.binding import plan_header
from sources import CORE, LIB

pytestmark = pytest.mark.usefixtures("library")

COMPENSATOR = sorted((LIB / "compensator").glob("*.c"))
STRICT = ["-std=c11", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O1"]
FC_LOW, LENGTH_LONG = 0.45, 0.0055  # N m, rad
MOVES = np.rint(6 * np.sin(np.arange(1000) / 60)).astype(int)  # counts: at most 2.3 rad/s


def compiled(root: Path, folder: Path, *words: object) -> ctypes.CDLL:
    """Compile sources with the library into a shared library."""
    flags = [*STRICT, "-shared", "-fPIC", f"-I{root}/lib/include", f"-I{folder}"]
    command = ["gcc", *flags, *words, *CORE, *COMPENSATOR, "-o", folder / "made.so"]
    subprocess.run([str(word) for word in command], check=True)
    return ctypes.CDLL(str(folder / "made.so"))


def test_the_page_has_the_bits_of_python(root: Path, tmp_path: Path) -> None:
    """Its C, with the bounds that `dahl identify` writes."""
    (code,) = re.findall(r"```c\n(.*?)```", (root / "docs/compensation.md").read_text(), re.S)
    (tmp_path / "page.c").write_text(code)
    bounds = plan_header.bounds("rig", FC_LOW, LENGTH_LONG, "N m", "rad")
    (tmp_path / "dahl_plan_rig.h").write_text(bounds)
    page = compiled(root, tmp_path, tmp_path / "page.c")
    page.compensation_tick.restype = ctypes.c_float
    assert page.compensation_init() == 0
    low, long = (float(one) for one in re.findall(r"(\S+)f /\*", bounds))
    sigma0 = float(np.float32(low) / np.float32(long))
    theta = float(np.float32(6.2831853) / 16384)
    compensator = dahl.Compensator(
        *(sigma0, low, theta),
        **{"Fc_low": low, "length_long": long, "gain": 0.9, "limit": 1.0, "slew": 50.0},
        **{"period": 1e-3, "rise": 0.5, "fall": 0.02, "fade_speed": 5.0},
        **{"noise": 1, "play": 2, "jump": 200},
    )
    flags = np.abs(np.arange(len(MOVES)) - 700) > 10
    due = compensator.run_log(dahl.Friction(dahl.Plan(sigma0, low, theta)), MOVES, is_good=flags)
    found = [page.compensation_tick(int(m), int(f)) for m, f in zip(MOVES, flags, strict=True)]
    assert found == pytest.approx(due, abs=1e-7 * low)
    assert math.isclose(max(found), max(due), rel_tol=1e-6) and max(found) > 0.1
