# SPDX-License-Identifier: MIT
"""Start a friction node and print how to reach it. Stop it with Ctrl-C.

With -i it answers on a bus of python-can, in Python. Without, dahl-loop serves a bus to at most 16
clients on --port. With --target it is the firmware on an emulated core, on such a bus.

The parameters are those of a scene, or --sigma0, --fc and --theta-per-count. Firmware receives
max_step, timeout_ms and [status] over the bus when it starts. If the scene has no timeout_ms, it
waits 10 s for an angle. It refuses a scene of another model, or with gain, limit or ramp_ms. At the
end the command prints the frame counts.
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
from dahl.commands.arguments import number, seconds, whole
from dahl.commands.bus_arguments import add_bus_arguments
from dahl.commands.model_arguments import note_units_of
from dahl.errors import Error, InputError, RunError
from dahl.facts import BOARDS

if TYPE_CHECKING:
    import can

    from dahl.interrupt import Stop
    from dahl.sim.recorded_run import Program
    from dahl.sim.scene import Scene

HELP = "run a node on any bus, or on a served one"
EXAMPLE = """examples:
  dahl node                                 a served bus, for as many as 16 clients
  dahl node --scene tribometer-slip --port 28600
  dahl node -i socketcan -c vcan0 --sigma0 100 --fc 0.5 --theta-per-count 3.8e-4
  dahl node --target m4f"""

SCENE = "steering"
OWN = ("sigma0", "fc", "theta_per_count")
HOST = "127.0.0.1"
LISTEN_S = 0.25  # time for another node with the same number to answer
WAIT_PERIOD_S = 0.05
LAST_FRAMES_S = 0.2  # at the end, to read the frames that have arrived
FIRMWARE_TIMEOUT_S = 10.0  # for the first answer of firmware; QEMU may start slowly
SENT = {"status_period": "STATUS", "timeout": "TIMEOUT", "max_step": "STEP"}  # to firmware


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", metavar="NAME", help=f"scene of the node (default: {SCENE})")
    parser.add_argument("--sigma0", type=number, metavar="X", help="stiffness at rest, N m/rad")
    parser.add_argument("--fc", type=number, metavar="Y", help="Coulomb torque, N m")
    parser.add_argument(
        "--theta-per-count", type=number, metavar="T", help="rad per count of the encoder"
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
        note_units_of(scene)
        args.node = scene.node if args.node is None else args.node
        begin = time.monotonic()
        served = _run_on_target if args.target else _run_served
        serve = _run_on_bus if _interface(args) else served
        counts = serve(args, scene, Path(folder), stop, console)
        text = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
        console.print(f"ended after {time.monotonic() - begin:.1f} s: {text or 'no frame came'}")


def _interface(args: argparse.Namespace) -> str | None:
    return getattr(args, "interface", None)


def _check(args: argparse.Namespace) -> None:
    _check_bus(args)
    given = [name for name in OWN if getattr(args, name) is not None]
    if given and (args.scene or len(given) < len(OWN)):
        names = ", ".join("--" + name.replace("_", "-") for name in OWN)
        raise InputError(f"{names}: all three, or a --scene")
    if given:
        from dahl import Plan
        from dahl.binding import parameters

        parameters.need_counted(args.theta_per_count)
        Plan(args.sigma0, args.fc, args.theta_per_count)  # refuses what the node would refuse


def _check_bus(args: argparse.Namespace) -> None:
    given = named(args)
    if "interface" in given:
        if args.target:
            raise InputError("-i and --target exclude each other; firmware has its own bus")
        return
    for key in given:
        if key not in ("host", "port"):
            option = " ".join(words({key: given[key]}))
            raise InputError(f"{option}: needs an interface, -i")
    if args.host not in (None, HOST):
        raise InputError(
            f"--host {args.host}: it serves {HOST}; -i socketcand joins another server"
        )


def _scene(args: argparse.Namespace, folder: Path) -> Scene:
    from dahl.sim import scene, scene_writer

    if args.sigma0 is None:
        return scene.read(scene.find(args.scene or SCENE))
    friction = {"sigma0": args.sigma0, "Fc": args.fc, "theta_per_count": args.theta_per_count}
    sections = {"scene": {"title": "parameters of your own"}, "friction": friction}
    path = folder / "own.ini"
    path.write_text(scene_writer.text_of(sections | scene_writer.STATUS), encoding="ascii")
    return scene.read(path)


def _print_access(
    console: Any, args: argparse.Namespace, scene: Scene, where: str, bus: dict[str, Any]
) -> None:
    """Print the node and how to reach it; `bus` as dahl.bus.named() returns it."""
    call = ", ".join(f"{key}={value!r}" for key, value in (keywords(bus) | tuned_for(bus)).items())
    number = f" --node {args.node}" if args.node else ""
    of = f"{scene.title}: {scene.model}, Fc {scene.Fc:g} {scene.measured.unit}"
    console.print(f"node    {args.node} {where} ({of})")
    console.print(f"open    can.Bus({call})")
    console.print(f"watch   dahl monitor {shlex.join(words(bus))}{number}")
    if bus.get("interface") == "virtual":
        console.print(
            "note    a virtual bus exists in one process: other programs cannot reach this node"
        )
    console.print("Ctrl-C ends")
    sys.stdout.flush()


def _run_on_bus(
    args: argparse.Namespace, scene: Scene, _: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """Run the node in Python, on a bus of python-can."""
    from dataclasses import asdict

    from dahl.can.bus import open_from
    from dahl.can.node import Node, run
    from dahl.sim.scene import element, settings

    node = Node(element(scene), args.node, **settings(scene))
    with open_from(args) as bus:
        _refuse_second(bus, args.node)
        _print_access(console, args, scene, "in Python", named(args))
        traffic = run(bus, node, seconds=args.seconds, ended=lambda: stop.asked)
    return {**asdict(node.counts), "not sent": traffic.refused}


def _refuse_second(bus: can.BusABC, number: int) -> None:
    """Raise dahl.RunError if a node of this number sends a frame or answers a read: both would
    answer each angle, with the same id.
    """
    from dahl.can import codec
    from dahl.can.bus import is_gone, receive

    try:
        bus.send(codec.pack(codec.ParamWrite(codec.Param.MODEL), number))
    except (codec.python_can().CanError, OSError) as error:
        if is_gone(error):
            raise RunError(f"the bus has gone: {error}") from None  # else no other node is there
    own = {kind.base + number for kind in (codec.FrictionTorque, codec.ParamReply, codec.Status)}
    until = time.monotonic() + LISTEN_S
    while (left := until - time.monotonic()) > 0:
        message = receive(bus, left)
        if message is not None and message.arbitration_id in own and not message.is_extended_id:
            raise RunError(f"node {number} is on this bus already; --node takes another number")


def _run_served(
    args: argparse.Namespace, scene: Scene, folder: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """Run the node in dahl-loop, on a bus that it serves."""
    with _start_hub(args, scene.path, folder, args.node) as (hub, port):
        _print_access(console, args, scene, "of dahl-loop", _client(port))
        _wait(args, stop, [hub])
    counts: dict[str, int] = hub.numbers().get("node", {})
    return counts


def _run_on_target(
    args: argparse.Namespace, scene: Scene, folder: Path, stop: Stop, console: Any
) -> dict[str, int]:
    """Run the node in firmware, on a bus that dahl-loop serves. Its counts come with its Status."""
    from dahl.can.bus import open_bus
    from dahl.can.codec import Param, ParamWrite
    from dahl.can.node import ask
    from dahl.target import firmware

    if scene.model != "dahl" or scene.compensates:
        raise InputError(f"--target runs model dahl alone, not the scene's ({scene.path.name})")
    image = firmware.build(args.target)
    params = (scene.sigma0, scene.Fc, scene.theta_per_count)
    other = 15 if args.node != 15 else 14  # only serves the bus
    with (
        _start_hub(args, firmware.write_hub_scene(folder), folder, other) as (_, port),
        firmware.attach_firmware(args.target, params, folder, port, args.node),
        open_bus(**_client(port)) as bus,
    ):
        ask(
            bus, ParamWrite(Param.MODEL), args.node, timeout=FIRMWARE_TIMEOUT_S
        )  # raises if it is absent
        _configure(bus, args.node, scene)
        board = BOARDS[args.target][0]
        _print_access(console, args, scene, f"{image.name} on {board} in QEMU", _client(port))
        return _watch(args, stop, bus)


def _configure(bus: can.BusABC, number: int, scene: Scene) -> None:
    """Send firmware the settings that its flash page does not hold. Raises dahl.Error for a value
    that it refuses or rounds.
    """
    from dahl.can.codec import Param, ParamWrite
    from dahl.can.node import ask
    from dahl.sim.scene import settings

    for name, value in settings(scene).items():
        asked = ParamWrite.of_si(Param[SENT[name]], value)
        reply = ask(bus, asked, number, timeout=FIRMWARE_TIMEOUT_S)
        if not math.isclose(reply.si, value):
            raise InputError(f"{scene.path}: {name} = {value:g}: the firmware keeps {reply.si:g}")


def _watch(args: argparse.Namespace, stop: Stop, bus: can.BusABC) -> dict[str, int]:
    """Count frames and answers until the end. Return these, and the counts of the last Status."""
    from dahl.can import codec
    from dahl.can.bus import receive

    counts = {"frames": 0, "answers": 0}
    end, last = time.monotonic() + (args.seconds or math.inf), math.inf
    while time.monotonic() < last:
        message = receive(bus, WAIT_PERIOD_S)
        if last == math.inf and (stop.asked or time.monotonic() > end):
            last = time.monotonic() + LAST_FRAMES_S
        if message is None:
            continue
        counts["frames"] += 1
        counts["answers"] += message.arbitration_id == codec.FrictionTorque.base + args.node
        if message.arbitration_id == codec.Status.base + args.node:
            with contextlib.suppress(Error):
                counts |= _status_counts(codec.unpack(message))
    return counts


def _status_counts(status: Any) -> dict[str, int]:
    return {name: getattr(status, name) for name in ("lost", "corrupt", "out_of_step")}


@contextlib.contextmanager
def _start_hub(
    args: argparse.Namespace, scene: Path, folder: Path, number: int
) -> Iterator[tuple[Program, int]]:
    """Start the node of dahl-loop as the server of a bus. Return it and its port."""
    from dahl.sim.recorded_run import Program, Setup
    from dahl.sim.scene import read

    setup = Setup(read(scene, [f"friction.node={number}"]), "socketcand", folder)
    hub = Program(setup, "node", f"socketcand:{args.port or 0}")
    try:
        yield hub, hub.port()
    finally:
        hub.end()
        hub.check()


def _wait(args: argparse.Namespace, stop: Stop, programs: list[Program]) -> None:
    end = time.monotonic() + (args.seconds or math.inf)
    while not stop.asked and time.monotonic() < end:
        if any(program.has_ended() for program in programs):
            return  # check() raises its error
        time.sleep(WAIT_PERIOD_S)


def _client(port: int) -> dict[str, Any]:
    from dahl.can.bus import VCAN

    return {"interface": "socketcand", "channel": VCAN, "host": HOST, "port": port}
