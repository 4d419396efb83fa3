# SPDX-License-Identifier: MIT
"""The C tests and the tests of dahl-loop pass in each sanitizer preset."""

from __future__ import annotations

import os
import shutil
import sys

import pytest
from conftest import ROOT
from programs import run

pytestmark = pytest.mark.checks

# A sanitized program is large and slow, and no library can be loaded before the sanitizer's.
NOT_HERE = "memory or 200 or million or slow or witness or minute or tribometer or refuses_a_socket"


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("preset", "compiler"), [("sanitize", "gcc"), ("clang", "clang")])
def test_sanitizers_find_no_error(preset: str, compiler: str) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"unproven: sanitizers find no error: no {compiler} (tools/setup.sh checks)")
    run("cmake", "--preset", preset, cwd=ROOT)
    run("cmake", "--build", "--preset", preset, cwd=ROOT)
    run("ctest", "--preset", preset, "--timeout", "600", cwd=ROOT)
    names = ("loop_virtual", "scene_errors", "loop_models", "loop_faults", "loop_control")
    tests = [ROOT / f"tests/python/sim/test_{name}.py" for name in names]
    environment = {**os.environ, "DAHL_BUILD_DIR": str(ROOT / "build" / preset)}
    environment.pop("DAHL_LOOP", None)
    chosen = ["-q", "-p", "no:cacheprovider", "-k", f"not ({NOT_HERE})"]
    run(sys.executable, "-m", "pytest", *chosen, *tests, env=environment, cwd=ROOT)
