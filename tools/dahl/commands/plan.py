# SPDX-License-Identifier: MIT
"""Prepare a plan for flash from known numbers: a header with a const dahl_plan_t, for C99 and
C++11. With --model it is the plan of another model (dahl_parts.h).

The header holds the result of dahl_prepare(), dahl_slip_prepare() ..., so that the firmware need
not call it. For linear motion read m for rad and N for N m. `dahl identify` finds sigma0 and Fc
from a log.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from dahl.errors import Error

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dahl.binding.models import AnyPlan

HELP = "a plan for flash from known numbers"
EXAMPLE = """examples:
  dahl plan --sigma0 100 --fc 0.5 --counts-per-turn 16384 -o dahl_plan_shaft.h
  dahl plan --sigma0 100 --fc 0.5 --theta-per-count 3.8e-4 --name shaft -o -
  dahl plan --model slip --sigma0 100,40 --fc 0.5,0.3 --theta-per-count 3.8e-4 -o seal.h
  dahl plan --model asymmetric --sigma0 100 --fc 0.5,0.3 --theta-per-count 3.8e-4 -o rod.h"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from dahl.binding import models

    with_plan = [name for name, row in models.table().items() if row.has_plan]
    parser.add_argument("--model", choices=with_plan, default="dahl", help="default: dahl")
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
        " forward,backward",
    )
    parser.add_argument(
        "--breakaway",
        metavar="B",
        help=f"of {_breakaway_model()}: torque up to which nothing creeps, a fraction of Fc between"
        " 0 and 1",
    )
    encoder = parser.add_mutually_exclusive_group(required=True)
    encoder.add_argument("--counts-per-turn", metavar="N", help="of the encoder, with all edges")
    encoder.add_argument(
        "--theta-per-count", metavar="T", help="rad per count; 0: moves by angle only"
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="PLAN.h",
        help="header to write, -: standard output",
    )
    parser.add_argument(
        "--name", help="of the plan, dahl_plan_NAME (default: from the file's name)"
    )
    parser.add_argument("--force", action="store_true", help="overwrite a file that is no plan")


def run(args: argparse.Namespace) -> None:
    from dahl.binding import plan_header
    from dahl.io import files

    plan = _plan(args)
    path = Path("shaft.h" if args.output == "-" else args.output)
    name = plan_header.identifier(args.name or path.stem.removeprefix("dahl_plan_"))
    text = plan_header.text(name, plan, [])
    if args.output == "-":
        sys.stdout.write(text)
        return
    if not args.force and path.is_file() and not plan_header.is_plan(path):
        raise Error(f"{path}: exists and is no plan; --force overwrites it")
    files.write_atomic(path, text)
    print(f"{path}: {plan}")


def _plan(args: argparse.Namespace) -> AnyPlan:
    from typing import cast

    from dahl.binding import models
    from dahl.binding.parameters import FC, SIGMA0

    model = models.table()[args.model]
    sigma0, fc = _numbers("--sigma0", args.sigma0, SIGMA0), _numbers("--fc", args.fc, FC)
    theta = _theta_per_count(args)
    if (args.breakaway is not None) != (model.key == "breakaway"):
        raise Error(
            f"--breakaway B, 0 < B < 1, is required by --model {_breakaway_model()} and refused by"
            " the others"
        )
    _check_numbers("--sigma0", args.sigma0, sigma0, model.sigma0s, args.model)
    _check_numbers("--fc", args.fc, fc, model.Fcs, args.model)
    own = model.key and _number("--breakaway", args.breakaway, "0 < breakaway < 1")
    return cast("AnyPlan", models.make(model, sigma0, fc, theta, own))


def _breakaway_model() -> str:
    from dahl.binding import models

    return models.with_key("breakaway").name


def _numbers(option: str, text: str, limit: str) -> list[float]:
    """Return one number, or several separated by commas."""
    return [_number(option, word, limit) for word in text.split(",")]


def _check_numbers(option: str, text: str, values: list[float], count: int, model: str) -> None:
    """Raise dahl.Error unless there are `count` values; 0 allows any number."""
    if count not in (0, len(values)):
        raise Error(f"{option} {text}: {len(values)} numbers; --model {model} needs {count}")


def _number(option: str, text: str, limit: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise Error(f"{option} {text}: not a number; {limit} was expected") from None


def _theta_per_count(args: argparse.Namespace) -> float:
    from dahl.binding.parameters import THETA_PER_COUNT

    if args.theta_per_count is not None:
        return _number("--theta-per-count", args.theta_per_count, THETA_PER_COUNT)
    counts = _number("--counts-per-turn", args.counts_per_turn, "a number above 0")
    if not 0 < counts < math.inf:
        raise Error(f"--counts-per-turn {args.counts_per_turn}: not a finite number above 0")
    return 2 * math.pi / counts
