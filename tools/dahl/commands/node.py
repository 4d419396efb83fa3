# SPDX-License-Identifier: MIT
"""
Start a friction node and say how to speak to it, until Ctrl-C.

With -i it answers on that bus of python-can, in Python; without, dahl-loop serves a bus to as many
as 16 clients (--port says where); with --target it is the firmware on an emulated core, on such a
bus. Parameters are those of a scene, or --sigma0, --fc and --theta-per-count; firmware is sent the
scene's max_step, timeout_ms and [status] over the bus as it starts, waits 10 s for an angle where
the scene has no timeout_ms, and takes no scene of another model or with gain, limit or ramp_ms. At
the end it says what became of the frames.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import shlex
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.can.bus import keywords, named, tuned_for, words
from dahl.commands.arguments import seconds, whole
from dahl.commands.bus_arguments import add_bus_arguments
from dahl.errors import Error, RunError

if TYPE_CHECKING:
    import can

    from dahl.interrupt import Stop
    from dahl.sim.loop import Program
    from dahl.sim.scene import Scene

HELP = "a node to speak to, on any bus or on a served one"
EXAMPLE = """examples:
  dahl node                                 a served bus, for as many as 16 clients
  dahl node --scene tribometer-slip --port 28600
  dahl node -i socketcan -c vcan0 --sigma0 100 --fc 0.5 --theta-per-count 3.8e-4
  dahl node --target m4f"""

SCENE = "steering"
OWN = ("sigma0", "fc", "theta_per_count")
HOST = "127.0.0.1"
LISTEN = 0.25  # s for a node of the same number to answer
LOOK = 0.05  # s
DRAIN = 0.2  # s to read what had come at the end
PATIENCE = 10.0  # s for firmware to answer
SENT = {"status_period": "STATUS", "timeout": "TIMEOUT", "max_step": "STEP"}  # to firmware


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", metavar="NAME", help=f"whose node (default: {SCENE})")
    parser.add_argument("--sigma0", type=float, metavar="X", help="stiffness at rest, N m/rad")
    parser.add_argument("--fc", type=float, metavar="Y", help="Coulomb torque, N m")
    parser.add_argument(
        "--theta-per-count", type=float, metavar="T", help="rad per count of the encoder"
    )
    parser.add_argument(
        "--node", type=whole(0, 15), metavar="N", help="number, 0 to 15 (default: the scene's)"
    )
    parser.add_argument(
        "--target", metavar="CORE", help="firmware on an emulated core, such as m4f"
    )
    parser.add_argument("--seconds", type=seconds, metavar="S", help="end after S seconds")
    add_bus_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from dahl.interrupt import Stop
    from dahl.report import terminal

    console = terminal.console(soft_wrap=True)
    _check(args)
    with tempfile.TemporaryDirectory(prefix="dahl-node-") as folder, Stop(is_its_end=True) as stop:
        scene = _scene(args, Path(folder))
        args.node = scene.node if args.node is None else args.node
        begin = time.monotonic()
        serve = _on_bus if _interface(args) else _on_target if args.target else _served
        counts = serve(args, scene, Path(folder), stop, console)
        told = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
        console.print(f"ended after {time.monotonic() - begin:.1f} s: {told or 'no frame came'}")


def _interface(args: argparse.Namespace) -> str | None:
    return getattr(args, "interface", None)


def _check(args: argparse.Namespace) -> None:
    """Raise dahl.Error for options that do not go together."""
    _check_bus(args)
    given = [name for name in OWN if getattr(args, name) is not None]
    if given and (args.scene or len(given) < len(OWN)):
        names = ", ".join("--" + name.replace("_", "-") for name in OWN)
        raise Error(f"{names}: all three, or a --scene")
    if given:
        from dahl import Plan
        from dahl.binding import parameters

        parameters.need_counted(args.theta_per_count)
        Plan(args.sigma0, args.fc, args.theta_per_count)  # refuses what the node would


def _check_bus(args: argparse.Namespace) -> None:
    """Raise dahl.Error for options of a bus that is not theirs."""
    said = named(args)
    if "interface" in said:
        if args.target:
            raise Error("-i and --target: one of both; firmware has a bus of its own")
        return
    for key in said:
        if key not in ("host", "port"):
            option = " ".join(words({key: said[key]}))
            raise Error(f"{option}: of which interface? Name it with -i")
    if args.host not in (None, HOST):
        raise Error(f"--host {args.host}: it serves {HOST}; -i socketcand joins another server")


def _scene(args: argparse.Namespace, folder: Path) -> Scene:
    """That of the name, or one of the parameters given."""
    from dahl.sim import scene

    if args.sigma0 is None:
        return scene.read(scene.find(args.scene or SCENE))
    lines = f"sigma0 = {args.sigma0}\nFc = {args.fc}\ntheta_per_count = {args.theta_per_count}\n"
    path = folder / "own.ini"
    head = "[scene]\ntitle = parameters of your own\n[status]\nperiod_ms = 100\n"
    path.write_text(f"{head}[friction]\n{lines}", encoding="ascii")
    return scene.read(path)


def _say(
    console: Any, args: argparse.Namespace, scene: Scene, where: str, bus: dict[str, Any]
) -> None:
    """What there is, and how to speak to it; `bus` as dahl.bus.named() has it."""
    call = ", ".join(f"{key}={value!r}" for key, value in (keywords(bus) | tuned_for(bus)).items())
    number = f" --node {args.node}" if args.node else ""
    of = f"{scene.title}: {scene.model}, Fc {scene.Fc:g} {scene.measured.unit}"
    console.print(f"node    {args.node} {where} ({of})")
    console.print(f"open    can.Bus({call})")
    console.print(f"watch   dahl monitor {shlex.join(words(bus))}{number}")
    if bus.get("interface") == "virtual":
        console.print("note    a virtual bus is of one process: no other program reaches this node")
    console.print("Ctrl-C ends")
    sys.stdout.flush()


def _on_bus(
    args: argparse.Namespace, scene: Scene, _: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """In Python, on a bus of python-can."""
    from dataclasses import asdict

    from dahl.can.bus import open_from
    from dahl.can.node import Node, run
    from dahl.sim.scene import element, settings

    node = Node(element(scene), args.node, **settings(scene))
    with open_from(args) as bus:
        _refuse_second(bus, args.node)
        _say(console, args, scene, "in Python", named(args))
        traffic = run(bus, node, seconds=args.seconds, ended=lambda: stop.asked)
    return {**asdict(node.counts), "not sent": traffic.refused}


def _refuse_second(bus: can.BusABC, number: int) -> None:
    """Raise dahl.RunError if a node of this number sends a frame or answers a read: both would
    answer each angle, with the same id.
    """
    from dahl.can import codec
    from dahl.can.bus import receive

    with contextlib.suppress(codec.python_can().CanError, OSError):  # no other node on the bus
        bus.send(codec.pack(codec.ParamWrite(codec.Param.MODEL), number))
    own = {kind.base + number for kind in (codec.FrictionTorque, codec.ParamReply, codec.Status)}
    until = time.monotonic() + LISTEN
    while (left := until - time.monotonic()) > 0:
        message = receive(bus, left)
        if message is not None and message.arbitration_id in own and not message.is_extended_id:
            raise RunError(f"node {number} is on this bus already; --node takes another number")


def _served(
    args: argparse.Namespace, scene: Scene, folder: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """By dahl-loop, on a bus that it serves."""
    with _hub(args, scene.path, folder, args.node) as (hub, port):
        _say(console, args, scene, "of dahl-loop", _client(port))
        _wait(args, stop, [hub])
    counts: dict[str, int] = hub.numbers().get("node", {})
    return counts


def _on_target(
    args: argparse.Namespace, scene: Scene, folder: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """In firmware, on a bus that dahl-loop serves; what it has counted comes with its Status."""
    from dahl.can.bus import open_bus
    from dahl.can.codec import Param, ParamWrite
    from dahl.can.node import ask
    from dahl.sim import firmware

    if scene.model != "dahl" or scene.compensates:
        raise Error(f"--target runs model dahl alone, not the scene's ({scene.path.name})")
    image = firmware.build(args.target)
    params = (scene.sigma0, scene.Fc, scene.theta_per_count)
    other = 15 if args.node != 15 else 14  # serves the bus, and is never asked
    with (
        _hub(args, firmware.hub(folder), folder, other) as (_, port),
        firmware.attached(args.target, params, folder, port, args.node),
        open_bus(**_client(port)) as bus,
    ):
        ask(bus, ParamWrite(Param.MODEL), args.node, timeout=PATIENCE)  # it is there
        _configure(bus, args.node, scene)
        board = firmware.boards()[args.target].machine
        _say(console, args, scene, f"{image.name} on {board} in QEMU", _client(port))
        return _watch(args, stop, bus)


def _configure(bus: can.BusABC, number: int, scene: Scene) -> None:
    """Send firmware what its page of flash has no room for. Raises dahl.Error for a value that it
    does not take, or not exactly.
    """
    from dahl.can.codec import Param, ParamWrite
    from dahl.can.node import ask
    from dahl.sim.scene import settings

    for name, value in settings(scene).items():
        asked = ParamWrite.of_si(Param[SENT[name]], value)
        reply = ask(bus, asked, number, timeout=PATIENCE)
        if not math.isclose(reply.si, value):
            raise Error(f"{scene.path}: {name} = {value:g}: the firmware keeps {reply.si:g}")


def _watch(args: argparse.Namespace, stop: Stop, bus: can.BusABC) -> dict[str, int]:
    """Frames of the bus, answers and the last Status of the node, until the end."""
    from dahl.can import codec
    from dahl.can.bus import receive

    counts = {"frames": 0, "answers": 0}
    end, last = time.monotonic() + (args.seconds or math.inf), math.inf
    while time.monotonic() < last:
        message = receive(bus, LOOK)
        if last == math.inf and (stop.asked or time.monotonic() > end):
            last = time.monotonic() + DRAIN
        if message is None:
            continue
        counts["frames"] += 1
        counts["answers"] += message.arbitration_id == codec.FrictionTorque.base + args.node
        if message.arbitration_id == codec.Status.base + args.node:
            with contextlib.suppress(Error):
                counts |= _told(codec.unpack(message))
    return counts


def _told(status: Any) -> dict[str, int]:
    return {name: getattr(status, name) for name in ("lost", "corrupt", "out_of_step")}


@contextlib.contextmanager
def _hub(
    args: argparse.Namespace, scene: Path, folder: Path, number: int
) -> Iterator[tuple[Program, int]]:
    """dahl-loop's node as the server of a bus, and the port."""
    from dahl.sim.loop import Program, Setup

    hub = Program(
        Setup(scene, "socketcand", folder),
        "node",
        f"socketcand:{args.port or 0}",
        *("--set", f"friction.node={number}"),
    )
    try:
        yield hub, hub.port()
    finally:
        hub.end()
        hub.check()


def _wait(args: argparse.Namespace, stop: Stop, programs: list[Program]) -> None:
    end = time.monotonic() + (args.seconds or math.inf)
    while not stop.asked and time.monotonic() < end:
        if any(program.ended() for program in programs):
            return  # its own words come with check()
        time.sleep(LOOK)


def _client(port: int) -> dict[str, Any]:
    from dahl.can.bus import VCAN

    return {"interface": "socketcand", "channel": VCAN, "host": HOST, "port": port}
