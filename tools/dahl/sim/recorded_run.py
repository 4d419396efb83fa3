# SPDX-License-Identifier: MIT
"""Run dahl-loop: a node and an encoder as two processes on one bus, recorded by python-can.

The latency of the encoder is then a real round trip over the bus, and the results come from the
recorded frames.
"""

from __future__ import annotations

import dataclasses
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from dahl.can.bus import VCAN, Reception, open_bus
from dahl.errors import Error, RunError, Timeout
from dahl.interrupt import Stop
from dahl.io import files
from dahl.io.candump import candump_line
from dahl.sim import program, scene
from dahl.sim.run_file import RunFile
from dahl.sim.scene import Scene

if TYPE_CHECKING:
    import can

PROGRAM_TIMEOUT_S = 5.0  # for a bus to open and for a program to end
DRAIN_S = 0.3  # after the encoder has ended, the last frames are still recorded
SERVED = re.compile(r"^socketcand [\d.]+:(\d+) ", re.MULTILINE)
MAX_SILENCE_S = 10.0  # without any frame; after it a run has failed


@dataclass
class Setup:
    """The settings of a run and the places of its files."""

    scene: Scene
    bus: str  # socketcan:IF, socketcand, socketcand:PORT
    folder: Path
    log: Path | None = None  # recorded motion that replaces that of the scene
    seconds: float | None = None
    seed: int | None = None
    node_scene: Scene | None = None  # of the node that serves the bus, if another node answers
    # starts that other node on a port
    attach: Callable[[int], AbstractContextManager[object]] | None = None
    alone: bool = False  # one process in virtual time, with the same result on each machine
    trace: bool = False  # write angle, velocity and torques of a rotor to folder/trace.csv
    lockstep: bool = False  # each count waits for the previous answer


class Program:
    """dahl-loop in one role, as a child process. Ctrl-C in a terminal does not reach it; this
    process ends it in order.
    """

    def __init__(self, setup: Setup, role: str, bus: str, *extra: str) -> None:
        self.is_ending = False  # after end()
        self.role = role
        self._facts = (bus, 1 if setup.seed is None else setup.seed, setup.alone)
        self._run = RunFile(setup.scene, setup.log, role)
        self.errors = (setup.folder / f"{role}.err").open("w", encoding="utf-8")
        options = ["--role", role, "--bus", bus, *_options(setup, role), *extra]
        streams = {"stdin": subprocess.DEVNULL, "stdout": self.errors, "stderr": self.errors}
        self.process = program.start(self._run, *options, **streams, start_new_session=True)

    def has_ended(self) -> bool:
        return self.process.poll() is not None

    def wait(self) -> bool:
        """Wait for the end of the program; return False after a timeout."""
        try:
            self.process.wait(PROGRAM_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return False
        return True

    def end(self) -> None:
        """End the program in order, by force after a timeout."""
        if not self.has_ended():
            self.is_ending = True
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(PROGRAM_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.errors.close()

    def check(self) -> None:
        """Raise the error that the program printed, if it failed."""
        code = self.process.returncode
        was_interrupted = self.is_ending and code == -signal.SIGINT  # before it handled SIGINT
        if code in (0, None) or was_interrupted:
            return
        lines = [line.strip() for line in self.output().split("\n") if line.strip()]
        words = next(
            (line.removeprefix("error: ") for line in lines if line.startswith("error: ")), ""
        )
        kind = Error if code == 2 else RunError
        ended = f"dahl-loop ({self.role}) ended with code {code}"
        raise kind(self._run.explain(words) or self._unwritable() or ended)

    def _unwritable(self) -> str:
        """Return why its messages could not be written, such as a full disk; "" if they could."""
        try:
            with Path(self.errors.name).open("a", encoding="utf-8") as errors:
                errors.write("\n")
        except OSError as error:
            return f"{self.errors.name}: {error.strerror}"
        return ""

    def output(self) -> str:
        """Return its output so far."""
        return Path(self.errors.name).read_text(encoding="utf-8", errors="replace")

    def port(self) -> int:
        """Return the TCP port that the program serves."""
        until = time.monotonic() + PROGRAM_TIMEOUT_S
        while time.monotonic() < until and not self.has_ended():
            if served := SERVED.search(self.output()):
                return int(served[1])
            time.sleep(0.02)
        self.end()
        self.check()
        raise RunError(f"dahl-loop ({self.role}) did not print the port that it serves")

    def numbers(self) -> dict[str, Any]:
        """Return its summary, {} if it did not write its counters."""
        return self._run.summary(*self._facts)


def _options(setup: Setup, role: str) -> list[str]:
    if role == "node":
        return []
    named = {"--seconds": setup.seconds, "--seed": setup.seed}
    words = [str(word) for pair in named.items() if pair[1] is not None for word in pair]
    return words + ["--lockstep"] * setup.lockstep


def _bus_names(bus: str, node: Program) -> tuple[str, dict[str, Any]]:
    """Return the bus as the encoder and as python-can name it; a server prints its port."""
    kind, _, rest = bus.partition(":")
    if kind == "socketcan":
        return bus, {"interface": "socketcan", "channel": rest}
    port = node.port()
    return f"socketcand:127.0.0.1:{port}", {
        "interface": "socketcand",
        "channel": VCAN,
        "host": "127.0.0.1",
        "port": port,
    }


def _start_server(setup: Setup) -> Program:
    """Start the program with the node, which serves the bus. If it runs alone, it waits for the
    recorder.
    """
    if setup.alone:
        trace = ["--trace", str(setup.folder / "trace.csv")] * setup.trace
        return Program(setup, "both", "socketcand:0", "--virtual", "--wait-clients", "1", *trace)
    until_idle = ["--until-idle"] * setup.bus.startswith("socketcand")
    bus = "socketcand:0" if setup.bus == "socketcand" else setup.bus
    served = dataclasses.replace(setup, scene=setup.node_scene or setup.scene)
    return Program(served, "node", bus, "--lockstep", *until_idle)


def run(setup: Setup, stop: Stop, progress: Callable[[int], None]) -> dict[str, Any]:
    """Run the scene, record it in folder/run.log, and return the numbers of all programs. `stop`
    ends the run early, in order.

    progress is called about ten times a second with the number of frames recorded so far.
    """
    node = _start_server(setup)
    encoder = node if setup.alone else None
    try:
        encoder_bus, here = _bus_names(setup.bus, node)
        with (
            open_bus(PROGRAM_TIMEOUT_S, **here) as bus,
            _open_log(setup.folder) as log,
            setup.attach(here["port"]) if setup.attach else nullcontext(),
        ):
            encoder = encoder or Program(setup, "encoder", encoder_bus)
            _record(bus, log, encoder, node, stop, progress)
    except RunError:
        if encoder is None or not (encoder.wait() or _has_dropped(node, encoder)):
            raise  # otherwise its end has closed the bus: report the recorded frames
    finally:
        started = [one for one in (node, encoder) if one]
        for one in reversed(started):
            one.end()
        for one in started:  # a program's own error says more than a lost bus
            one.check()
    return {
        **node.numbers(),
        **encoder.numbers(),
        "node": node.numbers().get("node", {}),
        "interrupted": stop.asked,
        "recorder_dropped": _has_dropped(node),
    }


def _has_dropped(server: Program, *clients: Program) -> bool:
    """End the programs. Return whether the server closed the connection of a slow recorder."""
    for one in (*clients, server):
        one.end()
    return bool(server.numbers().get("bus_counts", {}).get("dropped"))


@contextmanager
def _open_log(folder: Path) -> Iterator[IO[str]]:
    path = folder / "run.log"
    with path.open("w", buffering=1, encoding="ascii") as log, files.whole_lines(path, log):
        yield log


def run_without(part: str, setup: Setup, keys: Iterable[str], *output: str | Path) -> None:
    """Run the scene again without a part: with 0 for its keys, in virtual time, without a bus.
    `output`: the option of dahl-loop that names the file to write, and the file.
    """
    run = RunFile(scene.read(setup.scene.path, [f"{key}=0" for key in keys]), setup.log)
    options = ["--virtual", *output, *_options(setup, "both")]
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "errors": "replace"}
    with program.start(run, *options, **streams) as process:
        _, errors = process.communicate()
    if process.returncode:
        last = errors.strip().splitlines()[-1:] or [f"code {process.returncode}"]
        raise RunError(f"dahl-loop without {part}: {last[0].removeprefix('error: ')}")


def _record(
    bus: can.BusABC,
    log: IO[str],
    encoder: Program,
    node: Program,
    stop: Stop,
    progress: Callable[[int], None],
) -> None:
    """Write each frame as a whole line until the encoder has ended (and DRAIN_S has passed), or
    stop is asked.
    """
    frames, last_frame, looked, ended = 0, time.monotonic(), 0.0, None
    reception = Reception(bus, stop)
    for message in reception:
        now = time.monotonic()
        if message is not None:
            log.write(candump_line(message))
            frames += 1
            last_frame = now
        if now - looked < 0.1:
            continue
        looked = now
        progress(frames)
        ended = ended or (now if encoder.has_ended() or node.has_ended() else None)
        if ended and now - ended > DRAIN_S:
            reception.finish()
        if now - last_frame > MAX_SILENCE_S:
            raise Timeout(f"no frame on the bus for {MAX_SILENCE_S:g} s")
