# SPDX-License-Identifier: MIT
"""dahl-loop refuses a bad scene, log or option in one line with place, key, value and limit, exits
with 2 and runs nothing. Each number is accepted up to its limits.
"""

from __future__ import annotations

import re
from pathlib import Path

import dahl
import numpy as np
import pytest
from dahl.binding import models
from loop_tools import SCENES, run_program, setting

GOOD = {
    "scene": "[scene]\ntitle = t",
    "friction": "[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4",
    "motion": "[motion]\nkind = log\nfile = log.csv\nangle = angle\ntime = t\ncounts_per_unit = 10",
    "status": "[status]\nperiod_ms = 100",
}
TABLE = "t,angle,note\n0,1,a\n1,2,b\n2,3,c\n"


def scene_of(**sections: str) -> str:
    """The good scene with some sections replaced. [friction] is line 3, [motion] 7, [status] 13."""
    return "\n".join({**GOOD, **sections}.values())


def write(folder: Path, scene: str | bytes, table: str | bytes = TABLE) -> Path:
    for name, text in (("log.csv", table), ("scene.ini", scene)):
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / "scene.ini"


def refused(place: str, facts: list[str], *options: object) -> str:
    """Check the one line: it begins with the place and has these facts."""
    done = run_program(*options)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done
    assert done.stderr.startswith(f"error: {place}"), done.stderr
    for fact in facts:
        assert re.search(rf"(?<![\w.]){re.escape(fact)}(?!\w|\.\d)", done.stderr), (
            fact,
            done.stderr,
        )
    return done.stderr


def friction(**keys: object) -> str:
    """Keys of [friction] from line 4 on. None leaves a key out."""
    known = {"sigma0": 1, "Fc": 1, "theta_per_count": 1} | keys
    lines = [f"{name} = {value}" for name, value in known.items() if value is not None]
    return scene_of(friction="\n".join(["[friction]", *lines]))


def model(name: str, sigma0: object = "1 2", Fc: object = "1 2", **keys: str) -> str:  # noqa: N803
    """[friction] with a model in line 4, its own keys from line 5 on, theta_per_count last."""
    known = {"model": name, **keys, "sigma0": sigma0, "Fc": Fc, "theta_per_count": 1}
    return scene_of(friction="\n".join(["[friction]", *(f"{k} = {v}" for k, v in known.items())]))


ROTOR = "[rotor]\ninertia = 0.1\nviscous = 0\nsigma0 = 50\nFc = 0.5\n"
MOTOR = "[motor]\nseconds = 1\n"
CONTROL = "[control]\nkp = 1\nkd = 1\ntorque_limit = 1\n"
LOADED = "[friction]\nmodel = loaded\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
BREAKAWAY = models.with_key("breakaway").name
NINE = "1 2 3 4 5 6 7 8 9"
REPLAY = GOOD["motion"]
SCENE_ERRORS = [  # scene, line, words of the error
    (scene_of(friction="[friction]"), 3, "[friction] sigma0"),
    (friction(sigma0="1 2"), 5, "[friction] sigma0 2 Fc 1 dahl"),
    (friction(sigma0="1 2", Fc="1 2"), 5, "[friction] sigma0 2 Fc dahl"),
    (friction(theta_per_count=1e-12), 6, "theta_per_count 1e-12 9.31322575e-10 1048576"),
    (friction(sigma0=1e15), 6, "theta_per_count 1e+15 9.31322575e-10 1048576"),
    (friction(theta_per_count=3.7e-26), 6, "theta_per_count 3.7e-26 5.42101086e-20 1.84467441e+19"),
    (friction(sigma0=0), 4, "[friction] sigma0 0 5.421010862e-20"),
    (friction(Fc="abc"), 5, "[friction] Fc abc"),
    (friction(Fc=""), 5, "[friction] Fc"),
    (model("lugre"), 4, f"[friction] model lugre slip {BREAKAWAY}"),
    (model("slip", "1 2 3"), 6, "[friction] sigma0 3 Fc 2 slip"),
    (model("slip", NINE, 1), 5, f"[friction] sigma0 {NINE} 8"),
    (model("slip", "1 x", "1 1"), 5, "[friction] sigma0 x"),
    (model("slip", "1 1e-9", "1 1e9"), 7, "theta_per_count 1e-18 9.31322575e-10 1048576"),
    (model("slip", kinds="slip slip"), 5, "[friction] kinds slip"),
    (model("slip", breakaway="0.5"), 5, "[friction] breakaway slip"),
    (model("parallel"), 4, "[friction] parallel kinds"),
    (model("parallel", kinds="dahl lugre"), 5, "[friction] kinds lugre dahl slip"),
    (model("parallel", kinds="dahl"), 5, "[friction] kinds 1 2"),
    (model("parallel", kinds="dahl slip dahl"), 5, "[friction] kinds 3 2"),
    (model("parallel", 1, kinds="dahl slip"), 7, "[friction] sigma0 1 Fc 2 parallel"),
    (model("parallel", "1 1e-9", "1 1e9", kinds="dahl slip"), 8, "theta_per_count 1e-18"),
    (model("asymmetric", 1, 1), 6, "[friction] sigma0 1 Fc 1 asymmetric"),
    (model("asymmetric"), 6, "[friction] sigma0 2 Fc 2 asymmetric"),
    (model("asymmetric", 1, "1 1e10"), 7, "theta_per_count 1e-10"),
    (model(BREAKAWAY, 1, 1), 4, f"[friction] {BREAKAWAY} breakaway"),
    (model(BREAKAWAY, breakaway="0.5"), 7, f"[friction] sigma0 2 Fc {BREAKAWAY}"),
    (model("loaded", 1, 1), 4, "loaded [load]"),
    (scene_of(status="[load]\nfull = 1"), 13, "[load] dahl"),
    (scene_of(friction="[load]\nfull = 1"), 3, "[load] [friction]"),
    (scene_of(friction=LOADED, status="[load]\nfull = 1"), 15, '[load] "column"'),
    (
        scene_of(friction=LOADED + ROTOR, motion="[load]\nfull = 1\ncolumn = x", status=MOTOR),
        16,
        "[load] column [rotor]",
    ),
    (scene_of(friction=LOADED, motion="[load]\nfull = 1", status=""), 9, "[load] [rotor] column"),
    (scene_of(friction="[friction]\nsigma0 = 1\nsigma0 = 2\nFc = 1"), 5, "[friction] sigma0 4"),
    (scene_of(friction="[friction]\nsigma = 1"), 4, '"sigma" [friction]'),
    (scene_of(friction="[friction]\nsigma0"), 4, ""),
    (scene_of(scene="[scene]\ntitle ="), 2, "[scene] title"),
    (scene_of(scene="[scene]\ntitle = " + "t" * 160), 2, "[scene] title"),
    (scene_of(friction="[fricton]\nsigma0 = 1"), 3, "[fricton]"),
    (scene_of(status="[bonus]"), 13, "[bonus]"),
    (scene_of(friction="[friction\nsigma0 = 1"), 3, ""),
    (scene_of(friction="[friction]\nsigma0 = " + "1" * 300), 4, "198"),
    (scene_of(motion="[motion]\nfile = x"), 7, "[motion] kind"),
    (scene_of(motion="[motion]\nkind = sine"), 8, "[motion] kind sine segments steering log"),
    (scene_of(motion=f"{REPLAY}\nspeed = 1"), 13, "[motion] speed log"),
    (scene_of(motion=f"{REPLAY}\nfile ="), 13, "[motion] file 9"),
    (scene_of(status="[faults]\ndrop = 0.5"), 13, "[faults] [friction] max_step"),
    (scene_of(status="[faults]\ndrop = 10 %"), 14, "[faults] drop 10"),
    (scene_of(status="[faults]\nloss = 0.1"), 14, '"loss" [faults]'),
    (scene_of(status="[faults]\ndrop = 0.6\nid = 0.6"), 13, "[faults] 1.2 1"),
    (scene_of(status=ROTOR), 13, "[rotor] [motor] [control]"),
    (scene_of(status=ROTOR + MOTOR), 7, "[motor] [motion]"),
    (scene_of(status=MOTOR), 7, "[motor] [motion]"),
    (scene_of(status=ROTOR + MOTOR + CONTROL), 13, "[rotor] [motor] [control]"),
    (scene_of(status=CONTROL), 13, "[control] [rotor]"),
    (scene_of(motion=ROTOR + CONTROL), 12, "[control] [motion]"),
    (scene_of(friction=ROTOR + CONTROL), 3, "[rotor] [friction]"),
    (scene_of(motion=MOTOR), 7, "[motor] [rotor]"),
    ("[scene]\ntitle = empty", "", "[friction] [motion]"),
    ("", "", "[friction] [motion]"),
    ("sigma0 = 1\n[friction]", 1, '"sigma0"'),
    ("\x00\x01\x02binary\xff\n", 1, "198"),
]


@pytest.mark.parametrize(("scene", "line", "words"), SCENE_ERRORS)
def test_a_bad_scene_is_refused(tmp_path, scene, line, words):
    path = write(tmp_path, scene)
    refused(f"{path}:{line}".rstrip(":") + ":", words.split(), "--scene", path)


TABLE_ERRORS = [  # rows of a log, line, words of the error
    ("", 1, '"angle"'),
    ("t,angle,note\n", 2, '"angle"'),
    ("t,winkel,note\n0,1,a\n", 1, '"angle" "t" "winkel" "note"'),
    ("time,angle,note\n0,1,a\n", 1, '"t" "time"'),
    ("t,angle,angle\n0,1,1\n", 1, '"angle"'),
    ("t,angle,t\n0,1,1\n", 1, '"t"'),
    ("t,angle,note\nx,y,a\nz\n", 2, '"t" "x"'),  # the first of many
    ("t,angle,note\n0,1,a\n1,,b\n", 3, '"angle" ""'),
    ("t,angle,note\n0,1,a\n1,nan,b\n", 3, '"angle" "nan"'),
    ("t,angle,note\n0,1,a\n1,-inf,b\n", 3, '"angle" "-inf"'),
    ("t,angle,note\n0,1,a\n1,1e999,b\n", 3, '"angle" "1e999"'),
    ("t,angle,note\n0,1,a\n\n1,2 3,b\n", 4, '"angle" 2 3'),
    ("t,angle,note\n0,1,a\n2,2,b\n1,3,c\n", 4, '"t" 2 1'),
    ("t,angle,note\n0,1,a\n1,2\n", 3, '"angle" 2 3'),
    ("t,angle,note\n0,1,a\n1,2", 3, '"angle" 2 3'),
    ("t,angle,note\n0,1,a\n1,2,b,c\n", 3, '"angle" 4 3'),
    ("t,angle,note\n0,1,a\n1,1e9,b\n", 3, '"angle" 1e+09 9.99999999e+09 2^31'),
    ("t,angle,note\n0,1,a\n1,214748365.7,b\n", 3, '"angle" 214748366 2.14748365e+09 2^31'),
    ("t,angle,note\n0,1,a\n1,-214748363.7,b\n", 3, '"angle" -214748364 -2.14748365e+09 2^31'),
    ('t,angle,note\n0,"1\n\a",a\n', 3, '"angle" "1??"'),
    ('t,angle,note\n0,1,"a\n1,2,b\n', 4, "3"),
    ('t,angle,note\n0,1,"' + "a" * 200000, 2, "3"),
    (b"\x00\x01\x02\xff\xfe", 1, '"angle"'),
]


@pytest.mark.parametrize(("table", "line", "words"), TABLE_ERRORS)
def test_a_bad_log_is_refused(tmp_path, table, line, words):
    path = write(tmp_path, scene_of(), table)
    refused(f"{tmp_path}/log.csv:{line}: ", words.split(), "--scene", path)


@pytest.mark.parametrize(
    ("header", "line", "words"),
    [
        ("angle,other", 1, '"load" "angle" "other"'),
        ("load,angle,load", 1, '"load"'),
        ("angle,load", 3, '"load" "x"'),
        ("load", 3, '"x"'),  # as both columns: reported once
    ],
)
def test_a_bad_column_of_a_load_is_refused(tmp_path, header, line, words):
    angle = "load" if header == "load" else "angle"
    motion = REPLAY.replace("angle = angle\ntime = t", f"angle = {angle}")
    load = "[load]\nfull = 1\ncolumn = load"
    rows = "".join(",".join(["0"] * header.count(",") + [cell]) + "\n" for cell in "0x")
    scene = scene_of(friction=LOADED, motion=motion, status=load)
    path = write(tmp_path, scene, f"{header}\n{rows}")
    refused(f"{tmp_path}/log.csv:{line}: ", words.split(), "--scene", path)


def test_a_long_list_of_columns_is_cut(tmp_path):
    names = ["t", *(f"column {k}" for k in range(100))]
    path = write(tmp_path, scene_of(), f"{','.join(names)}\n{'0,' * 100}0\n")
    error = refused(f"{tmp_path}/log.csv:1: ", ['"angle"'], "--scene", path)
    assert ", ".join(f'"{name}"' for name in names)[:255] + "\n" in error


@pytest.mark.parametrize(
    ("title", "shown"),
    [
        (b"caf\xe9", "caf?"),
        (b"\xc0\xaf", "??"),
        (b"\xed\xa0\x80", "???"),
        (b"\xf4\x90\x80\x80", "????"),
        (b"\xe2\x82", "??"),
        ("é€😀".encode() + b"\x80x", "é€😀?x"),
    ],
)
def test_a_title_must_be_utf8_and_is_shown(tmp_path, title, shown):
    path = write(tmp_path, scene_of().encode().replace(b"title = t", b"title = " + title))
    assert f"title = {shown}: " in refused(f"{path}:2: [scene] ", [], "--scene", path)


def test_control_characters_in_a_message_are_replaced():
    words = ("--scene", SCENES / "steering.ini", "--set")
    assert "kind = ?? ?~: " in refused("--set:1: ", [], *words, "motion.kind=\x01\x1f \x7f~")
    assert "kind = é€😀: " in refused("--set:1: ", [], *words, "motion.kind=é€😀")


# --- required keys, words, numbers ----------------------------------------------------------------

ENDS = ("theta1 = 2", "theta2 = 1", "theta3 = 2", "speed = 1000")
SWEEPS = ("amplitude = 9", "sweep_s = 1", "tremor = 1", "tremor_s = 1", "seconds = 0.01")
DAHL = {"friction": ("sigma0 = 50", "Fc = 0.5", "theta_per_count = 1e-4")}
SHAFT = {**DAHL, "rotor": ("inertia = 0.1", "sigma0 = 50", "Fc = 0.5")}
LEAST = {  # the required keys of each part
    "segments": {**DAHL, "motion": ("kind = segments", *ENDS)},
    "steering": {**DAHL, "motion": ("kind = steering", *SWEEPS)},
    "log": {"motion": ("kind = log", "file = log.csv", "angle = angle", "counts_per_unit = 10")},
    "motor": {
        **SHAFT,
        "friction": ("model = loaded", *DAHL["friction"]),
        "motor": ("seconds = 0.01",),
        "load": ("full = 1",),
    },
    "control": {
        **SHAFT,
        "motion": ("kind = segments", *ENDS),
        "control": ("kp = 1", "kd = 1", "torque_limit = 1"),
        "status": ("period_ms = 5",),
    },
}


def text_of(sections: dict) -> str:
    return "\n".join(f"[{name}]\n" + "\n".join(keys) for name, keys in sections.items())


@pytest.mark.parametrize("name", LEAST)
def test_only_required_keys_are_required(tmp_path, name):
    """A scene runs without optional keys; each missing required key is named. Any line ends, a byte
    order mark, comments.
    """
    text = text_of(LEAST[name])
    measured = f"{text}\n[measured]\ntorque = Friction [uN]\nspring = none\n"
    forms = (text, f"\ufeff{text}", f"; a word\n\t{text}", measured.replace("\n", "\r\n"))
    logs = []
    for form in forms:
        path = write(tmp_path, form)
        done = run_program("--scene", path, "--virtual", "--log", tmp_path / "run.log")
        assert (done.returncode, done.stderr) == (0, "")
        logs.append((tmp_path / "run.log").read_bytes())
    assert set(logs) == {logs[0]} and len(logs[0]) > 90
    for section, key in ((section, key) for section, keys in LEAST[name].items() for key in keys):
        left = {**LEAST[name], section: [other for other in LEAST[name][section] if other != key]}
        write(tmp_path, text_of(left))
        if not key.startswith("model"):
            refused(f"{path}:", [f"[{section}]", key.split(" ")[0]], "--scene", path)


WORDS = [("motion.kind", name) for name in ("segments", "steering", "log")]
WORDS += [("friction.kinds", name) for name in ("dahl", "slip")]
WORDS += [("friction.model", name) for name in models.table()]
WORDS += [("--role", name) for name in ("both", "encoder", "node")]


@pytest.mark.parametrize(("key", "name"), WORDS)
def test_a_word_must_be_complete(key, name):
    """No abbreviation, no suffix, no capitals."""
    parts = ["friction.model=parallel", "friction.sigma0=1 1", "friction.Fc=1 1"]
    more = setting(*parts) if key == "friction.kinds" else []
    for word in (name[:1], name[:-1], f"{name}s", name.upper()):
        option = [key, word] if key == "--role" else setting(f"{key}={word}")
        words = ("--scene", SCENES / "steering.ini", *more, *option)
        refused("--", [key.rpartition(".")[2], word], *words)


BIG = 2147483647
LIMITS = [  # scene, key, least and greatest value
    ("steering", "friction.node", 0, 15),
    ("steering", "friction.timeout_ms", 1, 60000),
    ("parking", "friction.gain", 0, 1),
    ("parking", "friction.limit", 0, 1),
    ("parking", "friction.ramp_ms", 0, 60000),
    ("steering", "friction.max_step", 1, BIG),
    ("steering", "status.period_ms", 1, 60000),
    ("steering", "motion.start_count", -BIG, BIG),
    *(("segments", f"motion.theta{k}", -BIG, BIG) for k in (1, 2, 3)),
    ("segments", "motion.speed", 1e-9, 1e12),
    ("segments", "motion.hold_s", 0, 3600),
    ("steering", "motion.amplitude", 0, 1e9),
    ("steering", "motion.sweep_s", 0.001, 3600),
    ("steering", "motion.tremor", 0, 1e9),
    ("steering", "motion.tremor_s", 0, 3600),
    ("steering", "motion.seconds", 0.001, 1e9),
    ("creep", "rotor.viscous", 0, 1e6),
    ("creep", "rotor.inertia", 1e-9, 1e6),
    ("creep", "rotor.sigma0", 1e-9, 1e12),
    ("creep", "rotor.Fc", 1e-9, 1e12),
    ("creep", "motor.bias", -1e12, 1e12),
    ("creep", "motor.amplitude", 0, 1e12),
    ("creep", "motor.frequency", 0, 100),
    ("creep", "motor.seconds", 0.001, 1e9),
    ("steering", "friction.breakaway", 1e-37, float(np.nextafter(np.float32(1), 0))),
    ("creep", "load.full", 1e-9, 1e12),
    ("creep", "load.rest", 0, 1),
    *(("parking", f"control.{key}", 0, 1e12) for key in ("kp", "kd", "torque_limit")),
    *(
        ("fault-storm", f"faults.{kind}", 0, 1)
        for kind in "drop duplicate reorder delay corrupt length id extended invalid glitch".split()
        + "babble silence bus_off restart".split()
    ),
]
CALM = [f"{key}=0" for _, key, *_ in LIMITS if key.startswith("faults.")]
BESIDE = {  # other settings of a key, so that only its own limit matters
    "rotor": ["rotor.inertia=1e6", "motor.bias=0", "motor.amplitude=0"],
    "faults": CALM,
    "friction.breakaway": [f"friction.model={BREAKAWAY}"],
    "load": ["friction.model=loaded", "load.full=1"],
}
WHOLE = re.compile(r"\.(node|max_step|start_count|theta\d)$")


@pytest.mark.parametrize(
    ("scene", "key", "low", "high"), LIMITS, ids=[f"{scene} {key}" for scene, key, *_ in LIMITS]
)
def test_each_number_has_its_limits(scene, key, low, high):
    section, _, name = key.partition(".")
    given = BESIDE.get(key, BESIDE.get(section, []))
    beside = [one for one in given if not one.startswith(f"{key}=")]
    words = ["--scene", SCENES / f"{scene}.ini", "--seconds", "0.001", *setting(*beside)]
    place = f"--set:{len(beside) + 1}: [{section}] {name} = "
    for value in (low, high):
        if key == "rotor.inertia" and value == low:
            continue  # too light for a step: see test_loop_control.py
        done = run_program(*words, *setting(f"{key}={value!r}"), "--virtual")
        assert (done.returncode, done.stderr) == (0, ""), value
    whole = bool(WHOLE.search(key))
    for value in (beyond(low, -1, whole), beyond(high, 1, whole)):
        facts = [f"{value!r}", f"{low:.10g}", f"{high:.10g}"]
        refused(place, facts, *words, *setting(f"{key}={value!r}"))
    for value in ("nan", "-inf", "1x", "1 x", *["1.5"] * whole):
        refused(place, [value], *words, *setting(f"{key}={value}"))


def beyond(value: float, side: int, whole: bool) -> float:
    """The next value outside that a user could mean."""
    if whole:
        return int(value) + side
    return value + side * (1e-10 if value == 0 else abs(value) * 1e-6)


OPTION_LIMITS = [
    ("--seconds", "0.001", "1e9", ("0.000999", "1.0001e9", "5m", "", "nan")),
    ("--seed", "0", "18446744073709551615", ("-1", "18446744073709551616", "1x", "")),
    ("--nodes", "1", "16", ("0", "17", "2.5")),
    ("--bitrate", "10000", "1000000", ("9999", "1000001", "500k")),
    ("--with-parent", "1", "2147483647", ("0", "2147483648", "1 2")),
    ("--wait-clients", "0", "16", ("-1", "17", "1.0")),
]


@pytest.mark.parametrize(("option", "least", "greatest", "wrong"), OPTION_LIMITS)
def test_each_option_has_its_limits(option, least, greatest, wrong):
    short = ["--scene", SCENES / "steering.ini", "--set", "motion.seconds=0.001"]
    taken = {"--with-parent": [greatest], "--wait-clients": [least]}.get(option, [least, greatest])
    for value in taken:  # process 1 is not the parent; clients need a served bus
        assert run_program(*short, option, value, "--virtual").returncode == 0, value
    for value in wrong:
        refused(f"{option} {value}: ", [least, greatest], *short, option, value)


def test_rates_of_faults_may_add_up_to_one():
    words = ("--scene", SCENES / "fault-storm.ini", "--seconds", "0.01", *setting(*CALM))
    assert (
        run_program(*words, *setting("faults.drop=0.5", "faults.id=0.5"), "--virtual").returncode
        == 0
    )
    sets = setting("faults.drop=0.5", "faults.id=0.51")
    refused(f"{SCENES}/fault-storm.ini:21: [faults] ", ["1.01", "1"], *words, *sets)


def test_eight_elements_and_32_settings_fit():
    eight = "1 2 3 4 5\t6 \t7  8"  # blanks and tabs, as many as one likes
    sets = ["friction.model=slip", f"friction.sigma0={eight}", f"friction.Fc={eight}"]
    steering = ("--scene", SCENES / "steering.ini", "--seconds", "0.001", "--virtual")
    done = run_program(*steering, *setting(*sets, *["friction.node=1"] * 29))
    assert (done.returncode, done.stderr) == (0, "")
    refused("--set friction.gain=1: ", ["32"], *steering, *setting(*["friction.gain=1"] * 33))


# --- options --------------------------------------------------------------------------------------

OPTION_ERRORS = [  # scene, options, facts of the line
    ("steering", "--frobnicate", "--frobnicate"),
    ("steering", "-xy", "-x"),
    ("steering", "extra", "extra"),
    ("steering", "--seed", "--seed"),
    ("steering", "--role boss", "--role boss both encoder node"),
    ("steering", "--bus can0", "--bus can0 loopback"),
    ("steering", "--bus socketcand:99999", "--bus socketcand:99999"),
    ("steering", "--bus socketcand::5", "--bus socketcand::5"),
    ("steering", "--bus socketcand:127.0.0.1:0", "--bus socketcand:127.0.0.1:0"),
    ("steering", f"--bus socketcand:{'x' * 128}:5", f"--bus socketcand:{'x' * 128}:5"),
    ("steering", "--bus socketcan:", "--bus"),
    ("steering", "--wait-clients 1", "--wait-clients socketcand:PORT loopback"),
    (
        "steering",
        "--until-idle --bus socketcand:localhost:5",
        "--until-idle socketcand:localhost:5",
    ),
    ("steering", "--virtual --bus socketcand:127.0.0.1:5", "--virtual socketcand:127.0.0.1:5"),
    ("steering", "--virtual --lockstep", "--lockstep --virtual"),
    ("steering", "--nodes 2 --set friction.node=15", "--nodes 2 15"),
    ("steering", "--trace x.csv", "--trace x.csv [rotor]"),
    ("steering", "--set friction", "--set friction section.key=value"),
    ("steering", "--set friction.gian=1", '--set:1 "gian" [friction]'),
    ("steering", "--set friction.gain=1 --set bonus.x=1", '--set:2 "x" [bonus]'),
    ("steering", "--set motion.speed=5", "--set:1 [motion] speed steering"),
    ("steering", "--set status.period_ms=9 --set faults.id=0.1", "--set:2 [faults] max_step"),
    ("steering", "--set control.kp=1", "--set:1 [control] kd"),
    (
        "steering",
        "--set friction.node=2 --set friction.theta_per_count=1e-18",
        "--set:2 theta_per_count 1e-18",
    ),
    ("creep", "--set rotor.viscous=1e5", "creep.ini:12 [rotor] inertia 0.02 1"),
    ("creep", "--set rotor.inertia=1e-7", "--set:1 [rotor] inertia 1e-07 5e-06 20"),
    ("creep", "--set friction.gain=0 --set motion.kind=log", "--set:2 [motion] file"),
    ("creep", "--nodes 2", "--nodes 2 [rotor]"),
    ("creep", "--trace x.csv --role node", "--trace x.csv --role node [rotor]"),
    ("steering", "--role node --virtual", "--virtual --seconds"),
]


@pytest.mark.parametrize(("scene", "options", "words"), OPTION_ERRORS)
def test_a_bad_option_is_refused(scene, options, words):
    """A setting is named by its place on the command line, any other key by its line."""
    refused("", words.split(), "--scene", SCENES / f"{scene}.ini", *options.split())


@pytest.mark.parametrize(
    ("role", "name", "missing"), [("node", "motion", "friction"), ("encoder", "friction", "motion")]
)
def test_a_role_needs_its_section(tmp_path, role, name, missing):
    path = write(tmp_path, GOOD[name])
    refused(f"{path}: ", [f"[{missing}]"], "--scene", path, "--role", role)


def test_a_missing_file_is_refused(tmp_path):
    """A folder is refused as well."""
    path = write(tmp_path, scene_of())
    words = ("--scene", path, "--log-file")
    refused(f"{tmp_path}/absent.csv: ", ["No such file"], *words, tmp_path / "absent.csv")
    refused(f"{tmp_path}:", ["Is a directory"], *words, tmp_path)
    refused(f"{tmp_path}/absent.ini: ", ["No such file"], "--scene", tmp_path / "absent.ini")
    refused("no --scene", [])


OPTIONS = (
    "scene bus bitrate nodes set role virtual lockstep seconds seed log trace summary wait-clients"
    " until-idle with-parent data log-file help version"
)


def test_help_lists_each_option_and_version_is_that_of_the_package():
    told = re.findall(
        r"^  --([a-z-]+)(?:, --([a-z-]+))?", run_program("--help").stdout, re.MULTILINE
    )
    assert sorted(name for both in told for name in both if name) == sorted(OPTIONS.split())
    for name in OPTIONS.split():
        assert "unknown option" not in run_program(f"--{name}").stderr
    for option, words in (("--help", "usage: "), ("--version", f"dahl-loop {dahl.__version__}\n")):
        done = run_program(option)
        assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith(words)
