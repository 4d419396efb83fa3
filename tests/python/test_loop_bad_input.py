# SPDX-License-Identifier: MIT
"""Bad scenes, logs and options: one line `error: ...` with the place, exit code 2, nothing run."""

from __future__ import annotations

import json
import os
import re
import subprocess

import dahl
import pytest
from loop_tools import SCENES, counts_of, program, read_log, run, said, setting

GOOD = {
    "scene": "[scene]\ntitle = t",
    "friction": "[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4",
    "motion": "[motion]\nkind = log\nfile = log.csv\nangle = angle\ntime = t\ncounts_per_unit = 10",
    "status": "[status]\nperiod_ms = 100",
}
TABLE = "t,angle,note\n0,1,a\n1,2,b\n2,3,c\n"


TWO = "sigma0 = 1 2\nFc = 1 2"
MODELS = [  # model, its keys, what is said of them
    ("parallel", TWO, ':4: [friction] model = parallel needs the key "kinds"'),
    ("parallel", f"kinds = dahl lugre\n{TWO}", ":5: [friction] kinds = dahl lugre: lugre is not"),
    ("parallel", f"kinds = dahl\n{TWO}", ":5: [friction] kinds has 1 words and Fc 2 numbers"),
    ("parallel", f"kinds = dahl slip dahl\n{TWO}", ":5: [friction] kinds has 3 words and Fc 2"),
    (
        "parallel",
        "kinds = dahl slip\nsigma0 = 1\nFc = 1 2",
        ":7: [friction] sigma0 has 1 numbers and Fc 2: model",
    ),
    (
        "parallel",
        "kinds = dahl slip\nsigma0 = 1 1e-9\nFc = 1 1e9",
        ":8: [friction] theta_per_count = 1: sigma0/Fc*theta_per_count = 1e-18",
    ),
    ("slip", f"kinds = slip slip\n{TWO}", ":5: [friction] kinds has no meaning for model = slip"),
    ("slip", f"breakaway = 0.5\n{TWO}", ":5: [friction] breakaway has no meaning for model = slip"),
    ("asymmetric", "sigma0 = 1\nFc = 1", ":6: [friction] sigma0 has 1 numbers and Fc 1: model"),
    ("asymmetric", TWO, ":6: [friction] sigma0 has 2 numbers and Fc 2: model asymmetric wants one"),
    (
        "asymmetric",
        "sigma0 = 1\nFc = 1 1e10",
        ":7: [friction] theta_per_count = 1: sigma0/Fc*theta_per_count = 1e-10",
    ),
    (
        "elastoplastic",
        "sigma0 = 1\nFc = 1",
        ':4: [friction] model = elastoplastic needs the key "br',
    ),
    ("elastoplastic", "sigma0 = 1\nFc = 1\nbreakaway = 1", ":7: [friction] breakaway = 1: outside"),
    ("elastoplastic", "sigma0 = 1\nFc = 1\nbreakaway = 0", ":7: [friction] breakaway = 0: outside"),
    ("elastoplastic", "sigma0 = 1\nFc = 1\nbreakaway = nan", ":7: [friction] breakaway = nan: not"),
    ("elastoplastic", f"{TWO}\nbreakaway = 0.5", ":6: [friction] sigma0 has 2 numbers and Fc 2"),
]


def write(folder, scene: str, table: str | bytes = TABLE):
    (folder / "log.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    (folder / "scene.ini").write_text(scene, encoding="utf-8")
    return folder / "scene.ini"


def complaint(folder, *options: str) -> str:
    """The one line that a failing run prints."""
    result = run(folder, folder / "scene.ini", "--virtual", *options)
    assert result.code == 2, (result.code, result.err)
    assert result.err.count("\n") == 1
    assert result.err.startswith("error: ")
    assert not result.log.exists(), "something was run"
    return result.err


def with_(name: str, section: str) -> str:
    """The good scene with one section replaced."""
    return "\n".join({**GOOD, name: section}.values())


def test_the_good_scene_is_good(tmp_path):
    result = run(tmp_path, write(tmp_path, "\n".join(GOOD.values())), "--virtual")
    assert (result.code, result.err) == (0, "")
    assert result.summary["frames_answered"] == 3


@pytest.mark.parametrize("before", ["\ufeff", "  ", "; a word\n\t"])
def test_what_stands_before_the_first_section_changes_nothing(tmp_path, before):
    """A byte order mark, as some editors write it; an indent."""
    scene = before + "\n".join((GOOD["friction"], GOOD["motion"]))
    result = run(tmp_path, write(tmp_path, scene), "--virtual")
    assert (result.code, result.err) == (0, "")
    assert result.summary["node"]["ok"] == 3


ROTOR = "[rotor]\ninertia = 0.1\nviscous = 0\nsigma0 = 50\nFc = 0.5\n"
MOTOR = "[motor]\nseconds = 1\n"
CONTROL = "[control]\nkp = 1\nkd = 1\ntorque_limit = 1\n"


def friction(**keys: object) -> str:
    """The good scene with other keys of its friction, from line 4 on; None leaves one out."""
    known = {"sigma0": 1, "Fc": 1, "theta_per_count": 1} | keys
    lines = [f"{name} = {value}" for name, value in known.items() if value is not None]
    return with_("friction", "\n".join(["[friction]", *lines]))


def model(name: str, keys: str) -> str:
    return with_("friction", f"[friction]\nmodel = {name}\n{keys}\ntheta_per_count = 1")


NINE = "1 2 3 4 5 6 7 8 9"
FAR = "1 1e-9\nFc = 1 1e9"
SCENE_ERRORS = [
    (friction(sigma0=None), ':3: [friction] has no key "sigma0"'),
    (with_("friction", "[friction]"), ':3: [friction] has no key "sigma0"'),
    (friction(sigma0=0), ":4: [friction] sigma0 = 0: outside"),
    (
        friction(theta_per_count=3.7e-26),
        ":6: [friction] theta_per_count = 3.7e-26: outside 5.42101086e-20 to 1.84467441e+19",
    ),
    (friction(sigma0="nan"), ":4: [friction] sigma0 = nan: not"),
    (friction(sigma0="inf"), ":4: [friction] sigma0 = inf: not"),
    (friction(Fc="abc"), ":5: [friction] Fc = abc: not"),
    (friction(Fc=""), ":5: [friction] Fc = : not"),
    (friction(Fc="1 2"), ":5: [friction] sigma0 has 1 numbers and Fc 2: model dahl wants one of"),
    (
        friction(sigma0="1 2", Fc="1 2"),
        ":5: [friction] sigma0 has 2 numbers and Fc 2: model dahl wants one of each",
    ),
    (friction(theta_per_count=1e-12), ":6: [friction] theta_per_count"),
    (friction(sigma0=1e15), ":6: [friction] theta_per_count"),
    (friction(node=1.9), ":7: [friction] node = 1.9: not a whole number"),
    (friction(max_step=2.5), ":7: [friction] max_step = 2.5: not a whole number"),
    (model("slip", "sigma0 = 1 2 3\nFc = 1 2"), ":6: [friction] sigma0 has 3 numbers and Fc 2"),
    (model("lugre", "sigma0 = 1\nFc = 1"), ":4: [friction] model = lugre: not one of dahl, slip,"),
    *((model(name, keys), words) for name, keys, words in MODELS),
    (
        model("slip", f"sigma0 = {NINE}\nFc = 1"),
        f":5: [friction] sigma0 = {NINE}: more than 8 numbers",
    ),
    (model("slip", "sigma0 = 1 x\nFc = 1 1"), ":5: [friction] sigma0 = x: not"),
    (
        model("slip", f"sigma0 = {FAR}"),
        ":7: [friction] theta_per_count = 1: sigma0/Fc*theta_per_count = 1e-18,"
        " outside 9.31322575e-10 to 1048576",
    ),
    (
        with_("friction", "[friction]\nsigma0 = 1\nsigma0 = 2\nFc = 1"),
        ":5: [friction] sigma0 given twice",
    ),
    (with_("friction", "[friction]\nsigma = 1"), ':4: unknown key "sigma" in [friction]'),
    (with_("friction", "[friction]\nsigma0"), ":4: neither a [section]"),
    (with_("scene", "[scene]\ntitle ="), ":2: [scene] title: empty"),
    (with_("scene", "[scene]\ntitle = " + "t" * 160), ":2: [scene] title: too long"),
    (with_("friction", "[fricton]\nsigma0 = 1"), ":3: unknown section [fricton]"),
    (with_("status", "[bonus]"), ":13: unknown section [bonus]"),
    (with_("friction", "[friction\nsigma0 = 1"), ":3: a section name without ]"),
    (with_("friction", "[friction]\nsigma0 = " + "1" * 300), ":4: line longer than"),
    (with_("motion", "[motion]\nfile = x"), ':7: [motion] has no key "kind"'),
    (with_("motion", "[motion]\nkind = sine"), ":8: [motion] kind = sine: not one of"),
    (
        with_("motion", "[motion]\nkind = log\nfile = log.csv\ncounts_per_unit = 1"),
        ':7: [motion] has no key "angle"',
    ),
    (with_("motion", "[motion]\nkind = segments\nspeed = 1"), ':7: [motion] has no key "theta1"'),
    (
        with_("motion", GOOD["motion"] + "\nspeed = 1"),
        ":13: [motion] speed has no meaning for kind = log",
    ),
    (with_("motion", GOOD["motion"] + "\nfile ="), ":13: [motion] file given twice"),
    (with_("status", "[faults]\ndrop = 0.5"), ":13: [faults] needs [friction] max_step"),
    (with_("status", "[faults]\ndrop = 1.5"), ":14: [faults] drop = 1.5: outside 0 to 1"),
    (with_("status", "[faults]\ndrop = 10 %"), ":14: [faults] drop = 10 %: not a finite number"),
    (with_("status", "[faults]\nloss = 0.1"), ':14: unknown key "loss" in [faults]'),
    (
        with_("status", "[faults]\ndrop = 0.6\nid = 0.6"),
        ":13: [faults] rates add up to 1.2: above 1",
    ),
    (with_("status", ROTOR), ":13: [rotor] needs one of [motor] and [control]"),
    (with_("status", ROTOR + MOTOR), ":7: [motor] moves the shaft, so [motion] has no meaning"),
    (with_("status", MOTOR), ":7: [motor] moves the shaft"),
    (with_("status", ROTOR + MOTOR + CONTROL), ":13: [rotor] needs one of [motor] and [control]"),
    (with_("status", CONTROL), ":13: [control] needs [rotor]"),
    (with_("motion", ROTOR + CONTROL), ":12: [control] needs [motion]"),
    (with_("friction", ROTOR + CONTROL), ":3: [rotor] needs [friction]"),
    (with_("motion", MOTOR), ":7: [motor] needs [rotor]"),
    (with_("status", "[rotor]\ninertia = 0"), ":14: [rotor] inertia = 0: outside"),
    (with_("status", "[rotor]\ninertia = 1"), ':13: [rotor] has no key "sigma0"'),
    (
        with_("motion", GOOD["motion"] + "\nstart_count = -0.5"),
        ":13: [motion] start_count = -0.5: not a whole number",
    ),
    (
        with_("motion", "[motion]\nkind = segments\ntheta1 = 1.5"),
        ":9: [motion] theta1 = 1.5: not a whole number",
    ),
    ("[scene]\ntitle = empty", "names neither [friction] nor [motion]"),
    ("", "names neither [friction] nor [motion]"),
    ("sigma0 = 1\n[friction]", ':1: unknown key "sigma0" in []'),
    ("\x00\x01\x02binary\xff\n", ":1: line longer than 198 characters, or not text"),
]


@pytest.mark.parametrize(("scene", "words"), SCENE_ERRORS, ids=[words for _, words in SCENE_ERRORS])
def test_bad_scenes(tmp_path, scene, words):
    path = write(tmp_path, scene)
    assert f"{path}{words}" in complaint(tmp_path).replace(f"{path}: names", f"{path}names")


WORDS = [  # where it is said, what is complained of, words that there are
    ("--set motion.kind=", "[motion] kind = ", "segments steering log"),
    ("--set friction.model=", "[friction] model = ", "dahl slip parallel asymmetric elastoplastic"),
    ("--role ", "--role ", "both encoder node"),
]


@pytest.mark.parametrize(
    ("option", "told", "name"), [(*one[:2], name) for one in WORDS for name in one[2].split()]
)
def test_a_word_is_said_in_full_and_as_it_is_written(tmp_path, option, told, name):
    write(tmp_path, "\n".join(GOOD.values()))
    for word in nearly(name):
        assert f"{told}{word}: not one of" in complaint(tmp_path, *f"{option}{word}".split())


def nearly(name: str) -> tuple[str, ...]:
    return name[:1], name[:-1], f"{name}s", name.upper()


@pytest.mark.parametrize("name", ["dahl", "slip"])
def test_a_kind_of_element_is_said_in_full(tmp_path, name):
    for word in nearly(name):
        write(tmp_path, model("parallel", f"kinds = slip {word}\n{TWO}"))
        assert f"kinds = slip {word}: {word} is not one of dahl, slip" in complaint(tmp_path)


DAHL = {"friction": ("sigma0 = 50", "Fc = 0.5", "theta_per_count = 1e-4")}
ENDS = ("theta1 = 2", "theta2 = 1", "theta3 = 2", "speed = 1000")
SWEEPS = ("amplitude = 9", "sweep_s = 1", "tremor = 1", "tremor_s = 1", "seconds = 0.01")
SHAFT = {"rotor": ("inertia = 0.1", "sigma0 = 50", "Fc = 0.5")}
LEAST = {  # all that has to be said, of each part
    "segments": {**DAHL, "motion": ("kind = segments", *ENDS)},
    "steering": {**DAHL, "motion": ("kind = steering", *SWEEPS)},
    "log": {"motion": ("kind = log", "file = log.csv", "angle = angle", "counts_per_unit = 10")},
    "motor": {**DAHL, **SHAFT, "motor": ("seconds = 0.01",)},
    "control": {
        **DAHL,
        **SHAFT,
        "motion": ("kind = segments", *ENDS),
        "control": ("kp = 1", "kd = 1", "torque_limit = 1"),
        "status": ("period_ms = 5",),
    },
}


@pytest.mark.parametrize("name", LEAST)
def test_what_has_to_be_said_and_no_more(tmp_path, name):
    """Without any key that may be left out it runs; without one of the others that one is named."""
    write(tmp_path, text_of(LEAST[name]))
    good = run(tmp_path / "good", tmp_path / "scene.ini", "--virtual")
    assert (good.code, good.err) == (0, "")
    assert good.summary["frames_sent"] > 2
    for section, keys in LEAST[name].items():
        for key in keys:
            left = {**LEAST[name], section: [other for other in keys if other != key]}
            write(tmp_path, text_of(left))
            words = f'[{section}] has no key "{key.split(" ")[0]}"\n'
            assert complaint(tmp_path).endswith(words), key


def text_of(sections) -> str:
    return "\n".join(f"[{name}]\n" + "\n".join(keys) for name, keys in sections.items())


BAD_TEXTS = {
    b"caf\xe9": "caf?",
    b"\xc0\xaf": "??",
    b"\xed\xa0\x80": "???",
    b"\xf4\x90\x80\x80": "????",
    b"\xe2\x82": "??",
    b"\x80x": "?x",
}


@pytest.mark.parametrize(("title", "shown"), BAD_TEXTS.items(), ids=BAD_TEXTS.values())
def test_a_title_that_is_no_text_is_refused(tmp_path, title, shown):
    path = write(tmp_path, "")
    good = "\n".join(GOOD.values()).encode()
    path.write_bytes(good.replace(b"title = t", b"title = " + title))
    assert complaint(tmp_path) == f"error: {path}:2: [scene] title = {shown}: not UTF-8\n"


def test_the_summary_is_valid_json_whatever_the_names_are(tmp_path):
    title = '"é€😀\\' + 148 * "t"  # 159 bytes, as many as there may be
    path = write(tmp_path, "\n".join(GOOD.values()).replace("title = t", f"title = {title}"))
    odd = tmp_path / os.fsdecode(b"caf\xe9 \xe2\x82.ini")
    path.rename(odd)
    result = run(tmp_path, odd, "--virtual")
    assert result.code == 0, result.err
    assert result.summary["title"] == title
    assert result.summary["scene"] == f"{tmp_path}/caf? ??.ini"


def test_what_is_text_is_shown_as_it_is(tmp_path):
    """In a summary and in an error line: letters of two to four bytes, beside a wrong one."""
    path = write(tmp_path, "\n".join(GOOD.values()))
    odd = tmp_path / os.fsdecode("aé€😀".encode() + b"\xe9" + "ü.ini".encode())
    path.rename(odd)
    result = run(tmp_path, odd, "--virtual")
    assert result.summary["scene"] == f"{tmp_path}/aé€😀?ü.ini"
    wrong = run(tmp_path, odd, "--virtual", "--set", "motion.kind=é€😀")
    shown = run(tmp_path, odd, "--virtual", "--set", "motion.kind=\x01\x1f \x7f~").err
    assert "[motion] kind = ?? ?~: not one of" in shown
    assert (wrong.code, wrong.err.count("\n")) == (2, 1)
    assert "[motion] kind = é€😀: not one of" in wrong.err


@pytest.mark.parametrize("option", ["--log", "--summary", "--trace"])
@pytest.mark.parametrize("way", ["same", "link", "symlink", "dots"])
@pytest.mark.parametrize("victim", ["scene.ini", "log.csv"])
def test_no_output_destroys_an_input(tmp_path, option, way, victim):
    scene = write(tmp_path, "\n".join(GOOD.values()))
    target = tmp_path / victim
    kept = target.read_bytes()
    other = tmp_path / "other"
    if way == "link":
        other.hardlink_to(target)
    elif way == "symlink":
        other.symlink_to(target)
    path = {"same": target, "dots": f"{tmp_path}/../{tmp_path.name}/{victim}"}.get(way, other)
    done = said("--scene", scene, "--virtual", option, path)
    name = "--scene" if victim == "scene.ini" else "the measured log"
    assert (done.returncode, done.stderr) == (
        2,
        f"error: {option} {path}: that is the file of {name} {target}\n",
    )
    assert target.read_bytes() == kept


def test_no_two_outputs_are_one_file(tmp_path):
    """Whether it is there or not; what is no file, as /dev/null, may be named twice."""
    scene = write(tmp_path, "\n".join(GOOD.values()))
    new = tmp_path / "new"
    for again in (new, f"{tmp_path}/./new", "new"):
        options = ["--virtual", "--log", new, "--summary", again]
        done = said("--scene", scene, *options, cwd=tmp_path)
        assert done.stderr == f"error: --summary {again}: that is the file of --log {new}\n"
        assert (done.returncode, new.exists()) == (2, False)
    null = ["--virtual", "--log", "/dev/null", "--summary", "/dev/null"]
    assert said("--scene", scene, *null).returncode == 0
    apart = ["--virtual", "--log", tmp_path / "a", "--summary", tmp_path / "b"]
    assert said("--scene", scene, *apart).returncode == 0


def test_outputs_of_one_name_in_two_folders_are_two(tmp_path):
    scene = write(tmp_path, "\n".join(GOOD.values()))
    for name in "ab":
        (tmp_path / name).mkdir()
    options = ["--virtual", "--log", tmp_path / "a" / "run", "--summary", tmp_path / "b" / "run"]
    done = said("--scene", scene, *options)
    assert done.returncode == 0
    assert json.loads((tmp_path / "b" / "run").read_text())["ticks"] == 3


def test_outputs_take_the_place_of_what_was_there(tmp_path):
    """Nothing of a longer file stays; who may read a new one is the umask's matter."""
    scene = write(
        tmp_path, "\n".join(GOOD.values()).replace("[status]", ROTOR + CONTROL + "[status]")
    )
    alone = run(tmp_path, scene, "--virtual", "--trace", str(tmp_path / "trace.csv"))
    assert alone.code == 0, alone.err
    names = ("run.log", "summary.json", "trace.csv")
    assert {(tmp_path / name).stat().st_mode & 0o777 for name in names} == {0o666 & ~umask()}
    wanted = [(tmp_path / name).read_text() for name in ("run.log", "trace.csv")]
    for name in names:
        (tmp_path / name).write_text("old\n" * 10000)
    again = run(tmp_path, scene, "--virtual", "--trace", str(tmp_path / "trace.csv"))
    assert [(tmp_path / name).read_text() for name in ("run.log", "trace.csv")] == wanted
    assert again.summary.keys() == alone.summary.keys()


def umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_the_path_of_a_measured_log_has_1023_characters_at_most(tmp_path):
    write(tmp_path, "\n".join(GOOD.values()))
    folder = f"{tmp_path}{'/' * (1023 - len(str(tmp_path)) - len('log.csv'))}"
    result = run(tmp_path, tmp_path / "scene.ini", "--virtual", "--data", folder)
    assert (result.code, result.summary["ticks"]) == (0, 3)
    result.log.unlink()
    assert complaint(tmp_path, "--data", folder + "/") == "error: log.csv: path too long\n"


@pytest.mark.parametrize(
    ("role", "name", "missing"), [("node", "motion", "friction"), ("encoder", "friction", "motion")]
)
def test_a_role_that_the_scene_does_not_have_is_told(tmp_path, role, name, missing):
    path = write(tmp_path, GOOD[name])
    words = f"names no [{missing}], so there is nothing to run for this --role"
    assert complaint(tmp_path, "--role", role) == f"error: {path}: {words}\n"


def test_thirty_two_settings_are_taken_and_eight_slip_elements():
    eight = "1 2 3 4 5\t6 \t7  8"  # blanks and tabs, as many as one likes
    sets = ["friction.model=slip", f"friction.sigma0={eight}", f"friction.Fc={eight}"]
    words = [word for text in [*sets, *["friction.node=1"] * 29] for word in ("--set", text)]
    done = said(*STEERING, "--virtual", "--seconds", "0.001", *words)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_summary_that_standard_output_does_not_take_is_told():
    words = [program(), *STEERING, "--virtual", "--seconds", "0.001", "--summary", "-"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=20, check=False
        )
    assert done.returncode == 1
    assert done.stderr.startswith("error: --summary -: ")


def test_of_many_columns_as_many_are_named_as_there_is_room_for(tmp_path):
    names = ["t", *(f"column {k}" for k in range(100))]
    write(tmp_path, "\n".join(GOOD.values()), f"{','.join(names)}\n{'0,' * 100}0\n")
    named = ", ".join(f'"{name}"' for name in names)
    assert complaint(tmp_path).endswith(f'no column "angle"; there is {named[:255]}\n')


@pytest.mark.parametrize("side", [1, -1])
def test_a_log_may_go_as_far_as_a_count_does(tmp_path, side):
    """From its first row; the count on the bus wraps."""
    least = "t,angle,note\n0,5,a\n1,{},b\n"
    scene = "\n".join(GOOD.values()).replace("counts_per_unit = 10", "counts_per_unit = 1")
    write(tmp_path, scene, least.format(5 + side * 2147483646))
    result = run(tmp_path, tmp_path / "scene.ini", "--virtual")
    assert (result.code, counts_of(read_log(result.log))) == (0, [0, side * 2147483646])
    result.log.unlink()
    write(tmp_path, scene, least.format(5 + side * 2147483647))
    words = f"{5 + side * 2147483647:.9g} is {side * 2147483647:.9g} counts from the first row"
    assert f'log.csv:3: column "angle": {words}, more than 2^31' in complaint(tmp_path)


TABLE_ERRORS = [
    ("", ":1: ", 'column "angle": the file has no rows'),
    ("t,angle,note\n", ":2: ", "the file has no rows"),
    ("t,winkel,note\n0,1,a\n", ":1: ", 'no column "angle"; there is "t", "winkel", "note"'),
    ("time,angle,note\n0,1,a\n", ":1: ", 'no column "t"; there is'),
    ("t,angle,angle\n0,1,1\n", ":1: ", 'two columns "angle"'),
    ("t,angle,t\n0,1,1\n", ":1: ", 'two columns "t"'),
    ("t,angle,angle,t\nx,y,z,1\n", ":1: ", 'two columns "angle"'),  # the first of many
    ("t,angle,note\nx,y,a\nz\n", ":2: ", 'column "t": "x" is not a finite number'),
    ("t,angle,note\n0,1,a\n1,hello,b\n", ":3: ", 'column "angle": "hello" is not a finite number'),
    ("t,angle,note\n0,1,a\n1,,b\n", ":3: ", 'column "angle": "" is not a finite number'),
    ("t,angle,note\n0,1,a\n1,nan,b\n", ":3: ", 'column "angle": "nan" is not a finite number'),
    ("t,angle,note\n0,1,a\n1,-inf,b\n", ":3: ", 'column "angle": "-inf" is not a finite number'),
    ("t,angle,note\n0,1,a\n1,1e999,b\n", ":3: ", 'column "angle": "1e999" is not a finite number'),
    ("t,angle,note\n0,1,a\n\n1,2 3,b\n", ":4: ", 'column "angle": "2 3" is not a finite number'),
    ("t,angle,note\n0,1,a\nx,2,b\n", ":3: ", 'column "t": "x" is not a finite number'),
    ("t,angle,note\n0,1,a\n2,2,b\n1,3,c\n", ":4: ", 'column "t": time goes back from 2 to 1'),
    ("t,angle,note\n0,1,a\n1,2\n", ":3: ", 'column "angle": the row has 2 fields, the header 3'),
    ("t,angle,note\n0,1,a\n1,2", ":3: ", 'column "angle": the row has 2 fields, the header 3'),
    (
        "t,angle,note\n0,1,a\n1,2,b,c\n",
        ":3: ",
        'column "angle": the row has 4 fields, the header 3',
    ),
    ("t,angle,note\n0,1,a\n1,1e9,b\n", ":3: ", 'column "angle": 1e+09 is 9.99999999e+09 counts'),
    ('t,angle,note\n0,"1\n\a",a\n', ":3: ", 'column "angle": "1??" is not a finite number'),
    ('t,angle,note\n0,1,"a\n1,2,b\n', ":4: ", "column 3: a quote inside a field or never closed"),
    ('t,angle,note\n0,1,"' + "a" * 200000, ":2: ", "column 3: a field without end"),
    (b"\x00\x01\x02\xff\xfe", ":1: ", 'no column "angle"'),
]


@pytest.mark.parametrize(
    ("table", "place", "words"), TABLE_ERRORS, ids=[words for _, _, words in TABLE_ERRORS]
)
def test_bad_log_files(tmp_path, table, place, words):
    write(tmp_path, "\n".join(GOOD.values()), table)
    error = complaint(tmp_path)
    assert f"{tmp_path}/log.csv{place}" in error
    assert words in error


def test_a_log_file_that_is_not_there(tmp_path):
    write(tmp_path, "\n".join(GOOD.values()))
    assert "absent.csv: No such file" in complaint(
        tmp_path, "--log-file", str(tmp_path / "absent.csv")
    )
    assert "Is a directory" in complaint(tmp_path, "--log-file", str(tmp_path))


def test_a_scene_that_is_not_there(tmp_path):
    result = run(tmp_path, tmp_path / "absent.ini", "--virtual")
    assert result.code == 2
    assert result.err == f"error: {tmp_path}/absent.ini: No such file or directory\n"


STEERING = ["--scene", str(SCENES / "steering.ini")]
CREEP = ["--scene", str(SCENES / "creep.ini")]
OPTION_ERRORS = [
    ([], "no --scene FILE"),
    ([*STEERING, "--frobnicate"], "unknown option --frobnicate"),
    ([*STEERING, "-xy"], "unknown option -x;"),
    ([*STEERING, "extra"], "unexpected argument extra"),
    ([*STEERING, "--seed"], "--seed needs a value"),
    ([*STEERING, "--role", "boss"], "--role boss: not one of both, encoder, node"),
    ([*STEERING, "--bus", "can0"], "--bus can0: not loopback"),
    ([*STEERING, "--bus", "socketcand:99999"], "--bus socketcand:99999: not loopback"),
    ([*STEERING, "--bus", "socketcand::5"], "--bus socketcand::5: not loopback"),
    ([*STEERING, "--wait-clients", "1"], "need --bus socketcand:PORT, not loopback"),
    (
        [*STEERING, "--until-idle", "--bus", "socketcand:127.0.0.1:5"],
        "need --bus socketcand:PORT, not socketcand:127.0.0.1:5",
    ),
    ([*STEERING, "--bus", "socketcand:127.0.0.1:0"], "--bus socketcand:127.0.0.1:0: not loopback"),
    ([*STEERING, "--bus", "socketcan:"], "--bus socketcan:: not loopback"),
    ([*STEERING, *["--set", "friction.gain=1"] * 33], "more than 32"),
    ([*STEERING, "--virtual", "--bus", "socketcand:127.0.0.1:5"], "--virtual needs a bus whose"),
    ([*STEERING, "--virtual", "--lockstep"], "--lockstep is for real time"),
    ([*STEERING, "--nodes", "2", "--set", "friction.node=15"], "numbers would pass 15"),
    ([*STEERING, "--trace", "x.csv"], "has no [rotor] to trace"),
    ([*STEERING, "--set", "friction"], "--set friction: not section.key=value"),
    ([*STEERING, "--set", "friction.gain=2"], "--set:1: [friction] gain = 2: outside 0 to 1"),
    ([*STEERING, "--set", "friction.gian=1"], '--set:1: unknown key "gian" in [friction]'),
    (
        [*STEERING, "--set", "friction.gain=1", "--set", "bonus.x=1"],
        '--set:2: unknown key "x" in [bonus]',
    ),
    ([*CREEP, "--nodes", "2"], "a scene with a [rotor] has one"),
    ([*CREEP, "--trace", "x.csv", "--role", "node"], "--role node runs no [rotor] to trace"),
    ([*STEERING, "--bus", f"socketcand:{'x' * 128}:5"], "xx:5: not loopback"),
    ([*STEERING, "--bus", "socketcand:localhost:65536"], "localhost:65536: not loopback"),
    ([*STEERING, "--virtual", "--role", "node"], "--virtual without an encoder never ends"),
]


@pytest.mark.parametrize(
    ("options", "words"), OPTION_ERRORS, ids=[words for _, words in OPTION_ERRORS]
)
def test_bad_options(options, words):
    result = said(*options)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("error: ")
    assert words in result.stderr


SET_ERRORS = [  # scene, what is set, what is said: where, which value, which limit
    ("steering", ["motion.speed=5"], "--set:1: [motion] speed has no meaning"),
    ("steering", ["friction.node=1", "motion.kind=x"], "--set:2: [motion] kind = x: not one of"),
    ("steering", ["status.period_ms=9", "faults.id=0.1"], "--set:2: [faults] needs [friction]"),
    ("steering", ["faults.drop=0.7", "faults.id=0.5"], "--set:1: [faults] rates add up to 1.2"),
    ("steering", ["control.kp=1"], '--set:1: [control] has no key "kd"'),
    ("steering", ["friction.model=x"], "--set:1: [friction] model = x: not one of dahl, slip"),
    ("steering", ["friction.Fc=1 2"], "--set:1: [friction] sigma0 has 1 numbers and Fc 2: model"),
    (
        "steering",
        ["friction.node=2", "friction.theta_per_count=1e-18"],
        "--set:2: [friction] theta",
    ),
    ("creep", ["rotor.viscous=1e5"], "creep.ini:12: [rotor] inertia = 0.02: below 1, the least"),
    ("creep", ["rotor.inertia=1e-7"], "--set:1: [rotor] inertia = 1e-07: below 5e-06, the least"),
    ("creep", ["rotor.inertia=1e-7"], "at which steps of 20 us are stable"),
    ("creep", ["friction.gain=0", "motion.kind=log"], '--set:2: [motion] has no key "file"'),
]


@pytest.mark.parametrize(("scene", "sets", "words"), SET_ERRORS)
def test_what_is_set_is_named_by_its_place_on_the_command_line(scene, sets, words):
    """What stands in the file by its line there, as before."""
    options = setting(*sets)
    done = said("--scene", SCENES / f"{scene}.ini", "--virtual", *options)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert words in done.stderr
    assert done.stderr.startswith("error: --set:") or "creep.ini:12" in words


BUS_ERRORS = [
    ("socketcan:nosuchif0", "--bus socketcan:nosuchif0: "),
    ("socketcand:127.0.0.1:65535", "Connection refused"),
    ("socketcand:::1:1", ":1: "),  # an address with colons: the port stands behind the last
    (f"socketcand:{'x' * 127}:5", "xx:5: Cannot assign requested address"),
    ("socketcand:255.255.255.255:1", "Network is unreachable"),
]


@pytest.mark.parametrize(("bus", "words"), BUS_ERRORS)
def test_a_bus_that_is_not_there(bus, words):
    result = said(*STEERING, "--bus", bus)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert words in result.stderr


PLANTED = """
#include <errno.h>
#include <sys/socket.h>
int socket(int domain, int type, int protocol)
{
    (void)domain, (void)type, (void)protocol;
    errno = PLANT;
    return -1;
}
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("EPERM", "Operation not permitted"),
        ("EACCES", "Permission denied"),
        ("EAFNOSUPPORT", "Address family not supported by protocol (this kernel has no CAN)"),
    ],
)
def test_a_kernel_that_refuses_a_socket_is_told(tmp_path, name, words):
    """No permission, no CAN: what the kernel would say, said by a socket() of our own."""
    planted = tmp_path / "planted.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", f"-DPLANT={name}", "-x", "c", "-", "-o", str(planted)],
        input=PLANTED,
        text=True,
        check=True,
        timeout=60,
    )
    done = subprocess.run(
        [program(), "--scene", str(SCENES / "steering.ini"), "--bus", "socketcan:vcan0"],
        env={**os.environ, "LD_PRELOAD": str(planted)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"error: --bus socketcan:vcan0: {words}\n"


@pytest.mark.parametrize("option", ["--log", "--summary", "--trace"])
@pytest.mark.parametrize("path", ["/dev/full", "absent/file"])
def test_an_output_that_cannot_be_written_is_told(tmp_path, option, path):
    words = ("--virtual", "--set", "motor.seconds=1", option, path)
    result = run(tmp_path, SCENES / "creep.ini", *words)
    assert result.code == 1
    assert result.err.startswith(f"error: {option} {path}: ")
    assert result.err.count("\n") == 1
    assert path == "/dev/full" or "No such file or directory" in result.err


OPTIONS = (
    "scene bus bitrate nodes set role virtual lockstep seconds seed log trace summary wait-clients"
    " until-idle with-parent data log-file help version"
)


def test_the_help_has_a_line_of_each_option():
    """And none that is not taken."""
    told = re.findall(r"^  --([a-z-]+)(?:, --([a-z-]+))?", said("--help").stdout, re.MULTILINE)
    assert sorted(name for both in told for name in both if name) == sorted(OPTIONS.split())
    for name in OPTIONS.split():
        assert "unknown option" not in said(f"--{name}").stderr


def test_help_and_version():
    for option, words in (
        ("--help", "usage: dahl-loop"),
        ("--version", f"dahl-loop {dahl.__version__}"),
    ):
        result = said(option)
        assert (result.returncode, result.stderr) == (0, "")
        assert result.stdout.startswith(words)


def test_a_folder_that_one_may_not_write_to_is_told(tmp_path):
    """As another user where this one may do everything."""
    (tmp_path / "shut").mkdir(mode=0o500)
    other = {"user": 65534} if os.geteuid() == 0 else {}
    done = subprocess.run(
        [program(), *STEERING, "--seconds", "0.1", "--log", tmp_path / "shut" / "run.log"],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
        **other,
    )
    assert done.returncode == 1
    assert done.stderr == f"error: --log {tmp_path}/shut/run.log: Permission denied\n"
