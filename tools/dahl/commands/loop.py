# SPDX-License-Identifier: MIT
"""Run the actuator loop of a scene on a CAN bus: an encoder sends counts at 1 kHz, a friction node
answers each with a torque.

It resolves the scene and its log to a run file, and starts dahl-loop. `dahl-loop --help` explains
the options of the bus and the clock. Ctrl-C, SIGTERM and SIGHUP end a run early, with whole files
and exit code 0.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from dahl import paths
from dahl.errors import InputError, RunError

if TYPE_CHECKING:
    from dahl.sim.run_file import RunFile
    from dahl.sim.scene import Scene

HELP = "run the loop of a scene on a bus, in real or virtual time"
EXAMPLE = """examples:
  dahl loop --scene steering --virtual --log build/run.log --summary -
  dahl loop --scene steering --set motion.seconds=1e9 --bus socketcand:28600 --until-idle"""

PASSED = {  # options of dahl-loop with a value, which it checks
    "--bus": ("SPEC", "loopback (default), socketcan:IF, socketcand:PORT, socketcand:HOST:PORT"),
    "--nodes": ("N", "N encoders and N nodes, 1 to 16"),
    "--role": ("ROLE", "both (default), encoder or node"),
    "--seconds": ("S", "end after S seconds, or earlier with the motion"),
    "--seed": ("N", "seed of random motions and faults (default 1)"),
    "--log": ("FILE", "write each frame as candump -L does"),
    "--trace": ("FILE", "write angle, velocity and torques of the rotor as CSV"),
    "--wait-clients": ("N", "start when N clients are on the served bus"),
}
FLAGS = {
    "--virtual": "virtual time: as fast as possible; the same seed gives the same log",
    "--lockstep": "wait for each answer and each count, 2 s at most",
    "--until-idle": "end when all clients of the served bus have left",
}
OUTPUTS = ("log", "trace", "summary")
FORWARDED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
PR_SET_PDEATHSIG = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", required=True, metavar="NAME", help="scene by name or path")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="S.KEY=VALUE",
        help="override a key of the scene, e.g. friction.gain=0.9",
    )
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of the scene's log, else that of the scene"
    )
    parser.add_argument(
        "--log-file", type=Path, metavar="FILE", help="log to replay, instead of [motion] file"
    )
    for name, (value, text) in PASSED.items():
        parser.add_argument(name, metavar=value, help=text)
    for name, text in FLAGS.items():
        parser.add_argument(name, action="store_true", help=text)
    parser.add_argument(
        "--summary", metavar="FILE", help="write counts and latencies as JSON; - for stdout"
    )
    parser.add_argument(
        "--with-parent", metavar="PID", help="end when process PID, which started this one, ends"
    )


def run(args: argparse.Namespace) -> int:
    from dahl.commands.model_arguments import note_units_of
    from dahl.io import data
    from dahl.sim import scene as scenes
    from dahl.sim.run_file import RunFile

    if args.with_parent:
        _end_with_parent(args.with_parent)
    paths.loop_program()  # raises if it is not built
    scene = scenes.read(scenes.find(args.scene), args.set)
    log = args.log_file
    if scene.log and not log and args.role != "node":
        log = data.find_log(scene.log, args.data or scene.path.parent)
    _check_outputs(args, scene, log)
    note_units_of(scene)
    run_file = RunFile(scene, log, args.role or "both")
    code = _run_program(run_file, *_options(args))
    if args.summary and code != 2:
        _write_summary(args, run_file)
    return code


def _options(args: argparse.Namespace) -> Iterator[str]:
    for name in PASSED:
        value = getattr(args, name[2:].replace("-", "_"))
        if value is not None:
            yield from (name, value)
    yield from (name for name in FLAGS if getattr(args, name[2:].replace("-", "_")))


def _run_program(run_file: RunFile, *options: str) -> int:
    """Run dahl-loop, pass signals to it and its messages to stderr. Return its exit code."""
    from dahl.sim import program

    process = program.start(run_file, *options, stderr=subprocess.PIPE, errors="replace")
    with _forward_signals(process):
        assert process.stderr is not None
        for line in process.stderr:
            sys.stderr.write(run_file.explain(line))
            sys.stderr.flush()
        code = process.wait()
    return code if code >= 0 else 128 - code


@contextlib.contextmanager
def _forward_signals(process: subprocess.Popen[str]) -> Iterator[None]:
    def forward(number: int, _: FrameType | None) -> None:
        process.send_signal(number)

    before = {
        number: signal.signal(number, forward)
        for number in FORWARDED
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN  # nohup
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_with_parent(text: str) -> None:
    """Let the kernel end this process with its parent. Raises dahl.Error for another process."""
    if not text.isdecimal() or not 1 <= int(text) < 2**31:
        raise InputError(f"--with-parent {text}: not an integer from 1 to {2**31 - 1}")
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() == int(text):
        return
    with contextlib.suppress(ProcessLookupError):
        with contextlib.suppress(PermissionError):
            os.kill(int(text), 0)
        words = f"this process did not start dahl loop; {os.getppid()} did"
        raise InputError(f"--with-parent {text}: {words}")
    raise SystemExit(0)  # the parent has ended


def _check_outputs(args: argparse.Namespace, scene: Scene, log: Path | None) -> None:
    """Raise dahl.Error if an output is an input or another output."""
    known: dict[str, Path] = {"--scene": scene.path} | ({"the measured log": log} if log else {})
    for option in OUTPUTS:
        text = getattr(args, option)
        if text is None or (option == "summary" and text == "-"):
            continue
        path = Path(text)
        for name, other in known.items():
            if _is_same_file(path, other):
                raise InputError(f"--{option} {text}: that is the file of {name} {other}")
        known[f"--{option}"] = path


def _is_same_file(path: Path, other: Path) -> bool:
    if path.exists() and other.exists():
        return path.is_file() and path.samefile(other)
    return path.resolve() == other.resolve()


def _write_summary(args: argparse.Namespace, run_file: RunFile) -> None:
    found: dict[str, Any] = run_file.summary(
        args.bus or "loopback", int(args.seed or 1), args.virtual
    )
    text = json.dumps(found, indent=2) + "\n"
    if not found:
        return
    if args.summary == "-":
        sys.stdout.write(text)
        return
    try:
        Path(args.summary).write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"--summary {args.summary}: {error.strerror}") from None
