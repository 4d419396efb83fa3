# SPDX-License-Identifier: MIT
"""`dahl fmu`: torques of each model against its Python class, split steps, states, errors."""

import math
import re
import struct
import zipfile
from ctypes import c_size_t, c_uint
from functools import partial
from pathlib import Path

import dahl as package
import fmu_instance
import numpy as np
import pytest
from dahl.binding import models
from dahl.simulators import fmu
from fmu_instance import CO_SIMULATION, ERROR, OK, Instance
from identify_tools import complaint
from model_examples import THETA, made, numbers, whole

MODELS = list(models.table().values())
DAHL = MODELS[0]
COUNT = float(np.float32(THETA))
EVERY = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
BY_TRAVEL = pytest.mark.parametrize(  # their torque does not depend on the length of a step
    "model", [model for model in MODELS if model.key != "stribeck"], ids=lambda model: model.name
)


@pytest.fixture(params=fmu.VERSIONS, ids="fmi{}".format)
def export(dahl, request):
    """Write an FMU of this version of FMI."""
    return partial(fmu_instance.export, dahl, request.param)


def walk(seed: int, rows: int = 300) -> np.ndarray:
    """Counts from moves of very different lengths."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.integers(-9, 10, rows) * 10 ** rng.integers(0, 5, rows))


def loads(model: models.Model, seed: int = 1) -> list[dict[str, float]]:
    values = np.random.default_rng(seed).uniform(0, 2, 300)
    return [{"load": float(value)} if model.name == "loaded" else {} for value in values]


@EVERY
def test_by_counts_the_torques_have_the_bits_of_the_python_class(export, model):
    one = Instance(export(model, "--theta-per-count", THETA)).initialize(angle=5 * COUNT)
    element, moves = made(model), np.diff(walk(1), prepend=5)
    if model.name == "dahl":
        element = package.Friction(element)
    angles = (walk(1) + np.random.default_rng(1).uniform(-0.49, 0.49, 300)) * COUNT
    for angle, move, load in zip(angles, moves, loads(model), strict=True):
        torque = one.step(angle=angle, **load)
        assert torque == element.step_counts(int(move), **load)
        assert one.get("ratio") == pytest.approx(torque / whole(model), abs=2e-7)
    one.step(angle=-COUNT * 2.0**50)
    assert abs(one.get("ratio")) == 1 or model.name == "loaded"


UNITS = {"angle": "rad", "theta_per_count": "rad", "sigma0": "N.m/rad", "Fc": "N.m", "time": "s"}
UNITS |= {"torque": "N.m", "Fs": "N.m", "sigma1": "N.m.s/rad"}


@EVERY
def test_each_variable_has_its_unit_and_each_parameter_its_start_value(export, model):
    """In the description, which tools show, and in the instance."""
    one, found = Instance(export(model)), {}
    for name, values in zip(("sigma0", "Fc"), numbers(model), strict=True):
        names = [name] if len(values) == 1 else [f"{name}[{k}]" for k in range(len(values))]
        if name == "Fc" and model.has_two_limits:
            names = ["Fs", "Fc"] if model.key else ["Fc_forward", "Fc_backward"]
        found |= dict(zip(names, values, strict=True))
    assert {name: one.get(name) for name in found} == pytest.approx(found)
    for row in one.xml.find("ModelVariables"):
        name, number = row.get("name"), row.attrib | (row[0].attrib if one.fmi == 2 else {})
        assert number.get("unit", "") == UNITS.get(re.match("Fc|sigma0|.*", name)[0], "")
        if row.get("causality") in ("parameter", "input"):
            assert float(number["start"]) == one.get(name)


@pytest.mark.parametrize("words", [(), ("--fixed-stiffness",)])
def test_by_angle_the_torques_have_the_bits_of_the_python_class(export, words):
    model = models.table()["loaded" if words else "dahl"]
    one = Instance(export(model, *words)).initialize(sigma0=90.3, Fc=0.7, angle=-0.1)
    plan = package.Plan(90.3, 0.7)
    element = package.Loaded(plan, fixed_stiffness=True) if words else package.Friction(plan)
    angles = walk(2) * 1.1e-4
    for angle, move, load in zip(angles, np.diff(angles, prepend=-0.1), loads(model), strict=True):
        assert one.step(angle=angle, **load) == element.step(float(np.float32(move)), **load)


@BY_TRAVEL
def test_a_step_may_be_split_and_the_default_counts_are_fine(export, model):
    """At an intermediate angle of the same direction, and without motion."""
    path = export(model)
    one = Instance(path)
    split, fine = (Instance(path, Path(one.functions._name)) for _ in range(2))  # one library
    fine.initialize(theta_per_count=5e-11)
    one.initialize(), split.initialize()
    before = 0.0
    for angle, load in zip(walk(3) * 1e-5, loads(model), strict=True):
        torque = one.step(angle=angle, **load)
        assert fine.step(angle=angle, **load) == pytest.approx(torque, abs=5e-6 * whole(model))
        split.step(2e-4, angle=before + (angle - before) / 3, **load)
        halfway = split.step(5e-4, angle=angle)
        assert halfway == pytest.approx(torque, abs=5e-6 * whole(model))
        assert split.step(3e-4) == halfway
        before = angle


@EVERY
def test_sigma1_adds_the_change_by_a_move_over_its_time(export, model):
    """Within twice the largest torque. A change of the load alone adds nothing."""
    path, sigma1, before = export(model), 0.07, 0.0
    one, plain = Instance(path).initialize(sigma1=sigma1), Instance(path).initialize()
    gain, limit = sigma1 / sum(numbers(model)[0]), 2 * whole(model)
    durations = 10 ** np.random.default_rng(7).uniform(-5, 0, 300)
    for angle, load, time in zip(walk(6) * 1e-5, loads(model), durations, strict=True):
        unmoved, torque = plain.step(angle=before, **load), plain.step(angle=angle, **load)
        expected = np.clip(torque + gain * (torque - unmoved) / time, -limit, limit)
        assert one.step(time, angle=angle, **load) == pytest.approx(expected, rel=1e-6, abs=1e-9)
        before = angle


@EVERY
def test_with_sigma1_a_shaft_under_half_of_Fc_comes_to_rest(export, model):
    """And each swing is smaller than the last one."""
    sigma0, Fc = (np.array(each, float) for each in numbers(model))
    inertia, step = 1 / 150, 0.25 * math.sqrt(1 / 150 / sigma0.sum())
    one = Instance(export(model)).initialize(sigma1=0.6 * math.sqrt(inertia * sigma0.sum()))
    angle, speed, friction, speeds = 0.0, 0.0, 0.0, []
    for _ in range(round(10 / step)):
        speed += (Fc.min() / 2 - friction) / inertia * step
        angle += speed * step
        friction = one.step(step, angle=angle)
        speeds.append(abs(speed))
    peaks = [max(speeds[k : k + 100]) for k in range(0, len(speeds), 100)]
    assert (np.diff(peaks) < 1e-6).all() and peaks[-1] < 1e-5


def test_a_move_may_have_more_counts_than_an_integer(export):
    one = Instance(export(DAHL)).initialize(theta_per_count=2e-12)  # 1e-9 of Fc/sigma0
    assert one.step(angle=0.01) == pytest.approx(0.2 * -math.expm1(-5), rel=1e-6)


@EVERY
def test_a_saved_state_continues_with_the_same_bits(export, model):
    path = export(model, "--theta-per-count", THETA)
    one, other = Instance(path).initialize(theta_per_count=1e-4, sigma1=0.01), Instance(path)
    angles = walk(4) * 3e-5
    for angle, load in zip(angles[:150], loads(model), strict=False):
        one.step(angle=angle, **load)
    saved, torque = one.save(), one.get("torque")
    rest = list(zip(angles[150:], loads(model)[150:], strict=True))
    continued = [one.step(angle=angle, **load) for angle, load in rest]
    for instance in (one, other):
        assert instance.restore(saved) == OK and instance.save() == saved
        assert instance.get("torque") == torque
        assert [instance.step(angle=angle, **load) for angle, load in rest] == continued
    assert one.call("Reset") == OK and one.get("torque") == 0
    assert one.save() == Instance(path).save() and len(set(continued)) > 20


def with_nan(one: Instance, name: str) -> bytes:
    """Return a saved state with NaN in place of a value."""
    return one.save().replace(struct.pack("d", one.get(name)), struct.pack("d", math.nan), 1)


def with_word(one: Instance, place: int, form: str, value: float) -> bytes:
    """Return a saved state with another value at this place."""
    saved = bytearray(one.save())
    struct.pack_into(form, saved, place, value)
    return bytes(saved)


GUID, MODE, POSITION, UNUSED = 0, 40, 48, 64  # places in fmu_state_t of port/fmu/fmu.h
NOTHING = (None, c_size_t(1), None, c_size_t(1))  # the arguments of a call for one variable
EARLY = [  # before the initialization: facts that the message names in this order, the call
    ("fmi#DoStep fmi#ExitInitializationMode", lambda one: one.do_step(1)),
    ("sigma0 -1 5.42101086e-20 1.84467441e+19", lambda one: one.set(sigma0=-1)),
    ("Fc 0 5.42101086e-20", lambda one: one.set(angle=1, Fc=0)),
    ("theta_per_count nan", lambda one: one.set(theta_per_count=math.nan)),
    ("theta_per_count -1 0", lambda one: one.set(theta_per_count=-1)),
    ("sigma1 -1 0", lambda one: one.set(sigma1=-1)),
]
LATE = [  # after it
    ("sigma0 2 fixed fmi#ExitInitializationMode", lambda one: one.set(sigma0=2)),
    ("theta_per_count 1 fixed", lambda one: one.set(theta_per_count=1)),
    ("fmi#EnterInitializationMode fmi#Reset", lambda one: one.call("EnterInitializationMode")),
    ("communicationStepSize 0", lambda one: one.do_step(0)),
    ("communicationStepSize -1", lambda one: one.do_step(-1)),
    ("communicationStepSize nan", lambda one: one.do_step(math.nan)),
]
ALWAYS = [
    ("angle nan -1e+30 1e+30", lambda one: one.set(angle=math.nan)),
    ("angle 1e+30", lambda one: one.set(angle=1e30)),
    ("torque output", lambda one: one.set(torque=0)),
    ("fmi#Set 1 dahl", lambda one: one.set(load=1)),
    ("fmi#Set 99 dahl", lambda one: one.set(none=1)),
    ("fmi#Get NULL", lambda one: one.access("Get", None, 1, None)),
    ("fmi#Set NULL", lambda one: one.access("Set", (c_uint * 1)(), 1, None)),
    ("fmi#GetFMU NULL", lambda one: one.call("GetFMUstate", None)),
    ("fmi#SetFMU NULL", lambda one: one.call("SetFMUstate", None)),
    ("fmi#SerializedFMU NULL", lambda one: one.call("SerializedFMUstateSize", None, None)),
    ("fmi#SerializeFMU NULL", lambda one: one.call("SerializeFMUstate", None, None, c_size_t(8))),
    ("fmi#De NULL", lambda one: one.call("DeSerializeFMUstate", None, c_size_t(8), None)),
    ("erializeFMU Fc nan", lambda one: one.restore(with_nan(one, "Fc"))),
    ("erializeFMU size 1", lambda one: one.restore(b"x")),
    ("erializeFMU size", lambda one: one.restore(one.save()[:-1])),
    ("erializeFMU size", lambda one: one.restore(one.save() + b"x")),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, GUID, "b", 0))),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, MODE, "Q", 4))),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, POSITION, "d", math.inf))),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, UNUSED, "d", math.nan))),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, UNUSED, "d", -1))),
    ("erializeFMU no state", lambda one: one.restore(with_word(one, UNUSED, "d", 1))),
]
OF_FMI3 = [
    ("time output", lambda one: one.set(time=1)),
    ("fmi3GetFloat64 nValues 2 1", lambda one: one.call("GetFloat64", *NOTHING[:3], c_size_t(2))),
    ("fmi3SetFloat64 nValues 2 1", lambda one: one.call("SetFloat64", *NOTHING[:3], c_size_t(2))),
]
EARLY_OF_FMI3 = [("fmi3EnterInitializationMode time nan", lambda one: one.enter(math.nan))]
LATE_OF_FMI3 = [
    ("fmi3DoStep time inf", lambda one: one.do_step(math.inf)),
    ("fmi3DoStep NULL", lambda one: one.call("DoStep", 0, 0, 0, None, None, None, None)),
]


@pytest.mark.parametrize("is_ready", [False, True])
def test_an_error_is_one_line_and_changes_nothing(export, is_ready):
    one = Instance(export(DAHL))
    one.references |= {"none": 99, "load": 1}
    if is_ready:
        one.initialize().step(angle=0.01)
    cases = (LATE if is_ready else EARLY) + ALWAYS
    if one.fmi == 3:
        cases += (LATE_OF_FMI3 if is_ready else EARLY_OF_FMI3) + OF_FMI3
    before = one.save()
    for number, (facts, call) in enumerate(cases, 1):
        assert call(one) == ERROR, facts
        words = facts.replace("#", str(one.fmi)).split()
        assert re.search(".*".join(map(re.escape, words)), one.messages[-1]), one.messages[-1]
        assert len(one.messages) == number and "\n" not in one.messages[-1]
        assert one.save() == before
    assert one.call("FreeFMUstate", None) == OK


MODES = [["enter"], ["leave"], ["do_step", "Terminate"], []]  # calls that each mode allows


def test_each_mode_allows_its_calls_and_can_be_saved(export):
    one = Instance(export(DAHL))
    calls = {"enter": one.enter, "leave": one.leave, "do_step": partial(one.do_step, 1e-3)}
    calls["Terminate"] = partial(one.call, "Terminate")
    for allowed in MODES + MODES:
        assert {name for name in calls.keys() - allowed if calls[name]() == OK} == set()
        assert [name for name in allowed if calls[name]() == OK] == allowed
        assert one.restore(one.save()) == OK
        assert allowed or one.call("Reset") == OK


def test_a_saved_state_with_a_wrong_byte_is_refused_or_safe(export):
    one = Instance(export(DAHL)).initialize()
    one.step(angle=0.01)
    good = one.save()
    for place in range(len(good)):
        wrong = bytearray(good)
        wrong[place] ^= 0x55
        if one.restore(bytes(wrong)) == OK:
            if one.do_step(1) == OK:
                assert abs(one.get("torque")) <= np.float32(one.get("Fc"))
            assert one.restore(good) == OK
        assert one.save() == good


DENIED = {  # functions of features that the model does not have
    2: ["GetInteger", "SetString", "SetRealInputDerivatives", "CancelStep"],
    3: ["GetInt32", "SetString", "GetBinary", "SetClock", "GetDirectionalDerivative"],
}


def test_a_function_of_a_missing_feature_is_an_error_and_changes_nothing(export):
    one = Instance(export(DAHL)).initialize(angle=0.01)
    before = one.save()
    for number, name in enumerate(DENIED[one.fmi], 1):
        assert one.call(name, *NOTHING, *[None] * 5) == ERROR
        assert len(one.messages) == number
        assert one.messages[-1].startswith(f"fmi{one.fmi}{name}: ")
    for name in ("GetInteger", "SetString") if one.fmi == 2 else ("GetInt32", "SetString"):
        assert one.call(name, None, c_size_t(0), None, c_size_t(0)) == OK
    assert one.save() == before


def test_time_is_that_of_the_last_step(dahl):
    one = Instance(fmu_instance.export(dahl, 3, DAHL))
    assert one.get("time") == 0 and one.enter(2.5) == one.leave() == OK
    saved = one.save()
    assert one.get("time") == 2.5 and one.do_step(0.25, 2.5) == OK and one.get("time") == 2.75
    assert one.restore(saved) == OK and one.get("time") == 2.5
    assert one.call("Reset") == OK and one.get("time") == 0


def test_a_saved_state_whose_values_do_not_fit_changes_nothing(export):
    """Each value of it is in range, but the travel of a count is not."""
    path = export(DAHL, "--theta-per-count", THETA)
    one, other = Instance(path).initialize(), Instance(path).initialize()
    saved = one.save()
    theta = struct.pack("d", one.get("theta_per_count"))
    wrong = saved.replace(theta, struct.pack("d", 1e9))
    assert wrong != saved and one.restore(wrong) == ERROR and one.save() == saved
    assert f"fmi{one.fmi}SetFMU" in one.messages[0] and "2^20" in one.messages[0]
    assert one.step(angle=0.01) == other.step(angle=0.01)


INITIALIZATIONS = [  # model, values that are set, facts of the message
    ("slip", {"theta_per_count": 1e9}, "sigma0[0] = 100 Fc[0] = 0.2 = 1e+09 5e+11 2^20"),
    ("asymmetric", {"theta_per_count": 1e-4, "Fc_backward": 1e-9}, "sigma0 = Fc_backward = 1e-09"),
    ("dahl", {"sigma0": 2.0**64 - 2.0**20}, "rounded to float"),
    ("dahl", {"Fc": 2.0**64 - 2.0**20}, "rounded to float"),
]


@pytest.mark.parametrize(("model", "values", "facts"), INITIALIZATIONS)
def test_parameters_that_do_not_fit_are_an_error_of_the_initialization(
    export, model, values, facts
):
    one = Instance(export(models.table()[model]))
    assert one.enter() == one.set(**values) == OK
    assert one.leave() == ERROR
    assert re.search(".*".join(map(re.escape, facts.split())), one.messages[0])
    assert one.set(**dict.fromkeys(values, 1e-4)) == one.leave() == OK


def test_the_smallest_breakaway_can_be_set_saved_and_restored(export):
    path = export(models.with_key("breakaway"), "--breakaway", 1e-44)
    one = Instance(path).initialize(breakaway=1e-44)
    assert one.restore(one.save()) == OK


WRONG = {  # arguments of an instantiation, facts of the message
    2: [({"kind": 1 - CO_SIMULATION}, "fmi2CoSimulation")],
    3: [
        ({"kind": "ModelExchange"}, "fmi3InstantiateModelExchange only co-simulation"),
        ({"kind": "ScheduledExecution"}, "fmi3InstantiateScheduledExecution only co-simulation"),
        ({"events": True}, "eventModeUsed hasEventMode"),
        ({"n": 1}, "nRequiredIntermediateVariables providesIntermediateUpdate"),
    ],
}


def test_an_instance_of_another_fmu_or_kind_is_refused(export):
    path, other = export(DAHL), Instance(export(DAHL, name="other.fmu"))
    assert not Instance(path, guid=other.guid).component
    (message,) = Instance(path, guid="%n%s").messages  # the logger of FMI 2.0 uses it as a format
    assert "GUID" in message and ("%" in message) == (other.fmi == 3)
    for words, facts in WRONG[other.fmi]:
        wrong = Instance(path, **words)
        assert not wrong.component
        assert re.search(".*".join(map(re.escape, facts.split())), wrong.messages[0])
    assert Instance(path).restore(other.save()) == ERROR
    for name in ("DoStep", "Reset", "GetFMUstate", "Terminate", "SetDebugLogging"):
        assert wrong.call(name, *[None] * 8) == ERROR  # a component that is NULL
    assert wrong.access("Get", None, 1, None) == wrong.access("Set", None, 1, None) == ERROR


def test_equal_options_give_equal_bytes_and_other_options_another_guid(export):
    first = export(DAHL).read_bytes()
    assert export(DAHL).read_bytes() == first
    with zipfile.ZipFile("x.fmu") as content:  # also at another time
        assert {file.date_time for file in content.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    options = [(), ("--name", "seal"), ("--theta-per-count", 1e-4), ("--fc", 0.3)]
    guids = {Instance(export(DAHL, *more)).guid for more in options}
    assert len(guids) == len(options)


def test_another_shared_object_is_refused(dahl, library, monkeypatch):
    monkeypatch.setenv("DAHL_FMU", str(library))
    code, line = complaint(dahl("fmu", "--sigma0", 1, "--fc", 1, "-o", "x.fmu"))
    assert code == 1 and str(library) in line and not Path("x.fmu").exists()
