# SPDX-License-Identifier: MIT
"""A command whose packages are not there brings them once, or says in a line what it lacks; and the
extras of the package bring what each command imports.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from identify_tools import caller, complaint
from packaging.requirements import Requirement

# Of each verb: the extras that its refusal names, and what it imports.
NEEDS = {
    "demo": ("can,plot", ["can", "cantools", "rich", "matplotlib", "mpmath", "pooch", "pandas"]),
    "identify": ("identify", ["scipy", "pandas", "joblib", "matplotlib", "mpmath", "rich", "can"]),
    "excite": ("identify", ["scipy"]),
    "monitor": ("can", ["can", "cantools", "rich", "plotext", "mpmath"]),
    "node": ("can", ["can", "rich"]),
    "record": ("can", ["can"]),
    "plot": ("plot", ["matplotlib", "can", "cantools", "mpmath", "pandas"]),
    "report": ("plot", ["jinja2", "mpmath"]),
    "data": ("plot", ["pooch"]),
    "dbc": ("can", ["cantools", "mpmath"]),
}
WORDS = {"excite": ["--counts-per-turn", "1"], "record": ["-o", "x.log"], "plot": ["x"]}
WORDS |= {"report": ["x"], "identify": ["x.csv"], "node": ["-c", "x"]}
CALLED = {"can": "python-can", "jinja2": "jinja2"}  # by pip, where it is another name


def without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    """As if it were not installed, nor could be set up."""
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setenv("DAHL_SETUP_TRIED", "1")


def brought_by(said: str) -> list[list[str]]:
    """What each pip command in a line installs, as a shell splits it."""
    commands = re.findall(r"pip install ('[^']+'(?: '[^']+')*)", said)
    return [shlex.split(words) for words in commands]


@pytest.mark.parametrize("verb", NEEDS)
def test_each_command_names_what_it_lacks_and_what_brings_it(
    dahl, tmp_path, verb, monkeypatch, extras
):
    """By the packages' own names, since no index has dahl, and in the versions of its extras; or by
    an extra, from the sources. Nothing has been written then.
    """
    names, packages = NEEDS[verb]
    for package in packages:
        with monkeypatch.context() as missing:
            without(missing, package)
            code, said = complaint(dahl(verb, *WORDS.get(verb, [])))
        assert code == 1 and f"dahl {verb} " in said
        (direct,), from_sources = brought_by(said)
        allowed = {str(one) for some in extras.values() for one in some if "dahl" not in one.name}
        assert str(Requirement(direct)) in allowed
        assert Requirement(direct).name == CALLED.get(package, package)
        assert from_sources == [f".[{names}]"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("verb", NEEDS)
def test_an_unknown_option_is_reported_before_what_is_lacking(dahl, verb, monkeypatch):
    """Not an option of python-can's, which it knows without it."""
    for package in NEEDS[verb][1]:
        without(monkeypatch, package)
    words = [*WORDS.get(verb, []), "--nonsense", "7"]
    if verb in ("monitor", "record", "node", "identify"):
        words += ["--interface", "socketcan", "-b", "500000", "--fd", "--bus-kwargs", "a=1"]
    code, said = complaint(dahl(verb, *words))
    assert code == 2 and "--nonsense" in said
    assert [word for word in ("socketcan", "500000", "--fd", "a=1", "pip") if word in said] == []


@pytest.mark.parametrize("asked", ["--help", "-h"])
def test_the_help_without_python_can_says_what_it_lacks(dahl, monkeypatch, asked):
    """Beside all that it knows without it."""
    without(monkeypatch, "can")
    said = dahl("monitor", asked)
    assert (said.returncode, said.stderr) == (0, "")
    for words in ("--window TICKS", "dahl monitor -i socketcan", "--bitrate"):
        assert words in said.stdout
    (direct,), from_sources = brought_by(" ".join(said.stdout.split()))
    assert direct.startswith("python-can") and from_sources == [".[can]"]


def test_a_plan_and_completion_need_no_extra(dahl, monkeypatch):
    for package in {package for _, packages in NEEDS.values() for package in packages}:
        without(monkeypatch, package)
    words = ("--sigma0", "1", "--fc", "1", "--theta-per-count", "1", "-o", "x.h")
    assert dahl("plan", *words).returncode == 0 and dahl("complete").returncode == 0


# --- the extras of the package --------------------------------------------------------------------


@pytest.fixture(scope="module")
def extras(root) -> dict[str, list[Requirement]]:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return {
        name: [*map(Requirement, wanted)]
        for name, wanted in project["optional-dependencies"].items()
    }


def test_the_extras_that_are_named_bring_what_is_imported(extras):
    brought = {name: {one.name.lower() for one in wanted} for name, wanted in extras.items()}
    for names, packages in NEEDS.values():
        together = set().union(*(brought[name] for name in names.split(",")))
        assert {CALLED.get(package, package) for package in packages} <= together, names
    for package, name in (("asammdf", "identify"), ("dask", "cluster"), ("pyarrow", "identify")):
        assert package in brought[name]


def test_extras_take_what_is_tested_here_and_nothing_with_other_calls(extras, root):
    """pip takes the newest that an extra allows, or keeps what is there: plotext 6 lacks what the
    monitor calls, python-can before 4.6 has no can.cli.
    """
    wanted = [one for some in extras.values() for one in some]
    lock = (root / "tools/requirements.lock").read_text()
    pins = dict(re.findall(r"^([\w-]+)(?:\[\w+\])?==(\S+)", lock, re.MULTILINE))
    tested = [one for one in wanted if one.name in pins]
    assert len(tested) > 10
    assert [one for one in tested if not one.specifier.contains(pins[one.name])] == []
    (plotext,) = {one.specifier for one in wanted if one.name == "plotext"}
    assert not any(map(plotext.contains, ("6.0.0", "6.1.0", "7.0")))
    (python_can,) = {one.specifier for one in wanted if one.name == "python-can"}
    assert python_can.contains("4.6.0") and not python_can.contains("4.5.0")


# --- in a checkout, whose build/venv is filled by need --------------------------------------------


@pytest.fixture
def checkout(monkeypatch, tmp_path):
    """A checkout whose build/venv has no scipy; its setup.sh ends with the code in file `code`. An
    exception to the public seams: where the checkout is, and the start of the program anew.
    """
    script = tmp_path / "tools/setup.sh"
    script.parent.mkdir()
    asked = f'echo "$@" | tee -a {tmp_path}/asked'
    script.write_text(f'#!/bin/sh\n{asked}\nexit "$(cat {tmp_path}/code)"\n')
    script.chmod(0o755)
    started: list[tuple[object, ...]] = []

    def start(*words: object) -> None:
        started.append(words)
        raise SystemExit(0)

    monkeypatch.setattr("dahl.paths.ROOT", tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "build/venv"))
    monkeypatch.setattr(os, "execve", start)
    without(monkeypatch, "scipy")
    monkeypatch.delenv("DAHL_SETUP_TRIED")
    return tmp_path, started


def test_it_sets_up_and_starts_again_with_the_same_words(checkout, capfd):
    """What needs no more starts at once; the words of the set-up are no output."""
    (folder, started), given = checkout, ["identify", "log.csv", "--json", "-"]
    dahl = caller(capfd)
    (folder / "code").write_text("0")
    assert dahl("dbc").returncode == 0 and not (folder / "asked").exists()
    done = dahl(*given)
    assert (folder / "asked").read_text() == "identify\n" and not done.stdout
    [(program, words, environment)] = started
    assert (program, words[1:]) == (sys.executable, ["-m", "dahl", *given])
    monkeyed = environment.keys() - os.environ.keys()
    assert len(monkeyed) == 1, "a variable that keeps it from a third start"


@pytest.mark.parametrize("why", ["it fails", "tried before", "another environment"])
def test_it_never_sets_up_twice_nor_for_others(checkout, capfd, monkeypatch, why):
    folder, started = checkout
    (folder / "code").write_text("1")
    if why == "tried before":
        monkeypatch.setenv("DAHL_SETUP_TRIED", "1")
    if why == "another environment":
        monkeypatch.setattr(sys, "prefix", "/usr")
    done = caller(capfd)("excite", "--counts-per-turn", "1")
    said = done.stderr.splitlines()[-1]  # below the words of the set-up
    assert done.returncode == 1 and said.startswith("error: ") and "scipy" in said and not started
    assert ("tools/setup.sh" in said) == (why == "it fails") == (folder / "asked").exists()


# --- what costs much is imported where it is meant ------------------------------------------------


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("plot", "run"), False),
        (("record", "-o", "run.blf", "-i", "virtual", "-c", "x", "--seconds", "0.01"), False),
        (("record", "-o", "RUN.MF4", "-i", "virtual", "-c", "x", "--seconds", "0.01"), True),
        (("record", "-o", "run.mf4", "--help"), False),
    ],
)
def test_asammdf_is_imported_where_an_mf4_is_meant(root, tmp_path, words, wanted):
    """It takes most of the start of a command that reads and writes no MF4."""
    code = (
        "import atexit, sys; from dahl.__main__ import main; sys.argv[0] = 'dahl'\n"
        "atexit.register(lambda: print('asammdf', bool(sys.modules.get('asammdf'))))\n"
        "sys.exit(main())"
    )
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == f"asammdf {wanted}", done.stderr
