# SPDX-License-Identifier: MIT
"""Write a friction element as an FMU (FMI 2.0 or 3.0, co-simulation) for Simulink, OpenModelica,
Dymola and other simulators.

Input: angle in rad, of --model loaded also load. Outputs: torque in N m with the sign of the
motion, and ratio, its fraction of the largest torque. The numbers given here are start values of
parameters, which the simulator may change. The FMU contains a shared object for this machine, a DLL
for Windows if one was built, and the C sources for any other platform. docs/simulators.md
describes its limits.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dahl.commands import model_arguments
from dahl.commands.arguments import whole
from dahl.errors import InputError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dahl.binding.models import Model
    from dahl.simulators.fmu import Fmu

HELP = "an FMU for other simulators"
EXAMPLE = """examples:
  dahl fmu --sigma0 120 --fc 1.8 -o friction.fmu
  dahl fmu --fmi 3 --sigma0 120 --fc 1.8 -o friction3.fmu
  dahl fmu --model asymmetric --sigma0 100 --fc 0.5,0.3 -o rod.fmu
  dahl fmu --model parallel --kinds dahl,slip --sigma0 100,20 --fc 0.5,1 -o seal.fmu"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from dahl.binding import models

    model_arguments.add_model(parser, models.table())
    parser.add_argument("--kinds", metavar="K,K", help="of parallel: dahl or slip for each element")
    parser.add_argument(
        "--fixed-stiffness", action="store_true", help="of loaded: sigma0 does not follow the load"
    )
    model_arguments.add_encoder(
        parser,
        False,
        "rad per count, to which the angle is rounded (default: 0, which does not round, for dahl;"
        " for the others 1e-6 of Fc/sigma0)",
    )
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="NAME.fmu", help="file to write"
    )
    parser.add_argument(
        "--fmi", type=whole(2, 3), default=2, metavar="N", help="version of FMI (default: 2)"
    )
    parser.add_argument("--name", help="of the model (default: from the file's name)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def run(args: argparse.Namespace) -> None:
    from dahl.simulators import fmu

    path: Path = args.output
    if path.suffix != ".fmu":
        raise InputError(f"-o {path}: the name of an FMU ends in .fmu")
    contents = _contents(args)
    if path.is_file() and not args.force:
        raise InputError(f"{path}: exists; --force overwrites it")
    guid = fmu.write(path, contents)
    named = f"FMI {args.fmi}.0 co-simulation, model {contents.model.name}, GUID {guid}"
    print(f"{path}: {named}, for {', '.join(fmu.platforms(args.fmi))}")


def _contents(args: argparse.Namespace) -> Fmu:
    from dahl.binding import models, plan_header
    from dahl.simulators import fmu

    model = models.table()[args.model]
    sigma0, fc = model_arguments.read_numbers(args, model)
    own = model_arguments.read_own(args, model)
    kinds = _kinds(args, model)
    _check_elements(args, model, sigma0, fc, kinds)
    if args.fixed_stiffness and model.name != "loaded":
        raise InputError(f"--fixed-stiffness: an option of --model loaded, not of {model.name}")
    theta = model_arguments.read_theta_per_count(args)
    if args.fixed_stiffness and theta is not None:
        raise InputError(
            "--fixed-stiffness: moves are by angle; leave out the option of the encoder"
        )
    if theta is None:
        theta = fmu.default_theta_per_count(model, sigma0, fc)
    models.make(model, sigma0, fc, theta, kinds or own)  # raises dahl.Error out of range
    model_arguments.note_units(sigma0, fc, theta)
    name = plan_header.identifier(args.name or args.output.stem)
    if name[0].isdigit():
        raise InputError(f"--name {name}: a letter or _ was expected at its start")
    return fmu.Fmu(name, model, sigma0, fc, theta, own, kinds, args.fixed_stiffness, args.fmi)


def _kinds(args: argparse.Namespace, model: Model) -> list[str]:
    """Return the kind of each element, none for models other than parallel."""
    from dahl.binding import models

    if (args.kinds is not None) != (model.key == "kinds"):
        raise InputError(
            f"--kinds K,K is required by --model {models.with_key('kinds').name} and refused by"
            " the others"
        )
    kinds = args.kinds.split(",") if args.kinds is not None else []
    for kind in kinds:
        if kind not in ("dahl", "slip"):
            raise InputError(f"--kinds {args.kinds}: {kind} is neither dahl nor slip")
    return kinds


def _check_elements(
    args: argparse.Namespace, model: Model, sigma0: list[float], fc: list[float], kinds: list[str]
) -> None:
    """Raise dahl.Error for another number of kinds, too many elements, or an element that is not
    valid by angle.
    """
    from dahl.binding.friction import Plan
    from dahl.binding.slip import SLIP_MAX

    if model.sigma0s == 0 and (len(kinds or fc) != len(fc) or len(fc) > SLIP_MAX):
        raise model_arguments.wrong_counts(args, sigma0, fc, *([kinds] if kinds else []))
    for k, torque in enumerate(fc):
        Plan(sigma0[min(k, len(sigma0) - 1)], torque)
