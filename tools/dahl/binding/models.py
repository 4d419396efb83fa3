# SPDX-License-Identifier: MIT
"""The friction models of a node, and the Python objects that are made from the numbers of a model.

The shared library is loaded only when an object is made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias

from dahl.facts import MODELS

if TYPE_CHECKING:
    from dahl.binding.friction import Friction, Plan
    from dahl.binding.loaded import Loaded
    from dahl.binding.slip import Parallel, Slip
    from dahl.binding.state_element import StateElement

    AnyPlan: TypeAlias = Plan | Slip | StateElement
    AnyModel: TypeAlias = AnyPlan | Parallel | Loaded


@dataclass(frozen=True)
class Model:
    """One row of DAHL_MODELS; the comment in dahl_parts.h defines the columns."""

    name: str
    class_name: str
    number: int
    sigma0s: int  # numbers of sigma0 [N m/rad]; 0: one for each element
    Fcs: int  # numbers of Fc [N m]; 0: one for each element; 2: of each direction, or Fs and Fc
    has_plan: bool
    key: str
    meaning: str
    low: float  # of the key if it is a number, else 0
    high: float

    @property
    def has_two_limits(self) -> bool:
        """Whether Fc differs with direction or speed; the torque ratio is of the larger one."""
        return self.Fcs == 2

    @property
    def limit_names(self) -> list[str]:
        """The names of both Fc of a model with two limits."""
        return list(class_of(self)._limits)[1:3]

    def fits(self, sigma0s: int, Fcs: int) -> bool:  # noqa: N803
        """Return whether it can be made of this many sigma0 and Fc."""
        wanted = (self.sigma0s or Fcs, self.Fcs or Fcs)
        return Fcs > 0 and (sigma0s, Fcs) == wanted

    @property
    def has_own_number(self) -> bool:
        """Whether its own key is a number, between `low` and `high`."""
        return self.high > 0


_TABLE = {row[0]: Model(*row) for row in MODELS}


def table() -> dict[str, Model]:
    """Return the models by name, `dahl` first."""
    return _TABLE


def with_key(key: str) -> Model:
    """Return the model that has this key of its own in a scene."""
    return next(model for model in table().values() if model.key == key)


def make(
    model: Model,
    sigma0: Sequence[float],
    Fc: Sequence[float],  # noqa: N803
    theta_per_count: float,
    own: Any = None,
) -> AnyModel:
    """Return the Python object of a model: sigma0 in N m/rad, Fc in N m, theta_per_count in
    rad/count, as many as `model.fits`; `own` is the value of its own key, of `kinds` a sequence.

    Raises dahl.Error naming the parameter, its value and its limit.
    """
    from dahl.binding.friction import Plan
    from dahl.binding.loaded import Loaded
    from dahl.binding.slip import Parallel, Slip

    if model.name == "slip":
        return Slip(sigma0, Fc, theta_per_count)
    if model.name == "parallel":
        elements = zip(own, sigma0, Fc, strict=True)
        return Parallel(*(_element(*element, theta_per_count) for element in elements))
    if model.name == "loaded":
        return Loaded(Plan(sigma0[0], Fc[0], theta_per_count))
    values = (*sigma0, *Fc, theta_per_count, *([own] if model.key else []))
    return class_of(model)(*values)  # type: ignore[no-any-return]


def class_of(model: Model) -> Any:
    """Return the Python class of a model."""
    name = "Plan" if model.name == "dahl" else model.class_name
    modules = {"dahl": "friction", "slip": "slip", "parallel": "slip", "loaded": "loaded"}
    module = modules.get(model.name, "state_element")
    return getattr(import_module(f"dahl.binding.{module}"), name)


def _element(
    kind: str,
    sigma0: float,
    Fc: float,
    theta_per_count: float,  # noqa: N803
) -> Friction | Slip:
    from dahl.binding.friction import Friction, Plan
    from dahl.binding.slip import Slip

    if kind == "slip":
        return Slip([sigma0], [Fc], theta_per_count)
    return Friction(Plan(sigma0, Fc, theta_per_count))
