# SPDX-License-Identifier: MIT
"""All public classes: equality, repr, copies and pickles. Then names and examples of the API."""

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
import pytest
from dahl import codec, node
from dahl.binding import models
from dahl.can.async_bus import AsyncBus
from model_examples import OWN, STATE_ELEMENTS, THETA, numbers
from strategies import COPIES


def step(one: Any) -> Any:
    return one.step_counts(-7)


@dataclass(frozen=True)
class Kind:
    """A class, the arguments of one object, and a call that moves it, if it moves."""

    of: type
    arguments: dict[str, Any]
    move: Callable[[Any], Any] | None = None
    unseen: tuple[str, ...] = ()  # arguments that its repr omits

    def make(self, **changed: Any) -> Any:
        arguments = copy.deepcopy(self.arguments | changed)
        parts = arguments.pop("parts", ())
        return self.of(*parts, **arguments)

    def others(self) -> Iterator[tuple[str, Any]]:
        for name, value in self.arguments.items():
            for other in others(name, value):
                yield name, other


def others(name: str, value: Any) -> Iterator[Any]:
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


def arguments_of(model: models.Model) -> dict[str, Any]:
    """Return the arguments of a class that is derived from StateElement, by name."""
    sigma0, torques = numbers(model)
    own = [OWN[model.key]] if model.key else []
    names = inspect.signature(models.class_of(model)).parameters
    return dict(zip(names, [*sigma0, *torques, THETA, *own], strict=True))


PLAN = {"sigma0": 100.0, "Fc": 0.5, "theta_per_count": 2e-4}
PLANNED = {"plan": dahl.Plan(**PLAN)}
TWO = {"sigma0": [100.0, 50.0], "Fc": [0.5, 1.0], "theta_per_count": 1e-3}
COMPENSATED = PLAN | {"period": 1e-3, "limit": 0.3, "slew": 50.0, "gain": 0.5, "Fc_low": 0.4}
COMPENSATED |= {"length_long": 1e-3, "reference": False, "rise": 0.2, "fall": 0.1}
COMPENSATED |= {"fade_speed": 3.0, "noise": 1, "play": 5, "jump": 90, "elastic": False}
COMPENSATED |= {"sigma0_high": 120.0, "load": 0.01, "inertia": 2e-3, "delay": 2e-3}
OBSERVED = {"inertia": 1e-3, "corner": 4.0, "limit": 0.3, "speed_gain": 0.5, "resonance": 90.0}
OBSERVED |= {"delay": 2, "slew": 50.0, "no_integral": True}
DAMPED = {"sigma0": 500.0, "Fc": 1.5, "sigma1": 1.75, "period": 1e-3}
AXIS = {"period": 1e-3, "theta_per_count": 1e-4, "inertia": 2e-3, "torque_limit": 3.0}
AXIS |= {"travel": 0.35, "angle_limit": 0.75, "speed_limit": 10.0}
NODE = {"gain": 0.5, "limit": 0.25, "ramp": 0.3, "timeout": 0.02, "max_step": 7}
NODE |= {"status_period": 0.07}
TABLE = [0.5, 0.3, 0.25, -0.125, *(0.0625 * k for k in range(1, 13))]
MIX = (dahl.Friction(dahl.Plan(**PLAN)), dahl.Slip(**TWO))
KINDS = {
    kind.of.__name__: kind
    for kind in (
        *(Kind(models.class_of(model), arguments_of(model), step) for model in STATE_ELEMENTS),
        Kind(dahl.Commission, AXIS, lambda one: one.tick(2, 0.5)),
        Kind(dahl.Compensator, COMPENSATED, lambda one: one.move(-7)),
        Kind(dahl.Damping, DAMPED, lambda one: one.apply_q30(-7)),
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
        Kind(
            dahl.Residual,
            PLAN | OBSERVED | {"period": 1e-3},
            lambda one: one.note_q24(-7),
        ),
        Kind(dahl.Slip, TWO, step),
        Kind(dahl.State, {"w": 5}, lambda one: setattr(one, "w", -5)),
        Kind(dahl.Throughput, PLAN),
        Kind(dahl.VelocityTable, {"torque": TABLE, "segment_bits": 3}),
        Kind(dahl.Work, PLANNED, step),
    )
}
EXCEPTIONS = {"BusError", "Error", "InputError", "RunError", "Timeout"}  # equal only to themselves
ON_A_BUS = {"Client"}  # it has no value: equal only to itself
CLASSES = {name for name in dahl.__all__ if inspect.isclass(getattr(dahl, name))}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


def test_each_public_class_has_a_row() -> None:
    assert KINDS.keys() == CLASSES - EXCEPTIONS - ON_A_BUS, "a new class: add a row to KINDS"


def test_objects_are_equal_if_made_and_moved_alike(kind: Kind) -> None:
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


def test_each_argument_counts_for_equality_repr_and_copies(kind: Kind) -> None:
    made = [(None, kind.make()), *((name, kind.make(**{name: v})) for name, v in kind.others())]
    assert {name for name, _ in made[1:]} == kind.arguments.keys()
    for _, one in made:
        assert [other is one for _, other in made] == [other == one for _, other in made]
        assert all(copied(one) == one for copied in COPIES)
    shown = [repr(one) for name, one in made if name not in kind.unseen]
    assert len({*shown}) == len(shown)
    one = made[0][1]
    for name, value in kind.arguments.items():
        held = getattr(one, name, value)
        wanted = tuple(value) if isinstance(value, list) else value
        assert held == wanted or held == pytest.approx(wanted, rel=1e-7)


def test_the_repr_makes_it_again_or_shows_its_numbers_with_units(kind: Kind) -> None:
    one = kind.make()
    assert type(one).__name__ in repr(one) and " at 0x" not in repr(one)
    if "<" not in repr(one):
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
    """With its unit and its element. theta_per_count = 0 is good only if moves may be angles."""
    for name, unit in LIMITED.items():
        if not isinstance(given := kind.arguments.get(name), (float, list)):
            continue
        with pytest.raises(dahl.Error) as caught:
            kind.make(**{name: [given[0], value] if isinstance(given, list) else value})
        where, _, rest = str(caught.value).partition(" = ")
        place = {f"{name}[1]", f"element 1: {name}"} if isinstance(given, list) else {name}
        own = kind.of is dahl.Commission  # its ranges are narrower
        shown = f"{value:g}" if own else OUTSIDE[value]
        assert where in place and rest.startswith(f"{shown} ")
        limit = kind.of._limits[name] if own else f"2^-64 <= {name} < 2^64 ({unit})"
        assert limit in rest
        if name == "theta_per_count" and kind.of not in (dahl.Plan, dahl.Throughput):
            with pytest.raises(dahl.Error, match=f"{name} = 0 "):
                kind.make(**{name: 0})


@pytest.mark.parametrize("copied", COPIES, ids=["copy", "deepcopy", "pickle"])
def test_a_copy_has_the_state_of_the_original_and_its_own_from_then_on(
    kind: Kind, copied: Any
) -> None:
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
def test_objects_copied_together_share_their_copies(copied: Any) -> None:
    bearing = dahl.Friction(dahl.Plan(**PLAN))
    mix, again, state = copied((dahl.Parallel(bearing), bearing, bearing.state))
    assert mix.parts[0] is again and again.state is state


def examples() -> list[doctest.DocTest]:
    find = doctest.DocTestFinder(recurse=False)
    names = {"dahl": dahl, **{name: getattr(dahl, name) for name in dahl.__all__}}
    found = (
        find.find(thing, name, module=False, globs={"dahl": dahl}) for name, thing in names.items()
    )
    return [one for some in found for one in some if one.examples]


def test_each_example_of_a_docstring_prints_what_it_shows() -> None:
    every = examples()
    assert len(every) >= 13
    for one in every:
        printed: list[str] = []
        result = doctest.DocTestRunner().run(one, out=printed.append)
        assert result.failed == 0, "".join(printed)


DEFAULTS: dict[Any, dict[str, Any]] = {  # of the arguments that need not be given
    dahl.Compensator: {"gain": 0.9, "reference": False, "noise": 0, "play": 1, "jump": 1000}
    | dict.fromkeys(("Fc_low", "length_long", "rise", "fall", "fade_speed"), 0)
    | dict.fromkeys(("sigma0_high", "load", "inertia", "delay"), 0)
    | {"elastic": False},
    dahl.Compensator.move: {"is_good": True},
    dahl.Encoder: {"modulus": 0, "sign": 1, "largest_step": 0},
    dahl.Loaded: {"fixed_stiffness": False},
    dahl.Node: {"number": 0, "gain": 1, "limit": 1, "ramp": 0, "timeout": 0.1, "max_step": 0}
    | {"status_period": 0.1},
    dahl.Plan: {"theta_per_count": 0},
    dahl.State: {"w": 0},
    dahl.Throughput: {"theta_per_count": 0},
    dahl.Throughput.run: {"F": 0, "out": None, "threads": 1},
    dahl.Throughput.run_counts: {"F": 0, "out": None, "threads": 1},
    dahl.counts_between: {"modulus": 0},
    codec.EncoderState: {"counter": 0, "valid": True},
    codec.FrictionTorque: {"counter": 0, "state": codec.State.OK, "echo": 0},
    codec.ParamReply: {"result": codec.Result.DONE, "counter": 0},
    codec.ParamWrite: {"value": 0, "write": codec.Write.READ, "counter": 0},
    codec.ParamWrite.of_si: {"write": codec.Write.WRITE, "counter": 0},
    codec.Reset: {"counter": 0},
    codec.pack: {"node": 0},
    node.ask: {"node": 0, "timeout": 1},
    node.expect_silence: {"frame": None, "node": 0, "seconds": 0.1},
    AsyncBus.ask: {"node": 0, "timeout": 1},
    AsyncBus.expect_silence: {"frame": None, "node": 0, "seconds": 0.1},
    AsyncBus.send: {"node": 0},
    AsyncBus.recv: {"timeout": 1},
    dahl.Client: {"number": 0, "timeout": 1},
}


@pytest.mark.parametrize("call", DEFAULTS)
def test_an_argument_that_is_not_given_has_its_default(call: Any) -> None:
    found = {name: one.default for name, one in inspect.signature(call).parameters.items()}
    assert {k: v for k, v in found.items() if v is not inspect.Parameter.empty} == DEFAULTS[call]


def test_exceptions_are_one_line_after_pickling_too() -> None:
    for kind_of in (getattr(dahl, name) for name in EXCEPTIONS):
        again = pickle.loads(pickle.dumps(kind_of("sigma0 = -1\n\x1b[2J")))
        assert (type(again), str(again)) == (kind_of, "sigma0 = -1 ?[2J")
        assert issubclass(kind_of, dahl.Error)
        assert issubclass(kind_of, ValueError) == (kind_of is dahl.InputError)


@pytest.mark.parametrize("module", [dahl, node, codec])
def test_only_public_names_are_listed_and_imported(module: Any) -> None:
    brought: dict[str, Any] = {}
    exec(f"from {module.__name__} import *", brought)
    found = {name for name, value in brought.items() if name != "__builtins__"}
    assert found >= {*module.__all__} and found <= {*dir(module)}
    assert not any(inspect.ismodule(brought[name]) for name in found - {"codec", "node"})
    assert found.isdisjoint({"RawFrame", "number_of", "python_can"})
    with pytest.raises(AttributeError, match="Frction"):
        _ = module.Frction
