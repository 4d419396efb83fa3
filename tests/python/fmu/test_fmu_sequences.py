# SPDX-License-Identifier: MIT
"""Random calls of an FMU: FMI 2.0, FMI 3.0 and a model of their state machine agree."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import dahl as package
import fmu_instance
import hypothesis
import numpy as np
import pytest
from dahl.binding import models
from dahl.sim import fmu
from fmu_instance import ERROR, OK, Instance
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test
from law_tools import SLOW, modes
from model_examples import FC, SIGMA0

pytestmark = pytest.mark.usefixtures("library")

START = {"angle": 0.0, "theta_per_count": 0.0, "sigma0": SIGMA0[0], "Fc": FC[0]}
ORDER = ["INSTANTIATED", "INITIALIZING", "STEPPING", "TERMINATED"]
ANGLES = st.floats(-0.1, 0.1) | st.sampled_from([1e29, -1e29, 1e30, math.nan, -math.inf])
PARAMETERS = st.floats(0.01, 100) | st.sampled_from([0.0, -1.0, math.nan, math.inf])
NEW_NAMES = {  # of functions of FMI 2.0 in FMI 3.0
    "SetReal": "SetFloat64",
    "SetupExperiment": "EnterInitializationMode",
}
DURATIONS = st.floats(1e-6, 1) | st.sampled_from([0.0, -1.0, math.nan])


@dataclass
class Model:
    """The behaviour that docs/simulators.md and the standards describe, by the Python class."""

    mode: int = 0
    value: dict[str, float] = field(default_factory=lambda: dict(START))
    position: float = 0.0
    torque: float = 0.0
    friction: Any = None

    def advance(self, mode: int) -> int:
        if self.mode != mode:
            return ERROR
        if ORDER[mode] == "INITIALIZING":
            plan = package.Plan(self.value["sigma0"], self.value["Fc"])
            self.friction = package.Friction(plan)
        self.mode, self.position = mode + 1, self.value["angle"]
        return OK

    def set(self, name: str, value: float) -> int:
        is_parameter = name != "angle"
        low, high = (2.0**-64, 2.0**64) if is_parameter else (-1e30, 1e30)
        if (is_parameter and self.mode > 1) or not low <= value < high:
            return ERROR
        self.value[name] = value
        return OK

    def step(self, duration: float) -> int:
        if ORDER[self.mode] != "STEPPING" or not duration > 0:
            return ERROR
        move = np.float32(self.value["angle"] - self.position)
        self.torque, self.position = self.friction.step(float(move)), self.value["angle"]
        return OK


class AgainstTheModel(RuleBasedStateMachine):
    """The same calls for both versions. Compare each status, each message and each value."""

    def __init__(self, units: dict[int, tuple[Path, Path]]) -> None:
        super().__init__()
        self.units = {fmi: [Instance(*unit), Instance(*unit)] for fmi, unit in units.items()}
        self.models = [Model(), Model()]
        self.saved: list[tuple[Model, dict[int, bytes]]] = []
        self.at = 0

    @property
    def model(self) -> Model:
        return self.models[self.at]

    def expect(self, status: int, name: str, *arguments: Any, **values: float) -> None:
        messages = []
        for fmi, units in self.units.items():
            one = units[self.at]
            assert getattr(one, name)(*arguments, **values) == status
            assert len(one.messages) == (status != OK)
            messages.append([text.replace(f"fmi{fmi}", "fmi") for text in one.messages])
            one.messages.clear()
        of_fmi2, of_fmi3 = messages
        for old, new in NEW_NAMES.items():
            of_fmi2 = [text.replace(old, new) for text in of_fmi2]
        assert of_fmi2 == of_fmi3

    @rule()
    def use_the_other_instance(self) -> None:
        self.at = 1 - self.at

    @rule()
    def enter(self) -> None:
        self.expect(self.model.advance(0), "enter")

    @rule()
    def leave(self) -> None:
        self.expect(self.model.advance(1), "leave")

    @rule(angle=ANGLES)
    def start_anew(self, angle: float) -> None:
        self.reset()
        self.enter()
        self.set_angle(angle)
        self.leave()

    @rule()
    def terminate(self) -> None:
        self.expect(self.model.advance(2), "call", "Terminate")

    @rule()
    def reset(self) -> None:
        self.models[self.at] = Model()
        self.expect(OK, "call", "Reset")

    @rule(angle=ANGLES)
    def set_angle(self, angle: float) -> None:
        self.expect(self.model.set("angle", angle), "set", angle=angle)

    @rule(name=st.sampled_from(["sigma0", "Fc"]), value=PARAMETERS)
    def set_parameter(self, name: str, value: float) -> None:
        self.expect(self.model.set(name, value), "set", **{name: value})

    @rule(angle=ANGLES)
    def set_all_or_nothing(self, angle: float) -> None:
        self.expect(ERROR, "set", angle=angle, torque=0.0)

    @rule(angle=st.floats(-0.1, 0.1), duration=DURATIONS)
    def step(self, angle: float, duration: float) -> None:
        self.set_angle(angle)
        self.expect(self.model.step(duration), "do_step", duration)

    @rule()
    def save(self) -> None:
        bits = {fmi: units[self.at].save() for fmi, units in self.units.items()}
        self.saved.append((copy.deepcopy(self.model), bits))

    @rule(choice=st.integers(0, 9))
    def restore(self, choice: int) -> None:
        if not self.saved:
            return
        model, bits = self.saved[choice % len(self.saved)]
        self.models[self.at] = copy.deepcopy(model)
        for fmi, units in self.units.items():
            assert units[self.at].restore(bits[fmi]) == OK
            assert units[self.at].save() == bits[fmi]

    @rule(choice=st.integers(0, 9), damage=st.tuples(st.integers(0), st.integers(1, 255)))
    def restore_a_damaged_state(self, choice: int, damage: tuple[int, int]) -> None:
        """A byte is wrong, then the end is missing. What is accepted can step, and then go back."""
        place, mask = damage
        for units in self.units.values():
            one = units[self.at]
            good = one.save()
            wrong = bytearray(good)
            wrong[place % len(good)] ^= mask
            assert one.restore(good[: place % len(good)]) == ERROR and one.save() == good
            if one.restore(bytes(wrong)) == OK:
                if one.do_step(1) == OK:
                    assert abs(one.get("torque")) <= np.float32(one.get("Fc"))
                    assert abs(one.get("ratio")) <= 1
                assert one.restore(good) == OK
            assert one.save() == good
            one.messages.clear()

    @invariant()
    def values_agree(self) -> None:
        for units in self.units.values():
            for one, model in zip(units, self.models, strict=True):
                assert one.get("torque") == model.torque
                assert {name: one.get(name) for name in model.value} == model.value

    def teardown(self) -> None:
        for units in self.units.values():
            for one in units:
                one.free()


@modes(100, 5000)
def test_any_calls_have_the_status_and_the_bits_of_the_model(dahl, examples):
    units = {}
    for fmi in fmu.VERSIONS:
        path = fmu_instance.export(dahl, fmi, models.table()["dahl"], name=f"unit{fmi}.fmu")
        units[fmi] = path, Path(Instance(path).functions._name)
    how = hypothesis.settings(max_examples=examples, suppress_health_check=SLOW, deadline=None)
    run_state_machine_as_test(partial(AgainstTheModel, units), settings=how)
