# SPDX-License-Identifier: MIT
"""Run the firmware of the node (port/cortex_m/node_image.c) on an emulated core, with slcan over
TCP.

It is built with the preset of the core and runs in QEMU. The parameters are in the flash page in
which a product stores its calibration.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dahl import paths
from dahl.errors import InputError, RunError
from dahl.facts import BOARDS
from dahl.sim import scene_writer

QEMU_START_TIMEOUT_S = 20.0  # generous: a loaded machine may start QEMU slowly
ERROR_LINE = re.compile(r"^fatal: |\berror: ", re.IGNORECASE)  # of git, cmake or a compiler
PAGE_WRITTEN = 0x4C484144  # "DAHL", see node_image.c


def with_parent() -> list[str]:
    """Return the words before a command that end it with this process, even after SIGKILL.

    Without setpriv (util-linux), the command survives a SIGKILL.
    """
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "TERM"] if setpriv else []


def build(core: str) -> Path:
    folder = paths.checkout("the firmware of --target") / "build" / core
    if core not in BOARDS:
        raise InputError(f"--target {core}: one of {' '.join(BOARDS)} was expected")
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
            cause = next((line for line in lines if ERROR_LINE.search(line)), lines[-1])
            raise RunError(
                f"the image for {core} could not be built (tools/setup.sh firmware installs the"
                f" tools): {cause.strip()}"
            )
    return folder / "port" / "node_image"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Firmware:
    """A running image: `with Firmware(...) as node: can.Bus(**node.bus)`."""

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
        """Prepare the flash page and the image.

        params: sigma0, Fc, theta_per_count; None leaves the page blank. timeout_us: 0 keeps the
        default of the firmware. folder: for files. options: more arguments of QEMU.
        """
        self.options = options
        self.core, self.number = core, number
        self.machine, self.page_address = BOARDS[core]
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
        command = [*with_parent(), "qemu-system-arm", "-M", self.machine, "-display", "none"]
        command += ["-monitor", "none", "-serial", serial, "-kernel", str(self.image)]
        page = str(self.page).replace(",", ",,")  # QEMU escapes a comma in a value so
        loader = f"loader,file={page},addr={self.page_address:#x},force-raw=on"
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

    def has_ended(self) -> bool:
        return self.process.poll() is not None

    @property
    def bus(self) -> dict[str, object]:
        """The keywords of can.Bus for this node."""
        return {"interface": "slcan", "channel": f"socket://127.0.0.1:{self.port}"}

    def _wait(self) -> None:
        """Wait until QEMU listens; /proc/net/tcp shows it without a connection."""
        until = time.monotonic() + QEMU_START_TIMEOUT_S
        while time.monotonic() < until and not self.has_ended():
            if f":{self.port:04X} " in _listening_addresses():
                return
            time.sleep(0.02)
        printed = self.errors.read_text(encoding="utf-8").strip().splitlines()
        self.__exit__()
        raise RunError(f"QEMU did not start: {printed[-1] if printed else 'it printed no message'}")


STALL_TIMEOUT_US = 10_000_000  # the clock of QEMU advances while a busy host delays frames


def write_hub_scene(folder: Path, number: int = 0) -> Path:
    """Return a scene whose node only serves the bus; `number` is that of the firmware."""
    path = folder / "hub.ini"
    other = 15 if number != 15 else 14
    friction: dict[str, Any] = {"sigma0": 1, "Fc": 1, "theta_per_count": 1e-3, "node": other}
    text = scene_writer.text_of(
        {"scene": {"title": "a bus for the firmware"}, "friction": friction}
    )
    path.write_text(text, encoding="ascii")
    return path


@contextlib.contextmanager
def attach_firmware(
    core: str, params: tuple[float, float, float], folder: Path, port: int, number: int = 0
) -> Iterator[None]:
    """Run firmware as a node of the bus that is served on `port`. The bridge of python-can joins
    both.
    """
    with Firmware(core, params, folder, number, STALL_TIMEOUT_US) as node:
        command = [*with_parent(), sys.executable, "-u", "-m", "can.bridge"]
        command += ["--bus1-interface", "slcan", "--bus1-channel", str(node.bus["channel"])]
        command += ["--bus2-interface", "socketcand", "--bus2-channel", "vcan0"]
        command += ["--bus2-bus-kwargs", "host=127.0.0.1", f"port={port}", "tcp_tune=True"]
        with subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # warnings of split frames
            text=True,
            start_new_session=True,
        ) as bridge:
            try:
                if bridge.stdout is None or "Started" not in bridge.stdout.readline():
                    raise RunError("the bridge from slcan to the bus did not open")
                yield
            finally:
                bridge.terminate()


def _listening_addresses() -> str:
    """Return the local addresses of TCP sockets in state LISTEN."""
    lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
    return " ".join(line.split()[1] for line in lines if line.split()[3] == "0A") + " "
