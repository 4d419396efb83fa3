# SPDX-License-Identifier: MIT
"""`dahl identify` on the measured sets: how much it explains of cycles left out, and which claims
it must not make.
"""

import json
from collections.abc import Callable

import numpy as np
import pytest
from dahl.io import data
from log_reading import run

PNEUMATIC = "--time 1 --angle 5 --torque 7 --time-unit ms --angle-unit mm --torque-unit N"
SERVO = "--angle position --torque load --angle-unit rad"
DAMPER = "--time 1 --angle 2 --torque 3 --time-unit s --angle-unit in --torque-unit kip"
MOVING_LOAD = "dataset-4_harmonic0.015forward.json"
PLAY = [f"play_test{n}.csv" for n in "123"]
STIFFNESS = [f"stiffness_test{n}.csv" for n in "12"]
SETS = {  # folder, files of one fit, words of the call
    "tribometer": ("tribometer", ["reciprocating.tsv"], ""),
    "pneumatic 1 bar": ("pneumatic", ["Circle_1bar.csv"], PNEUMATIC),
    "pneumatic 3 bar": ("pneumatic", ["PK_3bar.csv"], PNEUMATIC),
    "pneumatic 5 bar": ("pneumatic", ["Circle_5bar.csv"], PNEUMATIC),
    "damper 1": ("friction_damper", ["dataset-1_0.5Hz80lbtension.json"], DAMPER),
    "damper 3": ("friction_damper", ["dataset-3_0.5Hz30lbtension0.5amplitude.json"], DAMPER),
    "moving load": ("friction_damper", [MOVING_LOAD], DAMPER),
    "steel damper": ("nested_loops", ["damper1.csv"], "--angle 1 --torque 2 --angle-unit mm"),
    "play": ("cycloidal", PLAY, ""),
    "one play": ("cycloidal", PLAY[:1], ""),
    "both stiffnesses": ("cycloidal", STIFFNESS, ""),
    "pendulum 1": ("servo_pendulum", ["2026-01-15_10h28m10.json"], SERVO),
    "pendulum 2": ("servo_pendulum", ["2026-01-15_10h29m04.json"], SERVO),
}
MIN_R2 = {  # of the best hypothesis, on cycles left out, to the digits given
    "tribometer": 0.997,
    "pneumatic 1 bar": 0.989,
    "damper 1": 0.979,
    "steel damper": 0.98,
}
MIN_R2_OF_PLAY = {"1": 0.94, "2": 0.94, "3": 0.95}  # on the log left out
MIN_R2_BY_LOAD = 0.96  # on the second half of the log, from its first half
FEW_CYCLES = ("play", "one play", "both stiffnesses")  # fewer than six
CONTROLS = ("pendulum 1", "pendulum 2")  # a swinging load is no friction
WITHIN = {  # values from papers on these machines and from direct fits
    "tribometer": {"sigma0": (36e3, 41e3), "Fc": (2.6, 2.75)},
    "pneumatic 5 bar": {"Fc": (8.3, 9.2)},
}


def identified_by(*words: object) -> dict:
    done = run("identify", *words, "--json", "-", "--no-files")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout, parse_constant=pytest.fail)


@pytest.fixture
def identified(measured_file) -> Callable[..., dict]:
    def identify(name: str, *more: object, files: list[str] | None = None) -> dict:
        folder, usual, words = SETS[name]
        paths = [measured_file(folder, file) for file in files or usual]
        return identified_by(*paths, *words.split(), *more)

    return identify


@pytest.mark.parametrize("name", SETS)
def test_a_measured_set_is_explained_and_claimed_by_the_rule_alone(identified, name):
    """Six cycles, a narrow interval; the negative controls claim nothing."""
    found = identified(name)
    best, wanted = max(one["r2"] for one in found["choices"]), MIN_R2.get(name, 0.0)
    assert round(best, len(str(wanted)) - 2) >= wanted
    if name in FEW_CYCLES:
        assert found["cycles_scored"] < 6 and "cycles" in found["verdict"]
    for parameter, is_claimed in found["identifiable"].items():
        low, high = found["ci95"][parameter]
        if is_claimed:
            assert name not in (*FEW_CYCLES, *CONTROLS) and found["cycles_scored"] >= 6
            assert (high - low) / 2 / found[parameter] <= 0.3
            least, most = WITHIN.get(name, {}).get(parameter, (low, high))
            assert low <= most and least <= high


@pytest.mark.parametrize("number", MIN_R2_OF_PLAY)
def test_cycloidal_play_on_a_repetition_not_fitted(identified, measured_file, number):
    other = measured_file("cycloidal", f"play_test{number}.csv")
    files = [file for file in PLAY if file != other.name]
    found = identified("play", "--check", other, files=files)
    assert round(found["checks"][str(other)], 2) >= MIN_R2_OF_PLAY[number]
    assert any("turns back at once" in note for note in found["notes"])


def test_the_moving_load_of_the_band_brake(measured_file, tmp_path):
    """Two electric actuators move the band during the test: the first half is fitted and the second
    predicted, with the sum of their positions as load.
    """
    path = measured_file("friction_damper", MOVING_LOAD)
    whole = np.array(json.loads(path.read_text())["data"])
    half = len(whole) // 2
    names = "time_s,x_in,force_kip,first,second"
    for name, rows in (("first", whole[:half]), ("second", whole[half:])):
        table = rows[:, [0, 1, 2, 4, 5]]
        np.savetxt(tmp_path / f"{name}.csv", table, "%.12g", ",", header=names, comments="")
    other = tmp_path / "second.csv"
    load = ("--load", "first", "--load", "second")
    words = ("--angle", "x_in", "--torque", "force_kip", *load, "--check", other)
    assert identified_by(tmp_path / "first.csv", *words)["checks"][str(other)] >= MIN_R2_BY_LOAD


def test_can_logs_of_a_parked_car_are_read_alike_and_claim_nothing(measured_file):
    assert set(data.SETS) == {folder for folder, *_ in SETS.values()} | {"can_steering"}
    dbc = measured_file("can_steering", "opendbc_hyundai_can.dbc")
    words = ("--dbc", dbc, "--angle", "SAS_Angle", "--torque", "CR_Mdps_StrColTq")
    path = measured_file("can_steering", "kona_ccan_steering_subset.log")
    found = [identified_by(path.with_suffix(f".{kind}"), *words) for kind in ("log", "asc", "blf")]
    assert len({one["rows"] for one in found}) == 1
    for one in found:
        assert one["identifiable"] == {"sigma0": False, "Fc": False}
        assert one["sigma0"] == pytest.approx(found[0]["sigma0"], rel=0.01)
