# SPDX-License-Identifier: MIT
"""The options of a friction model and its encoder."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Iterable, Sequence

from dahl.commands.arguments import comma_hint
from dahl.errors import Error, InputError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dahl.binding.models import Model
    from dahl.sim.scene import Scene


def add_model(parser: argparse.ArgumentParser, names: Iterable[str]) -> None:
    parser.add_argument("--model", choices=list(names), default="dahl", help="default: dahl")
    parser.add_argument(
        "--sigma0",
        required=True,
        metavar="X",
        help="stiffness at rest, N m/rad; of slip one for each element: X,X",
    )
    parser.add_argument(
        "--fc",
        required=True,
        metavar="Y",
        help="Coulomb torque, N m; of slip one per element: Y,Y; if each direction has its own:"
        " forward,backward; of stribeck: Fs,Fc",
    )
    for model in _with_own_number():
        parser.add_argument(f"--{model.key}", metavar="B", help=f"of {model.name}: {model.meaning}")


def add_encoder(parser: argparse.ArgumentParser, required: bool, help_theta: str) -> None:
    encoder = parser.add_mutually_exclusive_group(required=required)
    encoder.add_argument("--counts-per-turn", metavar="N", help="of the encoder, with all edges")
    encoder.add_argument("--theta-per-count", metavar="T", help=help_theta)


def _with_own_number() -> list[Model]:
    """Return the models with a number as their own key, which is an option here."""
    from dahl.binding import models

    return [model for model in models.table().values() if model.has_own_number]


def read_numbers(args: argparse.Namespace, model: Model) -> tuple[list[float], list[float]]:
    """Return sigma0 and Fc, as many as the model needs."""
    from dahl.binding.parameters import FC, SIGMA0

    sigma0, fc = _numbers("--sigma0", args.sigma0, SIGMA0), _numbers("--fc", args.fc, FC)
    _check_count("--sigma0", args.sigma0, sigma0, model.sigma0s, args.model)
    _check_count("--fc", args.fc, fc, model.Fcs, args.model)
    if not model.sigma0s and len(sigma0) != len(fc):
        raise wrong_counts(args, sigma0, fc, hint=comma_hint(f"{args.sigma0} {args.fc}"))
    return sigma0, fc


def wrong_counts(
    args: argparse.Namespace, *each: Sequence[float] | Sequence[str], hint: str = ""
) -> InputError:
    """Return the error of a model of several elements with other numbers of values."""
    from dahl.binding.slip import SLIP_MAX

    numbers = ", ".join(str(len(values)) for values in each)
    return InputError(
        f"--sigma0 {args.sigma0} --fc {args.fc}: {numbers} values; as many of each, 1 to"
        f" {SLIP_MAX}, were expected{hint}"
    )


def read_own(args: argparse.Namespace, model: Model) -> float | None:
    """Return the number of the model's own key, None if it has none."""
    found = None
    for owner in _with_own_number():
        text = getattr(args, owner.key)
        option, limit = f"--{owner.key}", f"{owner.low:g} <= {owner.key} <= {owner.high:g}"
        if (text is not None) != (model == owner):
            words = f"is required by --model {owner.name} and refused by the others"
            raise InputError(f"{option} B, {limit}, {words}")
        found = found if text is None else _number(option, text, limit)
    return found


def read_theta_per_count(args: argparse.Namespace) -> float | None:
    """Return the angle of one count in rad, or None if neither option was given."""
    from dahl.binding.parameters import THETA_PER_COUNT

    if args.theta_per_count is not None:
        return _number("--theta-per-count", args.theta_per_count, THETA_PER_COUNT)
    if args.counts_per_turn is None:
        return None
    counts = _number("--counts-per-turn", args.counts_per_turn, "a number above 0")
    if not 0 < counts < math.inf:
        raise InputError(f"--counts-per-turn {args.counts_per_turn}: not a finite number above 0")
    return 2 * math.pi / counts


def note_units(sigma0: Iterable[float], fc: Iterable[float], theta_per_count: float) -> None:
    """Print a note if an element is probably in a wrong unit. One sigma0 may serve several Fc."""
    import sys
    from itertools import cycle

    from dahl.binding.plausible import implausible

    elements = zip(cycle(sigma0), fc)  # noqa: B905 (cycle has no end)
    remarks = (implausible(*one, theta_per_count) for one in elements)
    if remark := next(filter(None, remarks), ""):
        print(f"note: {remark}", file=sys.stderr)


def note_units_of(scene: Scene) -> None:
    """Do note_units() for a scene. Numbers that the library refuses get an error later."""
    sigma0, torques = ([pair[k] for pair in scene.elements] for k in (0, 1))
    with contextlib.suppress(Error):
        note_units(sigma0, torques, scene.theta_per_count)


def _numbers(option: str, text: str, limit: str) -> list[float]:
    """Return one number, or several separated by commas. 0,5 could be meant as one."""
    values = [_number(option, word, limit) for word in text.split(",")]
    if len(values) > 1 and 0 in values:
        raise InputError(f"{option} {text}: 0 is outside {limit}{comma_hint(text)}")
    return values


def _check_count(option: str, text: str, values: list[float], count: int, model: str) -> None:
    """Raise dahl.Error unless there are `count` values; 0 allows any number."""
    if count not in (0, len(values)):
        needs = f"--model {model} needs {count}{comma_hint(text)}"
        raise InputError(f"{option} {text}: {len(values)} numbers; {needs}")


def _number(option: str, text: str, limit: str) -> float:
    try:
        return float(text)
    except ValueError:
        expected = f"{limit} was expected{comma_hint(text)}"
        raise InputError(f"{option} {text}: not a number; {expected}") from None
