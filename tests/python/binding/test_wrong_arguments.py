# SPDX-License-Identifier: MIT
"""A wrong value raises dahl.InputError and a wrong type TypeError, in one line with name, value and
limit, and changes nothing.
"""

import _ctypes
import copy
import inspect
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from functools import partial
from types import ModuleType

import dahl
import numpy as np
import pytest
from dahl.binding import models
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import run
from test_public_classes import KINDS

PLAN = dahl.Plan(100.0, 0.5, 1e-4)
BLIND = dahl.Plan(100.0, 0.5)  # without an encoder


def bearing() -> dahl.Friction:
    one = dahl.Friction(PLAN)
    one.step_counts(7)
    return one


def refused(
    call: Callable[[], object], first: str, *words: str, kind: type[Exception] = dahl.InputError
) -> None:
    """The message must begin with `first`, and contain the other words."""
    with pytest.raises(kind) as caught:
        call()
    line = str(caught.value)
    assert line.startswith(first), line
    assert "\n" not in line and len(line) < 300
    assert [word for word in words if word not in line] == [], line


# --- scalars --------------------------------------------------------------------------------------

NO_NUMBER = [
    *(None, "1", b"1", True, np.True_, 1j, [1.0], (), {}, ..., Decimal(1)),
    *(np.array(1), np.array([1]), np.ma.masked, np.timedelta64(1, "s")),
]
NOT_WHOLE = [0.5, -1e-300, math.nan, math.inf, -math.inf, Fraction(1, 3), np.float32(2.5)]
I32, U32, W = (-(2**31), 2**31 - 1), (0, 2**32 - 1), (-(2**62) - 2**31, 2**62 + 2**31 - 1)
REAL = {
    "dtheta": [lambda v: bearing().step(v), lambda v: dahl.Loaded(PLAN, True).step(v, 1.0)],
    "F": [
        lambda v: bearing().set_torque(v),
        lambda v: setattr(bearing(), "torque", v),
        lambda v: bearing().counts_to_torque(v),
        lambda v: dahl.Throughput(1, 1, 1).run_counts([1], F=v),
        lambda v: dahl.Throughput(1, 1, 1).run([1.0], F=v),
    ],
    "load": [
        lambda v: dahl.Loaded(PLAN).step_counts(1, v),
        lambda v: dahl.Loaded(PLAN).step_counts_q30(1, v),
        lambda v: dahl.Loaded(PLAN, True).step(1e-3, v),
    ],
}
BREAKAWAY = models.class_of(models.with_key("breakaway"))
WHOLE = {  # name and limits of a whole number
    ("dcounts", *I32): [
        lambda v: bearing().step_counts(v),
        lambda v: bearing().step_counts_q30(v),
        lambda v: dahl.Slip([1], [1], 1).step_counts(v),
        lambda v: dahl.Parallel(dahl.Slip([1], [1], 1)).step_counts_q30(v),
        lambda v: BREAKAWAY(1, 1, 1, 0.5).step_counts_q30(v),
        lambda v: dahl.Work(PLAN).step_counts(v),
        lambda v: dahl.Loaded(PLAN).step_counts(v, 1),
        lambda v: dahl.VelocityTable([1.0] * 16, 0).step_counts(v),
    ],
    ("before", *U32): [lambda v: dahl.counts_between(v, 1)],
    ("now", *U32): [lambda v: dahl.counts_between(1, v)],
    ("before", 0, 9999): [lambda v: dahl.counts_between(v, 1, 10000)],
    ("now", 0, 9999): [lambda v: dahl.counts_between(1, v, 10000)],
    ("modulus", *U32): [lambda v: dahl.counts_between(0, 0, v), dahl.Encoder],
    ("ratio_q30", *I32): [lambda v: dahl.to_units(v, 1)],
    ("Fc_units", 0, 2**30): [lambda v: dahl.to_units(1, v)],
    ("stroke", *U32): [PLAN.tip_torque],
    ("w", *W): [dahl.State, lambda v: setattr(bearing().state, "w", v)],
    ("segment_bits", 0, 24): [lambda v: dahl.VelocityTable([1.0] * 16, v)],
    ("sign", -1, 1): [lambda v: dahl.Encoder(10, v)],
    ("largest_step", 0, 4): [lambda v: dahl.Encoder(10, 1, v)],
    ("largest_step", 0, 5): [lambda v: dahl.Encoder(11, 1, v)],
    ("largest_step", 0, 2**31 - 1): [lambda v: dahl.Encoder(0, 1, v)],
    ("reading", 0, 9999): [
        lambda v: dahl.Encoder(10000).move(v),
        lambda v: dahl.Encoder(10000).home(v),
    ],
    ("threads", 1, 1024): [lambda v: dahl.Throughput(1, 1, 1).run([1.0], threads=v)],
}


@pytest.mark.parametrize("value", NO_NUMBER, ids=repr)
def test_a_value_that_is_not_a_number_is_named(value):
    for kind in KINDS.values():
        for name, held in kind.arguments.items():
            is_list = isinstance(held, list)
            if (name, value) == ("angle_limit", None):  # twice the travel
                continue
            if is_list or type(held) in (int, float):
                changed = [*held[:-1], value] if is_list else value
                place = f"{name}[{len(held) - 1}]" if is_list else name
                call = partial(kind.make, **{name: changed})
                refused(call, f"{place} = ", "is not a number", kind=TypeError)
    for name, calls in [*REAL.items(), *((limits[0], calls) for limits, calls in WHOLE.items())]:
        for call in calls:
            refused(partial(call, value), f"{name} = ", "is not a number", kind=TypeError)


@pytest.mark.parametrize("limits", WHOLE, ids=str)
def test_a_whole_number_is_accepted_at_its_limits_and_refused_beyond(limits):
    name, least, most = limits
    beyond = [least - 1, most + 1, 2**64, -(10**400), 1e300, np.uint64(2**63), 10**5000]
    for call in WHOLE[limits]:
        for value in (least, most):
            call(value)
        for value in NOT_WHOLE + beyond:
            refused(lambda call=call, v=value: call(v), f"{name} = ", str(least), str(most))


def test_numbers_of_any_type_are_accepted():
    plan = dahl.Plan(np.float64(100), Fraction(1, 2), np.float32(1e-4))
    assert plan == PLAN
    wanted = dahl.Friction(plan).step_counts(3)
    for value in (3, 3.0, np.int8(3), np.uint64(3), np.float16(3), Fraction(3)):
        assert dahl.Friction(plan).step_counts(value) == wanted
    assert dahl.State(np.int64(2**62 - 1)).w == 2**62 - 1  # more digits than a float has
    assert [bearing().step(side * 10**400) for side in (-1, 1)] == [-0.5, 0.5]  # beyond a float


# --- values that do not fit together, and calls ---------------------------------------------------

TRAVEL = ("", "travel", "2^-30 <=", "< 2^20")
REFUSED = [
    (lambda: dahl.Slip([], [], 1e-3), ("sigma0", "0 elements")),
    (lambda: dahl.Slip([1.0] * 9, [1.0] * 9, 1e-3), ("sigma0", "9 elements", "8")),
    (lambda: dahl.Slip([1.0, 2.0], [1.0], 1e-3), ("sigma0 has 2", "Fc 1")),
    (lambda: dahl.Slip([1.0, 1e-9], [1.0, 1e9], 1e-3), ("element 1", "travel", *TRAVEL)),
    (lambda: dahl.Plan(2, 0.5, 2.0**18), ("travel ", "1.04858e+06", *TRAVEL, "0.5", "262144")),
    (lambda: dahl.Asymmetric(1.0, 1, 1e12, 1e-3), ("travel ", "sigma0/Fc_backward", *TRAVEL)),
    *(
        (lambda b=b: BREAKAWAY(1.0, 1, 1, b), (f"breakaway = {b}", "0 <", "< 1"))
        for b in (0.0, 1.0, -0.5, math.nan)
    ),
    (lambda: dahl.VelocityTable([1.0] * 15, 0), ("torque has 15 ", "16")),
    (lambda: dahl.VelocityTable([1e-50] * 16, 0), ("torque[0] = 1e-50", "2^-64")),
    (lambda: dahl.VelocityTable([1.0, math.nan] + [1.0] * 14, 0), ("torque[1] = nan",)),
    (lambda: dahl.Encoder(2), ("modulus = 2", "3")),
    (lambda: dahl.Encoder(10, 0), ("sign = 0", "-1")),
    (lambda: dahl.Parallel(*[dahl.Slip([1], [1], 1)] * 2), ("parts[1]", "twice")),
    (lambda: dahl.Throughput.run_counts_channels([dahl.Throughput(1, 1, 1)] * 2, [[1, 2, 3]]),
     ("moves has shape (1, 3), not (n, 2)",)),
    # a torque that no move reaches
    (lambda: bearing().counts_to_torque(0.6), ("F = 0.6", "0.5")),
    # moves of the other kind of load
    *((lambda c=c: getattr(dahl.Loaded(PLAN), c)(1e-3, 1.0), (f"Loaded.{c}", "step_counts"))
      for c in ("step", "run")),
    *((lambda c=c: getattr(dahl.Loaded(PLAN, True), c)(1, 1.0), (f"Loaded.{c}", "step()"))
      for c in ("step_counts", "step_counts_q30", "run_counts")),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_values_that_do_not_fit_together_are_named(call, words):
    refused(call, *words)


WRONG_TYPES = [
    (lambda: dahl.Slip(100.0, [1.0], 1e-3), ("sigma0 = 100.0", "list")),
    (lambda: dahl.Slip([1.0], np.ma.masked, 1e-3), ("Fc = masked", "list")),
    (lambda: dahl.VelocityTable(3, 0), ("torque = 3", "list")),
    (lambda: dahl.Parallel(dahl.Slip([1], [1], 1), 3), ("parts[1] = 3",)),
    (lambda: dahl.Loaded(PLAN, 1), ("fixed_stiffness = 1",)),
    *(
        (lambda c=c, v=v: c(v), ("plan = ", "Plan"))
        for v in (None, (1, 1, 1), dahl.Throughput(1, 1, 1), dahl.Plan)
        for c in (dahl.Friction, dahl.Loaded, dahl.Work, bearing().change_plan)
    ),
    *(
        (lambda r=r, p=p: r(p, [[1.0]]), (name,))
        for r in (dahl.Throughput.run_channels, dahl.Throughput.run_counts_channels)
        for p, name in ((dahl.Throughput(1, 1), "params = "), ([PLAN], "params[0] = "))
    ),
    (lambda: dahl.Node(3), ("friction = 3", "Plan", "Slip")),
    # calls that do not fit the signature
    (lambda: dahl.Slip(sigma0=[1.0], fc=1, theta_per_count=1.0), ("", "fc")),
    (lambda: dahl.Throughput(sigma=100), ("Throughput", "sigma")),
    (lambda: dahl.Plan(1, 1, 1, 1), ("Plan", "5 were given")),
    (dahl.Friction, ("Friction", "'plan'")),
    (lambda: bearing().step_counts(counts=3), ("Friction.step_counts", "counts")),
    (lambda: bearing().step_counts(3, 4), ("Friction.step_counts", "3 were given")),
    (lambda: dahl.Throughput.run_channels(params=[], move=[[]]), ("Throughput.run_", "move")),
    (lambda: dahl.counts_between(1, 2, turn=4), ("counts_between", "turn")),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), WRONG_TYPES)
def test_a_wrong_type_and_an_argument_that_a_call_does_not_have_are_type_errors(call, words):
    refused(call, *words, kind=TypeError)


def test_counts_without_an_encoder_are_refused():
    blind, quick = dahl.Friction(BLIND), dahl.Throughput(100.0, 0.5)
    for call in (
        lambda: blind.step_counts(1),
        lambda: blind.step_counts_q30(0),
        lambda: blind.run_counts([1]),
        lambda: blind.counts_to_torque(0.5),
        lambda: BLIND.tip_torque(1),
        lambda: quick.run_counts([1]),
        lambda: dahl.Parallel(blind).step_counts(1),
        lambda: dahl.Loaded(BLIND),
        lambda: dahl.Work(BLIND),
        lambda: dahl.Node(BLIND),
    ):
        refused(call, "theta_per_count = 0", "2^-64 <=")
    assert blind.step(1e9) == 0.5 and quick.run([1e9])[0] == 0.5
    assert dahl.Loaded(BLIND, True).step(1e9, 1) == 0.5
    assert dahl.Throughput.run_channels([quick], [[1e9]])[0, 0] == 0.5


# --- arrays ---------------------------------------------------------------------------------------

MASKED = np.ma.array([1, 2, 3], mask=[False, True, False])
NO_MOVES = [
    (MASKED, "masked", dahl.InputError),
    ([MASKED[0], np.ma.masked], "masked", dahl.InputError),
    (np.array([1, 2], object), "object", TypeError),
    (np.array(1), "()", dahl.InputError),
    (None, "object", TypeError),
    (np.zeros((2, 2)), "(2, 2)", dahl.InputError),
    ([[1], [1, 2]], "not an array", dahl.InputError),
    ([True], "bool", TypeError),
    (["1"], "<U1", TypeError),
]
BEYOND = [
    *(np.array([1, v]) for v in (2**31, -(2**31) - 1, 2**63, -(2**63), 0.5, math.nan)),
    *([1, v] for v in (2**31, 0.5, math.inf)),
    np.array([1, 2.0**31], np.float32),  # whose nearest to 2^31 - 1 is 2^31
    np.array([1, -(2.0**31) - 256], np.float32),
    np.array([1, math.inf], np.float16),
]


def movers() -> list[object]:
    made = [kind.make() for kind in KINDS.values()]
    return [one for one in made if hasattr(one, "run_counts") and not isinstance(one, dahl.Loaded)]


def test_wrong_moves_are_named_and_nothing_moves():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for one in movers():
            before = copy.deepcopy(one)
            for moves, word, wrong in NO_MOVES:
                refused(partial(one.run_counts, moves), "moves", word, kind=wrong)
                if hasattr(one, "run"):
                    refused(partial(one.run, moves), "moves", word, kind=wrong)
            for moves in BEYOND:
                refused(lambda one=one, m=moves: one.run_counts(m), "moves[1] = ", "2147483647")
            assert one == before
    channels = [dahl.Throughput(1, 1, 1)]
    run = dahl.Throughput.run_counts_channels
    refused(lambda: run(channels, [[1], [2**31]]), "moves[1, 0] = ")
    refused(lambda: run(channels * 3, [MASKED, MASKED]), "moves", "masked")
    whole = np.ma.array([1, 2], mask=False)
    assert list(bearing().run_counts(whole)) == list(bearing().run_counts([1, 2]))


@pytest.mark.parametrize(
    ("out", "wrong"),
    [
        (np.empty(3, np.float32), dahl.InputError),
        (np.empty(2, np.float64), TypeError),
        (np.empty(4, np.float32)[::2], dahl.InputError),
        ([0.0, 0.0], TypeError),
        (np.frombuffer(bytes(8), np.float32), dahl.InputError),
        (np.frombuffer(bytearray(9), np.float32, offset=1), dahl.InputError),
    ],
)
def test_an_out_that_c_cannot_fill_is_refused(out, wrong):
    for one in movers():
        before = copy.deepcopy(one)
        refused(partial(one.run_counts, [1, 2], out=out), "out", kind=wrong)
        moves = np.array([1, 2], np.int32)
        refused(lambda o=one, m=moves: o.run_counts(m, out=m.view(np.float32)), "out", "moves")
        assert one == before


LOADS = [
    ([1, 2], [1.0], "(1,)", dahl.InputError),
    ([1, 2], [1.0, 2.0], "loads[1] = 2.0", dahl.InputError),
    ([1, 2], [-1e-9, 1.0], "loads[0] = -1e-09", dahl.InputError),
    ([1, 2], [1.0, math.nan], "loads[1] = nan", dahl.InputError),
    ([1, 2], ["a", "b"], "<U1", TypeError),
    ([1], None, "loads", TypeError),
    ([1], [[1], [1, 2]], "loads", dahl.InputError),
    ([1], np.ma.array([1.0], mask=[True]), "masked", dahl.InputError),
    ([1, "x"], [1, 1], "moves", TypeError),
]


@pytest.mark.parametrize("fixed", [False, True])
def test_wrong_loads_are_named_and_nothing_moves(fixed):
    gear, still = dahl.Loaded(PLAN, fixed), dahl.Loaded(PLAN, fixed)
    run, step = (gear.run, gear.step) if fixed else (gear.run_counts, gear.step_counts)
    for moves, loads, word, wrong in LOADS:
        refused(partial(run, moves, loads), "", word, kind=wrong)
    for load in (2.0, -1e-9, math.nan, math.inf):
        refused(lambda load=load: step(1, load), f"load = {load}", "0 <= load < 2")
    refused(lambda: step(1), "Loaded.step", "'load'", kind=TypeError)
    assert gear == still
    assert step(10**9, 0) == 0 and step(10**9, math.nextafter(2.0, 0.0)) == 1


# --- anything else --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sigma0", "Fc", "theta_per_count", "other"])
def test_parameters_cannot_be_changed(name):
    for fixed in (bearing().plan, dahl.Throughput(1, 1, 1)):
        with pytest.raises(AttributeError):
            setattr(fixed, name, 2.0)
        with pytest.raises(AttributeError):
            delattr(fixed, name)
    for one, part in ((bearing(), "plan"), (bearing(), "state"), (dahl.Encoder(), "jumps")):
        with pytest.raises(AttributeError):
            setattr(one, part, None)


numbers = st.one_of(st.integers(), st.floats(), st.fractions(), st.booleans(), st.complex_numbers())
others = st.one_of(st.none(), st.text(max_size=5), st.binary(max_size=5), st.just(object()))
arrays = st.lists(st.one_of(numbers, others), max_size=3).map(lambda each: np.array(each, object))
junk = st.one_of(numbers, others, arrays, st.lists(numbers, max_size=3), st.tuples(others))


def public_calls() -> Iterator[Callable[..., object]]:
    """Yield each function and class, and each method of one object of a class."""
    for name in dahl.__all__:
        if not isinstance(thing := getattr(dahl, name), ModuleType):
            yield pytest.param(thing, id=name)
    for kind in KINDS.values():
        for name, _ in inspect.getmembers(kind.of, callable):
            if not name.startswith("_"):
                call = lambda *given, k=kind, n=name: getattr(k.make(), n)(*given)  # noqa: E731
                yield pytest.param(call, id=f"{kind.of.__name__}.{name}")


@settings(max_examples=12)
@given(st.data())
@pytest.mark.parametrize("call", [*public_calls()])
def test_any_arguments_give_a_result_or_one_line(call, data):
    try:
        call(*data.draw(st.lists(junk, max_size=4)))
    except (dahl.Error, TypeError) as error:
        early = isinstance(error, dahl.RunError) and "not commissioned" in str(error)
        assert early or isinstance(error, (ValueError, TypeError, ConnectionError))
        assert str(error) and "\n" not in str(error)


@pytest.mark.parametrize("wrong", ["/tmp", _ctypes.__file__])
def test_a_library_that_is_another_file_is_one_line(wrong, tmp_path):
    """DAHL_LIBRARY may name a folder or another library."""
    environment = {**os.environ, "DAHL_LIBRARY": wrong}
    code = "import dahl\ntry: dahl.Plan(1, 1)\nexcept dahl.RunError as e: print(e)"
    words = ["-m", "dahl", "plan", "--sigma0", "1", "--fc", "1", "--theta-per-count", "1e-3"]
    how = {"env": environment, "cwd": tmp_path}
    said = run(sys.executable, "-c", code, **how)
    assert said.startswith(f"{wrong}: ") and said.count("\n") == 1
    said = run(sys.executable, *words, "-o", "x.h", code=1, **how)
    assert said.count("\n") == 1
    assert said.startswith(f"error: {wrong}: ") and not list(tmp_path.iterdir())
