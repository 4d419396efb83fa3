# SPDX-License-Identifier: MIT
"""Prepare a plan for flash from known numbers: a header with a const dahl_plan_t, for C99 and
C++11. With --model it is the plan of another model (dahl_parts.h).

The header holds the result of dahl_prepare(), dahl_slip_prepare() ..., so that the firmware need
not call it. For linear motion read m for rad and N for N m. `dahl identify` finds sigma0 and Fc
from a log.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from dahl.commands import model_arguments
from dahl.errors import InputError

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

    model_arguments.add_model(
        parser, (name for name, row in models.table().items() if row.has_plan)
    )
    model_arguments.add_encoder(parser, True, "rad per count; 0: moves by angle only")
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
        raise InputError(f"{path}: exists and is no plan; --force overwrites it")
    files.write_atomic(path, text)
    print(f"{path}: {plan}")


def _plan(args: argparse.Namespace) -> AnyPlan:
    from typing import cast

    from dahl.binding import models

    model = models.table()[args.model]
    sigma0, fc = model_arguments.read_numbers(args, model)
    theta = cast(float, model_arguments.read_theta_per_count(args))
    own = model_arguments.read_own(args, model)
    plan = cast("AnyPlan", models.make(model, sigma0, fc, theta, own))
    model_arguments.note_units(sigma0, fc, theta)
    return plan
