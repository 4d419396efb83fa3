# SPDX-License-Identifier: MIT
"""What every public class of the package promises alike: a repr, equality, copies and pickles that
go on where it stands, and a docstring that says units, errors and where it comes from.
"""

from __future__ import annotations

import copy
import doctest
import inspect
import math
import pickle
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import dahl
import numpy as np
import pytest
from dahl import codec, node
from dahl.binding import models

pytestmark = pytest.mark.usefixtures("library")


def step(one: Any) -> Any:
    return one.step_counts(-7)


@dataclass(frozen=True)
class Kind:
    """One class: what one is made of, by name, and what moves it, if it moves."""

    of: type
    arguments: dict[str, Any]
    move: Callable[[Any], Any] | None = None
    unseen: tuple[str, ...] = ()  # arguments that its repr does not tell

    def make(self, **changed: Any) -> Any:
        arguments = copy.deepcopy(self.arguments | changed)
        parts = arguments.pop("parts", ())
        return self.of(*parts, **arguments)

    def others(self) -> Iterator[tuple[str, Any]]:
        """Of each argument, its name and another value; of several numbers each for itself."""
        for name, value in self.arguments.items():
            for other in others(name, value):
                yield name, other


def others(name: str, value: Any) -> Iterator[Any]:
    """Other values; of what is made of others, as its own line of KINDS has it."""
    if isinstance(value, (list, tuple)):
        for k, each in enumerate(value):
            for other in others(name, each):
                yield type(value)([*value[:k], other, *value[k + 1 :]])
    elif isinstance(value, (bool, int)):
        yield not value if isinstance(value, bool) else -1 if name == "sign" else value + 1
    elif isinstance(value, float):
        yield value * 1.25
    else:
        for field, other in KINDS[type(value).__name__].others():
            yield KINDS[type(value).__name__].make(**{field: other})


PLAN = {"sigma0": 100.0, "Fc": 0.5, "theta_per_count": 2e-4}
BREAKAWAY = models.with_key("breakaway")
PLANNED = {"plan": dahl.Plan(**PLAN)}
TWO = {"sigma0": [100.0, 50.0], "Fc": [0.5, 1.0], "theta_per_count": 1e-3}
SEAL = {"sigma0": 100.0, "Fc_forward": 0.5, "Fc_backward": 0.3, "theta_per_count": 2e-4}
NODE = {"gain": 0.5, "limit": 0.25, "ramp": 0.3, "timeout": 0.02, "max_step": 7}
NODE |= {"status_period": 0.07}
TABLE = [0.5, 0.3, 0.25, -0.125, *(0.0625 * k for k in range(1, 13))]
MIX = (dahl.Friction(dahl.Plan(**PLAN)), dahl.Slip(**TWO))
FAST = (dahl.Throughput(**PLAN), dahl.ThroughputSlip(**TWO))
KINDS = {
    kind.of.__name__: kind
    for kind in (
        Kind(dahl.Asymmetric, SEAL, step),
        Kind(models.class_of(BREAKAWAY), PLAN | {"breakaway": 0.5}, step),
        Kind(dahl.Encoder, {"modulus": 65536, "sign": 1, "largest_step": 9}, lambda o: o.move(12)),
        Kind(dahl.Friction, PLANNED, step),
        Kind(
            dahl.Loaded,
            PLANNED | {"fixed_stiffness": False},
            lambda one: one.step_counts(-7, 0.75),
        ),
        Kind(
            dahl.Node,
            {"friction": dahl.Plan(**PLAN), "number": 3} | NODE,
            lambda one: one.receive(codec.pack(codec.EncoderState(12), 3)),
            unseen=tuple(NODE),
        ),
        Kind(dahl.Parallel, {"parts": MIX}, step),
        Kind(dahl.Plan, PLAN),
        Kind(dahl.Slip, TWO, step),
        Kind(dahl.State, {"w": 5}, lambda one: setattr(one, "w", -5)),
        Kind(dahl.Throughput, PLAN),
        Kind(dahl.ThroughputParallel, {"parts": FAST}),
        Kind(dahl.ThroughputSlip, TWO),
        Kind(dahl.VelocityTable, {"torque": TABLE, "segment_bits": 3}),
        Kind(dahl.Work, PLANNED, step),
    )
}
EXCEPTIONS = {"Error", "RunError", "Timeout"}  # equal only to themselves, as all of Python's
CLASSES = {name for name in dahl.__all__ if inspect.isclass(getattr(dahl, name))}
COPIES = [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


def test_no_class_is_left_out() -> None:
    assert KINDS.keys() == CLASSES - EXCEPTIONS, "a new class: give it a line in KINDS"


def test_equal_as_it_is_made_and_as_it_moves(kind: Kind) -> None:
    one, same = kind.make(), kind.make()
    assert one == same and one != "another thing"
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


def test_each_argument_is_held_told_compared_and_copied(kind: Kind) -> None:
    """Another value of any of them makes another one, with another repr."""
    made = [(None, kind.make()), *((name, kind.make(**{name: v})) for name, v in kind.others())]
    assert {name for name, _ in made[1:]} == kind.arguments.keys()
    for _, one in made:
        assert [other is one for _, other in made] == [other == one for _, other in made]
        assert all(copied(one) == one for copied in COPIES)
    told = [repr(one) for name, one in made if name not in kind.unseen]
    assert len({*told}) == len(told)
    one = made[0][1]
    for name, value in kind.arguments.items():
        held = getattr(one, name, value)
        wanted = tuple(value) if isinstance(value, list) else value
        assert held == wanted or held == pytest.approx(wanted, rel=1e-7)


def test_the_repr_makes_it_again_or_tells_its_numbers_in_their_units(kind: Kind) -> None:
    one = kind.make()
    assert type(one).__name__ in repr(one) and " at 0x" not in repr(one)
    if "<" not in repr(one):  # else it has a state, which no argument gives
        assert eval(repr(one), {name: getattr(dahl, name) for name in dahl.__all__}) == one
    for _ in range(2) if kind.move else ():
        kind.move(one)
        for name, number, unit in re.findall(r"(torque|work)=(\S+) (N m|J)", repr(one)):
            held = getattr(one.parts[0] if kind.of is dahl.Parallel else one, name)
            assert float(number) == float(f"{held:g}") != 0
            assert (name, unit) in {("torque", "N m"), ("work", "J")}
    if kind.of is dahl.Node:
        assert repr(one).endswith(", number=3, state=REPEATED, ok=1>")  # the frame came twice


LIMITED = {"sigma0": "N m/rad", "theta_per_count": "rad/count"}
LIMITED |= dict.fromkeys(("Fc", "Fc_forward", "Fc_backward"), "N m")
OUTSIDE = {-1.0: "-1", math.nan: "nan", math.inf: "inf", -math.inf: "-inf", 1e40: "1e+40"}
OUTSIDE |= {2.0**-65: "2.71051e-20", 2.0**64: "1.8446744073709552e+19", 1e-50: "1e-50"}


@pytest.mark.parametrize("value", OUTSIDE)
def test_a_parameter_outside_its_limits_is_named_with_them(kind: Kind, value: float) -> None:
    """In its unit, and of several elements the one that it is of. 0 is an encoder only where moves
    may be angles; at the limits there is one.
    """
    for name, unit in LIMITED.items():
        if not isinstance(given := kind.arguments.get(name), (float, list)):
            continue
        with pytest.raises(dahl.Error) as caught:
            kind.make(**{name: [given[0], value] if isinstance(given, list) else value})
        where, _, told = str(caught.value).partition(" = ")
        place = {f"{name}[1]", f"element 1: {name}"} if isinstance(given, list) else {name}
        assert where in place and told.startswith(f"{OUTSIDE[value]} ")
        assert f"2^-64 <= {name} < 2^64 ({unit})" in told
        if name == "theta_per_count" and kind.of not in (dahl.Plan, dahl.Throughput):
            with pytest.raises(dahl.Error, match=f"{name} = 0 "):
                kind.make(**{name: 0})


@pytest.mark.parametrize("copied", COPIES, ids=["copy", "deepcopy", "pickle"])
def test_a_copy_stands_where_the_other_does_and_goes_its_own_way(kind: Kind, copied: Any) -> None:
    """With all that a subclass adds, also where that is made of something else."""

    class Own(kind.of):  # type: ignore[name-defined, misc]
        __slots__ = ("note",)

        def __init__(self, name: str, parts: Any = (), **arguments: Any) -> None:
            super().__init__(*parts, **arguments)
            vars(self)["name"] = name
            object.__setattr__(self, "note", name)

    Own.__qualname__ = "Own"
    globals()["Own"] = Own
    one = Own("left", **copy.deepcopy(kind.arguments))
    again = copied(one)
    assert (type(again), again.name, again.note) == (Own, "left", "left") and again == one
    if kind.move:
        kind.move(one)
        assert copied(one) == one != again == Own("right", **copy.deepcopy(kind.arguments))


@pytest.mark.parametrize("copied", COPIES[1:], ids=["deepcopy", "pickle"])
def test_what_belongs_together_does_so_when_it_is_copied_together(copied: Any) -> None:
    bearing = dahl.Friction(dahl.Plan(**PLAN))
    mix, again, state = copied((dahl.Parallel(bearing), bearing, bearing.state))
    assert mix.parts[0] is again and again.state is state


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


def test_exceptions_are_one_line_also_when_pickled() -> None:
    for kind_of in (dahl.Error, dahl.RunError, dahl.Timeout):
        again = pickle.loads(pickle.dumps(kind_of("sigma0 = -1\n\x1b[2J")))
        assert (type(again), str(again)) == (kind_of, "sigma0 = -1 ?[2J")
    assert issubclass(dahl.RunError, dahl.Error)


@pytest.mark.parametrize(
    "call",
    [
        lambda: dahl.Plan(-1, 1),
        lambda: dahl.Plan("x", 1),
        lambda: dahl.Plan(1, 1, theta=1),
        lambda: codec.EncoderState(2**40),
        lambda: codec.from_bytes(0x100, bytes(8)),
    ],
)
def test_a_wrong_value_is_a_value_error(call: Callable[[], Any]) -> None:
    for kind_of in (dahl.Error, ValueError):
        with pytest.raises(kind_of):
            call()


@pytest.mark.parametrize("module", [node, codec])
def test_a_star_import_brings_what_the_module_defines_and_nothing_else(module: Any) -> None:
    """Every class and function of it and of the frames, without a leading underscore, but the seams
    to C.
    """
    brought: dict[str, Any] = {}
    exec(f"from {module.__name__} import *", brought)
    del brought["__builtins__"]
    assert {name for name in brought if inspect.ismodule(brought[name])} == set()
    kinds = inspect.isclass, inspect.isfunction
    homes = (module.__name__, "dahl.can.frame", "dahl.can.frames")
    own = {
        name
        for name, value in vars(module).items()
        if any(is_one(value) for is_one in kinds) and value.__module__ in homes
        if not name.startswith("_")
    }
    to_c = {"RawFrame", "number_of", "python_can"}
    classes_and_calls = {name for name in brought if callable(brought[name])}
    assert classes_and_calls == own - to_c


def test_both_ends_of_a_parameter_are_taken() -> None:
    for make in (dahl.Plan, dahl.Throughput):
        least, most = 2.0**-64, float(np.nextafter(np.float32(2.0**64), np.float32(0)))
        for sigma0, torque in ((least, most), (most, least), (least, least), (most, most)):
            make(sigma0, torque)  # no encoder
        make(least, least, 2.0**-30)
        make(1, 1, float(np.nextafter(np.float32(2**20), np.float32(0))))


def test_numbers_are_told_in_few_digits() -> None:
    """A float as C has it, in as few as make it again; those of the fast form are doubles."""
    numbers = "sigma0=100.0, Fc=0.3, theta_per_count=0.00038"
    assert repr(dahl.Plan(100, 0.3, 3.8e-4)) == f"Plan({numbers})"
    told = "(sigma0=[100.0, 40.0], Fc=[0.5, 0.3], theta_per_count=0.00038)"
    exact = dahl.Slip([100, 40], [0.5, 0.3], 3.8e-4)
    fast = dahl.ThroughputSlip([100, 40], [0.5, 0.3], 3.8e-4)
    assert (repr(exact), repr(fast)) == (f"Slip{told}", f"ThroughputSlip{told}")
    near = dahl.ThroughputSlip([100, 40], [0.5, exact.Fc[1]], 3.8e-4)
    assert repr(near) != repr(fast)
