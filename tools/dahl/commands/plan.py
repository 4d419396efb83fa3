# SPDX-License-Identifier: MIT
"""
Prepare a plan for flash from known numbers: a header with a const dahl_plan_t, for C99 and C++11.

The words are those of dahl_prepare(), which the firmware then need not call. For linear motion read
m for rad and N for N m. A log of your own gives sigma0 and Fc by `dahl identify`.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from dahl import Error

HELP = "a plan for flash from known numbers"
EXAMPLE = """examples:
  dahl plan --sigma0 100 --fc 0.5 --counts-per-turn 16384 -o dahl_plan_shaft.h
  dahl plan --sigma0 100 --fc 0.5 --theta-per-count 3.8e-4 --name shaft -o -"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sigma0", required=True, metavar="X", help="stiffness at rest, N m/rad")
    parser.add_argument("--fc", required=True, metavar="Y", help="Coulomb torque, N m")
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
    from dahl import files, plan_header
    from dahl.core import FC, SIGMA0, Plan

    sigma0, fc = _number("--sigma0", args.sigma0, SIGMA0), _number("--fc", args.fc, FC)
    plan = Plan(sigma0, fc, _theta_per_count(args))
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


def _number(option: str, text: str, limit: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise Error(f"{option} {text}: not a number; {limit} was expected") from None


def _theta_per_count(args: argparse.Namespace) -> float:
    from dahl.core import THETA_PER_COUNT

    if args.theta_per_count is not None:
        return _number("--theta-per-count", args.theta_per_count, THETA_PER_COUNT)
    counts = _number("--counts-per-turn", args.counts_per_turn, "a number above 0")
    if not 0 < counts < math.inf:
        raise Error(f"--counts-per-turn {args.counts_per_turn}: not a finite number above 0")
    return 2 * math.pi / counts
