# SPDX-License-Identifier: MIT
"""dahl-loop alone: it refuses a bad run file, file of counts or option in one line with place, key,
value and range, exits with 2 and runs nothing. Scenes: test_scene_errors.py.
"""

import re
from pathlib import Path

import dahl
import pytest
from conftest import ROOT
from dahl.binding import models
from dahl.sim import keys
from loop_tools import SCENES, counts_of, read_log, run, run_alone
from test_scene_errors import BREAKAWAY, beyond

STEERING = ROOT / "host_sim/steering.run"
FRICTION = "friction.sigma0 = 50\nfriction.Fc = 0.5\nfriction.theta_per_count = 1e-4\n"
COUNTS = "motion.kind = counts\nmotion.file = counts.txt\n"
ROTOR = "rotor.inertia = 1e6\nrotor.sigma0 = 50\nrotor.Fc = 0.5\n"
MOTOR = "motor.seconds = 0.01\n"
CONTROL = "control.kp = 1\ncontrol.kd = 1\ncontrol.torque_limit = 1\n"
HAND = "hand.stiffness = 1\nhand.amplitude = 1\nhand.frequency = 1\n"
LOAD = "load.full = 1\n"
SEGMENTS = "motion.kind = segments\nmotion.speed = 1\n" + "".join(
    f"motion.theta{k} = 0\n" for k in (1, 2, 3)
)
STEER = "motion.kind = steering\nmotion.amplitude = 9\nmotion.sweep_s = 1\nmotion.tremor = 0\n"
STEER += "motion.tremor_s = 1\nmotion.seconds = 1\n"


def write(folder: Path, text: str, counts: str = "1\n2\n") -> Path:
    (folder / "counts.txt").write_text(counts)
    (folder / "run.txt").write_text(text)
    return folder / "run.txt"


def refused(place: str, facts: str, *options: object) -> None:
    """Check the one line: it begins with the place and has these words, in this order."""
    error, words = run_alone(*options).error(2), (re.escape(fact) for fact in facts.split())
    assert error.startswith(place) and re.search(".*".join(words), error), (facts, error)


BAD = [  # run file, line if the message has one, words of the error
    ("", "", "friction motion"),
    ("friction.sigma0\n", ":1", "friction.sigma0 section.key"),
    ("[friction]\n", ":1", "[friction]"),
    ("a.b = 1\n", ":1", '"a.b"'),
    ("motion.angle = 1\n", ":1", '"motion.angle"'),  # only in a scene
    (f"{FRICTION}friction.gain =\n", ":4", "friction.gain not finite"),
    (f"{FRICTION}friction.gain = 1 x\n", ":4", "friction.gain 1 x not finite"),
    (f"{FRICTION}friction.gain = nan\n", ":4", "friction.gain nan not finite"),
    (f"{FRICTION}friction.gain = 0x1\n", ":4", "friction.gain 0x1 decimal"),
    (f"{FRICTION}# \0\n", ":4", "0 text"),
    (f"#{'x' * 4095}\n", ":1", "4095"),
    (f"{FRICTION}{STEER}motion.theta1 = 5\n", ":10", "motion.theta1 meaning steering"),
    (f"{FRICTION}friction.node = 1.5\n", ":4", "friction.node 1.5 whole"),
    (f"{FRICTION}friction.node = 1\n# a word\nfriction.node = 1\n", ":6", "twice line 4"),
    (f"{FRICTION}friction.model = {'x' * 1024}\n", ":4", "friction.model 1023"),
    ("friction.sigma0 = 1 2 3 4 5 6 7 8 9\n", ":1", "friction.sigma0 8"),
    (f"{FRICTION}friction.model = lugre\n", ":4", f"lugre dahl slip {BREAKAWAY}"),
    (FRICTION.replace("50", "50 60"), ":2", "sigma0 2 Fc 1 dahl"),
    (f"{FRICTION}friction.model = asymmetric\n", ":2", "sigma0 1 Fc 1 asymmetric"),
    (f"{FRICTION}friction.model = parallel\nfriction.kinds = lugre\n", ":5", "kinds lugre 1"),
    (f"{FRICTION}friction.model = parallel\n", "", "kinds missing parallel"),
    (f"{FRICTION}friction.model = {BREAKAWAY}\n", "", f"breakaway missing {BREAKAWAY}"),
    (f"{FRICTION}friction.breakaway = 0.5\n", ":4", "breakaway meaning dahl"),
    (f"{FRICTION}friction.kinds = slip\n", ":4", "kinds meaning dahl"),
    (FRICTION.replace("1e-4", "1e-30"), ":3", "theta_per_count 1e-30 5.43e-20"),
    (FRICTION.replace("1e-4", "1e-12"), "", "theta_per_count 1e-12 1e-10 2^-30"),
    ("motion.seconds = 1\n", "", "motion.kind missing"),
    ("motion.kind = log\n", ":1", "log segments steering counts"),
    ("motion.kind = counts\n", "", "motion.file missing"),
    (FRICTION + COUNTS + ROTOR, "", "rotor motor control"),
    (FRICTION + COUNTS + ROTOR + MOTOR, "", "motor motion"),
    (FRICTION + COUNTS + CONTROL, "", "control rotor"),
    (FRICTION + ROTOR + CONTROL, "", "control motion"),
    (COUNTS + LOAD, "", "load friction"),
    (FRICTION + COUNTS + HAND, "", "hand rotor"),
    (FRICTION + ROTOR.replace("1e6", "1e-9") + MOTOR, ":4", "rotor.inertia 1e-09 2e-08"),
]


@pytest.mark.parametrize(("text", "line", "words"), BAD)
def test_a_bad_run_file_is_refused(tmp_path, text, line, words):
    path = write(tmp_path, text)
    refused(f"{path}{line}: ", words, path, "--virtual", "--seconds", "0.001")


BAD_COUNTS = [  # counts, line of the error
    ("1\n2 0.5\n\n", ":3"),
    ("1\nx\n", ":2"),
    ("1.5\n", ":1"),
    ("2147483648\n", ":1"),
    ("-2147483649\n", ":1"),
    ("1 2 3\n", ":1"),
    ("1 nan\n", ":1"),
]


@pytest.mark.parametrize(("counts", "line"), BAD_COUNTS)
def test_a_bad_count_is_named_with_its_range(tmp_path, counts, line):
    path = write(tmp_path, FRICTION + COUNTS, counts)
    refused(f"{tmp_path}/counts.txt{line}: ", "-2147483648 2147483647", path, "--virtual")


def test_a_missing_file_is_named(tmp_path):
    refused("no RUN_FILE", "--help")
    refused(f"{tmp_path}/none: ", "No such file", tmp_path / "none")
    path = write(tmp_path, FRICTION + COUNTS, "")
    refused(f"{tmp_path}/counts.txt: ", "no counts", path, "--virtual")
    (tmp_path / "counts.txt").unlink()
    refused(f"{tmp_path}/counts.txt: ", "No such file", path, "--virtual")


BASE = {  # a run in which only the limit of one key of the section matters
    **dict.fromkeys(("rotor", "motor", "hand"), FRICTION + ROTOR + MOTOR + HAND),
    "load": FRICTION + "friction.model = loaded\n" + ROTOR + MOTOR + LOAD,
    "control": FRICTION + SEGMENTS + ROTOR + CONTROL,
}
NUMBERS = [
    key
    for key in keys.KEYS.values()
    if key.type in ("NUMBER", "WHOLE", "LIST") and not key.is_of_scene
]


def run_with(folder: Path, key: keys.Key, value: str) -> Path:
    usual = FRICTION + (STEER if "steering" in key.of else SEGMENTS)
    name = f"{key.section}.{key.name}"
    lines = BASE.get(key.section, usual).splitlines()
    lines = [line for line in lines if not line.startswith(f"{name} =")]
    if key.need == "OWN":
        lines.append(f"friction.model = {models.with_key(key.name).name}")
    return write(folder, "\n".join([f"{name} = {value}", *lines]))


@pytest.mark.parametrize("key", NUMBERS, ids=lambda key: key.place)
def test_each_number_has_the_limits_of_the_table(tmp_path, key):
    # limited by others too
    by_others = key.name in ("sigma0", "Fc", "theta_per_count", "inertia", "stribeck")
    for value in () if by_others else (key.low, key.high):
        path = run_with(tmp_path, key, f"{value:.17g}")
        done = run_alone(path, "--virtual", "--seconds", "0.001")
        assert (done.code, done.err) == (0, ""), value
    for value in beyond(key):
        path = run_with(tmp_path, key, value)
        limits = f"{key.low:.10g} to {key.high:.10g}"
        refused(f"{path}:1: {key.section}.{key.name} = {value}: ", limits, path)


def test_counts_are_replayed_from_a_file_or_a_pipe(tmp_path):
    path = write(tmp_path, COUNTS + "motion.start_count = 2147483647\n", " 1 \r\n-5 0.25\n7")
    log = tmp_path / "run.log"
    assert run_alone(path, "--virtual", "--log", log).code == 0
    assert counts_of(read_log(log)) == [-(2**31), 2147483642, -(2**31) + 6]
    path.write_text(
        f"motion.kind = counts ; a word\nmotion.file = {tmp_path}/counts.txt # a word\n"
    )
    assert run_alone(path, "--virtual", "--log", log).code == 0
    assert counts_of(read_log(log)) == [1, -5, 7]


def test_the_example_is_the_scene_of_its_name(tmp_path):
    run_alone(STEERING, "--virtual", "--log", tmp_path / "alone.log")
    scene = run(tmp_path, SCENES / "steering.ini", "--virtual")
    assert (tmp_path / "alone.log").read_bytes() == scene.log.read_bytes()
    assert "host_sim/steering.run" in run_alone("--help").out


# --- options --------------------------------------------------------------------------------------

OPTION_LIMITS = [
    ("--seconds", "0.001", "1e9", ("0.000999", "1.0001e9", "5m", "", "nan")),
    ("--seed", "0", "18446744073709551615", ("-1", "18446744073709551616", "0x10", "")),
    ("--nodes", "1", "16", ("0", "17", "2.5")),
    ("--with-parent", "1", "2147483647", ("0", "2147483648", "1 2")),
    ("--wait-clients", "0", "16", ("-1", "17", "1.0")),
]


@pytest.mark.parametrize(("option", "least", "greatest", "wrong"), OPTION_LIMITS)
def test_each_option_has_its_limits(tmp_path, option, least, greatest, wrong):
    path = write(tmp_path, FRICTION + STEER.replace("seconds = 1", "seconds = 0.001"))
    taken = {"--with-parent": [greatest], "--wait-clients": [least]}.get(option, [least, greatest])
    for value in taken:  # process 1 is not the parent; clients need a served bus
        assert run_alone(path, option, value, "--virtual").code == 0, value
    for value in wrong:
        refused(f"{option} {value}: ", f"{least} {greatest}", path, option, value)


OPTION_ERRORS = f"""
    --frobnicate => --frobnicate
    -xy => -x
    extra => extra
    --seed => --seed
    --role boss => --role boss both encoder node
    --bus can0 => --bus can0 loopback
    --bus socketcand:99999 => --bus socketcand:99999
    --bus socketcand::5 => --bus socketcand::5
    --bus socketcand:127.0.0.1:0 => --bus socketcand:127.0.0.1:0
    --bus socketcand:{"x" * 128}:5 => --bus socketcand:{"x" * 128}:5
    --bus socketcan: => --bus
    --bus loopback:can1 => --bus loopback:can1
    --wait-clients 1 => --wait-clients socketcand:PORT loopback
    --until-idle --bus socketcand:localhost:5 => --until-idle socketcand:localhost:5
    --virtual --bus socketcand:127.0.0.1:5 => --virtual socketcand:127.0.0.1:5
    --virtual --lockstep => --lockstep --virtual
    --nodes 2 node=15 => --nodes 2 15
    --trace x.csv => --trace x.csv rotor
    --role node --virtual => --virtual --seconds
    --nodes 2 shaft => --nodes 2 rotor
    --trace x.csv --role node shaft => --trace x.csv --role node rotor
"""


@pytest.mark.parametrize("row", OPTION_ERRORS.strip().splitlines())
def test_a_bad_option_is_refused(tmp_path, row):
    """`shaft` and `node=15` stand for lines of the run file."""
    options, words = row.partition(" =>")[0].split(), row.partition(" =>")[2]
    text = FRICTION + (ROTOR + MOTOR if "shaft" in options else STEER)
    text += "friction.node = 15\n" * ("node=15" in options)
    options = [word for word in options if word not in ("shaft", "node=15")]
    refused("", words, write(tmp_path, text), *options)


@pytest.mark.parametrize(
    ("role", "text", "missing"), [("node", STEER, "friction"), ("encoder", FRICTION, "motion")]
)
def test_a_role_needs_its_section(tmp_path, role, text, missing):
    path = write(tmp_path, text)
    refused(f"{path}: ", f"{missing} --role", path, "--role", role)


def test_help_lists_options_that_exist_and_version_is_that_of_the_package():
    done, version = run_alone("--help"), run_alone("--version")
    assert (done.code, version.code) == (0, 0)
    assert version.out == f"dahl-loop {dahl.__version__}\n"
    options = re.findall(r"^  (--[a-z-]+)", done.out, re.MULTILINE)
    assert len(options) == 14
    assert not [name for name in options if "unknown option" in run_alone(name).err]
