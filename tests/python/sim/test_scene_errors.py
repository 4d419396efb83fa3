# SPDX-License-Identifier: MIT
"""A bad scene, log or setting is refused in one line with place, key, value and limit, before any
program starts. Each number is accepted up to its limits. Run files of dahl-loop: test_run_file.py.
"""

import re
from pathlib import Path

import can
import dahl
import pytest
from dahl.binding import models
from dahl.sim import keys, run_file, scene
from identify_tools import complaint
from loop_tools import SCENES

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


def refused(place: str, facts: str, path: Path, *sets: str) -> str:
    """Check the one line: it begins with the place and has these words, in this order."""
    with pytest.raises(dahl.InputError) as raised:
        run_file.RunFile(scene.read(path, sets))
    error, words = str(raised.value), (re.escape(fact) for fact in facts.split())
    pattern = ".*?".join(rf"(?<![\w.]){word}(?!\w|\.\d)" for word in words)
    assert error.startswith(place) and re.search(pattern, error), (facts, error)
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
NODE_ERRORS = [  # scene, line, words of the error
    (scene_of(friction="[friction]"), 3, "[friction] sigma0"),
    (model("dahl", "1 2", 1), 6, "[friction] sigma0 2 Fc 1 dahl"),
    (model("dahl", 1, 1, 1e-12), 3, "[friction] theta_per_count 1e-12"),
    (model("dahl", 1, 1, 3.7e-26), 7, "[friction] theta_per_count 3.7e-26 5.43e-20"),
    (model("lugre"), 4, f"[friction] model lugre slip {BREAKAWAY}"),
    (model("slip", "1 2 3"), 6, "[friction] sigma0 3 Fc 2 slip"),
    (model("slip", "1 1e-9", "1 1e9"), 3, "[friction] theta_per_count"),
    (model("slip", *["1 " * 9] * 2), 3, "[friction] 8"),
    (model("slip", kinds="slip slip"), 5, "[friction] kinds slip"),
    (model("slip", breakaway="0.5"), 5, "[friction] breakaway slip"),
    (model("parallel"), 4, "[friction] parallel kinds"),
    (model("parallel", kinds="dahl lugre"), 5, "[friction] kinds dahl lugre slip"),
    (model("parallel", kinds="dahl"), 5, "[friction] kinds dahl 2"),
    (model("parallel", 1, kinds="dahl slip"), 7, "[friction] sigma0 1 Fc 2 parallel"),
    (model("asymmetric", 1, 1), 6, "[friction] sigma0 1 Fc 1 asymmetric"),
    (model("asymmetric"), 6, "[friction] sigma0 2 Fc 2 asymmetric"),
    (model("asymmetric", 1, "1 1e10"), 3, "[friction] theta_per_count"),
    (model(BREAKAWAY, 1, 1), 4, f"[friction] {BREAKAWAY} breakaway"),
    (model(BREAKAWAY, breakaway="0.5"), 7, f"[friction] sigma0 2 Fc {BREAKAWAY}"),
]
SCENE_ERRORS = [
    (model("loaded", 1, 1), 4, "loaded [load]"),
    (scene_of(status=LOAD), 13, "[load] dahl"),
    (scene_of(friction=LOAD), 3, "[load] [friction]"),
    (scene_of(friction=LOADED, status=LOAD), 15, "[load] 'column'"),
    (scene_of(friction=LOADED + ROTOR, motion=COLUMN, status=MOTOR), 16, "[load] column [rotor]"),
    (
        scene_of(friction=LOADED, status=COLUMN + "\nrotor_limit = 1"),
        18,
        "[load] rotor_limit [rotor]",
    ),
    (scene_of(friction=LOADED, motion=LOAD, status=""), 9, "[load] [rotor] log"),
    (scene_of(friction="[friction]\nsigma0"), 4, "sigma0 [section]"),
    (scene_of(friction="[fricton]\nsigma0 = 1"), 3, "[fricton]"),
    (scene_of(friction="[friction\nsigma0 = 1"), 3, "[friction [section]"),
    (scene_of(friction="[friction]\nsigma0 = " + "1" * 400), 4, "sigma0 finite"),
    (scene_of(status="[sectoin]"), 13, "[sectoin]"),
    (scene_of(status="[measured]\ntorqe = x"), 14, "[measured] 'torqe'"),
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
    ("sigma0 = 1\n[friction]", 1, "sigma0 [section]"),
    (b"\xff\n", "", "utf-8"),
]


@pytest.mark.parametrize(("text", "line", "words"), NODE_ERRORS + SCENE_ERRORS)
def test_a_bad_scene_is_refused(tmp_path, text, line, words):
    path = write(tmp_path, text)
    refused(f"{path}:{line}".rstrip(":") + ":", words, path)


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
    assert code == 2 and line.startswith(f"{path}:") and place in line


LOG_ERRORS = [  # text of a log, words of the error; more of them in tests/python/io
    ("", "empty"),
    ("t,winkel,note\n0,1,a\n", "angle t winkel note"),
    ("t,angle,note\n", ""),
    ("t,angle,note\n0,1e308,a\n1,1e308,a\n", "angle row 1 2^31"),
    ("t,angle,note\n0,1,a\n1,,b\n", "log.csv:3 angle"),
    ("t,angle,note\n0,1,a\n2,2,b\n1,3,c\n", "log.csv:4 t"),
    ("t,angle,note\n0,1,a\n1,1e9,b\n", "angle row 2 9.99999999e+09 2^31"),
    ("t,angle,note\n0,1,a\n1,-214748363.7,b\n", "angle row 2 -2.14748365e+09 2^31"),
]


@pytest.mark.parametrize(("table", "words"), LOG_ERRORS)
def test_a_bad_log_is_refused(tmp_path, table, words):
    refused(f"{tmp_path}/log.csv", words, write(tmp_path, scene_of(), table))


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
        key = keys.KEYS.get((section, line.partition(" =")[0]))
        path = write(tmp_path, "\n".join(lines[:number] + lines[number + 1 :]))
        if key and key.need == "REQUIRED":
            refused(f"{path}:", f"[{section}] {key.name}", path)
        elif key and key.name != "model":
            scene.read(path)


def test_a_scene_may_come_from_any_editor(tmp_path):
    text, found = scene_of(), set()
    measured = f"{text}\n[measured]\ntorque = Friction [uN]\n"
    for form in (text, f"\ufeff{text}", f"; a word\n\t{text}", measured.replace("\n", "\r\n")):
        file = scene.read(write(tmp_path, form)).file
        of_run = {name: one for name, one in file.values.items() if name[0] != "measured"}
        found.add(run_file.text_of(of_run))
    assert len(found) == 1


def beyond(key: keys.Key) -> list[str]:
    """Numbers just below and just above the limits."""
    if key.type == "WHOLE":
        return [f"{key.low - 1:.0f}", f"{key.high + 1:.0f}"]
    low = key.low - (abs(key.low) * 1e-6 or 1e-10)
    return [f"{low!r}", f"{key.high * (1 + 1e-6)!r}"]


def wrong_values(key: keys.Key) -> list[tuple[str, str]]:
    """Values of a wrong type or beyond a limit, each with the fact that the message must have."""
    if key.type == "TEXT":
        return [("", "empty")]
    limits = [(value, f" {key.low:.10g} to {key.high:.10g}") for value in beyond(key)]
    wrong = ["nan", "-inf", "1x", *["1 x"] * (key.type != "LIST"), *["1.5"] * (key.type == "WHOLE")]
    found = [*limits, *((value, value) for value in wrong)]
    if key.type != "LIST":
        return [("", "empty"), *found]
    return [*found, *((f"1 {value}", fact) for value, fact in found)]


@pytest.mark.parametrize("key", keys.KEYS.values(), ids=lambda key: key.place)
def test_each_key_is_refused_twice_or_with_a_wrong_value(tmp_path, key):
    line = f"{key.name} = {'x' if key.type == 'TEXT' else format(key.high, '.17g')}"
    path = write(tmp_path, f"[{key.section}]\n{line}\n{line}\n")
    refused(f"{path}:3: {key.place} ", "twice", path)
    for value, fact in wrong_values(key):
        write(tmp_path, f"[{key.section}]\n{key.name} = {value}\n")
        assert fact in refused(f"{path}:2: {key.place}", "", path), value


def test_rates_of_faults_may_add_up_to_one():
    path = SCENES / "fault-storm.ini"
    sets = [f"faults.{name}=0" for name in keys.names("faults")]
    scene.read(path, [*sets, "faults.drop=0.5", "faults.id=0.5"])
    refused(f"{path}:21: [faults] ", "1.01 1", path, *sets, "faults.drop=0.5", "faults.id=0.51")


SET_ERRORS = [  # settings of steering, place and words of the error
    ("friction", "--set friction: ", "section.key=value"),
    ("bonus.x=1", "--set bonus.x=1: ", "[bonus]"),
    ("motion.speed=5", "--set motion.speed=5: ", "[motion] speed steering"),
    ("control.kp=1", "--set control.kp=1: ", "[control] kd"),
    ("faults.id=0.1", "--set faults.id=0.1: ", "[faults] max_step"),
]


@pytest.mark.parametrize(("text", "place", "words"), SET_ERRORS)
def test_a_bad_setting_is_named(text, place, words):
    refused(place, words, SCENES / "steering.ini", text)


def test_of_two_settings_of_a_key_the_last_one_counts():
    sets = ("friction.gain=0.5", "scene.title=a = b; c", "friction.gain=0.25")
    played = scene.read(SCENES / "steering.ini", sets)
    assert (played.friction["gain"], played.title) == (0.25, "a = b; c")


SUMS = [  # keys of [friction], sigma0 and Fc at a torque ratio of 1
    ("sigma0 = 3\nFc = 2", (3, 2)),
    ("model = slip\nsigma0 = 3 4\nFc = 1 2", (7, 3)),
    ("model = asymmetric\nsigma0 = 5\nFc = 1 2", (5, 2)),
]


@pytest.mark.parametrize(("words", "due"), SUMS)
def test_a_scene_sums_its_elements_or_has_the_larger_direction(tmp_path, words, due):
    found = scene.read(write(tmp_path, f"[friction]\n{words}\ntheta_per_count = 1e-3\n"))
    assert (found.sigma0, found.Fc) == due


NODE_KEYS = [("friction", name) for name in scene.NODE_KEYS] + [("status", "period_ms")]


@pytest.mark.parametrize("name", NODE_KEYS, ids=".".join)
def test_a_scene_has_the_limits_of_a_node(name):
    key, path, plan = keys.KEYS[name], SCENES / "steering.ini", dahl.Plan(100, 0.5, 1e-3)
    for value in (key.low, key.high):
        settings = scene.settings(scene.read(path, [f"{'.'.join(name)}={value:.17g}"]))
        dahl.Node(plan, **settings)
    setting = {"period_ms": "status_period"}.get(key.name, key.name.removesuffix("_ms"))
    above = float(beyond(key)[1]) / (1e3 if key.name.endswith("_ms") else 1)
    with pytest.raises(dahl.Error):
        dahl.Node(plan, **{setting: above})
