# SPDX-License-Identifier: MIT
"""What every public class of the package promises alike: a repr, equality, copies and pickles that
go on where it stands, and a docstring that says units, errors and where it comes from.
"""

from __future__ import annotations

import copy
import doctest
import inspect
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import dahl
import numpy as np
import pytest
from dahl import codec

pytestmark = pytest.mark.usefixtures("library")

PLAN = (100.0, 0.5, 2e-4)


@dataclass(frozen=True)
class Kind:
    """One class: how one is made, how another one differs, and what moves it, if it moves."""

    make: Callable[[], Any]
    other: Callable[[], Any]
    move: Callable[[Any], Any] | None = None


def step(one: Any) -> Any:
    return one.step_counts(7)


KINDS = {
    "Asymmetric": Kind(
        lambda: dahl.Asymmetric(100.0, 0.5, 0.3, 2e-4),
        lambda: dahl.Asymmetric(100.0, 0.3, 0.5, 2e-4),
        step,
    ),
    "ElastoPlastic": Kind(
        lambda: dahl.ElastoPlastic(*PLAN, 0.5), lambda: dahl.ElastoPlastic(*PLAN, 0.25), step
    ),
    "Encoder": Kind(
        lambda: dahl.Encoder(65536), lambda: dahl.Encoder(4096), lambda one: one.move(12)
    ),
    "Friction": Kind(
        lambda: dahl.Friction(dahl.Plan(*PLAN)),
        lambda: dahl.Friction(dahl.Plan(1.0, 1.0, 1.0)),
        step,
    ),
    "Loaded": Kind(
        lambda: dahl.Loaded(dahl.Plan(*PLAN)),
        lambda: dahl.Loaded(dahl.Plan(*PLAN), fixed_stiffness=True),
        lambda one: one.step_counts(7, 0.75),
    ),
    "Node": Kind(
        lambda: dahl.Node(dahl.Plan(*PLAN)),
        lambda: dahl.Node(dahl.Plan(*PLAN), number=3),
        lambda one: one.receive(codec.pack(codec.EncoderState(12))),
    ),
    "Parallel": Kind(
        lambda: dahl.Parallel(dahl.Friction(dahl.Plan(*PLAN)), dahl.Slip([1.0], [1.0], 1e-3)),
        lambda: dahl.Parallel(dahl.Friction(dahl.Plan(*PLAN))),
        step,
    ),
    "Plan": Kind(lambda: dahl.Plan(*PLAN), lambda: dahl.Plan(*PLAN[:2])),
    "Slip": Kind(
        lambda: dahl.Slip([100.0, 50.0], [0.5, 1.0], 1e-3),
        lambda: dahl.Slip([100.0], [0.5], 1e-3),
        step,
    ),
    "State": Kind(dahl.State, lambda: dahl.State(1), lambda one: setattr(one, "w", 5)),
    "Throughput": Kind(lambda: dahl.Throughput(*PLAN), lambda: dahl.Throughput(*PLAN[:2])),
    "ThroughputParallel": Kind(
        lambda: dahl.ThroughputParallel(dahl.Throughput(*PLAN)), dahl.ThroughputParallel
    ),
    "ThroughputSlip": Kind(
        lambda: dahl.ThroughputSlip([100.0, 50.0], [0.5, 1.0], 1e-3),
        lambda: dahl.ThroughputSlip([100.0], [0.5], 1e-3),
    ),
    "VelocityTable": Kind(
        lambda: dahl.VelocityTable([0.5] * 16, 3), lambda: dahl.VelocityTable([0.5] * 16, 4)
    ),
    "Work": Kind(
        lambda: dahl.Work(dahl.Plan(*PLAN)), lambda: dahl.Work(dahl.Plan(1.0, 1.0, 1.0)), step
    ),
}
EXCEPTIONS = {"Error", "RunError"}  # equal only to themselves, as all of Python's
CLASSES = {name for name in dahl.__all__ if inspect.isclass(getattr(dahl, name))}
COPIES = [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


def test_no_class_is_left_out() -> None:
    assert KINDS.keys() == CLASSES - EXCEPTIONS, "a new class: give it a line in KINDS"


def test_equal_as_it_is_made_and_as_it_moves(kind: Kind) -> None:
    one, same = kind.make(), kind.make()
    assert one == same and one != kind.other() and one != "another thing"
    assert one.__eq__("another thing") is NotImplemented
    if kind.move:
        kind.move(one)
        assert one != same
        kind.move(same)
        assert one == same
        with pytest.raises(TypeError, match="unhashable"):
            hash(one)
    else:
        assert hash(one) == hash(same)


def test_the_repr_tells_the_class_and_no_address(kind: Kind) -> None:
    one = kind.make()
    assert type(one).__name__ in repr(one) and " at 0x" not in repr(one)
    assert repr(one) != repr(kind.other())
    if "<" not in repr(one):  # else it has a state, which no argument gives
        assert eval(repr(one), {name: getattr(dahl, name) for name in dahl.__all__}) == one


@pytest.mark.parametrize("copied", COPIES, ids=["copy", "deepcopy", "pickle"])
def test_a_copy_stands_where_the_other_does_and_goes_its_own_way(kind: Kind, copied: Any) -> None:
    one = kind.make()
    again = copied(one)
    assert again == one and type(again) is type(one)
    if not kind.move:
        return
    kind.move(one)
    assert copied(one) == one
    assert again != one and again == kind.make()


def test_wrong_arguments_are_one_line_with_the_name(kind: Kind) -> None:
    with pytest.raises(dahl.Error, match="no such argument"):
        type(kind.make())(colour="red")


def examples() -> list[doctest.DocTest]:
    """Those of the package and of each public name, with what a user's shell has after
    `import dahl`; no name of ours.
    """
    find = doctest.DocTestFinder(recurse=False)
    names = {"dahl": dahl, **{name: getattr(dahl, name) for name in dahl.__all__}}
    found = (
        find.find(thing, name, module=False, globs={"dahl": dahl}) for name, thing in names.items()
    )
    return [one for some in found for one in some if one.examples]


def test_each_example_of_a_docstring_is_what_a_shell_answers() -> None:
    every = examples()
    assert len(every) >= 13
    for one in every:
        told: list[str] = []
        result = doctest.DocTestRunner().run(one, out=told.append)
        assert result.failed == 0, "".join(told)


def test_the_names_of_the_api_are_listed_and_no_others() -> None:
    assert set(dir(dahl)) == {*dahl.__all__, "codec", "node", "__doc__", "__version__"}
    with pytest.raises(AttributeError, match="no attribute 'Frction'"):
        _ = dahl.Frction


def test_exceptions_are_pickled_with_their_line() -> None:
    for kind_of in (dahl.Error, dahl.RunError):
        again = pickle.loads(pickle.dumps(kind_of("sigma0 = -1 is outside")))
        assert (type(again), str(again)) == (kind_of, "sigma0 = -1 is outside")
    assert issubclass(dahl.RunError, dahl.Error)


def test_a_log_of_torques_is_of_float32() -> None:
    assert dahl.Friction(dahl.Plan(*PLAN)).run_counts([1, 2]).dtype == np.float32


def test_slip_elements_tell_their_numbers_in_few_digits() -> None:
    """As a Plan does; `dahl plan --model slip` prints it. The fast form's are doubles."""
    told = "(sigma0=[100.0, 40.0], Fc=[0.5, 0.3], theta_per_count=0.00038)"
    exact = dahl.Slip([100, 40], [0.5, 0.3], 3.8e-4)
    fast = dahl.ThroughputSlip([100, 40], [0.5, 0.3], 3.8e-4)
    assert (repr(exact), repr(fast)) == (f"Slip{told}", f"ThroughputSlip{told}")
    near = dahl.ThroughputSlip([100, 40], [0.5, exact.Fc[1]], 3.8e-4)
    assert eval(repr(near), {"ThroughputSlip": dahl.ThroughputSlip}) == near != fast
