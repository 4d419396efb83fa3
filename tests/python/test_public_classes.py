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
import pytest
from dahl import codec

pytestmark = pytest.mark.usefixtures("library")

PLAN = (100.0, 0.5, 2e-4)


def step(one: Any) -> Any:
    return one.step_counts(7)


@dataclass(frozen=True)
class Kind:
    """One class: what one is made of, how another one differs, and what moves it, if it moves."""

    of: type
    arguments: tuple[Any, ...]
    others: tuple[Any, ...]
    move: Callable[[Any], Any] | None = None

    def make(self) -> Any:
        return self.of(*copy.deepcopy(self.arguments))

    def other(self) -> Any:
        return self.of(*self.others)


A_PLAN, TWO = dahl.Plan(*PLAN), ([100.0, 50.0], [0.5, 1.0], 1e-3)
ANOTHER, ONE = dahl.Plan(1.0, 1.0, 1.0), ([100.0], [0.5], 1e-3)
MIX = (dahl.Friction(A_PLAN), dahl.Slip([1.0], [1.0], 1e-3))
KINDS = {
    kind.of.__name__: kind
    for kind in (
        Kind(dahl.Asymmetric, (100.0, 0.5, 0.3, 2e-4), (100.0, 0.3, 0.5, 2e-4), step),
        Kind(dahl.ElastoPlastic, (*PLAN, 0.5), (*PLAN, 0.25), step),
        Kind(dahl.Encoder, (65536,), (4096,), lambda one: one.move(12)),
        Kind(dahl.Friction, (A_PLAN,), (ANOTHER,), step),
        Kind(dahl.Loaded, (A_PLAN,), (A_PLAN, True), lambda one: one.step_counts(7, 0.75)),
        Kind(
            dahl.Node,
            (A_PLAN,),
            (A_PLAN, 3),
            lambda one: one.receive(codec.pack(codec.EncoderState(12))),
        ),
        Kind(dahl.Parallel, MIX, MIX[:1], step),
        Kind(dahl.Plan, PLAN, PLAN[:2]),
        Kind(dahl.Slip, TWO, ONE, step),
        Kind(dahl.State, (), (1,), lambda one: setattr(one, "w", 5)),
        Kind(dahl.Throughput, PLAN, PLAN[:2]),
        Kind(dahl.ThroughputParallel, (dahl.Throughput(*PLAN),), ()),
        Kind(dahl.ThroughputSlip, TWO, ONE),
        Kind(dahl.VelocityTable, ([0.5] * 16, 3), ([0.5] * 16, 4)),
        Kind(dahl.Work, (A_PLAN,), (ANOTHER,), step),
    )
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
    """With all that a subclass adds, also where that is made of something else."""

    class Own(kind.of):  # type: ignore[name-defined, misc]
        __slots__ = () if kind.of is dahl.State else ("note",)  # ctypes copies no slots

        def __init__(self, name: str, *arguments: Any) -> None:
            super().__init__(*arguments)
            vars(self)["name"] = name
            object.__setattr__(self, "note", name)

    Own.__qualname__ = "Own"
    globals()["Own"] = Own
    one = Own("left", *copy.deepcopy(kind.arguments))
    again = copied(one)
    assert (type(again), again.name, again.note) == (Own, "left", "left") and again == one
    if kind.move:
        kind.move(one)
        assert copied(one) == one != again == Own("right", *copy.deepcopy(kind.arguments))


@pytest.mark.parametrize("copied", COPIES[1:], ids=["deepcopy", "pickle"])
def test_what_belongs_together_does_so_when_it_is_copied_together(copied: Any) -> None:
    bearing = dahl.Friction(A_PLAN)
    mix, again, state = copied((dahl.Parallel(bearing), bearing, bearing.state))
    assert mix.parts[0] is again and again.state is state


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


def test_slip_elements_tell_their_numbers_in_few_digits() -> None:
    """As a Plan does; `dahl plan --model slip` prints it. The fast form's are doubles."""
    told = "(sigma0=[100.0, 40.0], Fc=[0.5, 0.3], theta_per_count=0.00038)"
    exact = dahl.Slip([100, 40], [0.5, 0.3], 3.8e-4)
    fast = dahl.ThroughputSlip([100, 40], [0.5, 0.3], 3.8e-4)
    assert (repr(exact), repr(fast)) == (f"Slip{told}", f"ThroughputSlip{told}")
    assert all(one != type(one)(one.sigma0, one.Fc, 3.9e-4) for one in (exact, fast))
    near = dahl.ThroughputSlip([100, 40], [0.5, exact.Fc[1]], 3.8e-4)
    assert eval(repr(near), {"ThroughputSlip": dahl.ThroughputSlip}) == near != fast
