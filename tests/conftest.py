# SPDX-License-Identifier: MIT
"""Fixtures of all tests in Python, and the marks `checks`, `long` and `soak`.

A missing build is a failure. Measured data that is out of reach is a skip.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from _pytest.junitxml import xml_key
from programs import call

EXAMPLES, MORE_EXAMPLES = 50, 200  # of each Hypothesis test, by default and with --checks or more

ROOT = Path(__file__).resolve().parents[1]
BUILD = Path(os.environ.get("DAHL_BUILD_DIR", ROOT / "build" / "host"))

# Folders whose tests are all marked checks. Those of mujoco and jax are in tests/python.
CHECKS = ("proof", "fuzz", "static", "quality", "mujoco", "jax")
CHECK_SECONDS = 1800  # of one test in these folders, so that only a hang ends it
MODES = ("--checks", "--long", "--full", "--soak")  # each runs some of these folders


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--checks", action="store_true", help="also run the tests marked checks")
    parser.addoption("--long", action="store_true", help="also run the tests marked checks or long")
    parser.addoption("--full", action="store_true", help="the same as --long")
    parser.addoption("--soak", action="store_true", help="run the tests marked soak only")


def pytest_configure(config: pytest.Config) -> None:
    """Draw the same examples on every machine, so that a red test stays red."""
    hypothesis.settings.register_profile(
        "dahl",
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=[hypothesis.HealthCheck.too_slow],
        max_examples=MORE_EXAMPLES if runs_checks(config) else EXAMPLES,
    )
    hypothesis.settings.load_profile("dahl")
    os.environ.pop("PYTHONUNBUFFERED", None)  # programs buffer, so that a missing flush shows


def runs_checks(config: pytest.Config) -> bool:
    """Return whether the chosen mode runs tests in the folders of checks."""
    return any(config.getoption(mode) for mode in MODES)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip the folders of checks, because their packages come with tools/setup.sh checks.

    A file that the caller names is imported anyway.
    """
    is_check = bool({collection_path.name, collection_path.parent.name} & set(CHECKS))
    return True if is_check and not runs_checks(config) else None


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Name the folders that were not imported."""
    chosen = [Path(word.partition("::")[0]).resolve() for word in config.args]
    folders = [Path(__file__).parent / name for name in CHECKS]
    left_out = [folder.name for folder in folders if {folder, *folder.parents}.intersection(chosen)]
    if left_out and not runs_checks(config):
        names = ", ".join(left_out)
        terminalreporter.write_line(
            f"left out: {names}; pytest --checks runs them, after tools/setup.sh checks"
        )


def is_wanted(config: pytest.Config, item: pytest.Item) -> bool:
    """Return whether the chosen mode runs this test. By default no marked test runs."""
    marks = {mark.name for mark in item.iter_markers()}
    if config.getoption("--soak") or "soak" in marks:
        return bool(config.getoption("--soak") and "soak" in marks)
    if config.getoption("--long") or config.getoption("--full"):
        return True
    return "long" not in marks and ("checks" not in marks or bool(config.getoption("--checks")))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the tests that the mode does not run; they are not reported as skipped."""
    for item in items:
        if item.path.parent.name in CHECKS:
            item.add_marker("checks")
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(CHECK_SECONDS))
    left_out = [item for item in items if not is_wanted(config, item)]
    items[:] = [item for item in items if is_wanted(config, item)]
    config.hook.pytest_deselected(items=left_out)


def need(tool: str, claim: str) -> str:
    """Return the path of a tool. Without it, skip and name the claim that is unproven."""
    path = shutil.which(tool) or next(iter(BUILD.parent.glob(f"deps/{tool}/bin/{tool}")), None)
    if path is None:
        pytest.skip(f"unproven: {claim}: {tool} is not here, and tools/setup.sh could not get it")
    return str(path)


def with_compilers(*commands: str) -> list[Any]:
    """Parameters of a test, one for each compiler. Only gcc is part of the default set-up."""
    default = ("gcc", "g++")
    return [
        pytest.param(one, id=one, marks=[] if one.split()[0] in default else pytest.mark.checks)
        for one in commands
    ]


def from_pypi(name: str, requirements: str, claim: str) -> Path:
    """Install packages into their own environment below build/; return its folder of programs."""
    environment = BUILD.parent / name
    stamp = environment / "installed.txt"
    if not stamp.exists() or stamp.read_text() != requirements:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(environment)], check=True)
        wanted = [line.split("#")[0].strip() for line in requirements.splitlines()]
        words = [str(environment / "bin/pip"), "install", "--quiet", *filter(None, wanted)]
        if subprocess.run(words, check=False, timeout=280).returncode != 0:
            pytest.skip(f"unproven: {claim}: PyPI is out of reach")
        stamp.write_text(requirements)
    return environment / "bin"


def announce(config: pytest.Config, tests: int) -> None:
    """Record the number of tests, so that tools/count_tests.py notices a missing result."""
    if junit := config.stash.get(xml_key, None):
        junit.global_properties[:] = [("collected", str(tests))]


def pytest_collection_finish(session: pytest.Session) -> None:
    announce(session.config, len(session.items))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: list[str]) -> None:
    """Do the same if workers run the tests; each of them collects all."""
    announce(node.config, len(ids))


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the folder of the project."""
    return ROOT


def built(*parts: str) -> Path:
    """Return a file of the build. Its absence fails the test."""
    path = BUILD.joinpath(*parts)
    if not path.exists():
        pytest.fail(
            f"{path} is not built; run tools/test.sh,"
            " or: cmake --preset host && cmake --build build/host"
        )
    return path


@pytest.fixture(scope="session")
def library() -> Path:
    path = built("lib", "libdahl.so")
    os.environ.setdefault("DAHL_LIBRARY", str(path))
    return path


@pytest.fixture(scope="session")
def dahl_loop() -> Path:
    path = built("host_sim", "dahl-loop")
    os.environ.setdefault("DAHL_LOOP", str(path))
    return path


@pytest.fixture(scope="module", autouse=True)
def build_of_python_tests(request: pytest.FixtureRequest) -> None:
    """Let each test of tests/python find the built library and dahl-loop."""
    if request.path.is_relative_to(ROOT / "tests" / "python"):
        request.getfixturevalue("library")
        request.getfixturevalue("dahl_loop")


@pytest.fixture(scope="session")
def dbc(root: Path) -> Path:
    """Return the bus description."""
    return root / "lib" / "node" / "dahl.dbc"


@pytest.fixture
def run_dahl(root: Path):
    """Run the command `dahl` in a process; return the finished process with its text."""

    def run(*args: str, timeout: float = 600, **kwargs) -> subprocess.CompletedProcess:
        command = (sys.executable, "-m", "dahl", *args)
        return call(*command, timeout=timeout, **{"cwd": root, **kwargs})

    return run


@pytest.fixture
def dahl_here(capsys):
    """Run a verb of `dahl` in this process, called like run_dahl."""
    from identify_tools import caller

    return caller(capsys)


@pytest.fixture
def dahl(dahl_here, monkeypatch, tmp_path):
    """Do the same in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return dahl_here


@pytest.fixture
def measured_file():
    """Return the path of a measured file by data set and name; skip if it is out of reach."""

    def find(name: str, file: str) -> Path:
        from dahl.io import data

        folder = data.local_folder(name)
        if folder is None or not (folder / file).exists():
            pytest.skip(
                f"unproven: claims about measured set {name}: not in reach (see `dahl data`)"
            )
        return folder / file

    return find
