# SPDX-License-Identifier: MIT
"""`dahl identify` on each measured set gives the verdict that the set deserves."""

from __future__ import annotations

import json

import pytest
from dahl import data
from identify_tools import caller

pytestmark = pytest.mark.usefixtures("library")

PNEUMATIC = (
    *("--time", "1", "--angle", "5", "--torque", "7"),
    *("--time-unit", "ms", "--angle-unit", "mm", "--torque-unit", "N"),
)
SERVO = ("--angle", "position", "--torque", "load", "--angle-unit", "rad")
DAMPER = (
    *("--time", "1", "--angle", "2", "--torque", "3"),
    *("--time-unit", "s", "--angle-unit", "in", "--torque-unit", "kip"),
)
PENDULUM = ["2026-01-15_10h28m10.json", "2026-01-15_10h29m04.json"]
DAMPERS = [
    "dataset-1_0.5Hz80lbtension.json",
    "dataset-3_0.5Hz30lbtension0.5amplitude.json",
    "dataset-4_harmonic0.015forward.json",
]
NAMES = (
    "sigma0",
    "Fc",
    "ci95",
    "extra",
    "r2",
    "r2_coulomb",
    "reversals",
    "identifiable",
    "verdict",
)


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


@pytest.fixture(scope="module")
def known():
    """What was found before, by the words of the call."""
    return {}


@pytest.fixture
def identified(run_dahl, known):
    """Run the command on files, once each, return its JSON."""

    def run(*words) -> dict:
        if words in known:
            return known[words]
        done = run_dahl("identify", *words, "--json", "-", "--no-files")
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        assert all(name in found for name in NAMES)
        known[words] = found
        return found

    return run


def test_tribometer(identified, measured_file):
    found = identified(measured_file("tribometer", "reciprocating.tsv"))
    assert 36e3 <= found["sigma0"] <= 40e3  # N/m
    assert 2.6 <= found["Fc"] <= 2.75
    assert found["r2"] >= 0.98
    assert found["identifiable"] == {"sigma0": True, "Fc": True}
    assert found["reversals"] == 60
    assert "loop is bilinear" in found["verdict"]


@pytest.mark.parametrize(("left_out", "least"), [("1", 0.94), ("2", 0.94), ("3", 0.95)])
def test_cycloidal_play_on_a_repetition_not_fitted(identified, measured_file, left_out, least):
    """Offset and spring are found by whole logs left out."""
    files = {n: measured_file("cycloidal", f"play_test{n}.csv") for n in "123"}
    check = files.pop(left_out)
    found = identified(*files.values(), "--check", check)
    assert found["checks"][str(check)] >= least
    assert set(found["extra"]) == {"offset", "spring"}
    assert found["held_out"]["dahl"]["r2"] > found["held_out"]["coulomb"]["r2"] + 0.2
    assert any("turns back at once" in note for note in found["notes"])


@pytest.mark.parametrize("tests", ["1", "2", "12"])
def test_cycloidal_stiffness(identified, measured_file, tests):
    """A control: a stroke each way is too little to claim anything."""
    found = identified(*[measured_file("cycloidal", f"stiffness_test{n}.csv") for n in tests])
    assert found["identifiable"] == {"sigma0": False, "Fc": False}
    assert found["verdict"].startswith("neither sigma0 nor Fc identifiable")
    assert found["extra"]["spring"] == pytest.approx(240, rel=0.05)  # N m/rad


@pytest.mark.parametrize("file", PENDULUM)
def test_servo_pendulum(identified, measured_file, file):
    found = identified(measured_file("servo_pendulum", file), *SERVO)
    assert "Dahl no better than Coulomb" in found["verdict"]
    assert not found["identifiable"]["sigma0"]
    assert any("signed 16-bit" in note for note in found["notes"])


def test_pneumatic_with_its_spikes(identified, measured_file):
    found = identified(measured_file("pneumatic", "Circle_5bar.csv"), *PNEUMATIC)
    assert found["Fc"] == pytest.approx(8.7, rel=0.05)
    assert found["identifiable"] == {"sigma0": False, "Fc": False}
    assert "Fc drifts by +6 %" in found["verdict"]  # cycle by cycle from 8.6 to 9.2 N
    assert any("gaps" in note for note in found["notes"])  # of 147 ms between rows of 10 ms
    assert any("spikes" in note for note in found["notes"])
    assert found["extra"]["offset"] == pytest.approx(5 * 49.5, rel=0.02)  # N, the pressure's load


@pytest.mark.parametrize("file", DAMPERS[:2])
def test_friction_damper(identified, measured_file, file):
    found = identified(measured_file("friction_damper", file), *DAMPER)
    assert 1.5e-3 < found["backlash"] < 3.5e-3  # m
    assert any("backlash" in note for note in found["notes"])
    assert any("backlash" in words for words in found["plan"]["against"])


BOTH, NEITHER = {"sigma0": True, "Fc": True}, {"sigma0": False, "Fc": False}
ONLY_FC = {"sigma0": False, "Fc": True}
PLAY, STIFFNESS = (["play_test1.csv", "play_test2.csv", "play_test3.csv"], ["stiffness_test1.csv"])
NESTED = ("--angle", "1", "--torque", "2", "--angle-unit", "mm")
VERDICTS = {  # of each set: files, words of the call, what is claimed, the reason
    # One slip element explains more, and its slope at rest lies within the interval.
    "tribometer": ("tribometer", ["reciprocating.tsv"], (), BOTH, "slip K=1 explains more"),
    # Three cycles: models with 3120 to 9450 N m/rad predict a log left out as well as each other.
    "play": ("cycloidal", PLAY, (), NEITHER, "sigma0 hangs on the model"),
    # One cycle: a spring or none, 1540 or 3500 N m/rad.
    "one play": ("cycloidal", PLAY[:1], (), NEITHER, "only 1 cycle scored"),
    # A control: the spring of the gear hides presliding, and there is one cycle.
    "stiffness": ("cycloidal", STIFFNESS, (), NEITHER, "only 1 cycle scored"),
    # Controls: a load that swings is no friction.
    "pendulum 1": ("servo_pendulum", PENDULUM[:1], SERVO, NEITHER, "no better than Coulomb"),
    "pendulum 2": ("servo_pendulum", PENDULUM[1:], SERVO, NEITHER, "no better than Coulomb"),
    # Seals bend more slowly than one exponential: two slip elements are half as stiff again.
    "pneumatic 1 bar": ("pneumatic", ["Circle_1bar.csv"], PNEUMATIC, ONLY_FC, "hangs on the model"),
    "pneumatic 3 bar": ("pneumatic", ["PK_3bar.csv"], PNEUMATIC, ONLY_FC, "hangs on the model"),
    # Cycle by cycle Fc goes from 8.6 to 9.2 N.
    "pneumatic 5 bar": ("pneumatic", ["Circle_5bar.csv"], PNEUMATIC, NEITHER, "Fc drifts"),
    # Play counted as travel or not, all within the interval.
    "damper 1": ("friction_damper", DAMPERS[:1], DAMPER, BOTH, "backlash"),
    "damper 3": ("friction_damper", DAMPERS[1:2], DAMPER, BOTH, "backlash"),
    # The load moves within the log.
    "moving load": ("friction_damper", DAMPERS[2:], DAMPER, ONLY_FC, "sigma0 hangs on the model"),
    # Steel hardens: Fc grows with the amplitude.
    "nested loops": ("nested_loops", ["damper1.csv"], NESTED, NEITHER, "Fc drifts"),
}


@pytest.mark.parametrize("name", VERDICTS)
def test_the_verdict_of_each_set(identified, measured_file, name):
    """What is claimed has an interval that says so; what is not has the reason in the same line."""
    folder, files, words, claimed, reason = VERDICTS[name]
    found = identified(*[measured_file(folder, file) for file in files], *words)
    assert found["identifiable"] == claimed
    assert reason in found["verdict"]
    for parameter in (name for name, is_claimed in claimed.items() if is_claimed):
        low, high = found["ci95"][parameter]
        assert low < found[parameter] < high < 2 * low


def test_every_set_has_a_verdict():
    """That of the car has a test of its own."""
    assert set(data.SETS) == {folder for folder, *_ in VERDICTS.values()} | {"can_steering"}


def test_nested_loops(identified, measured_file):
    found = identified(measured_file("nested_loops", "damper1.csv"), *NESTED)
    assert found["r2"] > 0.98


def test_can_logs_of_a_parked_car_are_read_alike_and_claim_nothing(identified, measured_file):
    dbc = measured_file("can_steering", "opendbc_hyundai_can.dbc")
    signals = ("--dbc", dbc, "--angle", "SAS_Angle", "--torque", "CR_Mdps_StrColTq")
    found = [
        identified(measured_file("can_steering", f"kona_ccan_steering_subset.{kind}"), *signals)
        for kind in ("log", "asc", "blf")
    ]
    assert len({one["rows"] for one in found}) == 1
    for one in found:
        assert one["identifiable"] == {"sigma0": False, "Fc": False}
        assert one["sigma0"] == pytest.approx(found[0]["sigma0"], rel=0.01)
