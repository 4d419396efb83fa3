# SPDX-License-Identifier: MIT
"""Replay a measured log over a bus, record it with python-can, and show how near and how exact the
torque was.

Without a log: the tribometer set, else the cycloidal one, else (no measured log in reach) the
steering scene. With LOG: your own recording, one row per tick of 1 ms. Leaves loop.png, run.log and
summary.json in build/demo. The scenes commission, compensation and park-steer are simulated without
dahl-loop; their pictures have the names of the scenes, as commission.png.
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl import paths
from dahl.commands.arguments import DEFAULT_SEED, MAX_SEED, finite, number, seconds, whole
from dahl.errors import Error, InputError, RunError
from dahl.facts import BOARDS, PERIOD_US
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.report.traces import Trace
    from dahl.sim.recorded_run import Setup
    from dahl.sim.replay import Recorded
    from dahl.sim.scene import Scene

HELP = "replay a log over the bus, record, compare, draw"
EXAMPLE = """examples:
  dahl demo
  dahl demo --scene steering --seconds 10
  dahl demo --scene commission
  dahl demo --scene compensation
  dahl demo shaft.csv --angle angle_deg --torque torque_Nm --sigma0 120 --fc 0.8 \\
      --counts-per-turn 16384"""

PREFERRED = ("tribometer", "cycloidal")  # measured sets, best first
WITHOUT_DATA = "steering"


OWN_LOG = (  # type, name of the value, help
    ("--angle", str, "COLUMN", "angle: column by name, or by number from 1"),
    ("--torque", str, "COLUMN", "the same for the measured torque"),
    ("--time", str, "COLUMN", "the same for the time"),
    ("--sigma0", number, "X", "stiffness at rest, N m/rad (mm: N/m)"),
    ("--fc", number, "Y", "Coulomb torque, N m (mm: N)"),
    ("--counts-per-turn", number, "N", "encoder counts per turn (mm: per millimetre)"),
    ("--angle-unit", str, "UNIT", "deg, rad, counts, mm, ... (default: by the name, else deg)"),
    ("--torque-scale", finite, "K", "N m per unit of the torque (default: by its name, else 1)"),
    ("--offset", finite, "T", "N m, added to the torque of the model"),
    ("--spring", finite, "K", "N m/rad; its product with the angle is added"),
)
RUN = (
    (
        "--scene",
        str,
        "NAME",
        "a shipped scene, a scene file, commission, compensation or park-steer",
    ),
    ("--bus", str, "SPEC", "socketcan:IF or socketcand (default: the best there is)"),
    ("--target", str, "CORE", "compute the torque in firmware on an emulated core, such as m4f"),
    ("--seconds", seconds, "S", "end the motion after S seconds"),
    ("--seed", whole(0, MAX_SEED), "N", "of a scene that has random parts"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    log_help = "your own log: a table as dahl identify reads it"
    parser.add_argument("log", nargs="?", type=Path, metavar="LOG", help=log_help)
    for group, options in ((parser.add_argument_group("your own log"), OWN_LOG), (parser, RUN)):
        for name, kind, metavar, words in options:
            group.add_argument(name, type=kind, metavar=metavar, help=words)
    json_help = "print summary.json, and all other output to standard error"
    parser.add_argument("--json", action="store_true", help=json_help)
    folder, folder_help = paths.OUTPUT / "demo", "folder of the files"
    parser.add_argument(
        "-o", "--output", type=Path, default=folder, metavar="FOLDER", help=folder_help
    )


def run(args: argparse.Namespace) -> int:
    from dahl.report import run_files, simulated, terminal

    console = terminal.console(stderr=args.json, soft_wrap=True)
    play = _simulate if args.scene in simulated.SCENES else _replay
    with paths.lock_folder(args.output), run_files.track(args.output):
        numbers, wrong = play(args, console)
    if args.json:
        print(json.dumps(numbers, indent=2))
    if numbers.get("interrupted"):
        return 130
    if wrong:
        raise RunError(f"{args.output / 'summary.json'}: {'; '.join(wrong)}")
    return 0


def _simulate(args: argparse.Namespace, console: Any) -> tuple[dict[str, Any], list[str]]:
    """Simulate a scene without dahl-loop. Return its numbers; nothing can be wrong with them."""
    from dahl.io import files
    from dahl.io.candump import candump_line
    from dahl.report import run_files, simulated, terminal

    scene, folder = simulated.SCENES[args.scene], args.output
    _refuse_options(args, scene.has_seed)
    seed = DEFAULT_SEED if args.seed is None else args.seed
    with terminal.Bar(console) as bar:
        played = scene.play(seed, bar.begin)
    names = [f"{args.scene}.png", *["run.log"] * bool(played.frames), "summary.json"]
    run_files.remove_earlier(folder)
    run_files.set_aside(folder, *names)
    if played.frames:
        files.write_atomic(folder / "run.log", "".join(map(candump_line, played.frames)))
    numbers = {"scene": args.scene, **({"seed": seed} if scene.has_seed else {})}
    numbers |= {**played.numbers, **_origin(args)}
    shown = terminal.table(simulated.table(numbers, folder))
    _write_results(folder, names, numbers, played.draw, shown, console)
    return numbers, []


def _refuse_options(args: argparse.Namespace, has_seed: bool) -> None:
    """Raise dahl.Error for an option that a scene without dahl-loop does not use."""
    others = ["bus", "target", "seconds"] + ["seed"] * (not has_seed)
    given = [*_given(args), *(name for name in others if getattr(args, name) is not None)]
    if given:
        names = ", ".join("LOG" if one == "log" else _option(one) for one in given)
        raise InputError(f"--scene {args.scene} does not use {names}")


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _origin(args: argparse.Namespace) -> dict[str, str]:
    """Return the version and the command, for the summary."""
    return {"version": __version__, "command": shlex.join(["dahl", *args.words])}


def _replay(args: argparse.Namespace, console: Any) -> tuple[dict[str, Any], list[str]]:
    """Run dahl-loop and compare. Return its numbers, and why a complete run has failed."""
    from dahl.report import plots, traces

    _refuse_overwriting(args.log, args.output)
    scene, log, recorded = _choose(args, console)
    numbers, trace = _play(args, scene, log, recorded, console)
    numbers |= traces.summary(scene, trace, recorded, numbers)

    def draw(path: Path) -> None:
        plots.draw(path, scene, trace, recorded, numbers)

    names = ["loop.png", "run.log", "summary.json"]
    shown = _table(numbers, trace.not_recorded)
    _write_results(args.output, names, numbers, draw, shown, console)
    if numbers["interrupted"]:
        console.print("ended early; the files hold all frames recorded until then")
    return numbers, [] if numbers["interrupted"] else _wrong(numbers, trace.not_recorded)


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
    from dahl.io import data
    from dahl.report import run_files, simulated
    from dahl.sim import replay, scene

    if args.log:
        run_files.set_aside(args.output, "own.ini", "own.csv")
        chosen, unit = scene.write_own(_own(args), args.output / "own.ini")
        console.print(f"angle   column '{args.angle}' in {unit} (else: --angle-unit)")
        table = args.output / chosen.log
        return chosen, table, replay.read_recorded(chosen, table)
    if given := _given(args):
        raise InputError(f"only with a LOG of your own: {', '.join(map(_option, given))}")
    others = simulated.SCENES
    chosen = scene.read(scene.find(args.scene, *others)) if args.scene else _default(console)
    if not chosen.log:
        return chosen, None, None
    log = data.find_log(chosen.log, chosen.path.parent)
    _refuse_overwriting(log, args.output)
    return chosen, log, replay.read_recorded(chosen, log)


def _own(args: argparse.Namespace) -> Any:
    from dahl.binding.friction import Plan
    from dahl.io.can_logs import CAN_LOGS
    from dahl.sim.scene import OwnLog

    if not args.log.exists():
        raise InputError(f"{args.log}: no such file")
    needed = ("angle", "sigma0", "fc", "counts_per_turn")
    missing = [_option(name) for name in needed if getattr(args, name) in (None, "")]
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
    setup = _setup(args, scene, log, console)
    _forget_earlier_run(args.output, scene, log)
    numbers = _run_with_progress(setup, _expected(args, scene, recorded), console)
    if setup.alone and not numbers["interrupted"]:
        _run_without(setup)
    source = args.log or log  # a user's own log is replayed by a copy of its columns
    numbers |= {"bus": setup.bus, "log": str(source.resolve()) if source else None}
    now = datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")
    numbers |= {"date": now, **_origin(args)}
    if args.target:  # the node that serves the bus received no frame
        numbers |= {"node": {}, "target": args.target}
    return numbers, _trace(args.output / "run.log", scene)


def _run_without(setup: Setup) -> None:
    """Run again without compensation or without faults, to draw both runs."""
    from dahl.report import traces
    from dahl.sim.recorded_run import run_without

    if setup.trace and setup.scene.compensates:
        trace = setup.folder / traces.UNCOMPENSATED
        run_without("compensation", setup, ["friction.gain"], "--trace", trace)
    faults = [f"faults.{key}" for section, key in setup.scene.file.values if section == "faults"]
    if faults:
        run_without("faults", setup, faults, "--log", setup.folder / traces.FAULTLESS)


def _run_with_progress(setup: Setup, ticks: int | None, console: Any) -> dict[str, Any]:
    """Run dahl-loop with a progress bar. Return its counts; `ticks` is None if unknown."""
    from dahl.interrupt import Stop
    from dahl.report.terminal import Bar
    from dahl.sim import recorded_run

    with Stop() as stop, Bar(console) as progress:
        task = progress.add_task("ticks", total=ticks)
        numbers = recorded_run.run(
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
    from dahl.report import run_files, traces

    run_files.remove_earlier(folder, [scene.path, *([log] if log else [])])
    again = traces.UNCOMPENSATED, traces.FAULTLESS
    run_files.set_aside(folder, "summary.json", "run.log", "loop.png", "trace.csv", *again)


def _setup(args: argparse.Namespace, scene: Scene, log: Path | None, console: Any) -> Setup:
    """Choose and print bus, node and clock before any program starts."""
    from dahl.can import bus
    from dahl.sim import recorded_run

    paths.loop_program()  # raises if it is not built
    alone = bool({"faults", "rotor"} & set(scene.parts)) and not (args.bus or args.target)
    chosen, why = bus.choose(args.bus or ("socketcand" if args.target or alone else None))
    if alone:
        why = "virtual time, so that faults and rotor are the same on every machine"
    console.print(f"scene   {scene.title} ({scene.path.name})" + (f", log {log}" if log else ""))
    console.print(f"bus     {chosen.split(':')[0]}: {why}")
    setup = recorded_run.Setup(scene, chosen, args.output, log, args.seconds, args.seed)
    setup.alone, setup.trace = alone, alone and "rotor" in scene.parts
    if args.target:
        _use_target(args, scene, setup, console)
    return setup


def _use_target(args: argparse.Namespace, scene: Scene, setup: Any, console: Any) -> None:
    """Let firmware be the node; the node of dahl-loop only serves the bus."""
    from dahl.sim.scene import read
    from dahl.target import firmware

    if not setup.bus.startswith("socketcand"):
        raise InputError(f"--target goes with --bus socketcand, not {setup.bus}")
    if scene.model != "dahl" or scene.compensates or "faults" in scene.parts:
        words = "runs model dahl alone, without compensation and without faults"
        raise InputError(f"--target {words}, not the scene's ({scene.path.name})")
    image = firmware.build(args.target)
    board, _ = BOARDS[args.target]
    console.print(f"node    {image.relative_to(paths.ROOT)} on {board} in QEMU, by slcan")
    params = (scene.sigma0, scene.Fc, scene.theta_per_count)
    setup.node_scene = read(firmware.write_hub_scene(args.output, scene.node))
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
    names: list[str],
    numbers: dict[str, Any],
    draw: Callable[[Path], None],
    table: Any,
    console: Any,
) -> None:
    """Write summary and picture, and print the table and the names, the picture first. An old file
    stays until its successor is complete.
    """
    from dahl.io import files

    files.write_atomic(folder / "summary.json", json.dumps(numbers, indent=2) + "\n")
    draw(folder / names[0])
    console.print(table)
    console.print("files   " + ", ".join(str(folder / name) for name in names))


def _table(numbers: dict[str, Any], not_recorded: int) -> Any:
    from rich.table import Table

    from dahl.report import summary

    rows = dict(summary.rows(numbers)) | _special(numbers)
    if not_recorded:
        rows["errors"] = _not_compared(numbers, not_recorded)
    elif numbers["max_error_ulp_Fc"] is None:
        rows["exact torque"] = "not compared: the node answers a part of the torque"
    if numbers["r2_measured"] is None:
        rows["measurement"] = "not compared" if numbers["log"] else "no measurement here"
    table = Table(show_header=False)
    for row in rows.items():
        table.add_row(*row)
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
