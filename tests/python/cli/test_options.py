# SPDX-License-Identifier: MIT
"""Every option of every command: its names, both ends of its range, values beyond, required
options, and completion in a shell.
"""

import ast
import math
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from dahl import cli, paths
from dahl.binding import models
from identify_tools import complaint
from programs import run

FINITE, ABOVE_0, TIME = (-1e30, 1e30), (1e-30, 1e30), (0.001, 1e9)
NODES, FRAMES, PORT = (0, 15), (1, 2**63), (0, 65535)  # of integers whole numbers, else any
OWN = [f"--{model.key}" for model in models.table().values() if model.has_own_number]
MODELS = tuple(name for name, model in models.table().items() if model.has_plan)
FLAG, TEXT, NUMBER = "a flag", "any text", "any number"  # else (least, most), or all choices
UNKNOWN = "unrecognized arguments: --no-such-option"
LIVE = {"--frames": FRAMES, "--seconds": TIME}
BUS = {"-i/--interface": TEXT, "-c/--channel": TEXT, "-b/--bitrate": NUMBER, "--fd": FLAG}
BUS |= {"--data-bitrate": NUMBER, "--timing": TEXT, "--bus-kwargs": TEXT, "--host": TEXT}
BUS |= {"--port": PORT}
OPTIONS: dict[str, dict[str, Any]] = {
    "demo": {"--angle": TEXT, "--torque": TEXT, "--time": TEXT, "--sigma0": NUMBER}
    | {"--fc": NUMBER, "--counts-per-turn": NUMBER, "--angle-unit": TEXT, "--scene": TEXT}
    | dict.fromkeys(("--torque-scale", "--offset", "--spring"), FINITE)
    | {"--bus": TEXT, "--target": TEXT, "--seconds": TIME, "--seed": (0, 2**64 - 1)}
    | {"--json": FLAG, "-o/--output": TEXT},
    "loop": dict.fromkeys(("--scene", "--set", "--data", "--log-file", "--bus", "--nodes"), TEXT)
    | dict.fromkeys(("--role", "--seconds", "--seed", "--log", "--trace", "--wait-clients"), TEXT)
    | dict.fromkeys(("--summary", "--with-parent"), TEXT)
    | dict.fromkeys(("--virtual", "--lockstep", "--until-idle"), FLAG),
    "identify": dict.fromkeys(("--angle", "--torque", "--time", "--load", "--angle-unit"), TEXT)
    | dict.fromkeys(("--torque-unit", "--time-unit", "--dbc", "--terms", "--model"), TEXT)
    | dict.fromkeys(("--check", "--each", "--dask", "--json", "--name", "-o/--output"), TEXT)
    | dict.fromkeys(("--skip-gaps", "--trust-units", "--no-delay", "--follow"), FLAG)
    | {"--force": FLAG, "--no-files": FLAG, "--median": (0, 99), "--jobs": (-1, 1024)}
    | dict.fromkeys(("--target-counts-per-turn", "--within", "--torque-constant"), ABOVE_0)
    | {"--counts-per-turn": NUMBER}
    | LIVE
    | BUS,
    "commission": dict.fromkeys(("--angle", "--torque", "--time", "--angle-unit", "--dbc"), TEXT)
    | dict.fromkeys(("--torque-unit", "--time-unit", "--table", "--json", "--name"), TEXT)
    | {"-o/--output": TEXT, "--simulate": FLAG, "--skip-gaps": FLAG, "--trust-units": FLAG}
    | dict.fromkeys(("--inertia", "--torque-limit", "--travel", "--angle-limit"), ABOVE_0)
    | dict.fromkeys(("--speed-limit", "--period", "--bandwidth", "--torque-constant"), ABOVE_0)
    | {"--drive": ("odrive", "moteus"), "--node": (0, 127), "--counts-per-turn": NUMBER}
    | BUS,
    "excite": dict.fromkeys(("--sigma0", "--fc", "--noise", "--counts-per-turn"), ABOVE_0)
    | dict.fromkeys(("--within", "--rate", "--speed", "--inertia", "--bandwidth"), ABOVE_0)
    | {"--torque-constant": ABOVE_0, "--loop": TEXT, "--reference": TEXT}
    | {"--from": TEXT, "--mm": FLAG, "--name": TEXT, "--force": FLAG, "-o/--output": TEXT},
    "plan": dict.fromkeys(("--sigma0", "--fc", *OWN, "--counts-per-turn"), TEXT)
    | {"--model": MODELS, "--theta-per-count": TEXT, "-o/--output": TEXT, "--name": TEXT}
    | {"--force": FLAG},
    "fmu": dict.fromkeys(("--sigma0", "--fc", *OWN, "--counts-per-turn"), TEXT)
    | dict.fromkeys(("--theta-per-count", "--kinds", "--name", "-o/--output"), TEXT)
    | {"--model": tuple(models.table()), "--fixed-stiffness": FLAG, "--force": FLAG}
    | {"--fmi": (2, 3)},
    "node": {"--scene": TEXT, "--sigma0": NUMBER, "--fc": NUMBER, "--theta-per-count": NUMBER}
    | {"--node": NODES, "--target": TEXT, "--seconds": TIME}
    | BUS,
    "monitor": {"--node": NODES, "--dbc": TEXT, "--window": (2, 10**6), "--fc": ABOVE_0}
    | {"--scene": TEXT, "--json": FLAG}
    | LIVE
    | BUS,
    "record": {"-o/--output": TEXT, "--force": FLAG} | LIVE | BUS,
    "plot": {"--scene": TEXT, "-c/--channel": TEXT, "-o/--output": TEXT},
    "report": {"-o/--output": TEXT},
    "data": {"--json": FLAG},
    "dbc": {"--nodes": (1, 16), "-o/--output": TEXT, "--force": FLAG},
    "complete": {},
}
NEEDED = {  # required options
    "excite": ["--counts-per-turn=1"],
    "loop": ["--scene=x"],
    "plan": ["--sigma0=1", "--fc=1", "--theta-per-count=0", "-ox"],
    "fmu": ["--sigma0=1", "--fc=1", "-ox"],
    **{"record": ["-ox"], "plot": ["x"], "report": ["x"]},
}
EVERY = [(verb, names) for verb, options in OPTIONS.items() for names in options]
DEFAULTS: dict[str, dict[str, Any]] = {  # all that are not None, False or empty
    "demo": {"output": paths.OUTPUT / "demo"},
    "identify": {"jobs": -1, "within": 2, "output": paths.OUTPUT / "identify"},
    "commission": {"drive": "odrive", "name": "axis", "output": paths.OUTPUT / "identify"},
    "excite": {"noise": 0.05, "within": 1, "rate": 1000, "speed": math.inf, "name": "excite"}
    | {"output": paths.OUTPUT / "identify", "bandwidth": math.inf},
    "plan": {"model": "dahl"},
    "fmu": {"model": "dahl", "fmi": 2},
    "monitor": {"window": 4000},
    "dbc": {"nodes": 1},
    "complete": {"shell": "bash"},
}


def refusal_of(dahl, verb: str, *words: str) -> str:
    """The message for these words and an unknown option: of an accepted value, only the unknown
    option is named.
    """
    option = words[0].partition("=")[0]
    needed = [one for one in NEEDED.get(verb, []) if one.partition("=")[0] != option]
    if option == "--counts-per-turn" and verb == "plan":
        needed.remove("--theta-per-count=0")
    code, line = complaint(dahl(verb, *needed, *words, "--no-such-option"))
    assert code == 2 and f"dahl {verb} --help" in line or "dahl --help" in line
    return line


def samples(takes: Any) -> list[str]:
    if isinstance(takes, tuple):
        return [one if isinstance(one, str) else repr(one) for one in takes]
    return {TEXT: ["a=b"], NUMBER: ["7"]}[takes]


def beyond(takes: Any) -> list[str]:
    if takes == NUMBER:
        return ["x", "1,5"]
    if isinstance(takes[0], str):
        return ["", "x", takes[0].upper()]
    low, high = takes
    if isinstance(low, float) or isinstance(high, float):
        return [repr(low - abs(low) / 1000), repr(high * 1.001), "nan", "inf", "x", "1,5"]
    return [str(low - 1), str(high + 1), "1.5", "x", "--5", "5-", "1" * 5000, "\u00b2"]


@pytest.mark.parametrize(("verb", "names"), EVERY)
def test_an_option_accepts_its_range_and_nothing_beyond(dahl, verb, names):
    takes = OPTIONS[verb][names]
    if takes == FLAG:
        assert UNKNOWN in refusal_of(dahl, verb, names)
        assert "ignored explicit argument" in refusal_of(dahl, verb, f"{names}=1")
        return
    if names in ("-i/--interface", "--timing"):  # python-can's own choices and forms
        assert names.split("/")[0] in refusal_of(dahl, verb, f"{names.split('/')[-1]}=x")
        return
    for name in names.split("/"):
        for value in samples(takes):
            word = f"{name}={value}" if name[:2] == "--" else name + value
            assert UNKNOWN in refusal_of(dahl, verb, word)
    for value in () if takes == TEXT else beyond(takes):
        line = refusal_of(dahl, verb, f"{names.split('/')[-1]}={value}")
        assert ("decimal sign is a point" in line) == (value == "1,5" and "bitrate" not in names)
        assert names.split("/")[-1] in line and value[:100] in line
        for limit in takes if isinstance(takes, tuple) else ():
            assert (f"{limit:g}" if isinstance(limit, float) else str(limit)) in line


@pytest.mark.parametrize("verb", OPTIONS)
def test_options_have_their_defaults_and_a_help(verb):
    args = vars(cli.build_parser().parse_args([verb, *NEEDED.get(verb, [])]))
    given = {word.partition("=")[0].strip("-").replace("-", "_") for word in NEEDED.get(verb, [])}
    given |= {"command", "command_parser", "parser", "run", "run_path"}
    given |= {"output"} if "ox" in given else set()
    defaults = {key: value for key, value in args.items() if value and key not in given}
    assert defaults == DEFAULTS.get(verb, {})
    assert [one.dest for one in args["command_parser"]._actions if not one.help] == []


def test_the_help_names_the_folder_in_which_outputs_are(dahl, monkeypatch):
    """It is build/ in a checkout, another one of an installed package."""
    assert "dahl plot build/demo\n" in dahl("plot", "--help").stdout
    monkeypatch.setattr(paths, "INSTALLED", True)
    monkeypatch.setattr(paths, "OUTPUT", Path("elsewhere"))
    assert "dahl plot elsewhere/demo\n" in dahl("plot", "--help").stdout


MISSING = [(verb, word) for verb, words in NEEDED.items() for word in words]


@pytest.mark.parametrize(("verb", "missing"), [*MISSING, ("record", "-c")])
def test_a_missing_required_option_is_named(verb, missing, dahl):
    words = [word for word in NEEDED[verb] if word != missing]
    code, line = complaint(dahl(verb, *words, *["-c"] * (missing == "-c")))
    name = {"x": "RUN", "-ox": "-o"}.get(missing, missing.partition("=")[0])
    assert code == 2 and name in line and not list(Path.cwd().iterdir())


def test_without_a_command_the_help_is_printed(dahl):
    done = dahl()
    assert (done.returncode, done.stdout) == (2, "") and done.stderr == dahl("--help").stdout


SLIPS = [  # words, of which one in <> is unknown, and the nearest known word; "": none is near
    ("demo <--secne> steering", "--scene"),
    ("plan <--simga0> 1 --fc 1 --counts-per-turn 4 -o x", "--sigma0"),  # --sigma0 is required
    ("plan --sigma0 1 <--Fc>=1 --counts-per-turn 4 -o x", "--fc"),
    ("record -o x <--chanel> can0", "--channel"),
    ("monitor <--prot> 3", "--port"),
    ("<--verison>", "--version"),
    ("<dmeo> --scene steering --verzion", "demo"),
    ("demo -y <--scnee> x", "--scene"),
    ("<Monitor>", "monitor"),
    ("demo <-scene> steering", "--scene"),
    ("record -o x <-chanel> can0", "--channel"),  # -c hanel and a word too many
    ("plan <-sigma0>=1 --fc 1 --counts-per-turn 4 -ox", "--sigma0"),
    ("plan --sigma0 1 --fc 1 --counts-per-turn 4 -o x -- <--fcs>", ""),
    ("data <--zzz>", ""),
    ("demo <-y>", ""),
    ("<zzz>", ""),
]


@pytest.mark.parametrize(("words", "meant"), SLIPS)
def test_a_slip_of_the_pen_is_named_and_has_a_suggestion(words, meant, dahl):
    code, line = complaint(dahl(*re.sub("[<>]", "", words).split()))
    assert code == 2 and re.findall(r"did you mean (\S+)\?", line) == [meant] * bool(meant)
    assert "--help" in line and re.search("<(.*)>", words)[1] in line


COMMAS = [  # --model and options of plan; whether a number with a decimal comma is the reason
    ("dahl --sigma0 100,5 --fc 1", True),
    ("dahl --sigma0 100 --fc 0,5", True),
    ("slip --sigma0 100,5 --fc 0.5", True),
    ("slip --sigma0 100,5 --fc 0,5", True),
    ("asymmetric --sigma0 100 --fc 0,2", True),
    ("asymmetric --sigma0 100 --fc 0,2,0,3", True),
    (f"{models.with_key('breakaway').name} --sigma0 1 --fc 1 --breakaway 0,5", True),
    ("dahl --sigma0 100;5 --fc 1", False),
    ("slip --sigma0 1 --fc nan", False),
    ("asymmetric --sigma0 100 --fc 1", False),
]


@pytest.mark.parametrize(("words", "is_comma"), COMMAS)
def test_a_decimal_comma_is_named_and_a_list_is_none(words, is_comma, dahl):
    code, line = complaint(dahl("plan", "--counts-per-turn=9", "-ox", "--model", *words.split()))
    assert code == 2 and ("decimal sign is a point" in line) == is_comma
    lists = dahl("plan", *"--model slip --sigma0 100,40 --fc 1,5 --theta-per-count 1 -o -".split())
    assert lists.returncode == 0


# --- options in texts -----------------------------------------------------------------------------

OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
OF_OTHERS = {"--help", "--version", "--preset", "--build", "--pdeathsig"}  # of CMake and setpriv
OF_OTHERS |= {f"--bus{name}" for name in ("1-interface", "1-channel", "2-interface", "2-channel")}
OF_OTHERS |= {"--bus2-bus-kwargs"}  # of python-can's bridge


def names_of(verb: str) -> set[str]:
    return {name for names in OPTIONS[verb] for name in names.split("/")}


def test_each_option_that_a_message_names_exists(root, dahl_loop):
    plugin = (root / "tools/dahl/can/pytest_plugin.py").read_text()
    known = OF_OTHERS.union(OPTION.findall(run(dahl_loop, "--help")), *map(names_of, OPTIONS))
    known |= {*re.findall(r"addoption\(\s*\"(--[\w-]+)\"", plugin)}
    for path in (root / "tools/dahl").rglob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        texts = [one.value for one in nodes if isinstance(one, ast.Constant)]
        named = {name for text in texts if isinstance(text, str) for name in OPTION.findall(text)}
        assert named <= known, path


def test_each_option_on_a_page_is_one_of_its_command(root):
    pages = [root / "README.md", *(root / "docs").glob("*.md"), *root.glob("examples/**/*.md")]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for verb, rest in re.findall(r"\bdahl ([a-z]+)((?: +(?!`)[^`\n#|]*)?)", text):
            if verb in OPTIONS:
                assert {*OPTION.findall(rest)} <= names_of(verb) | {"--help"}, (page, verb)


# --- completion in a shell ------------------------------------------------------------------------


def test_bash_completes_commands_options_and_values(dahl, root):
    script = dahl("complete").stdout
    function = re.search(r"^complete .*-F (\w+) dahl$", script, re.MULTILINE)[1]

    def completed(*words: str) -> list[str]:
        line = " ".join(map(shlex.quote, ("dahl", *words)))
        ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; {function} 2>/dev/null; "
        ask += 'printf "%s\\n" "${COMPREPLY[@]}"'
        return run("bash", "--norc", "-uc", script + ask).split()

    assert re.findall(r"^    (\w+)\b", dahl("--help").stdout, re.MULTILINE) == list(OPTIONS)
    assert set(completed("")) == {*OPTIONS}
    assert set(completed("-")) == {"-h", "--help", "--version"}
    assert completed("mon") == ["monitor"] and completed("demo", "--sce") == ["--scene"]
    for verb in OPTIONS:
        assert set(completed(verb, "-")) == names_of(verb) | {"-h", "--help"}
    scenes = {path.stem for path in (root / "host_sim" / "scenes").glob("*.ini")}
    scenes |= {"commission", "compensation", "park-steer"}
    assert set(completed("demo", "--scene", "")) == scenes
    assert completed("plan", "--model", "asy") == ["asymmetric"]
    for name in ("-i", "--interface"):
        assert "socketcand" in completed("node", name, "socketcan")
    assert completed("plot", str(root / "READ")) == [str(root / "README.md")]


def test_the_script_of_zsh_has_all_verbs_and_options(dahl):
    script = dahl("complete", "zsh").stdout
    for verb, options in OPTIONS.items():
        names = {name for names in options for name in names.split("/") if name.startswith("--")}
        assert all(word in script for word in {verb, *names})
