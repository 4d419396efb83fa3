# SPDX-License-Identifier: MIT
"""dahl-loop refuses a bad scene, log or option in one line with place, key, value and limit, exits
with 2 and runs nothing. Each number is accepted up to its limits.
"""

from __future__ import annotations

import re
from pathlib import Path

import can
import dahl
import pytest
from dahl.binding import models
from dahl.sim import scene, scene_keys
from identify_tools import complaint
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


def refused(place: str, facts: str, *options: object) -> str:
    """Check the one line: it begins with the place and has these words, in this order."""
    done = run_program(*options)
    error, words = done.error(2), (re.escape(fact) for fact in facts.split())
    pattern = ".*?".join(rf"(?<![\w.]){word}(?!\w|\.\d)" for word in words)
    assert error.startswith(place) and re.search(pattern, error), (facts, error)
    assert done.out == ""
    return error


def model(name: str, sigma0="1 2", Fc="1 2", theta=1, **keys: str) -> str:  # noqa: N803
    """[friction] with a model in line 4, its own keys from line 5 on, theta_per_count last."""
    known = {"model": name, **keys, "sigma0": sigma0, "Fc": Fc, "theta_per_count": theta}
    return scene_of(friction="\n".join(["[friction]", *(f"{k} = {v}" for k, v in known.items())]))


ROTOR = "[rotor]\ninertia = 0.1\nviscous = 0\nsigma0 = 50\nFc = 0.5\n"
MOTOR = "[motor]\nseconds = 1\n"
HAND = "[hand]\nstiffness = 1\namplitude = 1\nfrequency = 1\n"
CONTROL = "[control]\nkp = 1\nkd = 1\ntorque_limit = 1\n"
LOADED = "[friction]\nmodel = loaded\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
LOAD, COLUMN = "[load]\nfull = 1", "[load]\nfull = 1\ncolumn = x"
BREAKAWAY = models.with_key("breakaway").name
REPLAY = GOOD["motion"]
NODE_ERRORS = [  # scene, line, words of the error of dahl-loop; Python refuses them too
    (scene_of(friction="[friction]"), 3, "[friction] sigma0"),
    (model("dahl", "1 2", 1), 6, "[friction] sigma0 2 Fc 1 dahl"),
    (model("dahl", 1, 1, 1e-12), 7, "theta_per_count 1e-12 9.31322575e-10 1048576"),
    (model("dahl", 1, 1, 3.7e-26), 7, "theta_per_count 3.7e-26 5.42101086e-20 1.84467441e+19"),
    (model("lugre"), 4, f"[friction] model lugre slip {BREAKAWAY}"),
    (model("slip", "1 2 3"), 6, "[friction] sigma0 3 Fc 2 slip"),
    (model("slip", "1 1e-9", "1 1e9"), 7, "theta_per_count 1e-18 9.31322575e-10 1048576"),
    (model("slip", kinds="slip slip"), 5, "[friction] kinds slip"),
    (model("slip", breakaway="0.5"), 5, "[friction] breakaway slip"),
    (model("parallel"), 4, "[friction] parallel kinds"),
    (model("parallel", kinds="dahl lugre"), 5, "[friction] kinds lugre dahl slip"),
    (model("parallel", kinds="dahl"), 5, "[friction] kinds 1 2"),
    (model("parallel", 1, kinds="dahl slip"), 7, "[friction] sigma0 1 Fc 2 parallel"),
    (model("asymmetric", 1, 1), 6, "[friction] sigma0 1 Fc 1 asymmetric"),
    (model("asymmetric"), 6, "[friction] sigma0 2 Fc 2 asymmetric"),
    (model("asymmetric", 1, "1 1e10"), 7, "theta_per_count 1e-10"),
    (model(BREAKAWAY, 1, 1), 4, f"[friction] {BREAKAWAY} breakaway"),
    (model(BREAKAWAY, breakaway="0.5"), 7, f"[friction] sigma0 2 Fc {BREAKAWAY}"),
]
SCENE_ERRORS = [
    (model("loaded", 1, 1), 4, "loaded [load]"),
    (scene_of(status=LOAD), 13, "[load] dahl"),
    (scene_of(friction=LOAD), 3, "[load] [friction]"),
    (scene_of(friction=LOADED, status=LOAD), 15, '[load] "column"'),
    (scene_of(friction=LOADED + ROTOR, motion=COLUMN, status=MOTOR), 16, "[load] column [rotor]"),
    (
        scene_of(friction=LOADED, status=COLUMN + "\nrotor_limit = 1"),
        18,
        "[load] rotor_limit [rotor]",
    ),
    (scene_of(friction=LOADED, motion=LOAD, status=""), 9, "[load] [rotor] column"),
    (scene_of(friction="[friction]\nsigma0"), 4, ""),
    (scene_of(friction="[fricton]\nsigma0 = 1"), 3, "[fricton]"),
    (scene_of(friction="[friction\nsigma0 = 1"), 3, ""),
    (scene_of(friction="[friction]\nsigma0 = " + "1" * 300), 4, "198"),
    (scene_of(status="[sectoin]"), 13, "[sectoin]"),
    (scene_of(status="[measured]\ntorqe = x"), 14, '"torqe" [measured]'),
    (scene_of(motion="[motion]\nfile = x"), 7, "[motion] kind"),
    (scene_of(motion="[motion]\nkind = sine"), 8, "[motion] kind sine segments steering log"),
    (scene_of(motion=f"{REPLAY}\nspeed = 1"), 13, "[motion] speed log"),
    (scene_of(status="[faults]\ndrop = 0.5"), 13, "[faults] [friction] max_step"),
    (scene_of(status=ROTOR), 13, "[rotor] [motor] [control]"),
    (scene_of(status=ROTOR + MOTOR), 7, "[motor] [motion]"),
    (scene_of(status=ROTOR + MOTOR + CONTROL), 13, "[rotor] [motor] [control]"),
    (scene_of(status=CONTROL), 13, "[control] [rotor]"),
    (scene_of(motion=ROTOR + CONTROL), 12, "[control] [motion]"),
    (scene_of(friction=ROTOR + CONTROL), 3, "[rotor] [friction]"),
    (scene_of(motion=MOTOR), 7, "[motor] [rotor]"),
    (scene_of(status=HAND), 13, "[hand] [rotor]"),
    ("", "", "[friction] [motion]"),
    ("sigma0 = 1\n[friction]", 1, '"sigma0"'),
    ("\x00\x01\x02binary\xff\n", 1, "198"),
]


@pytest.mark.parametrize(("text", "line", "words"), NODE_ERRORS + SCENE_ERRORS)
def test_a_bad_scene_is_refused(tmp_path, text, line, words):
    path = write(tmp_path, text)
    refused(f"{path}:{line}".rstrip(":") + ":", words, "--scene", path)
    if (text, line, words) in NODE_ERRORS:
        with pytest.raises(dahl.Error):
            scene.element(scene.read(path))


NAMES = {  # sections that replace those of the good scene, and the place of the unknown name
    "[sectoin]": {"status": "[sectoin]"},
    "[fricton]": {"friction": "[fricton]\nsigma0 = 1"},
    "[DEFAULT]": {"scene": "[DEFAULT]\ntitle = t"},
    "[friction] has no key 'sgima0'": {"friction": "[friction]\nsgima0 = 1\nFc = 1"},
    "[status] has no key 'period'": {"status": "[status]\nperiod = 1"},
    "[motion] has no key 'File'": {"motion": "[motion]\nkind = log\nFile = x"},
    "[measured] has no key 'torqe'": {"status": "[measured]\ntorqe = x"},
}


@pytest.mark.parametrize("place", NAMES)
@pytest.mark.parametrize(
    "words", ["node -i virtual -c x", "monitor -i virtual -c x", "plot log.csv", "demo -o out"]
)
def test_an_unknown_name_in_a_scene_is_found_before_a_bus_is_opened(
    dahl_here, monkeypatch, tmp_path, words, place
):
    path = write(tmp_path, scene_of(**NAMES[place]))
    monkeypatch.setattr(can, "Bus", lambda **_: pytest.fail("a bus was opened"))
    monkeypatch.chdir(tmp_path)
    done = dahl_here(*words.split(), "--scene", path)
    code, line = complaint(done)
    assert code == 2 and line.startswith(f"{path}: ") and place in line


LOG_ERRORS = [  # text of a log, line, words of the error
    ("", 1, '"angle"'),
    ("t,angle,note\n", 2, '"angle"'),
    ("t,winkel,note\n0,1,a\n", 1, '"angle" "t" "winkel" "note"'),
    ("time,angle,note\n0,1,a\n", 1, '"t" "time"'),
    ("t,angle,angle\n0,1,1\n", 1, '"angle"'),
    ("t,angle,note\nx,y,a\nz\n", 2, '"t" "x"'),  # the first of many
    ("t,angle,note\n0,1,a\n1,,b\n", 3, '"angle" ""'),
    ("t,angle,note\n0,1,a\n1,nan,b\n", 3, '"angle" "nan"'),
    ("t,angle,note\n0,1,a\n1,1e999,b\n", 3, '"angle" "1e999"'),
    ("t,angle,note\n0,1,a\n\n1,2 3,b\n", 4, '"angle" 2 3'),
    ("t,angle,note\n0,1,a\n2,2,b\n1,3,c\n", 4, '"t" 2 1'),
    ("t,angle,note\n0,1,a\n1,2\n", 3, '"angle" 2 3'),
    ("t,angle,note\n0,1,a\n1,2,b,c\n", 3, '"angle" 4 3'),
    ("t,angle,note\n0,1,a\n1,1e9,b\n", 3, '"angle" 1e+09 9.99999999e+09 2^31'),
    ("t,angle,note\n0,1,a\n1,214748365.7,b\n", 3, '"angle" 214748366 2.14748365e+09 2^31'),
    ("t,angle,note\n0,1,a\n1,-214748363.7,b\n", 3, '"angle" -214748364 -2.14748365e+09 2^31'),
    ('t,angle,note\n0,"1\n\a",a\n', 3, '"angle" "1??"'),
    ('t,angle,note\n0,1,"a\n1,2,b\n', 4, "3"),
    ('t,angle,note\n0,1,"' + "a" * 200000, 2, "3"),
    (b"\x00\x01\x02\xff\xfe", 1, '"angle"'),
]
LOAD_ERRORS = [  # the same with two columns that are read
    ("angle,other\n0,0\n", 1, '"load" "angle" "other"'),
    ("load,angle,load\n0,0,0\n", 1, '"load"'),
    ("angle,load\n0,0\n0,x\n", 3, '"load" "x"'),
]
WITHOUT_TIME = REPLAY.replace("\ntime = t", "")
WITH_LOAD = scene_of(friction=LOADED, motion=WITHOUT_TIME, status=f"{LOAD}\ncolumn = load")
BAD_LOGS = [(scene_of(), *row) for row in LOG_ERRORS] + [(WITH_LOAD, *row) for row in LOAD_ERRORS]


@pytest.mark.parametrize(("text", "table", "line", "words"), BAD_LOGS)
def test_a_bad_log_is_refused(tmp_path, text, table, line, words):
    path = write(tmp_path, text, table)
    refused(f"{tmp_path}/log.csv:{line}: ", words, "--scene", path)


def test_a_long_list_of_columns_is_cut(tmp_path):
    names = ["t", *(f"column {k}" for k in range(100))]
    path = write(tmp_path, scene_of(), f"{','.join(names)}\n{'0,' * 100}0\n")
    error = refused(f"{tmp_path}/log.csv:1: ", '"angle"', "--scene", path)
    assert error.endswith(", ".join(f'"{name}"' for name in names)[:255])


SHOWN = [  # bytes of a word, its text in the message
    (b"caf\xe9", "caf?"),
    (b"\xc0\xaf\xed\xa0\x80", "?????"),
    (b"\xf4\x90\x80\x80\xe2\x82", "??????"),
    ("é€😀".encode() + b"\x80x", "é€😀?x"),
    (b"\x01\x1f \x7f~\xff", "?? ?~?"),
]


@pytest.mark.parametrize(("title", "shown"), SHOWN)
def test_a_text_must_be_utf8_and_is_shown_without_control_characters(tmp_path, title, shown):
    path = write(tmp_path, scene_of().encode().replace(b"title = t", b"title = " + title))
    assert f"title = {shown}: " in refused(f"{path}:2: [scene] ", "", "--scene", path)


# --- required keys, words, numbers ----------------------------------------------------------------

SHAFT = "[rotor]\ninertia = 0.1\nsigma0 = 50\nFc = 0.5\n[motor]\nseconds = 0.01\n[load]\nfull = 1\n"
LEAST = {  # scenes: each with all parts that it can have
    "log": scene_of(),
    "loaded": LOADED + SHAFT + HAND,
    **{name: (SCENES / f"{name}.ini").read_text() for name in ("segments", "parking")},
}


@pytest.mark.parametrize("name", LEAST)
def test_only_required_keys_are_required(tmp_path, name):
    lines, section = LEAST[name].splitlines(), ""
    for number, line in enumerate(lines):
        section = line.strip("[]") if line.startswith("[") else section
        key = scene_keys.keys().get((section, line.partition(" =")[0]))
        path = write(tmp_path, "\n".join(lines[:number] + lines[number + 1 :]))
        if key and key.need == "REQUIRED":
            refused(f"{path}:", f"[{section}] {key.name}", "--scene", path)
        elif key and key.name not in ("model", "max_step"):
            done = run_program("--scene", path, "--virtual", "--seconds", "0.001")
            assert (done.code, done.err) == (0, ""), line


def test_a_scene_may_come_from_any_editor(tmp_path):
    text, logs = scene_of(), set()
    measured = f"{text}\n[measured]\ntorque = Friction [uN]\nspring = none\n"
    for form in (text, f"\ufeff{text}", f"; a word\n\t{text}", measured.replace("\n", "\r\n")):
        path = write(tmp_path, form)
        done = run_program("--scene", path, "--virtual", "--log", tmp_path / "run.log")
        assert (done.code, done.err) == (0, "")
        logs.add((tmp_path / "run.log").read_bytes())
    assert len(logs) == 1


HIDDEN = ("sigma0", "Fc", "theta_per_count", "counts_per_unit")  # by other limits: see the table
PLACES = {  # a scene with this section
    **dict.fromkeys(("rotor", "motor", "load", "hand"), "creep"),
    "control": "parking",
    "faults": "fault-storm",
}
CALM = [f"faults.{name}=0" for name in scene_keys.names("faults")]
BESIDE = {  # other settings of a section or a key, so that only the limit of one key matters
    "rotor": ["rotor.inertia=1e6", "motor.bias=0", "motor.amplitude=0"],
    "hand": ["rotor.inertia=1e6", "hand.stiffness=1", "hand.amplitude=1", "hand.frequency=1"],
    "faults": CALM,
    "friction.breakaway": [f"friction.model={BREAKAWAY}"],
    "load": ["friction.model=loaded", "load.full=1"],
}
NUMBERS = [
    key
    for key in scene_keys.keys().values()
    if key.type in ("NUMBER", "WHOLE") and (key.section == "rotor" or key.name not in HIDDEN)
]


def scene_with_key(key: scene_keys.Key) -> Path:
    is_of_segments = f"\n{key.name} = " in (SCENES / "segments.ini").read_text()
    other = "segments" if is_of_segments and key.section == "motion" else "steering"
    return SCENES / f"{PLACES.get(key.section, other)}.ini"


@pytest.mark.parametrize("key", NUMBERS, ids=str)
def test_each_number_is_accepted_up_to_its_limits(key):
    place = f"{key.section}.{key.name}"
    given = BESIDE.get(place, BESIDE.get(key.section, []))
    beside = [one for one in given if not one.startswith(f"{place}=")]
    words = ["--scene", scene_with_key(key), "--seconds", "0.001", *setting(*beside)]
    for value in (key.low, key.high):
        if place == "rotor.inertia" and value == key.low:
            continue  # too light for a step: see test_loop_control.py
        done = run_program(*words, *setting(f"{place}={value:.17g}"), "--virtual")
        assert (done.code, done.err) == (0, ""), value


def beyond(key: scene_keys.Key) -> list[str]:
    """Numbers just below and just above the limits."""
    if key.type == "WHOLE":
        return [f"{key.low - 1:.0f}", f"{key.high + 1:.0f}"]
    low = key.low - (abs(key.low) * 1e-6 or 1e-10)
    return [f"{low!r}", f"{key.high * (1 + 1e-6)!r}"]


def wrong_values(key: scene_keys.Key) -> list[tuple[str, str]]:
    """Values of a wrong type or beyond a limit, each with the fact that the message must have."""
    if key.type == "TEXT":
        return [("", ""), ("t" * scene_keys.text_size(), "")]
    limits = [(value, f" {key.low:.10g} to {key.high:.10g}") for value in beyond(key)]
    wrong = ["nan", "-inf", "1x", *["1 x"] * (key.type != "LIST"), *["1.5"] * (key.type == "WHOLE")]
    found = [("", ""), *limits, *((value, value) for value in wrong)]
    if key.type != "LIST":
        return found
    return [*found, *((f"1 {value}", fact) for value, fact in found[1:]), ("1 " * 9, "8 numbers")]


@pytest.mark.parametrize("key", scene_keys.keys().values(), ids=str)
def test_each_key_is_refused_twice_or_with_a_wrong_value(tmp_path, key):
    place = f"[{key.section}] {key.name}"
    line = f"{key.name} = {'x' if key.type == 'TEXT' else format(key.high, '.17g')}"
    path = write(tmp_path, f"[{key.section}]\n{line}\n{line}\n")
    refused(f"{path}:3: {place} ", "2", "--scene", path)
    for value, fact in wrong_values(key):
        write(tmp_path, f"[{key.section}]\n{key.name} = {value}\n")
        assert fact in refused(f"{path}:2: {place}", "", "--scene", path), value


def test_an_unknown_key_of_each_section_is_refused(tmp_path):
    for section in {key.section for key in scene_keys.keys().values()}:
        path = write(tmp_path, f"[{section}]\nother = 1\n")
        refused(f"{path}:2: ", f'"other" [{section}]', "--scene", path)


OPTION_LIMITS = [
    ("--seconds", "0.001", "1e9", ("0.000999", "1.0001e9", "5m", "", "nan")),
    ("--seed", "0", "18446744073709551615", ("-1", "18446744073709551616", "0x10", "")),
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
        assert run_program(*short, option, value, "--virtual").code == 0, value
    for value in wrong:
        refused(f"{option} {value}: ", f"{least} {greatest}", *short, option, value)


def test_rates_of_faults_may_add_up_to_one():
    path, sets = SCENES / "fault-storm.ini", setting(*CALM, "faults.drop=0.5", "faults.id=0.5")
    words = ("--scene", path, "--virtual", "--seconds", "0.01", *sets)
    assert run_program(*words).code == 0
    refused(f"{path}:21: [faults] ", "1.01 1", *words, "--set", "faults.id=0.51")


def test_eight_elements_and_32_settings_fit():
    eight = "1 2 3 4 5\t6 \t7  8"  # blanks and tabs, as many as one likes
    sets = ["friction.model=slip", f"friction.sigma0={eight}", f"friction.Fc={eight}"]
    steering = ("--scene", SCENES / "steering.ini", "--seconds", "0.001", "--virtual")
    done = run_program(*steering, *setting(*sets, *["friction.node=1"] * 29))
    assert (done.code, done.err) == (0, "")
    refused("--set friction.gain=1: ", "32", *steering, *setting(*["friction.gain=1"] * 33))


# --- options --------------------------------------------------------------------------------------

OPTION_ERRORS = f"""
    steering --frobnicate => --frobnicate
    steering -xy => -x
    steering extra => extra
    steering --seed => --seed
    steering --role boss => --role boss both encoder node
    steering --bus can0 => --bus can0 loopback
    steering --bus socketcand:99999 => --bus socketcand:99999
    steering --bus socketcand::5 => --bus socketcand::5
    steering --bus socketcand:127.0.0.1:0 => --bus socketcand:127.0.0.1:0
    steering --bus socketcand:{"x" * 128}:5 => --bus socketcand:{"x" * 128}:5
    steering --bus socketcan: => --bus
    steering --bus loopback:can1 => --bus loopback:can1
    steering --wait-clients 1 => --wait-clients socketcand:PORT loopback
    steering --until-idle --bus socketcand:localhost:5 => --until-idle socketcand:localhost:5
    steering --virtual --bus socketcand:127.0.0.1:5 => --virtual socketcand:127.0.0.1:5
    steering --virtual --lockstep => --lockstep --virtual
    steering --nodes 2 --set friction.node=15 => --nodes 2 15
    steering --trace x.csv => --trace x.csv [rotor]
    steering --set friction => --set friction section.key=value
    steering --set friction.gain=1 --set bonus.x=1 => --set:2 "x" [bonus]
    steering --set motion.speed=5 => --set:1 [motion] speed steering
    steering --set status.period_ms=9 --set faults.id=0.1 => --set:2 [faults] max_step
    steering --set control.kp=1 => --set:1 [control] kd
    creep --set friction.node=2 --set friction.theta_per_count=1e-18 => --set:2 theta_per_count
    steering --role node --virtual => --virtual --seconds
    creep --set friction.gain=0 --set motion.kind=log => --set:2 [motion] file
    creep --nodes 2 => --nodes 2 [rotor]
    creep --trace x.csv --role node => --trace x.csv --role node [rotor]
"""


@pytest.mark.parametrize("row", OPTION_ERRORS.strip().splitlines())
def test_a_bad_option_is_refused(row):
    """A setting is named by its place on the command line, any other key by its line."""
    (scene, *options), words = row.partition(" =>")[0].split(), row.partition(" =>")[2]
    refused("", words, "--scene", SCENES / f"{scene}.ini", *options)


@pytest.mark.parametrize(
    ("role", "name", "missing"), [("node", "motion", "friction"), ("encoder", "friction", "motion")]
)
def test_a_role_needs_its_section(tmp_path, role, name, missing):
    path = write(tmp_path, GOOD[name])
    refused(f"{path}: ", f"[{missing}]", "--scene", path, "--role", role)


def test_a_missing_file_is_refused(tmp_path):
    path, absent = write(tmp_path, scene_of()), tmp_path / "absent"
    refused(f"{absent}: ", "No such file", "--scene", path, "--log-file", absent)
    refused(f"{tmp_path}:", "Is a directory", "--scene", path, "--log-file", tmp_path)
    refused(f"{absent}: ", "No such file", "--scene", absent)
    refused("no --scene", "")


def test_help_lists_options_that_exist_and_version_is_that_of_the_package():
    done, version = run_program("--help"), run_program("--version")
    assert (done.code, version.code) == (0, 0)
    assert version.out == f"dahl-loop {dahl.__version__}\n"
    options = re.findall(r"^  (--[a-z-]+)", done.out, re.MULTILINE)
    assert len(options) == 19
    assert not [name for name in options if "unknown option" in run_program(name).err]
