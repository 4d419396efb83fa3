# SPDX-License-Identifier: MIT
"""The friction node as firmware (port/cortex_m/node_image.c) on an emulated core, reachable over
TCP as slcan.

Built with the core's preset, run in QEMU, with the scene's parameters in the flash page where a
product would keep its calibration.
"""

from __future__ import annotations

import contextlib
import functools
import re
import shutil
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dahl import paths
from dahl.errors import Error, RunError

PATIENCE = 20.0  # s for QEMU to listen
TELLING = re.compile(r"^fatal: |\berror: ", re.IGNORECASE)  # a line of git, cmake or a compiler
PAGE_WRITTEN = 0x4C484144  # "DAHL", see node_image.c


def with_parent() -> list[str]:
    """In front of a command: it ends when this process does, even by SIGKILL. (util-linux has it;
    without it such an end leaves the command running.)
    """
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "TERM"] if setpriv else []


@dataclass(frozen=True)
class Board:
    """A board of QEMU, and the address of its flash page for parameters."""

    machine: str
    page: int


@functools.cache
def boards() -> dict[str, Board]:
    """Board by core, as the toolchain file and the board's linker script have it."""
    folder = paths.checkout("the firmware of --target") / "port" / "cortex_m"
    toolchain = (folder / "toolchain.cmake").read_text(encoding="utf-8")
    found = {}
    for core, machine in re.findall(r"^dahl_core\((\w+) (\S+)", toolchain, re.MULTILINE):
        script = (folder / f"{machine}.ld").read_text(encoding="utf-8")
        page = re.search(r"^param_page = (\w+);", script, re.MULTILINE)
        if page is None:
            raise RunError(f"{folder / machine}.ld: no param_page")
        found[core] = Board(machine, int(page[1], 0))
    return found


def build(core: str) -> Path:
    """Configure and build the image of one core; returns it."""
    if core not in boards():
        raise Error(f"--target {core}: one of {' '.join(boards())} was expected")
    folder = paths.ROOT / "build" / core
    for command in (
        ["cmake", "--preset", core],
        ["cmake", "--build", str(folder), "--target", "node_image"],
    ):
        try:
            done = subprocess.run(
                command, cwd=paths.ROOT, capture_output=True, text=True, check=False, timeout=300
            )
        except FileNotFoundError:
            raise RunError("cmake is not installed; tools/setup.sh installs it") from None
        if done.returncode:
            lines = (done.stderr or done.stdout).strip().splitlines() or [""]
            telling = next((line for line in lines if TELLING.search(line)), lines[-1])
            raise RunError(
                f"the image for {core} could not be built, for which tools/setup.sh firmware"
                f" brings what is needed: {telling.strip()}"
            )
    return folder / "port" / "node_image"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Firmware:
    """The image, running; `with Firmware(...) as node: can.Bus(**node.bus)`."""

    def __init__(
        self,
        core: str,
        params: tuple[float, float, float] | None,
        folder: Path,
        number: int = 0,
        timeout_us: int = 0,
        image: Path | None = None,
        options: tuple[str, ...] = (),
    ) -> None:
        """params: sigma0, Fc, theta_per_count; None leaves the page blank. timeout_us: 0 for
        the firmware's own. folder: for files. options: more words for QEMU.
        """
        self.options = options
        self.core, self.board, self.number = core, boards()[core], number
        self.image = image or build(core)
        self.page = folder / f"params.{core}.bin"
        self.page.write_bytes(
            struct.pack("<I3f2I", PAGE_WRITTEN, *params, number, timeout_us)
            if params
            else bytes(24)
        )
        self.errors = folder / f"qemu.{core}.err"

    def __enter__(self) -> Firmware:
        if not shutil.which("qemu-system-arm"):
            raise RunError("qemu-system-arm is missing; tools/setup.sh installs it")
        self.port = free_port()
        serial = f"tcp:127.0.0.1:{self.port},server=on,wait=off,nodelay=on"
        command = [*with_parent(), "qemu-system-arm", "-M", self.board.machine, "-display", "none"]
        command += ["-monitor", "none", "-serial", serial, "-kernel", str(self.image)]
        page = str(self.page).replace(",", ",,")  # as QEMU wants a comma inside of a value
        loader = f"loader,file={page},addr={self.board.page:#x},force-raw=on"
        with self.errors.open("w", encoding="utf-8") as errors:
            self.process = subprocess.Popen(
                [*command, "-device", loader, *self.options],
                stdin=subprocess.DEVNULL,
                stdout=errors,
                stderr=errors,
                start_new_session=True,
            )
        self._wait()
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def ended(self) -> bool:
        return self.process.poll() is not None

    @property
    def bus(self) -> dict[str, object]:
        """How python-can opens it."""
        return {"interface": "slcan", "channel": f"socket://127.0.0.1:{self.port}"}

    def _wait(self) -> None:
        """Until QEMU listens; a first look at the port costs it nothing."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and not self.ended():
            if f":{self.port:04X} " in _listening():
                return
            time.sleep(0.02)
        said = self.errors.read_text(encoding="utf-8").strip().splitlines()
        self.__exit__()
        raise RunError(f"QEMU did not start: {said[-1] if said else 'no word from it'}")


HUB = """; The bus of a run whose torque comes from firmware: this node serves it, never asked.
[scene]
title = a bus for the firmware
[friction]
sigma0 = 1
Fc = 1
theta_per_count = 1e-3
node = {number}
"""
STALL_US = 10000000  # QEMU's clock goes on while a busy desk computer holds frames back


def hub(folder: Path, number: int = 0) -> Path:
    """A scene whose node only serves the bus of the firmware, which has this number."""
    path = folder / "hub.ini"
    path.write_text(HUB.format(number=15 if number != 15 else 14), encoding="ascii")
    return path


@contextlib.contextmanager
def attached(
    core: str, params: tuple[float, float, float], folder: Path, port: int, number: int = 0
) -> Iterator[None]:
    """Firmware as a node of the bus that is served on `port`."""
    with Firmware(core, params, folder, number, STALL_US) as node:
        command = [
            *with_parent(),
            sys.executable,
            "-m",
            "dahl.can.bridge",
            str(node.port),
            str(port),
        ]
        with subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as bridge:
            try:
                if bridge.stdout is None or bridge.stdout.readline() != "ready\n":
                    raise RunError("the bridge from slcan to the bus did not open")
                yield
            finally:
                bridge.terminate()


def _listening() -> str:
    """Local addresses of TCP sockets in state LISTEN."""
    lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
    return " ".join(line.split()[1] for line in lines if line.split()[3] == "0A") + " "
