# SPDX-License-Identifier: MIT
"""
Prepare a plan for flash from known numbers: a header with a const dahl_plan_t, for C99 and C++11;
with --model that of another model (dahl_parts.h): slip elements, an Fc of each direction its own,
no creep below breakaway.

The words are those of dahl_prepare(), dahl_slip_prepare() ..., which the firmware then need not
call. For linear motion read m for rad and N for N m. A log of your own gives sigma0 and Fc by
`dahl identify`.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from dahl.errors import Error

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dahl.binding.plan_header import AnyPlan

HELP = "a plan for flash from known numbers"
EXAMPLE = """examples:
  dahl plan --sigma0 100 --fc 0.5 --counts-per-turn 16384 -o dahl_plan_shaft.h
  dahl plan --sigma0 100 --fc 0.5 --theta-per-count 3.8e-4 --name shaft -o -
  dahl plan --model slip --sigma0 100,40 --fc 0.5,0.3 --theta-per-count 3.8e-4 -o seal.h
  dahl plan --model asymmetric --sigma0 100 --fc 0.5,0.3 --theta-per-count 3.8e-4 -o rod.h"""
MODELS = ("dahl", "slip", "asymmetric", "elastoplastic")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", choices=MODELS, default="dahl", help="default: dahl")
    parser.add_argument(
        "--sigma0",
        required=True,
        metavar="X",
        help="stiffness at rest, N m/rad; of slip as many as there are elements: X,X",
    )
    parser.add_argument(
        "--fc",
        required=True,
        metavar="Y",
        help="Coulomb torque, N m; of slip as many: Y,Y; of asymmetric forward,backward",
    )
    parser.add_argument(
        "--breakaway",
        metavar="B",
        help="of elastoplastic: part of Fc, 0 < B < 1, that does not creep",
    )
    encoder = parser.add_mutually_exclusive_group(required=True)
    encoder.add_argument("--counts-per-turn", metavar="N", help="of the encoder, with all edges")
    encoder.add_argument(
        "--theta-per-count", metavar="T", help="rad per count; 0: moves by angle alone"
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
        raise Error(f"{path}: there already, and no plan; --force overwrites it")
    files.keep(path, text)
    print(f"{path}: {plan}")


def _plan(args: argparse.Namespace) -> AnyPlan:
    from dahl.binding.bristles import Asymmetric, ElastoPlastic
    from dahl.binding.friction import Plan
    from dahl.binding.parameters import FC, SIGMA0
    from dahl.binding.slip import Slip

    sigma0, fc = _numbers("--sigma0", args.sigma0, SIGMA0), _numbers("--fc", args.fc, FC)
    theta = _theta_per_count(args)
    if (args.breakaway is not None) != (args.model == "elastoplastic"):
        raise Error(
            "--breakaway B, 0 < B < 1, goes with --model elastoplastic, and with no other model"
        )
    if args.model == "slip":
        return Slip(sigma0, fc, theta)
    _counted("--sigma0", args.sigma0, sigma0, 1, args.model)
    _counted("--fc", args.fc, fc, 2 if args.model == "asymmetric" else 1, args.model)
    if args.model == "asymmetric":
        return Asymmetric(sigma0[0], fc[0], fc[1], theta)
    if args.model == "elastoplastic":
        breakaway = _number("--breakaway", args.breakaway, "0 < breakaway < 1")
        return ElastoPlastic(sigma0[0], fc[0], theta, breakaway)
    return Plan(sigma0[0], fc[0], theta)


def _numbers(option: str, text: str, limit: str) -> list[float]:
    """One, or several with commas between them."""
    return [_number(option, word, limit) for word in text.split(",")]


def _counted(option: str, text: str, values: list[float], wanted: int, model: str) -> None:
    if len(values) != wanted:
        raise Error(f"{option} {text}: {len(values)} numbers, where --model {model} takes {wanted}")


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
