# SPDX-License-Identifier: MIT
"""One example of each friction model of the table: keys of a scene, and the Python object."""

from typing import Any

from dahl.binding import models

SIGMA0 = [100.0, 30.0, 50.0]  # N m/rad, of each element
FC = [0.2, 0.7, 0.05]  # N m, of each element or direction
THETA = 3.8e-4  # rad per count
OWN: dict[str, Any] = {  # own keys
    model.key: model.low + 0.6 * (model.high - model.low)
    for model in models.table().values()
    if model.has_own_number
} | {"kinds": ["dahl", "slip", "dahl"], "stribeck": 0.05}
STATE_ELEMENTS = [model for model in models.table().values() if model.has_plan and model.sigma0s]
STATE_ELEMENTS = [model for model in STATE_ELEMENTS if model.name != "dahl"]  # of a StateElement


def numbers(model: models.Model) -> tuple[list[float], list[float]]:
    """Return sigma0 and Fc; three elements if the model has elements."""
    return SIGMA0[: model.sigma0s or 3], FC[: model.Fcs or 3]


def whole(model: models.Model) -> float:
    """Return the torque that a ratio of 1 means."""
    torques = numbers(model)[1]
    return max(torques) if model.has_two_limits else sum(torques)


def made(model: models.Model) -> Any:
    return models.make(model, *numbers(model), THETA, OWN.get(model.key))


def keys(model: models.Model) -> str:
    sigma0, torques = numbers(model)
    lines = {"model": [model.name], "sigma0": sigma0, "Fc": torques}
    if model.key:
        own = OWN[model.key]
        lines[model.key] = own if isinstance(own, list) else [own]
    return "".join(f"{key} = {' '.join(map(str, value))}\n" for key, value in lines.items())
