# SPDX-License-Identifier: MIT
"""Draw a recorded run: torque over angle, then over time.

RUN is a folder of `dahl demo`, whose summary.json names the scene, or a log of frames (candump
.log, .asc, .blf, .trc, .mf4) with --scene. If several buses of the log have frames of the node, -c
selects one. The picture is loop.png next to the log, or the file of -o. The scenes commission,
compensation and park-steer are simulated again; their pictures have the names of the scenes.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.commands.arguments import DEFAULT_SEED, MAX_SEED
from dahl.errors import Error, InputError, RunError, meant

if TYPE_CHECKING:
    from dahl.report.traces import Trace
    from dahl.sim.replay import Recorded
    from dahl.sim.scene import Scene

HELP = "draw a recorded run"
EXAMPLE = """examples:
  dahl plot build/demo
  dahl plot run.log --scene steering -o steering.png"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run_path", type=Path, metavar="RUN", help="folder of a run, or a log of frames"
    )
    parser.add_argument("--scene", help="scene (name or file) whose parameters the run had")
    parser.add_argument(
        "-c",
        "--channel",
        metavar="BUS",
        help="of a log that holds several, such as can0; of an .asc, 0 for its channel 1",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="picture to write: .png, .svg, .pdf"
    )


def run(args: argparse.Namespace) -> None:
    from dahl.report import plots, run_files, simulated, traces
    from dahl.sim import scene

    if args.output and args.output.suffix.lower() not in plots.PICTURES:
        endings = ", ".join(plots.PICTURES[:-1])
        raise InputError(f"-o {args.output}: no picture is written so ({endings})")
    is_folder = args.run_path.is_dir()
    folder = args.run_path if is_folder else args.run_path.parent
    log = folder / "run.log" if is_folder else args.run_path
    known = _summary_of(folder, log)
    is_simulated = simulated.is_simulated(known)
    if is_simulated and is_folder and not args.scene:
        _draw_simulated(folder, args.output, known)
        return
    known = {} if is_simulated else known
    if not log.is_file():
        hint = "; `dahl demo` leaves one" if is_folder else ""
        raise InputError(f"{log}: no such file{hint}")
    own = _scene_of(known, folder)
    if not (args.scene or own):
        raise InputError(f"{log}: which parameters did this run have? Name its scene with --scene")
    played = scene.read(scene.find(args.scene or str(own)))
    trace = _trace(log, played.node, args.channel)
    is_own = own is not None and own.exists() and played.path.samefile(own)
    recorded = _recorded(played, known.get("log") if is_own else None)
    if recorded is not None and (ticks := int(trace.row.max()) + 1) > recorded.rows:
        raise InputError(
            f"{log}: {ticks} ticks, but {played.log} has {recorded.rows} rows: another run?"
        )
    output = args.output or folder / "loop.png"
    known |= traces.fit(played, trace, recorded)  # that of the summary may be of another scene
    plots.draw(output, played, trace, recorded, known, folder)
    run_files.add(output)
    print(f"{output}: {len(trace.row)} ticks, {played.title}")


def _summary_of(folder: Path, log: Path) -> dict[str, Any]:
    """Return the summary in a folder; {} if there is none, or if it is not of this log."""
    from dahl.report import summary

    run_log = folder / "run.log"
    is_other = log.exists() and not (run_log.exists() and log.samefile(run_log))
    return {} if is_other or not (folder / "summary.json").exists() else summary.read(folder)


def _draw_simulated(folder: Path, output: Path | None, known: dict[str, Any]) -> None:
    """Simulate such a scene again with the seed of its summary, and draw it."""
    from dahl.report import run_files, simulated, terminal

    name, seed = known["scene"], known.get("seed", DEFAULT_SEED)
    if not isinstance(seed, int) or not 0 <= seed <= MAX_SEED:
        place = folder / "summary.json"
        raise InputError(f"{place}: seed = {seed}: a number from 0 to 2^64 - 1 was expected")
    with terminal.Bar(terminal.console(stderr=True), leaves_nothing=True) as bar:
        played = simulated.SCENES[name].play(seed, bar.begin)
    output = output or folder / f"{name}.png"
    played.draw(output)
    run_files.add(output)
    print(f"{output}: scene {name}, simulated again")


def _trace(log: Path, node: int, channel: str | None) -> Trace:
    """Return the ticks of a node on one bus of a log. Raises dahl.Error if several buses have such
    ticks, or if there is no bus of that name.
    """
    from dahl.io import can_logs
    from dahl.report import traces

    pairing, buses, notes = traces.Pairing(node), set(), list[str]()
    for frame in can_logs.frames_of(log, notes):
        buses |= set() if frame.channel is None else {str(frame.channel)}  # of an error frame
        if channel in (None, str(frame.channel)):
            pairing.feed(frame)
    if channel is not None and channel not in buses:
        raise InputError(f"{log}: no bus '{channel}'{meant(channel, sorted(buses))}")
    if len(pairing.channels) > 1:
        raise InputError(
            f"{log}: frames of {', '.join(sorted(pairing.channels))}; name one with -c"
        )
    trace = can_logs.with_notes(notes, pairing.trace)
    for note in notes:
        print(note)
    return trace


def _scene_of(known: dict[str, Any], folder: Path) -> Path | None:
    """Return the scene of the run; if it was moved, the scene in the folder of the run."""
    if "scene_file" not in known:
        return None
    path = Path(known["scene_file"])
    beside = folder / path.name
    return beside if beside.is_file() and not path.is_file() else path


def _recorded(played: Scene, log: str | None) -> Recorded | None:
    """Return the measurement: from the log of the run, else from that of the scene."""
    from dahl.io import data
    from dahl.sim import replay

    if not played.log:
        return None
    try:
        path = data.find_log(played.log, played.path.parent)
    except (Error, RunError):
        if log is None:
            raise
        path = Path(log)
    return replay.read_recorded(played, path)
