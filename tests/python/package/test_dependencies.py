# SPDX-License-Identifier: MIT
"""A command whose packages are missing names them in one line. The extras of the package contain
the packages that each command imports.
"""

import importlib
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from dahl import RunError, codec
from identify_tools import complaint
from packaging.requirements import Requirement

# Of each verb: the extras in its message, and the packages that it imports.
NEEDS = {
    "demo": ("can,plot", ["can", "cantools", "rich", "matplotlib", "mpmath", "pooch", "pandas"]),
    "identify": ("identify", ["scipy", "pandas", "joblib", "matplotlib", "mpmath", "rich", "can"]),
    "commission": ("identify", ["scipy", "pandas", "matplotlib", "rich", "can"]),
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
CALLED = {"can": "python-can", "jinja2": "jinja2"}  # other names, for pip


def without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)


def brought_by(line: str) -> list[list[str]]:
    """Return the arguments of each pip command in a line, as a shell splits them."""
    commands = re.findall(r"pip install ('[^']+'(?: '[^']+')*)", line)
    return [shlex.split(words) for words in commands]


@pytest.mark.parametrize("verb", NEEDS)
def test_each_command_names_the_missing_package_and_its_extra(
    dahl, tmp_path, verb, monkeypatch, extras
):
    """It names the package and its version, since no index has dahl, and the extra for the sources.
    It writes no file.
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
def test_options_are_checked_and_help_is_printed_before_packages_are_missed(
    dahl, verb, monkeypatch
):
    """The options of python-can are known without it. A plan needs no extra."""
    for package in {package for _, packages in NEEDS.values() for package in packages}:
        without(monkeypatch, package)
    words = [*WORDS.get(verb, []), "--nonsense", "7"]
    if verb in ("monitor", "record", "node", "identify"):
        words += ["--interface", "socketcan", "-b", "500000", "--fd", "--bus-kwargs", "a=1"]
    code, said = complaint(dahl(verb, *words))
    assert code == 2 and "--nonsense" in said
    assert [word for word in ("socketcan", "500000", "--fd", "a=1", "pip") if word in said] == []
    shown = dahl(verb, "--help")
    assert (shown.returncode, shown.stderr) == (0, "") and f"dahl {verb}" in shown.stdout
    given = ("--sigma0", "1", "--fc", "1", "--theta-per-count", "1", "-o", "-")
    assert dahl("plan", *given).returncode == 0 and dahl("complete").returncode == 0


def test_only_messages_of_python_can_need_python_can(monkeypatch):
    without(monkeypatch, "can")
    frame = codec.EncoderState(7)
    assert codec.from_bytes(frame.base, codec.to_bytes(frame)) == frame
    with pytest.raises(RunError, match=r"pip install 'python-can\b"):
        codec.pack(frame)


# --- the extras of the package --------------------------------------------------------------------


@pytest.fixture(scope="module")
def extras(root) -> dict[str, list[Requirement]]:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return {
        name: [*map(Requirement, wanted)]
        for name, wanted in project["optional-dependencies"].items()
    }


def test_the_extras_contain_the_imported_packages_in_the_tested_versions(extras, root):
    """plotext 6 lacks functions that the monitor calls; python-can before 4.6 has no can.cli."""
    brought = {name: {one.name.lower() for one in wanted} for name, wanted in extras.items()}
    for names, packages in NEEDS.values():
        together = set().union(*(brought[name] for name in names.split(",")))
        assert {CALLED.get(package, package) for package in packages} <= together, names
    wanted = {one.name: one.specifier for some in extras.values() for one in some}
    lock = (root / "tools/requirements.lock").read_text()
    pins = dict(re.findall(r"^([\w-]+)(?:\[\w+\])?==(\S+)", lock, re.MULTILINE))
    tested = wanted.keys() & pins.keys()
    assert len(tested) > 8
    assert [name for name in tested if not wanted[name].contains(pins[name])] == []
    assert not any(map(wanted["plotext"].contains, ("6.0.0", "6.1.0", "7.0")))
    assert not wanted["python-can"].contains("4.5.0")


def test_dahl_jax_names_the_command_that_installs_jax_and_dahl_itself_needs_none(monkeypatch):
    without(monkeypatch, "jax")
    monkeypatch.delitem(sys.modules, "dahl.jax", raising=False)
    with pytest.raises(RunError, match=r"pip install '\.\[jax\]'") as error:
        importlib.import_module("dahl.jax")
    assert "jax" in brought_by(str(error.value))[0][0]
    run = "import dahl, sys; dahl.Plan(1, 1); sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", run], check=False).returncode == 0
