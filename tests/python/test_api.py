# SPDX-License-Identifier: MIT
"""The Python API takes nothing silently: a wrong argument is one line with name, value and limit.
Values are values: equal, copied, pickled.
"""

from __future__ import annotations

import _ctypes
import copy
import inspect
import math
import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from ctypes import Structure
from decimal import Decimal
from fractions import Fraction
from functools import partial
from types import ModuleType

import dahl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_public_classes import KINDS, Kind

pytestmark = pytest.mark.usefixtures("library")

NO_NUMBER = [
    *(None, "1", b"1", True, np.True_, 1j, [1.0], (), {}, ..., Decimal(1)),
    *(np.array(1), np.array([1]), np.ma.masked, np.ma.array([1])),
]
NOT_WHOLE = [0.5, -1e-300, math.nan, math.inf, -math.inf, Fraction(1, 3), np.float32(2.5)]
BEYOND = [2**31, -(2**31) - 1, 2**64, -(10**400), 1e300, np.int64(2**31), np.uint64(2**63)]


def bearing() -> dahl.Friction:
    """One that carries some torque."""
    one = dahl.Friction(dahl.Plan(100.0, 0.5, 1e-4))
    one.step_counts(7)
    return one


def refused(call, *words: str) -> None:
    """The call raises dahl.Error, in one line that holds all the words."""
    with pytest.raises(dahl.Error) as caught:
        call()
    said = str(caught.value)
    assert "\n" not in said and len(said) < 300
    for word in words:
        assert word in said, said


SCALARS = {
    "sigma0": lambda v: dahl.Plan(v, 1.0, 1.0),
    "Fc": lambda v: dahl.Plan(1.0, v, 1.0),
    "theta_per_count": lambda v: dahl.Plan(1.0, 1.0, v),
    "sigma0 ": lambda v: dahl.Throughput(v, 1.0, 1.0),
    "Fc ": lambda v: dahl.Throughput(1.0, v, 1.0),
    "theta_per_count ": lambda v: dahl.Throughput(1.0, 1.0, v),
    "dtheta": lambda v: bearing().step(v),
    "F": lambda v: bearing().set_torque(v),
    "F ": lambda v: setattr(bearing(), "torque", v),
    "F  ": lambda v: dahl.Throughput(1, 1, 1).run_counts([1], F=v),
    "F   ": lambda v: dahl.Throughput(1, 1, 1).run([1.0], F=v),
}
COUNTS = {
    "dcounts": lambda v: bearing().step_counts(v),
    "dcounts ": lambda v: bearing().step_counts_q30(v),
}
READINGS = {
    "before": lambda v: dahl.counts_between(v, 1),
    "now": lambda v: dahl.counts_between(1, v),
    "modulus": lambda v: dahl.counts_between(0, 0, v),
}
UNITS = {"ratio_q30": lambda v: dahl.to_units(v, 1), "Fc_units": lambda v: dahl.to_units(1, v)}
STATES = {"w": dahl.State, "w ": lambda v: setattr(bearing().state, "w", v)}


@pytest.mark.parametrize("value", NO_NUMBER, ids=repr)
@pytest.mark.parametrize("name", [*SCALARS, *COUNTS, *READINGS, *UNITS, *STATES])
def test_what_is_no_number_is_named(name, value):
    call = {**SCALARS, **COUNTS, **READINGS, **UNITS, **STATES}[name]
    refused(lambda: call(value), f"{name.strip()} = ", "is not a number; ", "was expected")


@pytest.mark.parametrize("value", NOT_WHOLE + BEYOND, ids=repr)
@pytest.mark.parametrize("name", COUNTS)
def test_counts_beyond_int32_or_not_whole_are_named(name, value):
    refused(
        lambda: COUNTS[name](value),
        f"{name.strip()} = ",
        "is not a whole number from -2147483648 to 2147483647",
    )


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1, 0.5, float("nan")])
@pytest.mark.parametrize("name", UNITS)
def test_a_ratio_and_Fc_outside_their_range_are_named(name, value):  # noqa: N802
    refused(lambda: UNITS[name](value), f"{name} = ")


@pytest.mark.parametrize("value", [*NOT_WHOLE, -1, 2**32, 2**40, 1e300], ids=repr)
@pytest.mark.parametrize("name", READINGS)
def test_readings_and_modulus_beyond_uint32_are_named(name, value):
    refused(
        lambda: READINGS[name](value), f"{name} = ", "is not a whole number from 0 to 4294967295"
    )


@pytest.mark.parametrize(
    "value", [*NOT_WHOLE, 2**62 + 2**31, -(2**62) - 2**31 - 1, 2**64], ids=repr
)
@pytest.mark.parametrize("name", STATES)
def test_states_that_no_step_can_leave_are_named(name, value):
    refused(lambda: STATES[name](value), "w = ", "is not a whole number from -4611686020574871552")


@pytest.mark.parametrize("kind", [dahl.Plan, dahl.Throughput])
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((10**400, 1, 1), ("sigma0 = inf", "2^-64 <= sigma0 < 2^64")),
        ((np.timedelta64(1, "s"), 1, 1), ("sigma0 = ", "is not a number")),
        (
            (2, 0.5, 2.0**18),
            ("= 1.04858e+06 ", "travel < 2^20 (sigma0 = 2, Fc = 0.5, theta_per_count = 262144)"),
        ),
        ((1, 1, 2.0**-30 * (1 - 2.0**-24)), ("= 9.313225191043273e-10", "2^-30 <= travel")),
    ],
    ids=repr,
)
def test_parameters_are_named_with_their_limits(kind, arguments, words):
    refused(lambda: kind(*arguments), *words)


def test_limits_themselves_are_taken():
    for kind in (dahl.Plan, dahl.Throughput):
        kind(2.0**-64, 2.0**-64, 2.0**-30)
        kind(1, 1, np.nextafter(np.float32(2**20), np.float32(0)))
    assert dahl.counts_between(2**32 - 1, 0) == 1
    assert dahl.counts_between(65535, 0, 65536) == 1
    assert dahl.counts_between(0, 0, 2**32 - 1) == 0
    assert bearing().step_counts(-(2**31)) == -0.5
    for w in (-(2**62) - 2**31, 2**62 + 2**31 - 1):  # of the header
        assert dahl.State(w).w == w


@pytest.mark.parametrize(
    "beyond",
    [
        np.array([1, 2.0**31], np.float32),
        np.array([1, -(2.0**31) - 256], np.float32),
        np.array([1, math.inf], np.float16),
        np.array([1, math.nan], np.float16),
    ],
)
def test_moves_of_narrow_floats_beyond_the_range_are_refused(beyond):
    """Their nearest to 2^31 - 1 is 2^31, or infinite."""
    with warnings.catch_warnings(), pytest.raises(dahl.Error, match=r"moves\[1\] = "):
        warnings.simplefilter("error")
        dahl.Friction(dahl.Plan(100, 0.5, 1e-3)).run_counts(beyond)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_moves_and_loads_are_the_same_in_any_type(kind):
    """The range of half precision ends below that of the int32 that moves are compared with."""
    moves, loads = np.array([1000, 1000, 0], kind), np.array([1.0, 0.5, 1.5], kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        torques = dahl.Loaded(dahl.Plan(100, 0.5, 1e-3)).run_counts(moves, loads)
    assert torques.tolist() == [0.5, 0.25, 0.25]


def test_numbers_of_any_kind_are_numbers():
    plan = dahl.Plan(np.float64(100), Fraction(1, 2), np.float32(1e-4))
    assert plan == dahl.Plan(100, 0.5, 1e-4)
    one = dahl.Friction(plan)
    wanted = dahl.Friction(plan).step_counts(3)
    for value in (3, 3.0, np.int8(3), np.uint64(3), np.float16(3), Fraction(3)):
        assert copy.copy(one).step_counts(value) == wanted
    assert dahl.State(np.int64(2**62 - 1)).w == 2**62 - 1  # more digits than a float has


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: dahl.Throughput(sigma=100), ("Throughput", "sigma = 100", "sigma0, Fc")),
        (lambda: dahl.Plan(sigma0=1, fc=1), ("Plan", "fc = 1", "sigma0, Fc, theta_per_count")),
        (lambda: dahl.Plan(1), ("Plan", "'Fc'", "(arguments: sigma0, Fc")),
        (lambda: dahl.Plan(1, 1, 1, 1), ("Plan", "too many")),
        (dahl.Friction, ("Friction", "'plan'")),
        (
            lambda: bearing().step_counts(counts=3),
            ("Friction.step_counts", "counts = 3", "dcounts"),
        ),
        (
            lambda: bearing().run([1.0], output=None),
            ("Friction.run", "output = None", "(there are: moves, out)"),
        ),
        (
            lambda: dahl.Throughput.run_channels(params=[], move=[[]]),
            ("Throughput.run_channels", "move = ", "params, moves, out"),
        ),
        (lambda: dahl.counts_between(1, 2, turn=4), ("counts_between", "turn = 4", "modulus")),
    ],
)
def test_calls_that_do_not_fit_name_what_does(call, words):
    refused(call, *words)


def test_only_a_plan_is_a_plan():
    for wrong in (None, (1, 1, 1), dahl.Throughput(1, 1, 1), dahl.Plan):
        refused(lambda wrong=wrong: dahl.Friction(wrong), "plan = ", "is not a Plan")
        refused(lambda wrong=wrong: bearing().change_plan(wrong), "plan = ", "is not a Plan")
    one = dahl.Throughput(1, 1, 1)
    for run in (dahl.Throughput.run_channels, dahl.Throughput.run_counts_channels):
        refused(lambda run=run: run(one, [[1]]), "params = ", "is not a list of Throughput")
        refused(lambda run=run: run([one, bearing().plan], [[1, 1]]), "params[1] = ", "Throughput")


def test_counts_without_an_encoder_are_refused():
    """0.0 N m for every count was no answer."""
    blind, quick = dahl.Friction(dahl.Plan(100.0, 0.5)), dahl.Throughput(100.0, 0.5)
    for call in (
        lambda: blind.step_counts(1),
        lambda: blind.step_counts_q30(0),
        lambda: blind.run_counts([1]),
        lambda: quick.run_counts([1]),
        lambda: dahl.Throughput.run_counts_channels([quick], [[1]]),
    ):
        refused(call, "theta_per_count = 0", "2^-64 <= theta_per_count < 2^64")
    assert blind.step(1e9) == 0.5 and quick.run([1e9])[0] == 0.5
    assert dahl.Throughput.run_channels([quick], [[1e9]])[0, 0] == 0.5


MASKED = np.ma.array([1, 2, 3], mask=[False, True, False])


@pytest.mark.parametrize(
    ("moves", "words"),
    [
        (MASKED, ("moves has masked values",)),
        ([MASKED[0], np.ma.masked], ("moves has masked values",)),
        (np.array([1, 2], object), ("moves has type object",)),
        ([2**70], ("moves has type object",)),
        (np.array(1), ("moves has shape ()",)),
        (None, ("moves has shape ()",)),
        (np.zeros((2, 2)), ("moves has shape (2, 2), not (n,)",)),
        ([[1], [1, 2]], ("moves is not an array of numbers",)),
        ([True], ("moves has type bool",)),
        ([1j], ("moves has type complex128",)),
        (["1"], ("moves has type <U1",)),
        (np.array(["2020-01-01"], "M8[s]"), ("moves has type datetime64[s]",)),
    ],
    ids=repr,
)
def test_moves_that_are_no_moves_are_named(moves, words):
    quick, one = dahl.Throughput(1, 1, 1), bearing()
    before = one.state.w
    for run in (one.run, one.run_counts, quick.run, quick.run_counts):
        refused(lambda run=run: run(moves), *words)
    assert one.state.w == before


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1, 2**63, -(2**63), 0.5, math.nan])
def test_moves_beyond_int32_are_named_and_nothing_moves(value):
    one, before = bearing(), bearing().state.w
    for moves in (np.array([1, value]), [1, value], np.array([1, value], float)):
        refused(lambda moves=moves: one.run_counts(moves), "moves[1] = ", "from -2147483648 to")
    refused(
        lambda: dahl.Throughput.run_counts_channels([dahl.Throughput(1, 1, 1)], [[1], [value]]),
        "moves[1, 0] = ",
    )
    assert one.state.w == before


def test_rows_that_are_masked_are_not_taken():
    two = [dahl.Throughput(1, 1, 1)] * 3
    refused(lambda: dahl.Throughput.run_channels(two, [MASKED, MASKED]), "masked")
    whole = np.ma.array([1, 2], mask=False)  # nothing of it is masked
    assert list(bearing().run_counts(whole)) == list(bearing().run_counts([1, 2]))
    out = np.ma.array(np.zeros(2, np.float32))
    refused(lambda: bearing().run_counts([1, 2], out), "out is a MaskedArray")


@pytest.mark.parametrize("name", ["sigma0", "Fc", "theta_per_count", "other"])
def test_parameters_cannot_be_changed(name):
    for fixed in (bearing().plan, dahl.Throughput(1, 1, 1)):
        with pytest.raises(AttributeError):
            setattr(fixed, name, 2.0)
        with pytest.raises(AttributeError):
            delattr(fixed, name)
    for part in ("plan", "state"):
        with pytest.raises(AttributeError):
            setattr(bearing(), part, None)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(1, 2**32 - 1))
def test_a_reading_that_does_not_wrap_at_the_modulus_is_refused(before, now, modulus):
    if before < modulus and now < modulus:
        assert abs(dahl.counts_between(before, now, modulus)) <= modulus / 2
    else:
        name = "before" if before >= modulus else "now"
        refused(
            lambda: dahl.counts_between(before, now, modulus=modulus),
            f"{name} = ",
            f"is not a whole number from 0 to {modulus - 1}",
        )


numbers = st.one_of(st.integers(), st.floats(), st.fractions(), st.booleans(), st.complex_numbers())
others = st.one_of(st.none(), st.text(max_size=5), st.binary(max_size=5), st.just(object()))
arrays = st.lists(st.one_of(numbers, others), max_size=3).map(lambda each: np.array(each, object))
junk = st.one_of(numbers, others, arrays, st.lists(numbers, max_size=3), st.tuples(others))


def public_calls() -> Iterator[tuple[str, Callable[..., object]]]:
    """Each function and class, and each method of one of every class."""
    for name in dahl.__all__:
        if not isinstance(thing := getattr(dahl, name), ModuleType):
            yield name, thing
    for kind in KINDS.values():
        for name, _ in inspect.getmembers(kind.of, callable):
            if not name.startswith("_") and name not in dir(Structure):
                yield f"{kind.of.__name__}.{name}", partial(called, kind, name)


def called(kind: Kind, name: str, *given: object) -> object:
    return getattr(kind.make(), name)(*given)


@settings(max_examples=40)
@given(st.data())
@pytest.mark.parametrize(("_", "call"), [*public_calls()])
def test_whatever_is_passed_there_is_an_answer_or_one_line(_, call, data):
    try:
        call(*data.draw(st.lists(junk, max_size=4)))
    except dahl.Error as error:
        assert str(error) and "\n" not in str(error)


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_what_is_kept_between_steps_changes_no_bit(ticks, seed):
    """A bearing that is pickled or rebuilt from w after each step goes on as one that is not."""
    path = np.random.default_rng(seed).integers(-2000, 2001, ticks)
    plan = dahl.Plan(100.0, 0.5, 1e-4)
    wanted, kept = dahl.Friction(plan).run_counts(path), dahl.Friction(plan)
    for move, torque in zip(path, wanted, strict=True):
        kept = pickle.loads(pickle.dumps(kept))
        w, kept = kept.state.w, dahl.Friction(plan)
        kept.state.w = w
        assert kept.step_counts(move) == torque


@pytest.mark.parametrize("wrong", ["/etc/passwd", "/tmp", _ctypes.__file__])
def test_another_file_as_the_library_is_one_line(wrong, tmp_path):
    """DAHL_LIBRARY names a text file, a folder, another library."""
    environment = {**os.environ, "DAHL_LIBRARY": wrong}
    code = "import dahl\ntry: dahl.Plan(1, 1)\nexcept dahl.RunError as e: print(e)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stderr == "" and done.stdout.startswith(f"{wrong}: not the shared library of dahl")
    log = tmp_path / "log.csv"
    log.write_text("theta,torque\n" + "".join(f"{i % 9},{i % 7}\n" for i in range(100)))
    command = [sys.executable, "-m", "dahl", "identify", log, "--angle", "theta", "--trust-units"]
    command += ["--torque", "torque", "--no-files"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == f"error: {wrong}: not the shared" + done.stderr.partition("the shared")[2]
    assert done.returncode == 1 and done.stderr.count("\n") == 1


def test_a_number_too_long_to_print_is_named_too():
    refused(lambda: bearing().step_counts(10**5000), "dcounts = an int of many digits")
    refused(lambda: dahl.Plan(10**5000, 1), "sigma0 = inf")
    refused(lambda: dahl.Plan(-(10**5000), 1), "sigma0 = -inf")
    refused(lambda: bearing().set_torque("1"), "F = '1' is not a number; a torque in N m")


@given(
    st.integers(3, 2**32) | st.just(2**16),
    st.sampled_from([1, -1]),
    st.lists(st.floats(-0.499, 0.499), min_size=1, max_size=20),
)
def test_an_encoder_gives_back_each_move_within_half_a_round(size, sign, parts):
    moves = [int(part * size) for part in parts]
    encoder, angle = dahl.Encoder(size % 2**32, sign), 0
    assert encoder.move(0) == 0
    for move in moves:
        angle += sign * move
        before = copy.copy(encoder)
        assert encoder.move(angle % size) == move
        assert pickle.loads(pickle.dumps(before)) == before
        assert (before == encoder) == (move == 0)
    assert encoder.jumps == 0


def test_an_encoder_takes_readings_of_all_32_bits():
    """For what it is made with, and for every reading."""
    top = 2**32 - 1
    wide = dahl.Encoder(modulus=top, largest_step=2**31 - 2)
    wide.home(top - 1)
    assert (wide.move(1), wide.move(2**31 - 2), wide.jumps) == (2, 2**31 - 3, 0)
    assert wide.move(2**31 - 2 - 70_000) == -70_000
    narrow = dahl.Encoder(modulus=0, largest_step=70_000)
    narrow.home(3_000_000_000)
    assert (narrow.move(3_000_070_000), narrow.jumps) == (70_000, 0)
    assert (narrow.move(3_000_140_001), narrow.jumps) == (0, 1)


def test_an_encoder_tells_a_jump_and_goes_home():
    encoder = dahl.Encoder(10000, 1, 100)
    assert [encoder.move(reading) for reading in (9990, 5, 5000, 5003)] == [0, 15, 0, 3]
    assert encoder.jumps == 1
    encoder.home(0)
    assert encoder.move(9999) == -1
    assert repr(encoder) == "Encoder(modulus=10000, sign=1, largest_step=100)"
    assert "sign=-1" in repr(dahl.Encoder(10, -1))
    with pytest.raises(AttributeError):
        encoder.jumps = 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((2**32,), ("modulus = 4294967296", "from 0 to 4294967295")),
        ((2,), ("modulus = 2 ", "3 to 4294967295")),
        ((10, 0), ("sign = 0", "1 nor -1")),
        ((10, 2), ("sign = 2", "from -1 to 1")),
        ((10, 1, 5), ("largest_step = 5", "from 0 to 4")),
        ((0, 1, 2**31), ("largest_step = 2147483648", "from 0 to 2147483647")),
        ((10, 1, None), ("largest_step = None", "not a number")),
    ],
)
def test_what_is_no_encoder_is_named(arguments, words):
    refused(lambda: dahl.Encoder(*arguments), *words)


@pytest.mark.parametrize("reading", [-1, 10000, 65535, 0.5, math.nan, None, "1", [1]])
def test_a_reading_that_the_counter_cannot_have_is_named(reading):
    encoder = dahl.Encoder(10000)
    refused(lambda: encoder.move(reading), "reading = ", "from 0 to 9999")
    refused(lambda: encoder.home(reading), "reading = ", "from 0 to 9999")
    assert encoder == dahl.Encoder(10000)
