# SPDX-License-Identifier: MIT
"""Replay a measured log over a bus, record it with python-can, and show how near and how exact the
torque was.

Without a log: the tribometer set, else the cycloidal one, else (no measured log in reach) the
steering scene. With LOG: your own recording, one row per tick of 1 ms. Leaves loop.png, run.log and
summary.json in build/demo.
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl import paths
from dahl.commands.arguments import finite, number, seconds, whole
from dahl.errors import Error, InputError, RunError
from dahl.facts import BOARDS, PERIOD_US
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.report.traces import Trace
    from dahl.sim.loop import Setup
    from dahl.sim.scene import Recorded, Scene

HELP = "replay a log over the bus, record, compare, draw"
EXAMPLE = """examples:
  dahl demo
  dahl demo --scene steering --seconds 10
  dahl demo --scene compensation
  dahl demo shaft.csv --angle angle_deg --torque torque_Nm --sigma0 120 --fc 0.8 \\
      --counts-per-turn 16384"""

PREFERRED = ("tribometer", "cycloidal")  # measured sets, best first
WITHOUT_DATA = "steering"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log",
        nargs="?",
        type=Path,
        metavar="LOG",
        help="your own log: a table as dahl identify reads it",
    )
    _add_own(parser.add_argument_group("your own log"))
    _add_run(parser)


def _add_own(own: argparse._ActionsContainer) -> None:
    """Add the options that describe a user's own log and the model to compare it with."""
    own.add_argument("--angle", metavar="COLUMN", help="angle: column by name, or by number from 1")
    own.add_argument("--torque", metavar="COLUMN", help="the same for the measured torque")
    own.add_argument("--time", metavar="COLUMN", help="the same for the time")
    own.add_argument(
        "--sigma0", type=number, metavar="X", help="stiffness at rest, N m/rad (mm: N/m)"
    )
    own.add_argument("--fc", type=number, metavar="Y", help="Coulomb torque, N m (mm: N)")
    own.add_argument(
        "--counts-per-turn",
        type=number,
        metavar="N",
        help="encoder counts per turn (mm: per millimetre)",
    )
    own.add_argument(
        "--angle-unit",
        metavar="UNIT",
        help="deg, rad, mrad, turn, counts, m, mm, ... (default: that of the name, else deg)",
    )
    own.add_argument(
        "--torque-scale",
        type=finite,
        metavar="K",
        help="N m per unit of the torque column (default: that of its name, else 1)",
    )
    own.add_argument(
        "--offset", type=finite, metavar="T", help="N m, added to the torque of the model"
    )
    own.add_argument(
        "--spring", type=finite, metavar="K", help="N m/rad; its product with the angle is added"
    )


def _add_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help="a shipped scene, the path of a scene file, compensation (laws compared, no bus) or"
        " park-steer (a power steering, two nodes)",
    )
    parser.add_argument(
        "--bus", metavar="SPEC", help="socketcan:IF or socketcand (default: the best there is)"
    )
    parser.add_argument(
        "--target",
        metavar="CORE",
        help="compute the torque in firmware on an emulated core, such as m4f",
    )
    parser.add_argument(
        "--seconds", type=seconds, metavar="S", help="end the motion after S seconds"
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**64 - 1), metavar="N", help="of a scene that has random parts"
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print summary.json, and all other output to standard error",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=paths.OUTPUT / "demo",
        metavar="FOLDER",
        help="folder of the files",
    )


def run(args: argparse.Namespace) -> int:
    from dahl.commands import compare_laws, park_steer
    from dahl.report import run_files, terminal

    console = terminal.console(stderr=args.json, soft_wrap=True)
    with paths.lock_folder(args.output), run_files.track(args.output):
        if args.scene == compare_laws.SCENE:
            return compare_laws.run(args, console)
        if args.scene == park_steer.SCENE:
            return park_steer.run(args, console)
        _refuse_overwriting(args.log, args.output)
        scene, log, recorded = _choose(args, console)
        numbers, trace = _play(args, scene, log, recorded, console)
        _write_results(args.output, scene, trace, recorded, numbers, console)
    if args.json:
        print(json.dumps(numbers, indent=2))
    if numbers["interrupted"]:
        return 130
    wrong = _wrong(numbers, trace.not_recorded)
    if wrong:
        raise RunError(f"{args.output / 'summary.json'}: {'; '.join(wrong)}")
    return 0


def _refuse_overwriting(log: Path | None, folder: Path) -> None:
    """Raise dahl.Error if this run would write over the log that it reads."""
    from dahl.report import run_files

    if log and log.exists() and any(map(log.samefile, run_files.written_in(folder))):
        raise InputError(f"{log}: a run in {folder} would overwrite it; choose another -o")


def _wrong(numbers: dict[str, Any], not_recorded: int) -> list[str]:
    """Return why a complete run has failed; `not_recorded` counts frames of the bus."""
    from dahl.report import traces

    wrong = []
    error = numbers["max_error_ulp_Fc"]
    bound = traces.BOUND_ULP if numbers["model"] == "dahl" else traces.BOUND_ULP_PARTS
    if error is not None and error > bound:
        wrong.append(f"error of {error:.3f} ulp of Fc, above the bound of {bound:g}")
    if "faults" in numbers:
        counted = traces.disagreements(numbers)
        wrong += [f"faults counted, due: {counted}"] if counted else []
    elif numbers.get("frames_lost"):
        wrong.append(f"{numbers['frames_lost']} frames had no answer in time (a busy machine?)")
    if not_recorded:
        wrong.append(_not_compared(numbers, not_recorded))
    elif "faults" not in numbers and numbers["frames_not_recorded"]:
        wrong.append(f"{numbers['frames_not_recorded']} frames were not on the bus")
    return wrong


def _not_compared(numbers: dict[str, Any], not_recorded: int) -> str:
    why = ": the recorder read too slowly" * bool(numbers.get("recorder_dropped"))
    return f"not compared: at least {not_recorded} frames were not recorded{why}"


def _choose(args: argparse.Namespace, console: Any) -> tuple[Scene, Path | None, Recorded | None]:
    """Return scene, log and recording, checked before any program starts."""
    from dahl.commands import compare_laws, park_steer
    from dahl.io import data
    from dahl.report import run_files
    from dahl.sim import scene

    if args.log:
        run_files.set_aside(args.output, "own.ini", "own.csv")
        chosen, unit = scene.write_own(_own(args), args.output / "own.ini")
        console.print(f"angle   column '{args.angle}' in {unit} (else: --angle-unit)")
        table = args.output / chosen.log
        return chosen, table, scene.read_log(chosen, table)
    given = ["--" + name.replace("_", "-") for name in _given(args) if name != "log"]
    if given:
        raise InputError(f"only with a LOG of your own: {', '.join(given)}")
    others = compare_laws.SCENE, park_steer.SCENE
    chosen = scene.read(scene.find(args.scene, *others)) if args.scene else _default(console)
    if not chosen.log:
        return chosen, None, None
    log = data.find_log(chosen.log, chosen.path.parent)
    _refuse_overwriting(log, args.output)
    return chosen, log, scene.read_log(chosen, log)


def _own(args: argparse.Namespace) -> Any:
    from dahl.binding.friction import Plan
    from dahl.io.can_logs import CAN_LOGS
    from dahl.sim.scene import OwnLog

    if not args.log.exists():
        raise InputError(f"{args.log}: no such file")
    needed = ("angle", "sigma0", "fc", "counts_per_turn")
    missing = [
        "--" + name.replace("_", "-") for name in needed if getattr(args, name) in (None, "")
    ]
    if missing or args.scene:
        raise InputError(
            f"{args.log}: a log of your own needs {', '.join(missing)}"
            if missing
            else "--scene with a LOG: one of both"
        )
    if args.log.suffix.lower() in CAN_LOGS:
        raise InputError(
            f"{args.log}: a table was expected; dahl identify --dbc makes a scene of it"
        )
    Plan(args.sigma0, args.fc)  # names a parameter that is out of range
    return OwnLog(**_given(args))


def _given(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a user's own log that are given."""
    from dahl.sim.scene import OwnLog

    given = {key: getattr(args, key) for key in OwnLog.__dataclass_fields__}
    return {key: value for key, value in given.items() if value is not None}


def _default(console: Any) -> Scene:
    """Return the scene of the first available measured set, else a scene without one."""
    from dahl.io import data
    from dahl.sim import scene

    for name in PREFERRED:
        try:
            data.folder(name)
            return scene.read(scene.find(name))
        except Error as error:
            console.print(f"measured set {name}: {error}")
    console.print(
        f"no measured log was found, so this runs the scene '{WITHOUT_DATA}',"
        " without any comparison with a measurement"
    )
    return scene.read(scene.find(WITHOUT_DATA))


def _play(
    args: argparse.Namespace,
    scene: Scene,
    log: Path | None,
    recorded: Recorded | None,
    console: Any,
) -> tuple[dict[str, Any], Trace]:
    """Run and record. Return the counts of dahl-loop and the trace, read back from run.log."""
    from dahl.report import traces
    from dahl.sim import loop

    setup = _setup(args, scene, log, console)
    _forget_earlier_run(args.output, scene, log)
    numbers = _run_with_progress(setup, _expected(args, scene, recorded), console)
    if setup.trace and scene.compensates and not numbers["interrupted"]:
        loop.run_uncompensated(setup, args.output / traces.UNCOMPENSATED)
    source = args.log or log  # a user's own log is replayed by a copy of its columns
    numbers |= {"bus": setup.bus, "log": str(source.resolve()) if source else None}
    now = datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")
    numbers |= {"date": now, "version": __version__, "command": shlex.join(["dahl", *args.words])}
    if args.target:  # the node that serves the bus received no frame
        numbers |= {"node": {}, "target": args.target}
    return numbers, _trace(args.output / "run.log", scene)


def _run_with_progress(setup: Setup, ticks: int | None, console: Any) -> dict[str, Any]:
    """Run dahl-loop with a progress bar. Return its counts; `ticks` is None if unknown."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    from dahl.interrupt import Stop
    from dahl.sim import loop

    columns = (
        TextColumn("run    "),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.completed:.0f} ticks"),
        TimeElapsedColumn(),
    )
    with Stop() as stop, Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=ticks)
        numbers = loop.run(
            setup,
            stop,
            lambda frames: progress.update(task, completed=min(frames // 2, ticks or frames)),
        )
        done = numbers.get("ticks", 0)
        progress.update(task, completed=done, total=ticks if numbers["interrupted"] else done)
    return numbers


def _trace(log: Path, scene: Scene) -> Trace:
    """Return the answered ticks of the run. Raises RunError if no tick was recorded."""
    from dahl.io import can_logs
    from dahl.report import traces

    try:
        return traces.trace_of(can_logs.read_candump(log), scene.node)
    except Error as error:
        raise RunError(f"not compared: {error}") from None


def _forget_earlier_run(folder: Path, scene: Scene, log: Path | None) -> None:
    """Remove the files of an earlier run, also of another scene, except those that this run reads.
    Other files of the names that it writes are renamed in any case, since this run may fail.
    """
    from dahl.report import run_files

    run_files.remove_earlier(folder, [scene.path, *([log] if log else [])])
    traces = "trace.csv", "uncompensated.csv"
    run_files.set_aside(folder, "summary.json", "run.log", "loop.png", *traces)


def _setup(args: argparse.Namespace, scene: Scene, log: Path | None, console: Any) -> Setup:
    """Choose and print bus, node and clock before any program starts."""
    from dahl.can import bus
    from dahl.sim import loop

    paths.loop_program()  # raises if it is not built
    alone = bool({"faults", "rotor"} & set(scene.parts)) and not (args.bus or args.target)
    chosen, why = bus.choose(args.bus or ("socketcand" if args.target or alone else None))
    if alone:
        why = "virtual time, so that faults and rotor are the same on every machine"
    console.print(f"scene   {scene.title} ({scene.path.name})" + (f", log {log}" if log else ""))
    console.print(f"bus     {chosen.split(':')[0]}: {why}")
    setup = loop.Setup(scene.path, chosen, args.output, log, args.seconds, args.seed)
    setup.alone, setup.trace = alone, alone and "rotor" in scene.parts
    if args.target:
        _use_target(args, scene, setup, console)
    return setup


def _use_target(args: argparse.Namespace, scene: Scene, setup: Any, console: Any) -> None:
    """Let firmware be the node; the node of dahl-loop only serves the bus."""
    from dahl.sim import firmware

    if not setup.bus.startswith("socketcand"):
        raise InputError(f"--target goes with --bus socketcand, not {setup.bus}")
    if scene.model != "dahl" or scene.compensates or "faults" in scene.parts:
        words = "runs model dahl alone, without compensation and without faults"
        raise InputError(f"--target {words}, not the scene's ({scene.path.name})")
    image = firmware.build(args.target)
    board, _ = BOARDS[args.target]
    console.print(f"node    {image.relative_to(paths.ROOT)} on {board} in QEMU, by slcan")
    params = (scene.sigma0, scene.Fc, scene.theta_per_count)
    setup.node_scene = firmware.write_hub_scene(args.output, scene.node)
    setup.lockstep = True  # an emulated core may answer fewer than 1000 angles a second
    setup.attach = lambda port: firmware.attach_firmware(
        args.target, params, args.output, port, scene.node
    )


def _expected(args: argparse.Namespace, scene: Scene, recorded: Recorded | None) -> int | None:
    """Return the number of ticks of the run, or None if it is unknown."""
    known = [args.seconds, scene.seconds]
    per_second = 1e6 / PERIOD_US
    ticks = [int(seconds * per_second) for seconds in known if seconds and math.isfinite(seconds)]
    return min(ticks + ([recorded.rows] if recorded else []), default=None)


def _write_results(
    folder: Path,
    scene: Scene,
    trace: Trace,
    recorded: Recorded | None,
    numbers: dict[str, Any],
    console: Any,
) -> None:
    """Write summary and picture, and print the table. An old file stays until its successor is
    complete."""
    from dahl.io import files
    from dahl.report import plots, traces

    numbers |= traces.summary(scene, trace, recorded, numbers)
    files.write_atomic(folder / "summary.json", json.dumps(numbers, indent=2) + "\n")
    plots.draw(folder / "loop.png", scene, trace, recorded, numbers)
    console.print(_table(numbers, scene, trace.not_recorded))
    console.print(
        "files   "
        + ", ".join(str(folder / name) for name in ("loop.png", "run.log", "summary.json"))
    )
    if numbers["interrupted"]:
        console.print("ended early; the files hold all frames recorded until then")


def _table(numbers: dict[str, Any], scene: Scene, not_recorded: int) -> Any:
    from rich.table import Table

    from dahl.report import traces

    latency, late = numbers.get("latency_us") or {}, traces.format_late(numbers)
    error = numbers["max_error_ulp_Fc"]
    rows = {
        "bus": numbers["bus"],
        "ticks": numbers.get("ticks"),
        "frames sent, unanswered": f"{numbers.get('frames_sent')}, {numbers.get('frames_lost')}",
        "latency": ", ".join(f"{key} {value:.0f} µs" for key, value in latency.items())
        or "none: virtual time stands still between a count and its answer",
        **{f"{name} later than a period": text for name, text in late.items()},
        "error against the exact torque": "not compared: the node answers a part of the torque"
        if error is None
        else f"{error:.3f} ulp of Fc at most",
        "error against the measurement": "no measurement here",
    }
    if not_recorded:
        for name in ("exact torque", "measurement"):
            rows[f"error against the {name}"] = _not_compared(numbers, not_recorded)
    if numbers["r2_measured"] is not None:
        rows["error against the measurement"] = (
            f"rms {numbers['rmse_measured']:.4g} {scene.measured.unit},"
            f" R² {numbers['r2_measured']:.4f} (from row {numbers['compared_from_row']} on)"
        )
    rows |= _special(numbers)
    table = Table(show_header=False)
    for name, value in rows.items():
        table.add_row(name, str(value))
    return table


def _special(numbers: dict[str, Any]) -> dict[str, str]:
    from dahl.report import traces

    rows = {}
    if "faults" in numbers:
        injected = numbers["faults"]["injected"]
        rows["faults"] = ", ".join(f"{traces.words(key)} {n}" for key, n in injected.items() if n)
        wrong = {traces.words(key): pair for key, pair in traces.disagreements(numbers).items()}
        rows["faults counted by the node"] = "all, to the last one" if not wrong else str(wrong)
    if "control" in numbers:
        control = numbers["control"]
        rows["tracking error"] = (
            f"rms {control['rms_error_rad']:.3g} rad, max {control['max_error_rad']:.3g} rad"
        )
        rows["sign of the torque"] = (
            f"changed {control['torque_alternations']} times,"
            f" the motion {control['reference_reversals']} times"
        )
    return rows
