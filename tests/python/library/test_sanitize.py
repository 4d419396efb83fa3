# SPDX-License-Identifier: MIT
"""The C tests and the tests of dahl-loop pass in each sanitizer preset."""

import os
import shutil
import sys

import pytest
from conftest import ROOT
from programs import run

pytestmark = pytest.mark.checks

NOT_HERE = "memory or 200 or million or slow or witness or minute or tribometer or refuses_a_socket"
LOOP_TESTS = ("loop_virtual", "scene_errors", "loop_models", "loop_faults", "loop_control")


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("preset", "compiler"), [("sanitize", "gcc"), ("clang", "clang")])
def test_sanitizers_find_no_error_in_the_c_tests(preset: str, compiler: str) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"unproven: sanitizers find no error: no {compiler} (tools/setup.sh checks)")
    run("cmake", "--preset", preset, cwd=ROOT)
    run("cmake", "--build", "--preset", preset, cwd=ROOT)
    run("ctest", "--preset", preset, "--timeout", "600", cwd=ROOT)


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_sanitizers_find_no_error_in_the_loop_and_in_the_library_of_python() -> None:
    """The runtime of gcc is loaded before Python; clang's is part of each program."""
    run("cmake", "--preset", "sanitize", cwd=ROOT)
    run("cmake", "--build", "--preset", "sanitize", cwd=ROOT)
    runtime = run("gcc", "-print-file-name=libasan.so").strip()
    environment = {**os.environ, "DAHL_BUILD_DIR": str(ROOT / "build" / "sanitize")}
    environment |= {"LD_PRELOAD": runtime, "ASAN_OPTIONS": "detect_leaks=0"}  # Python leaks at exit
    environment.pop("DAHL_LOOP", None)
    environment.pop("DAHL_LIBRARY", None)
    tests = [ROOT / f"tests/python/sim/test_{name}.py" for name in LOOP_TESTS]
    chosen = ["-q", "-p", "no:cacheprovider", "-k", f"not ({NOT_HERE})"]
    run(sys.executable, "-m", "pytest", *chosen, *tests, env=environment, cwd=ROOT)
