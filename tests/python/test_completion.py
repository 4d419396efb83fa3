# SPDX-License-Identifier: MIT
"""The script of `dahl complete`, asked as bash asks it; and --json of the verbs that print."""

from __future__ import annotations

import json
import shlex
import subprocess

import pytest
from dahl.cli import COMMANDS
from identify_tools import caller


@pytest.fixture(scope="module")
def script() -> str:
    import contextlib
    import io

    from dahl.cli import main

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["complete"]) == 0
    return out.getvalue()


def completed(script: str, *words: str) -> list[str]:
    """What bash offers for the last of these words."""
    line = " ".join(map(shlex.quote, ("dahl", *words)))
    ask = f'COMP_WORDS=({line}); COMP_CWORD={len(words)}; _dahl; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(
        ["bash", "--norc", "-uc", script + ask], capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def test_commands_options_and_what_they_take(script, root):
    assert set(completed(script, "")) == {*COMMANDS, "--help", "--version"}
    assert completed(script, "mon") == ["monitor"]
    assert completed(script, "demo", "--sce") == ["--scene"]
    assert completed(script, "monitor", "--bus-k") == ["--bus-kwargs"]
    scenes = {path.stem for path in (root / "host_sim" / "scenes").glob("*.ini")}
    assert set(completed(script, "demo", "--scene", "")) == scenes
    assert completed(script, "plan", "--model", "asy") == ["asymmetric"]
    assert "socketcand" in completed(script, "node", "-i", "socketcan")
    assert completed(script, "plot", "some-file") == []  # bash then offers files


def test_a_demo_as_json(capsys, dahl_loop, library, tmp_path):
    """Standard output holds the summary alone; the words for people are beside it."""
    words = ("--scene", "steering", "--seconds", "0.2", "--output", tmp_path, "--json")
    done = caller(capsys)("demo", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((tmp_path / "summary.json").read_text())
    assert json.loads(done.stdout)["ticks"] == 200
    assert "scene   Steering" in done.stderr
