# SPDX-License-Identifier: MIT
"""Every option of every verb: its names, what it takes, where that ends, and what holds without."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from typing import Any

import can.cli
import pytest
from dahl import paths
from dahl.cli import COMMANDS, Parser, build_parser
from identify_tools import complaint

FINITE, ABOVE_0, TIME = (-1e30, 1e30), (1e-30, 1e30), (0.001, 1e9)
NODES, FRAMES = (0, 15), (1, 2**63)  # (least, most): of integers whole numbers, else any
UNITS = ("deg", "rad", "mm", "counts")
MODELS = ("dahl", "slip", "asymmetric", "elastoplastic")
FLAG = "flag"
# name: (what it takes, its value where nothing is said); no value: None. A set is that of choices.
LIVE = {"--frames": (FRAMES,), "--seconds": (TIME,)}
OWN = {"--sigma0": (float,), "--fc": (float,)}
DEMO = {
    **{"log": (Path,), "--angle": (str,), "--torque": (str,), "--time": (str,), **OWN},
    **{"--counts-per-turn": (float,), "--angle-unit": (UNITS,), "--torque-scale": (FINITE,)},
    **{"--offset": (FINITE,), "--spring": (FINITE,), "--scene": (str,), "--bus": (str,)},
    **{"--target": (str,), "--seconds": (TIME,), "--seed": ((0, 2**64 - 1),), "--json": (FLAG,)},
    "-o/--output": (Path, paths.ROOT / "build/demo"),
}
IDENTIFY = {
    **{"logs": (Path, []), "--angle": (str, ""), "--torque": (str, ""), "--time": (str, "")},
    **{"--load": (str, []), "--angle-unit": (str, ""), "--torque-unit": (str, "")},
    **{"--time-unit": (str, ""), "--counts-per-turn": (float, 0.0), "--dbc": (Path,)},
    **{"--skip-gaps": (FLAG,), "--trust-units": (FLAG,), "--terms": (str,), "--model": (str, "")},
    **{"--no-delay": (FLAG,), "--median": ((0, 99), 0), "--check": (Path, [])},
    **{"--each": (Path,), "--jobs": ((-1, 1024), -1), "--dask": (str,), "--follow": (FLAG,)},
    **{"--within": (ABOVE_0, 2.0), **LIVE, "--json": (str,), "--name": (str, "")},
    **{"-o/--output": (Path, paths.ROOT / "build/identify"), "--force": (FLAG,)},
    **{"--target-counts-per-turn": (ABOVE_0, 0.0), "--no-files": (FLAG,)},
}
EXCITE = {
    **{"--from": (Path,), "--sigma0": (ABOVE_0,), "--fc": (ABOVE_0,), "--noise": (ABOVE_0, 0.05)},
    **{"--counts-per-turn": (ABOVE_0,), "--mm": (FLAG,), "--within": (ABOVE_0, 1.0)},
    **{"--rate": (ABOVE_0, 1000.0), "--speed": (ABOVE_0, math.inf), "--name": (str, "excite")},
    **{"--force": (FLAG,), "-o/--output": (Path, paths.ROOT / "build/identify")},
}
PLAN = {
    **{"--model": (MODELS, "dahl"), "--sigma0": (str,), "--fc": (str,), "--breakaway": (str,)},
    **{"--counts-per-turn": (str,), "--theta-per-count": (str,), "-o/--output": (str,)},
    **{"--name": (str,), "--force": (FLAG,)},
}
NODE = {
    **{"--scene": (str,), **OWN, "--theta-per-count": (float,), "--node": (NODES,)},
    **{"--target": (str,), "--seconds": (TIME,)},
}
MONITOR = {
    **{"--node": (NODES,), "--dbc": (Path,), "--window": ((2, 10**6), 4000), "--fc": (ABOVE_0,)},
    **{"--scene": (str,), "--json": (FLAG,), **LIVE},
}
OPTIONS: dict[str, dict[str, tuple[Any, ...]]] = {
    **{"demo": DEMO, "identify": IDENTIFY, "excite": EXCITE, "plan": PLAN, "node": NODE},
    **{"monitor": MONITOR, "record": {"-o/--output": (Path,), "--force": (FLAG,), **LIVE}},
    "plot": {"run": (Path,), "--scene": (str,), "-c/--channel": (str,), "-o/--output": (Path,)},
    "report": {"run": (Path,), "-o/--output": (Path,)},
    "data": {"name": (str,), "--json": (FLAG,)},
    "dbc": {"--nodes": ((1, 16), 1), "-o/--output": (Path,), "--force": (FLAG,)},
    "complete": {},
}
OF_A_BUS = ("identify", "node", "monitor", "record")
KEPT = {"--from": "known", "run": "run_path"}  # under another name than the option's
NEEDED = {  # what has to be said beside, for the verb to be read
    "excite": ["--counts-per-turn=1"],
    "plan": ["--sigma0=1", "--fc=1", "--theta-per-count=0", "-ox"],
    **{"record": ["-ox"], "plot": ["x"], "report": ["x"]},
}
EVERY = [(verb, names) for verb, options in OPTIONS.items() for names in options]


def asked(verb: str, *words: str) -> Any:
    """What the verb reads of these words, and of what it needs beside."""
    option = words[0].partition("=")[0] if words else ""
    beside = [word for word in NEEDED.get(verb, []) if word.partition("=")[0] != option]
    if verb == "plan" and option == "--counts-per-turn":
        beside.remove("--theta-per-count=0")
    if verb in ("plot", "report") and words and option[:1] != "-":
        beside = []
    return build_parser().parse_args([verb, *beside, *words])


def parser_of(verb: str) -> Parser:
    (verbs,) = (
        one for one in build_parser()._actions if isinstance(one, argparse._SubParsersAction)
    )
    verbs.choices[verb].fill()
    return verbs.choices[verb]


def place(names: str) -> str:
    """Where argparse leaves the value."""
    long = names.rpartition("/")[2]
    return KEPT.get(long, long.lstrip("-").replace("-", "_"))


def refused(capsys: pytest.CaptureFixture[str], verb: str, word: str) -> str:
    with pytest.raises(SystemExit) as ended:
        asked(verb, word)
    said = capsys.readouterr()
    assert (ended.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    assert said.err.startswith("error: ") and said.err.endswith(f"(see dahl {verb} --help)\n")
    return said.err


def test_no_verb_and_no_option_is_left_out() -> None:
    assert list(OPTIONS) == list(COMMANDS)
    bus = argparse.ArgumentParser()
    can.cli.add_bus_arguments(bus)
    theirs = {name for one in bus._actions for name in one.option_strings} | {"--host", "--port"}
    for verb, options in OPTIONS.items():
        known = {"-h", "--help"} | (theirs if verb in OF_A_BUS else set())
        known |= {name for names in options for name in names.split("/") if name[0] == "-"}
        actions = parser_of(verb)._actions
        assert {name for one in actions for name in one.option_strings} == known
        places = {one.dest for one in actions if not one.option_strings}
        assert places == {place(names) for names in options if names[0] != "-"}


@pytest.mark.parametrize(("verb", "names"), EVERY)
def test_an_option_takes_what_it_says_and_no_more(verb, names, capsys) -> None:
    takes, *otherwise = OPTIONS[verb][names]
    at, alone = place(names), vars(parser_of(verb).parse_args([*NEEDED.get(verb, [])]))
    needed = any(word.startswith(tuple(names.split("/"))) for word in NEEDED.get(verb, []))
    if not needed and names != "run":
        wanted = otherwise[0] if otherwise else False if takes == FLAG else None
        assert alone[at] == wanted and type(alone[at]) is type(wanted)
    if takes == FLAG:
        assert getattr(asked(verb, names), at) is True
        assert "ignored explicit argument" in refused(capsys, verb, f"{names}=1")
        return
    for name in names.split("/"):
        for given, value in samples(takes):
            word = f"{name}={given}" if name[:2] == "--" else name + given
            found = getattr(asked(verb, word if name[0] == "-" else given), at)
            found = found if takes_many(verb, names) else [found]
            assert found == [value] and isinstance(found[0], type(value))
    if isinstance(takes, tuple):
        for given in beyond(takes):
            said = refused(capsys, verb, f"{names}={given}")
            assert names in said and given in said
            for limit in takes:
                assert (f" {limit:g}" if is_real(takes) else str(limit)) in said


def takes_many(verb: str, names: str) -> bool:
    return [*OPTIONS[verb][names][1:]] == [[]]


def is_real(takes: tuple[Any, ...]) -> bool:
    return any(isinstance(limit, float) for limit in takes)


def samples(takes: Any) -> list[tuple[str, Any]]:
    """Words that are taken, and what they are then: of a range both ends."""
    if isinstance(takes, tuple) and not isinstance(takes[0], str):
        return [(repr(limit), limit) for limit in takes]
    if isinstance(takes, tuple):
        return [(choice, choice) for choice in takes]
    return {
        Path: [("a b", Path("a b"))],
        str: [("a b", "a b")],
        float: [("-2.5e-3", -2.5e-3), ("7", 7.0)],
    }[takes]


def beyond(takes: tuple[Any, ...]) -> list[str]:
    """Words that are not taken: of a range the next on either side."""
    if isinstance(takes[0], str):
        return ["", "x", takes[0].upper()]
    if is_real(takes):
        low, high = takes
        return [repr(low - abs(low) / 1000), repr(high * 1.001), "nan", "inf", "x", "1,5"]
    return [str(takes[0] - 1), str(takes[1] + 1), "1.5", "x", "--5", "5-", "1" * 5000, "\u00b2"]


MISSING = [(verb, word) for verb, words in NEEDED.items() for word in words]


@pytest.mark.parametrize(("verb", "missing"), [*MISSING, ("record", "-c")])
def test_what_has_to_be_said_is_asked_for(verb, missing, dahl) -> None:
    """In one line that names it, and before anything is looked for or written."""
    words = [word for word in NEEDED[verb] if word != missing]
    code, said = complaint(dahl(verb, *words, *["-c"] * (missing == "-c")))
    name = {"x": "RUN", "-ox": "-o"}.get(missing, missing.partition("=")[0])
    assert code == 2 and name in said and not list(Path.cwd().iterdir())
    assert ("expected one argument" if missing == "-c" else "required") in said


@pytest.mark.parametrize(("words", "said"), [("", "required"), ("x", "'x'"), ("demo -y", "-y")])
def test_what_is_no_verb_and_no_option_is_named(words, said, dahl) -> None:
    code, told = complaint(dahl(*words.split()))
    assert code == 2 and said in told and "--help)" in told


@pytest.mark.parametrize("verb", OF_A_BUS)
def test_a_port_is_one_of_tcp(verb, capsys) -> None:
    assert [asked(verb, f"--port={port}").port for port in (0, 65535)] == [0, 65535]
    assert asked(verb).port is None and asked(verb, "--host=a").host == "a"
    for port in ("-1", "65536", "1.5"):
        said = refused(capsys, verb, f"--port={port}")
        assert f"{port}: " in said and "from 0 to 65535" in said


@pytest.mark.parametrize("verb", OPTIONS)
def test_what_the_help_calls_the_default_holds(verb) -> None:
    """Where it is a number or a word of the option's own kind; others are a sentence."""
    told = {}
    for one in parser_of(verb)._actions:
        if found := re.search(r"default:? ([\w.]+)(?=\)|$)", one.help or ""):
            told[one.option_strings[-1]] = (found[1], one.default)
    elsewhere = {"--torque-scale": 1.0, "--scene": "steering"}  # see test_demo, test_node_command
    for name, (said, held) in told.items():
        known = elsewhere.get(name) if held is None else held
        assert said == (f"{known:g}" if isinstance(known, float) else str(known))
    assert {name for name in told} == {
        "identify": {"--within"},
        "excite": {"--noise", "--within", "--rate"},
        "demo": {"--torque-scale"},
        **{"plan": {"--model"}, "node": {"--scene"}},
    }.get(verb, set())


UNITS_TOLD = {"--fc": "N m", "--sigma0": "N m/rad", "--theta-per-count": "rad per count"}
UNITS_TOLD |= {"--offset": "N m", "--spring": "N m/rad", "--torque-scale": "N m per unit"}


@pytest.mark.parametrize("verb", OPTIONS)
def test_the_help_tells_the_unit_of_a_number(verb) -> None:
    for one in parser_of(verb)._actions:
        for name in UNITS_TOLD.keys() & {*one.option_strings}:
            assert re.search(rf"(^|, |\b){UNITS_TOLD[name]}(?![\w/])", one.help), (verb, name)
