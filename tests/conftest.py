# SPDX-License-Identifier: MIT
"""What all tests in Python share: where the build is, measured data, and the marks `checks`,
`long` and `soak`.

A missing build is a failure, not a skip: nothing is proved without it. Measured data out of reach
is a skip with its reason, since a clone need not have it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from _pytest.junitxml import xml_key

EXAMPLES, MORE_EXAMPLES = 50, 200  # of each law, by default and with --checks or more

ROOT = Path(__file__).resolve().parents[1]
BUILD = Path(os.environ.get("DAHL_BUILD_DIR", ROOT / "build" / "host"))


CHECKS = ("proof", "fuzz", "static", "quality")  # folders whose tests are all marked checks
MODES = ("--checks", "--long", "--full", "--soak")  # that run some of these


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--checks", action="store_true", help="also the tests marked checks")
    parser.addoption("--long", action="store_true", help="also those marked checks or long")
    parser.addoption("--full", action="store_true", help="the same as --long")
    parser.addoption("--soak", action="store_true", help="the tests marked soak, no others")


def pytest_configure(config: pytest.Config) -> None:
    """The same examples on every machine: a red test stays red until it is mended."""
    hypothesis.settings.register_profile(
        "dahl",
        deadline=None,
        database=None,
        derandomize=True,
        max_examples=MORE_EXAMPLES if runs_checks(config) else EXAMPLES,
    )
    hypothesis.settings.load_profile("dahl")
    os.environ.pop(
        "PYTHONUNBUFFERED", None
    )  # programs buffer as a user's do, so that a flush that is missing shows


def runs_checks(config: pytest.Config) -> bool:
    """Whether the chosen mode runs tests in the folders of checks."""
    return any(config.getoption(mode) for mode in MODES)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no checks that the mode does not run: their packages come with tools/setup.sh checks.
    A file that the caller names is imported all the same.
    """
    is_check = bool({collection_path.name, collection_path.parent.name} & set(CHECKS))
    return True if is_check and not runs_checks(config) else None


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say which folders were not imported."""
    asked = [Path(word.partition("::")[0]).resolve() for word in config.args]
    folders = [Path(__file__).parent / name for name in CHECKS]
    left_out = [folder.name for folder in folders if {folder, *folder.parents}.intersection(asked)]
    if left_out and not runs_checks(config):
        names = ", ".join(left_out)
        terminalreporter.write_line(
            f"left out: {names}; pytest --checks runs them, after tools/setup.sh checks"
        )


def is_wanted(config: pytest.Config, item: pytest.Item) -> bool:
    """Whether the chosen mode runs this test; by default none that is marked."""
    marks = {mark.name for mark in item.iter_markers()}
    if config.getoption("--soak") or "soak" in marks:
        return bool(config.getoption("--soak") and "soak" in marks)
    if config.getoption("--long") or config.getoption("--full"):
        return True
    return "long" not in marks and ("checks" not in marks or bool(config.getoption("--checks")))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what the mode does not run (deselected, not reported as skipped)."""
    for item in items:
        if item.path.parent.name in CHECKS:
            item.add_marker("checks")
    left_out = [item for item in items if not is_wanted(config, item)]
    items[:] = [item for item in items if is_wanted(config, item)]
    config.hook.pytest_deselected(items=left_out)


def need(tool: str, claim: str) -> str:
    """Path of a tool. Without it the claim is not shown, and the skip says which."""
    path = shutil.which(tool) or next(iter(BUILD.parent.glob(f"deps/{tool}/bin/{tool}")), None)
    if path is None:
        pytest.skip(f"unproven: {claim}: {tool} is not here, and tools/setup.sh could not get it")
    return str(path)


def from_pypi(name: str, requirements: str, claim: str) -> Path:
    """The folder of programs of these packages, in an environment of their own below build/."""
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
    """How many tests there were to run: tools/count_tests.py misses those without a result."""
    if junit := config.stash.get(xml_key, None):
        junit.global_properties[:] = [("collected", str(tests))]


def pytest_collection_finish(session: pytest.Session) -> None:
    announce(session.config, len(session.items))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: list[str]) -> None:
    """The same where workers run the tests; each of them collects all."""
    announce(node.config, len(ids))


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


def built(*parts: str) -> Path:
    """A file of the build; its absence fails the test."""
    path = BUILD.joinpath(*parts)
    if not path.exists():
        pytest.fail(
            f"{path} is not built; run tools/test.sh,"
            " or: cmake --preset host && cmake --build build/host"
        )
    return path


@pytest.fixture(scope="session")
def library() -> Path:
    """The shared library."""
    path = built("lib", "libdahl.so")
    os.environ.setdefault("DAHL_LIBRARY", str(path))
    return path


@pytest.fixture(scope="session")
def dahl_loop() -> Path:
    """The program dahl-loop."""
    path = built("host_sim", "dahl-loop")
    os.environ.setdefault("DAHL_LOOP", str(path))
    return path


@pytest.fixture(scope="session")
def dbc(root: Path) -> Path:
    """The bus description."""
    return root / "lib" / "node" / "dahl.dbc"


@pytest.fixture
def run_dahl(root: Path):
    """Call the command `dahl` with arguments; returns the finished process with its text."""

    def run(*args: str, timeout: float = 120, **kwargs) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "dahl", *map(str, args)]
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            **{"cwd": root, **kwargs},
        )

    return run


@pytest.fixture
def dahl_here(capsys):
    """A verb of `dahl` in this process, called as run_dahl is."""
    from identify_tools import caller

    return caller(capsys)


@pytest.fixture
def dahl(dahl_here, monkeypatch, tmp_path):
    """The same in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return dahl_here


@pytest.fixture
def measured_file():
    """Path of a measured file by data set and name; skips with the reason where it is out of
    reach.
    """

    def find(name: str, file: str) -> Path:
        from dahl.io import data

        folder = data.local_folder(name)
        if folder is None or not (folder / file).exists():
            pytest.skip(f"measured set {name} is not in reach (see `dahl data`)")
        return folder / file

    return find
