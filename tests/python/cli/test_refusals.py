# SPDX-License-Identifier: MIT
"""Each command refuses bad input with one line `error: ...` that names value, limit and place. It
exits with 2 if the input is wrong and with 1 if a resource is missing. It changes no file.

One line of a table is `words => facts`: the facts must occur in the message in this order. Words in
capitals stand for several words (MACROS). dahl-loop has its own table: sim/test_run_file.py.
"""

import json
import os
import re
import resource
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from dahl.binding import models
from demo_tools import write_log
from identify_tools import FC, complaint, dahl_torque, noise_of, sine, write_csv
from loop_tools import SCENES
from programs import call

BREAKAWAY = models.with_key("breakaway").name  # the model with this parameter
COLUMNS = "--angle 'shaft [deg]' --torque 'sensor [mNm]'"
SHAFT = "--sigma0 40 --fc 0.8 --counts-per-turn 16384"
PLAN = "plan --sigma0 100 --fc 0.5 --counts-per-turn 16384 -o plan.h"
NINE = ",".join("1" * 9)
MACROS = {
    "DEMO": f"demo shaft.csv {COLUMNS} {SHAFT} -o out",
    "SMALL": f"demo {SHAFT} -o out",
    "PLAN": PLAN,
    "SLIP": f"{PLAN} --model slip",
    "ASYMMETRIC": f"{PLAN} --model asymmetric",
    "BREAKAWAY": f"{PLAN} --model {BREAKAWAY}",
    "FMU": "fmu --sigma0 100 --fc 0.5 -o new.fmu",
    "NODE": "node --sigma0 100 --fc 12.5 --theta-per-count 3.8e-4",
    "EXCITE": "excite --counts-per-turn 16384 -o out",
    "TIMING": "--timing f_clock=8000000 brp=2 tseg1=5 tseg2=2 sjw=2 nof_samples=1",
    "RECORD": "record -i virtual -c quiet",
    "MONITOR": "monitor -i virtual -c quiet",
}
SEGMENTS = (
    "[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n{}\n[motion]\nkind = segments\n"
)
SEGMENTS += "theta1 = 40\ntheta2 = -25\ntheta3 = 30\nspeed = 300\n{}"
FILES = {
    "run.log": "(0.1) vcan0 100#00\n",
    "broken.log": "(0.1) vcan0 100#00\n(0.2) vcan0 100#0\n",
    "table.csv": "angle,torque\n1,2\n",
    "odd.csv": "x,y,z\n1,2,3\n",
    "nan.csv": "t,angle,torque\n" + "nan,nan,nan\n" * 100,
    "own.ini": SEGMENTS.format("", ""),
    "slip.ini": SEGMENTS.format("model = slip", ""),
    "gain.ini": SEGMENTS.format("gain = 0.9", ""),
    "limit.ini": SEGMENTS.format("limit = 0.9", ""),
    "ramp.ini": SEGMENTS.format("ramp_ms = 1", ""),
    "faults.ini": SEGMENTS.format("max_step = 9", "[faults]\ndrop = 0.1"),
    "replay.ini": SEGMENTS.partition("\n{}")[0] + "\n[motion]\nkind = log\nfile = table.csv\n",
    "odd.ini": SEGMENTS.format("gian = 1", ""),
    "other.dbc": 'VERSION ""\nBU_: A\nBO_ 256 Other: 8 A\n',
    "list.json": "[]",
    "half.json": '{"sigma0": 1}',
    "text.json": '{"sigma0": "x", "Fc": 1, "identifiable": {"sigma0": true, "Fc": true}}',
    "linear.json": '{"sigma0": 3e4, "Fc": 2.7, "linear": true, "identifiable": '
    '{"sigma0": true, "Fc": true}}',
    ";a.csv": "a\n1\n2\n",
    f"{'x' * 156}.csv": "a\n1\n2\n",
    "mine.h": "int mine;\n/* dahl_prepare() of one */\n#ifndef DAHL_PLAN_X_H\n",
    "bytes.h": "\udcff",
    "old.fmu": "PK",
}

WRONG_INPUT = {  # exit code 2
    "demo": f"""
        demo shaft.csv {SHAFT} -o out => --angle
        demo shaft.csv {COLUMNS} --fc 1 --counts-per-turn 9 -o out => --sigma0
        demo shaft.csv {COLUMNS} --sigma0 1 --counts-per-turn 9 -o out => --fc
        demo shaft.csv {COLUMNS} --sigma0 1 --fc 1 -o out => --counts-per-turn
        DEMO --angle shft => shaft.csv:1 ... 'shft' ... 'shaft [deg]'
        DEMO --angle '' => needs --angle
        DEMO --fc -1 => Fc = -1
        DEMO --counts-per-turn=0 => -turn ... 0
        DEMO --counts-per-turn=inf => -turn ... inf
        DEMO --bus canopy => --bus canopy ... socketcan
        DEMO --scene steering => --scene
        demo none.csv -o out => none.csv: no such file
        SMALL none.csv --angle a => none.csv: no such file
        demo --scene none -o out => 'none' ... creep ... cycloidal
        demo --angle 1 -o out => --angle
        demo --fc 1 --scene steering -o out => --fc
        demo --offset 0 --sigma0 3 -o out => --sigma0 ... --offset
        demo --spring 0.3 --angle-unit deg -o out => --angle-unit ... --spring
        SMALL odd.csv --angle 'a ; b' => 'a ; b'
        SMALL odd.csv --angle ' x' => ' x'
        SMALL odd.csv --angle x --torque 'y ' => 'y '
        SMALL ';a.csv' --angle a => ;a.csv
        demo --scene replay.ini -o out => replay.ini:5: [motion] ... 'angle'
        demo --scene segments --target m4f --bus socketcan:x => --target ... can:x
        demo --scene own.ini --target m9 => --target m9 ... m4f
        demo --scene slip.ini --target m4f => --target ... slip.ini
        demo --scene gain.ini --target m4f => --target ... gain.ini
        demo --scene limit.ini --target m4f => --target ... limit.ini
        demo --scene ramp.ini --target m4f => --target ... ramp.ini
        demo --scene faults.ini --target m4f => --target ... faults.ini
        """,
    "bus of a demo": "".join(
        f"demo --bus '{bus}' => --bus {bus}: \n"
        for bus in ("vcan0", "socketcan", "socketcan:", "socketcan:a/b", "socketcan:a:b")
        + ("socketcand:x", "socketcand:1:2", "socketcan:a b")
    ),
    "plan": f"""
        SLIP --sigma0=1,2 --fc=1 => --sigma0 1,2 --fc 1: 2, 1 values ... 8
        SLIP --sigma0=1,-2 --fc=1,1 => element 1: sigma0 = -2
        SLIP --sigma0=1,1,1,1,1,1,1,1,1 --fc=1,1,1,1,1,1,1,1,1 => 9 elements ... 8
        ASYMMETRIC => --fc 0.5 ... 1 ... --model asymmetric ... 2
        ASYMMETRIC --fc=1,2,3 => --fc 1,2,3 ... 3 ... --model asymmetric ... 2
        ASYMMETRIC --fc=1,2 --breakaway=0.5 => --breakaway ... --model {BREAKAWAY}
        BREAKAWAY => --breakaway ... --model {BREAKAWAY}
        BREAKAWAY --breakaway=1 => breakaway = 1
        BREAKAWAY --breakaway=b => --breakaway b ... 1e-45 <= breakaway <= 1
        PLAN --breakaway=0 => --breakaway ... --model {BREAKAWAY}
        PLAN --sigma0=1e30 => sigma0 = 1e+30 ... 2^-64 <= sigma0 < 2^64
        PLAN --sigma0=soft => --sigma0 soft ... 2^-64 <= sigma0 < 2^64
        PLAN --sigma0=1,2 => --sigma0 1,2 ... 2 ... --model dahl ... 1
        PLAN --fc= => --fc : ... 2^-64 <= Fc < 2^64
        PLAN --fc=1,,2 => --fc :
        PLAN --counts-per-turn=0 => --counts-per-turn 0: ... above 0
        PLAN --counts-per-turn=inf => --counts-per-turn inf: ... above 0
        PLAN --counts-per-turn=1e14 => 2^-30 <= travel < 2^20
        PLAN --theta-per-count=1 => --theta-per-count ... --counts-per-turn
        plan --sigma0 1 --fc 1 -o x.h => --counts-per-turn ... --theta-per-count
        plan --sigma0 1 --fc 1 --theta-per-count x -o x.h => --theta-per-count x: ... 2^-64 <= theta
        PLAN --name=++ => --name ++
        PLAN -o mine.h => mine.h: ... --force
        PLAN -o bytes.h => bytes.h: ... --force
        """,
    "fmu": f"""
        FMU -o x.zip => -o x.zip: ... .fmu
        FMU -o - => -o -: ... .fmu
        FMU -o old.fmu => old.fmu: exists ... --force
        FMU --fc=-1 => Fc = -1 ... 2^-64 <= Fc < 2^64
        FMU --fc=0 --model=slip => Fc = 0
        FMU --sigma0=1,nan --fc=1,2 --model=slip => sigma0 = nan
        FMU --sigma0=1,2 => --sigma0 1,2 ... 2 ... --model dahl ... 1
        FMU --model=slip --sigma0=1,2 --fc=1 => --sigma0 1,2 --fc 1: 2, 1 values ... 8
        FMU --model=slip --sigma0={NINE} --fc={NINE} => 9, 9 values ... 8
        FMU --model=slip --theta-per-count=0 => theta_per_count = 0
        FMU --theta-per-count=1e-14 => 2^-30 <= travel < 2^20
        FMU --model=parallel => --kinds K,K ... --model parallel
        FMU --kinds=dahl => --kinds K,K ... --model parallel
        FMU --model=parallel --kinds=dahl,lugre => --kinds dahl,lugre: lugre
        FMU --model=parallel --kinds=dahl,slip => 1, 1, 2 values
        FMU --model={BREAKAWAY} => --breakaway ... --model {BREAKAWAY}
        FMU --model={BREAKAWAY} --breakaway=1 => breakaway = 1
        FMU --fixed-stiffness => --fixed-stiffness ... loaded ... dahl
        FMU --model=loaded --fixed-stiffness --theta-per-count=1 => --fixed-stiffness
        FMU --name=7up => --name 7up: ... letter
        FMU --name=++ => --name ++
        """,
    "node": """
        NODE -i virtual --target m4f => -i ... --target
        NODE -c vcan0 => -c vcan0 ... -i
        NODE --fd => --fd ... -i
        NODE --bus-kwargs a=1 b=2 => --bus-kwargs a=1 b=2 ... -i
        NODE TIMING => --timing f_clock=8000000 brp=2 tseg1=5 ... -i
        NODE -i virtual --host x --bus-kwargs host=y => host=y ... --host x
        node --fc 3 => --sigma0 ... --fc ... --theta-per-count ... --scene
        NODE --scene steering => --sigma0 ... --scene
        node --scene nowhere => 'nowhere' ... steering
        node --scene odd.ini -i virtual -c x => odd.ini:5: [friction] ... 'gian' ... Fc
        NODE --host 10.0.0.1 => --host 10.0.0.1 ... 127.0.0.1
        node --target m4f --scene tribometer-slip => --target ... tribometer-slip
        node --target m4f --scene slow-reversal => --target ... slow-reversal
        NODE --fc -1 => Fc = -1 ... 2^-64 <= Fc
        NODE --fc -1 -i virtual -c x => Fc = -1 ... 2^-64 <= Fc
        """,
    "logs and runs": """
        identify table.csv --each . => LOG ... --each ... --follow
        identify --each . --follow => LOG ... --each ... --follow
        identify => LOG ... --each ... --follow
        identify nan.csv --no-files => nan.csv:2
        identify nan.csv --no-files --skip-gaps => nan.csv:2
        EXCITE --sigma0 100 --fc 0.5 --speed 1e-30 => 1000000
        EXCITE --from linear.json --mm --sigma0 3 => --from ... --sigma0
        EXCITE --from list.json => list.json:
        EXCITE --from half.json => half.json:
        EXCITE --from text.json => text.json:
        plot none => none: no such file
        plot table.csv --scene segments => table.csv: ... .blf
        plot broken.log --scene segments => broken.log:2: ... 100#0
        plot run.log => run.log ... --scene
        plot run.log --scene segments -o x.gif => -o x.gif: ... .png, .svg, .pdf
        plot run.log --scene nowhere => nowhere
        report . => summary.json
        report whole => whole/loop.png: Is a directory
        report table.csv => table.csv:
        """,
    "bus": """
        MONITOR --dbc none.dbc => none.dbc: No such file or directory
        MONITOR --dbc other.dbc => other.dbc: ... 'Count' ... 'EncoderState'
        monitor -i nothing -c x => -i ... 'nothing'
        RECORD -o run.txt => .asc ... .blf ... .log ... .mf4 ... .trc
        RECORD -o run.log.gz => .asc ... .blf ... .log ... .mf4 ... .trc
        RECORD -o run.log => run.log: ... --force
        """,
}
MISSING_RESOURCE = {  # exit code 1
    "outputs": """
        PLAN -o none/plan.h => none/plan.h:
        PLAN -o loop.h => loop.h: Too many levels of symbolic links
        demo --scene segments -o table.csv/out => table.csv/out:
        """,
    "silent bus": """
        MONITOR --seconds 0.3 => interface=virtual channel=quiet ... s
        RECORD --seconds 0.3 -o new.log => interface=virtual channel=quiet ... s
        RECORD --seconds 0.3 -o run.log --force => interface=virtual channel=quiet
        """,
}
SCENE_OF_A_PLOT = [  # text of a scene, facts
    (b"[friction]\nsigma0 = \xff\n", "0xff"),
    (b"[friction]\nsigma0 = x\n", "[friction] sigma0 ... x"),
    (b"[friction]\ntheta_per_count = fine\n", "[friction] theta_per_count ... fine"),
    (b"[friction]\nnode = 16\n", "[friction] node ... 16 ...  0  ...  15"),
    (b"[friction]\nnode = 2.5\n", "[friction] node ... 2.5"),
    (b"[motor]\nseconds = 2 s\n", "[motor] seconds ... 2 s"),
    (b"[measured]\noffset = 1,5\n", "[measured] offset ... 1,5"),
    (b"[measured]\nsettle = 1.5\n", "[measured] settle ... 1.5"),
    (b"[measured]\nwheel = 1\n", "[measured] ... 'wheel'"),
    (b"sigma0 = 1\n", "section"),
]


def rows_of(tables: dict[str, str]) -> list[tuple[str, str]]:
    """(words, facts) of each line."""
    lines = [line.strip() for table in tables.values() for line in table.strip("\n ").split("\n")]
    return [tuple(part.strip() for part in line.split(" =>")) for line in lines]


def expand(words: str) -> list[str]:
    """The words of a row, macros replaced; a leading macro brings its own options first."""
    return [
        part
        for word in shlex.split(words)
        for part in shlex.split(MACROS.get(word, shlex.quote(word)))
    ]


@pytest.fixture
def folder(dahl) -> Path:
    for name, text in FILES.items():
        Path(name).write_text(text, encoding="utf-8", errors="surrogateescape")
    write_log(Path("shaft.csv"))
    Path("loop.h").symlink_to("loop.h")
    Path("whole/loop.png").mkdir(parents=True)
    Path("whole/summary.json").write_text('{"scene_file": "x.ini"}')
    return Path.cwd()


def contents() -> dict[Path, bytes | None]:
    """All files here. A demo may write the scene of an own log before it refuses the log."""
    paths = [path for path in Path().rglob("*") if path.parts[0] != "out" or path.name == "run.log"]
    return {path: path.read_bytes() if path.is_file() else None for path in paths}


def check(done: subprocess.CompletedProcess, code: int, facts: str) -> str:
    found, line = complaint(done)
    in_order = ".*".join(re.escape(fact.strip()) for fact in facts.split("..."))
    assert found == code and re.search(in_order, line), line
    return line


@pytest.mark.parametrize(
    ("code", "words", "facts"),
    [(2, *row) for row in rows_of(WRONG_INPUT)] + [(1, *row) for row in rows_of(MISSING_RESOURCE)],
)
def test_a_bad_command_line_is_refused_in_one_line_and_changes_no_file(
    dahl, folder, code, words, facts
):
    before = contents()
    check(dahl(*expand(words)), code, facts)
    assert contents() == before


@pytest.mark.parametrize(("text", "facts"), SCENE_OF_A_PLOT)
def test_plot_refuses_a_bad_scene(dahl, folder, text, facts):
    (path := folder / "bad.ini").write_bytes(text)
    check(dahl("plot", "run.log", "--scene", path), 2, f"{path}: ... {facts}")


# --- summaries that anyone may have written -------------------------------------------------------

SUMMARY = {"scene_file": str(SCENES / "segments.ini")}
TEXTS = ("title", "bus", "time", "log", "date", "version", "command")
NUMBERS = ("ticks", "frames_sent", "frames_lost", "deadline_misses", "max_error_ulp_Fc")
NUMBERS += ("rmse_measured", "r2_measured", "realtime_factor")
NUMBERS += ("frames_answered", "late_ticks", "late_answers")
OBJECTS = ("parameters", "control", "node", "answers_by_state", "latency_us", "jitter_us", "faults")
WRONG_SHAPES = [*((key, 5) for key in TEXTS), *((key, "5") for key in NUMBERS)]
WRONG_SHAPES += [(key, [["x"]]) for key in (*OBJECTS, "units")]
WRONG_SHAPES += [("ticks", float("nan")), ("frames_sent", 10**400), ("r2_measured", float("nan"))]
WRONG_SHAPES += [
    ("latency_us", {"max": 1}),
    ("latency_histogram", {}),
    ("faults", {"injected": {}}),
]
WRONG_SHAPES += [
    ("faults", {"injected": {"a": "b"}, "expected": {}}),
    ("jitter_us", {"p50": 1, "p99": "2", "max": 3}),
    ("units", {"sigma0": "N/m", "Fc": 1, "theta_per_count": "m"}),
]
WRONG_SHAPES += [("latency_histogram", [pair]) for pair in ([1, -2], [1], [1, "2"], [1, 2])]
NO_JSON = [b"[" * 100_000, b"\xff\xfe", b'{"scene_file": "x", "n": ' + b"9" * 5000 + b"}"]
NO_JSON += [b'{"scene_file": "x"', b'{"scene_file": 7}']


@pytest.mark.parametrize("verb", ["report", "plot"])
def test_each_number_of_a_summary_has_its_shape_or_is_null(dahl, verb):
    Path("run.log").touch()
    for key, wrong in WRONG_SHAPES:
        Path("summary.json").write_text(json.dumps({**SUMMARY, key: wrong}))
        check(dahl(verb, "."), 2, f"summary.json: {key}")
        Path("summary.json").write_text(json.dumps({**SUMMARY, key: None}), encoding="utf-8-sig")
        check(dahl(verb, "."), 2, {"report": "loop.png: ", "plot": "run.log: "}[verb])
    times = {"p50": 1, "p99": 2, "max": 3}
    complete = {"latency_us": times, "jitter_us": times, "deadline_misses": 0}
    for pair in ([1], [1, 2, 3], [1, -2]):
        wrong = {"latency_histogram": [pair], **complete}
        Path("summary.json").write_text(json.dumps({**SUMMARY, **wrong}))
        check(dahl(verb, "."), 2, "latency_histogram = ")
    for left_out in complete:
        known = {key: value for key, value in complete.items() if key != left_out}
        Path("summary.json").write_text(json.dumps({**SUMMARY, "latency_histogram": [], **known}))
        check(dahl(verb, "."), 2, "latency_histogram")


@pytest.mark.parametrize("verb", ["report", "plot"])
@pytest.mark.parametrize(
    "numbers",
    [
        {"scene": "commission", "result": None},
        {"scene": "commission", "result": {"gain": "wide"}, "tracking_rms_rad": {}},
        {"scene": "park-steer"},
        {"scene": "park-steer", "without": {}, "with": {"width_Nm": "wide"}},
        {"scene": "compensation", "position": [], "hand": {}},
        {"scene": "compensation", "position": {"a": {"dahl": {}}}, "hand": {"a": {"dahl": 1}}},
    ],
)
def test_a_summary_of_a_simulated_scene_has_its_numbers(dahl, verb, numbers):
    Path("summary.json").write_text(json.dumps(numbers))
    check(dahl(verb, "."), 2, f"summary.json: ... {numbers['scene']}")


@pytest.mark.parametrize("seed", [-1, 1.5, "1", 2**70, None])
def test_a_seed_of_a_summary_is_a_number(dahl, seed):
    cases = {"a": {"dahl": {"ratio": 0.5}}}
    numbers = {"scene": "compensation", "seed": seed, "position": cases, "hand": cases}
    Path("summary.json").write_text(json.dumps(numbers))
    if seed is not None:  # null: the seed of the demo
        check(dahl("plot", "."), 2, f"summary.json: seed = {seed}")
    check(dahl("report", "."), 2, "compensation.png: ... dahl plot")


@pytest.mark.parametrize("content", [*NO_JSON, None], ids=lambda each: str(each)[:20])
def test_a_summary_must_be_json(dahl, content):
    Path("run.log").touch()
    path = Path("summary.json")
    path.mkdir() if content is None else path.write_bytes(content)
    for words in ("report .", "plot .", "excite --from summary.json --counts-per-turn 9 -o ."):
        assert len(check(dahl(*words.split()), 2, "summary.json")) < 300


# --- outputs --------------------------------------------------------------------------------------


@pytest.fixture
def finished_run(dahl) -> Path:
    (run := Path("run")).mkdir()
    words = ["loop", "--scene", SUMMARY["scene_file"], "--virtual"]
    assert dahl(*words, "--seconds", "0.1", "--log", run / "run.log").returncode == 0
    (run / "summary.json").write_text(json.dumps(SUMMARY))
    (run / "loop.png").write_bytes(b"\x89PNG" + bytes(3000))
    return run


UNUSABLE_OUTPUTS = [
    (".", 2, "folder"),
    ("run", 2, "folder"),
    ("/dev/full", 1, "No space left on device"),
    ("none/x", 1, "No such file or directory"),
    ("x" * 300, 1, "File name too long"),
]


@pytest.mark.parametrize(("where", "code", "fact"), UNUSABLE_OUTPUTS)
def test_an_output_that_cannot_be_written_is_refused_and_leaves_nothing(
    dahl, finished_run, where, code, fact
):
    theta = sine(1, rows=600, cycles=5)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)
    write_csv("shaft.csv", theta, torque)
    before = contents()
    for words in ("report run -o", "plot run -o", "identify shaft.csv --no-files --json"):
        line = check(dahl(*words.split(), where), code, "")
        assert fact in line and where in line
    assert contents() == before


OUTPUTS_OF_A_DEMO = "loop.png params.m4f.bin own.ini run.log summary.json trace.csv node.err"


@pytest.mark.parametrize("name", OUTPUTS_OF_A_DEMO.split())
def test_a_demo_does_not_overwrite_its_log(dahl, name):
    Path(name).write_text("a\n1\n")
    motion = f"[motion]\nkind = log\nfile = {name}\nangle = a\ncounts_per_unit = 1\n"
    Path("scene").write_text(motion)
    for words in ((name,), ("--scene", "scene")):
        check(dahl("demo", *words, "--output", "."), 2, f"{name}: ... -o")
    assert Path(name).read_text() == "a\n1\n"


def test_a_demo_that_recorded_no_tick_is_one_line(dahl, monkeypatch):
    def record_no_frame(setup, *_: object) -> dict[str, object]:
        (setup.folder / "run.log").touch()
        return {"interrupted": False}

    monkeypatch.setattr("dahl.sim.recorded_run.run", record_no_frame)
    done = dahl("demo", "--scene", "segments", "-o", "out")
    check(done, 1, "not compared: out/run.log: no frames")


@pytest.mark.parametrize("name", ["trace.csv", "run.log"])
def test_a_full_disk_during_a_demo_is_reported(dahl, name):
    Path(name).symlink_to("/dev/full")
    done = dahl("demo", "--scene", "parking", "--seconds", 0.3, "--output", ".")
    check(done, 1, f"{name}: No space left on device")


def run_limited(run_dahl, folder: Path, size: int, *words: str) -> subprocess.CompletedProcess:
    """Run a command in a process that may write no file beyond this size, as on a full disk."""
    limit = (size, size)
    return run_dahl(
        *words, cwd=folder, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    )


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ("plan.h", "plan --sigma0 1 --fc 1 --theta-per-count 1e-3 --force -o plan.h"),
        ("bus.dbc", "dbc --force -o bus.dbc"),
        ("own.csv", f"demo shaft.csv {COLUMNS} {SHAFT} --output ."),
    ],
)
def test_a_full_disk_keeps_the_old_file(run_dahl, tmp_path, kept, words):
    """A demo renames a file of the user to NAME~ before it writes its own."""
    write_log(tmp_path / "shaft.csv")
    (tmp_path / kept).write_text("old")
    check(run_limited(run_dahl, tmp_path, 0, *shlex.split(words)), 1, f"{kept}: File too large")
    (left,) = tmp_path.glob(f"{kept}*")
    assert left.read_text() == "old" and not [*tmp_path.glob(".*")]


def test_a_full_disk_leaves_whole_lines_in_the_record_of_a_demo(run_dahl, tmp_path):
    words = "demo --scene steering --seconds 2 --bus socketcand -o ."
    check(run_limited(run_dahl, tmp_path, 50003, *words.split()), 1, "run.log: File too large")
    text = (tmp_path / "run.log").read_bytes()
    assert text.endswith(b"\n") and 50003 - 50 < len(text) <= 50003


# --- the environment ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("variable", "fact", "words"),
    [
        ("DAHL_LIBRARY", "none.so", PLAN),
        ("DAHL_LIBRARY", "none.so", "record -i virtual -c quiet -o x.log --seconds 0.1"),
        ("DAHL_BUILD_DIR", "lib/libdahl.so", PLAN),
        ("DAHL_BUILD_DIR", "dahl-loop", "demo --scene segments"),
        ("DAHL_FMU", "none.so", "fmu --sigma0 1 --fc 1 -o x.fmu"),
    ],
)
def test_a_missing_build_is_named(run_dahl, root, tmp_path, variable, fact, words):
    env = {
        key: text for key, text in os.environ.items() if key not in ("DAHL_LIBRARY", "DAHL_LOOP")
    }
    env |= {"DAHL_LIBRARY": "", variable: str(tmp_path / ("none.so" * (fact == "none.so")))}
    if variable != "DAHL_LIBRARY" and words != PLAN:
        env["DAHL_LIBRARY"] = os.environ["DAHL_LIBRARY"]
    env["PYTHONPATH"] = str(root / "tools")
    line = check(run_dahl(*words.split(), env=env, cwd=tmp_path), 1, fact)
    assert f"{tmp_path}/" in line and "build" in line.replace(str(tmp_path), "")


def test_a_missing_package_of_one_option_is_named_with_its_extra(dahl, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "cantools", None)
    done = dahl("identify", "run.log", "--dbc", "other.dbc", "--angle", "A", "--torque", "T")
    line = check(done, 1, "dahl identify needs cantools; pip install")
    assert "'.[can]'" in line


def test_too_little_memory_is_one_line(root):
    """A command that needs 8 GiB in a process that may have 2 GiB."""
    code = (
        "import resource, sys, numpy; from dahl.cli import main; from dahl.commands import data;"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 31, 1 << 31));"
        "data.run = lambda _: numpy.ones(1 << 30); sys.exit(main(['data']))"
    )
    check(call(sys.executable, "-c", code, cwd=root), 1, "memory")
