# SPDX-License-Identifier: MIT
"""A command whose packages are not there brings them once, or says in a line what it lacks."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import tomllib

import pytest
from dahl import RunError, by_need, paths
from dahl.cli import COMMANDS
from identify_tools import complaint
from packaging.requirements import Requirement


@pytest.fixture
def without_scipy(monkeypatch, tmp_path):
    """A checkout whose build/venv has no scipy; its setup.sh ends with the code in file `code`."""
    script = tmp_path / "tools/setup.sh"
    script.parent.mkdir()
    script.write_text(
        f'#!/bin/sh\necho "$@" | tee -a {tmp_path}/asked\nexit "$(cat {tmp_path}/code)"\n'
    )
    script.chmod(0o755)
    started = []
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "build/venv"))
    monkeypatch.setattr(by_need, "find_spec", lambda name: None if name == "scipy" else name)
    monkeypatch.setattr(os, "execve", lambda *words: started.append(words))
    monkeypatch.delenv(by_need.TRIED, raising=False)
    return tmp_path, started


def test_what_needs_no_more_starts_at_once(without_scipy):
    folder, started = without_scipy
    by_need.bring("demo", ["demo"])
    by_need.bring("monitor", ["monitor"])
    assert not started
    assert not (folder / "asked").exists()


@pytest.mark.parametrize(
    "need",
    [
        ("identify", "pandas"),
        ("identify", "joblib"),
        ("excite", "scipy"),
        ("monitor", "plotext"),
        ("report", "jinja2"),
    ],
)
def test_each_command_knows_its_packages(monkeypatch, need):
    monkeypatch.setenv(by_need.TRIED, "1")
    monkeypatch.setattr(by_need, "find_spec", lambda name: None if name == need[1] else name)
    with pytest.raises(RunError, match=f"dahl {need[0]} needs {need[1]}; pip install 'dahl"):
        by_need.bring(need[0], [need[0]])


def test_each_command_names_extras_that_bring_what_it_needs(root):
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    extras = {
        name: {re.split(r"[\[><=]", one)[0].lower() for one in wanted}
        for name, wanted in project["optional-dependencies"].items()
    }
    needs = [*by_need.NEEDS.values(), *((extra, [x]) for x, extra in by_need.AT_TIMES.items())]
    assert {*COMMANDS} - {*by_need.NEEDS} == {"complete", "plan"}  # with numpy alone
    for names, modules in needs:
        brought = set().union(*(extras[name] for name in names.split(",")))
        wanted = {by_need.DISTRIBUTED_AS.get(name, name).partition("[")[0] for name in modules}
        assert wanted - {"pyserial"} <= brought, names  # python-can[serial] brings that


def test_identification_needs_no_package_that_it_does_not_name():
    """Of those that some command names: what its modules import, in a process of its own."""
    known = {name for _, names in by_need.NEEDS.values() for name in names}
    code = (
        "import sys; from dahl.identify import draw, output, pipeline, readers; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = known & set(done.stdout.split())
    assert "mpmath" in found and found <= set(by_need.NEEDS["identify"][1])


def test_extras_take_what_is_tested_here_and_nothing_with_other_calls(root):
    """pip takes the newest that an extra allows, or keeps what is there: plotext 6 lacks what the
    monitor calls, python-can before 4.6 has no can.cli.
    """
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    wanted = [*map(Requirement, sum(project["optional-dependencies"].values(), []))]
    locks = (lock.read_text() for lock in (root / "tools/requirements").glob("*.lock"))
    pins = dict(re.findall(r"^([\w-]+)(?:\[\w+\])?==(\S+)", "".join(locks), re.MULTILINE))
    tested = [one for one in wanted if one.name in pins]
    assert len(tested) > 10
    assert [one for one in tested if not one.specifier.contains(pins[one.name])] == []
    (plotext,) = {one.specifier for one in wanted if one.name == "plotext"}
    assert not any(map(plotext.contains, ("6.0.0", "6.1.0", "7.0")))
    (python_can,) = {one.specifier for one in wanted if one.name == "python-can"}
    assert python_can.contains("4.6.0") and not python_can.contains("4.5.0")


@pytest.mark.parametrize("asked", ["--help", "-h"])
def test_the_help_without_python_can_says_what_it_lacks(dahl, monkeypatch, asked):
    """Beside all that it knows without it."""
    monkeypatch.setitem(sys.modules, "can", None)
    said, lacking = (
        dahl("monitor", asked),
        "dahl monitor needs python-can; pip install 'dahl[can]'",
    )
    assert (said.returncode, said.stderr) == (0, "")
    for words in (
        "--window TICKS",
        "dahl monitor -i socketcan",
        f"More options, of the bus: {lacking}",
    ):
        assert words in said.stdout
    assert complaint(dahl("monitor")) == (1, lacking)


def test_it_sets_up_and_starts_again_with_the_same_words(without_scipy, capfd):
    """The words of the set-up are no output."""
    (folder, started), given = without_scipy, ["identify", "log.csv", "--json", "-"]
    (folder / "code").write_text("0")
    by_need.bring("identify", given)
    assert (folder / "asked").read_text() == "identify\n" and not capfd.readouterr().out
    [(program, words, environment)] = started
    assert (program, words[1:]) == (sys.executable, ["-m", "dahl", *given])
    assert environment[by_need.TRIED]


def test_a_set_up_that_fails_is_one_error(without_scipy):
    folder, _ = without_scipy
    (folder / "code").write_text("1")
    with pytest.raises(RunError, match="scipy, and tools/setup.sh identify failed"):
        by_need.bring("identify", ["identify"])


@pytest.mark.parametrize("why", ["tried before", "another environment"])
def test_it_never_sets_up_twice_nor_for_others(without_scipy, monkeypatch, why):
    folder, _ = without_scipy
    if why == "tried before":
        monkeypatch.setenv(by_need.TRIED, "1")
    else:
        monkeypatch.setattr(sys, "prefix", "/usr")
    with pytest.raises(RunError, match="dahl identify needs scipy; pip install 'dahl.identify.'"):
        by_need.bring("identify", ["identify"])
    assert not (folder / "asked").exists()


def test_asammdf_is_imported_where_an_mf4_is_meant(monkeypatch):
    for words in (["demo"], ["record", "-o", "run.blf"], ["plot", "run"]):
        monkeypatch.setitem(sys.modules, "asammdf", None)  # as it was, after the test
        del sys.modules["asammdf"]
        by_need.spare_mf4(words[0], words)
        with pytest.raises(ImportError):
            importlib.import_module("asammdf")
    for words in (["record", "-o", "RUN.MF4"], ["identify", "logs"], ["plot", "run.mf4"]):
        monkeypatch.setitem(sys.modules, "asammdf", None)  # as it was, after the test
        del sys.modules["asammdf"]
        by_need.spare_mf4(words[0], words)
        assert "asammdf" not in sys.modules
