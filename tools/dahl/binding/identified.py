# SPDX-License-Identifier: MIT
"""Read the bounds for a compensator from the JSON of `dahl identify`."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dahl.binding import checks, parameters, plan_header
from dahl.errors import InputError

RECORD_AGAIN = "record a motion that dahl excite proposes"
LINEAR = "ratio = 2*pi/lead in rad/m for a motor with a screw, or 1 for a linear motor"
NAMES = ("Fc_low", "length_long", "sigma0_high")


@dataclass(frozen=True)
class Bounds:
    """Bounds at the motor. N m and rad, or N and m of a linear motor."""

    Fc_low: float
    length_long: float
    sigma0_high: float  # 0 if the log does not show it


def read_bounds(path: str | os.PathLike[str], ratio: float | None, reference: bool) -> Bounds:
    """Return the floats on the safe side of the bounds. One rad or m of the log is `ratio` rad of
    the motor. Raises dahl.Error with the next step.
    """
    found = _read(Path(path))
    if found["linear"] and ratio is None:
        raise InputError(f"{path} is in N and m of a linear motion: give {LINEAR}")
    turned = checks.finite("ratio", 1.0 if ratio is None else ratio, "rad of the motor")
    if turned <= 0:
        raise InputError(f"ratio = {turned:g} is not above 0")
    needed = NAMES[:2] if reference else NAMES
    if missing := [name for name in needed if found[name] is None]:
        raise InputError(f"{path} has no {missing[0]}: {_reason(found)}")
    low, long, high = (float(found[name] or 0) for name in NAMES)
    return Bounds(
        plan_header.rounded(low / turned, 0.0),
        plan_header.rounded(long * turned, math.inf),
        plan_header.rounded(high / turned**2, math.inf),
    )


def complete(bounds: Bounds, is_free: bool, given: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of a compensator: the given ones, with those of the bounds and
    defaults. Raises TypeError for a parameter that follows from the file, and dahl.Error for one
    that breaks the guarantee.
    """
    low, long, high = bounds.Fc_low, bounds.length_long, bounds.sigma0_high
    if surplus := {"sigma0", "Fc", *NAMES} & given.keys():
        raise TypeError(f"{min(surplus)} follows from the file")
    lengths = 4 if is_free and given.get("elastic", False) else 1
    load, noise = (checks.real(name, given.get(name, 0)) for name in ("load", "noise"))
    if is_free and load >= low:
        raise InputError(f"load = {load:g} is not below Fc_low = {low:g}: friction cannot hold it")
    defaults = {
        "gain": 0.9 * (low - load) / low if is_free else 1.0,
        "limit": 1.2 * low,
        "slew": max(100 * low, _least_slew(bounds, given) if is_free else 0),
        "play": 2 * noise + 2 if noise else 1,
        "rise": 0.5,
        "fall": 0.02,
    }
    friction = {"sigma0": low / (lengths * long), "Fc": low}
    taken = {**defaults, **given, **friction, "Fc_low": low, "length_long": long}
    taken["sigma0_high"] = high
    if is_free:
        _check_guarantee(bounds, taken)
    return taken


def _least_slew(bounds: Bounds, given: dict[str, Any]) -> float:
    """Return the least slew of the guarantee; the constructor refuses a missing inertia."""
    inertia = checks.real("inertia", given.get("inertia", 0))
    swing = math.sqrt(bounds.sigma0_high / inertia) if inertia > 0 else 0.0  # rad/s
    return bounds.Fc_low * max(20.0, swing / 25)


def _check_guarantee(bounds: Bounds, taken: dict[str, Any]) -> None:
    """Raise dahl.Error for a condition of the guarantee that the constructor does not check."""
    slew, least = checks.real("slew", taken["slew"]), _least_slew(bounds, taken)
    if slew < least:
        raise InputError(f"slew = {slew:g} is below {least:g}: 20 Fc/s, Fc*sqrt(sigma0/inertia)/25")
    noise, play = (checks.real(name, taken.get(name, 0)) for name in ("noise", "play"))
    if play < (2 * noise + 2 if noise else 1):
        raise InputError(f"play = {play:g} is below 2*noise + 2 = {2 * noise + 2:g}")
    inertia, fade = (checks.real(name, taken.get(name, 0)) for name in ("inertia", "fade_speed"))
    slowest = math.sqrt(bounds.Fc_low * bounds.length_long / inertia) / 2 if inertia > 0 else 0.0
    if 0 < fade < slowest:
        raise InputError(f"fade_speed = {fade:g} is below {slowest:g}: Fc/sqrt(sigma0*inertia)/2")


def _read(path: Path) -> dict[str, Any]:
    """Return the content of the file. Its bounds are numbers above 0, or None."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; dahl identify writes it") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error})") from None
    if isinstance(found, dict) and "compensator_without_load_table" in found:
        raise InputError(
            f"{path}: by dahl commission; its 'compensator' has all keywords of dahl.Compensator:"
            " dahl.Compensator(**json.load(open(...))['compensator'])"
        )
    is_ours = isinstance(found, dict) and {"linear", *NAMES} <= found.keys()
    if not is_ours or not all(_is_bound(found[name]) for name in NAMES):
        raise InputError(f"{path}: not written by this version of dahl identify {NAMES}")
    return dict(found)


def _is_bound(value: object) -> bool:
    is_number = isinstance(value, float | int) and not isinstance(value, bool)
    return value is None or (is_number and 0 < value < parameters.TORQUE_MAX)  # type: ignore[operator]


def _reason(found: dict[str, Any]) -> str:
    """Return why the log gives no bound, and the next step."""
    reason = found.get("against_bounds") or "; ".join(map(str, found.get("reasons") or ()))
    steps = found.get("next_steps") or {}
    step = next(iter(steps.values()), RECORD_AGAIN)
    return f"{reason or 'the log does not show it'}; next: {step}"
