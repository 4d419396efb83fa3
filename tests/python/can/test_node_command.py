# SPDX-License-Identifier: MIT
"""`dahl node` prints lines that open its bus and runs the node of the scene or of the options."""

import contextlib
import errno
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial

import can
import pytest
from bus_frames import bus_of
from dahl import Friction, Node, Plan, RunError, codec, node
from dahl.codec import EncoderState, Param, ParamWrite
from identify_tools import complaint
from loop_tools import SCENES, client, serving, wait_until
from test_node import MODELS, THETA

OWN = ("--sigma0", "100.0625", "--fc", "12.500004768371582", "--theta-per-count", "3.8e-4")
PLAN = Plan(100.0625, 12.500004768371582, 3.8e-4)  # more digits than are shown
OWN_SCENE = "[friction]\nsigma0 = 100.0625\nFc = 12.500004768371582\ntheta_per_count = 3.8e-4\n"
TIMING = ("f_clock=8000000", "brp=2", "tseg1=5", "tseg2=2", "sjw=2", "nof_samples=1")


@contextlib.contextmanager
def started(root, *words: str) -> Iterator[tuple[list[str], list[str]]]:
    command = [sys.executable, "-m", "dahl", "node", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=root, **pipes)
    last: list[str] = []
    try:
        lines = []
        while not lines or lines[-1] not in ("Ctrl-C ends\n", ""):
            lines.append(process.stdout.readline())
        yield lines, last
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, err) == (0, "")
        last += out.splitlines()
    finally:
        process.kill()
        process.communicate()


def opened(lines: list[str]) -> can.BusABC:
    (call,) = [line.removeprefix("open    ") for line in lines if line.startswith("open    ")]
    return eval(call, {"can": can})


def asked(bus: can.BusABC, number: int = 0) -> None:
    bearing = Friction(PLAN)
    for counter, (count, move) in enumerate([(0, 0), (9, 9), (40, 31), (-7, -47)]):
        answer = node.ask(bus, EncoderState(count, counter), number, timeout=60)
        assert answer.torque_q30 == bearing.step_counts_q30(move)
    reply = node.ask(bus, ParamWrite(Param.FC), number, timeout=60)
    assert reply.si == PLAN.Fc


def counted(last: list[str]) -> dict[str, int]:
    return {name: int(count) for name, count in re.findall(r"(\w+) (\d+)(?:,|$)", last[-1])}


# --- as a program ---------------------------------------------------------------------------------


def test_the_printed_line_opens_the_bus_of_the_node(root, tmp_path):
    """A second server has a node of another number."""
    hub = ("--role", "node", "--set", "friction.node=9")
    with (
        serving(tmp_path, SCENES / "segments.ini", *hub) as (_, port),
        started(root, *OWN, "--node", "3", *bus_of(port)) as (lines, last),
    ):
        assert "Fc 12.5 N m" in lines[0]
        with opened(lines) as bus:
            asked(bus, 3)
            assert node.ask(bus, ParamWrite(Param.STATUS), 3, timeout=60).si == 0.1
    counts = counted(last)
    assert (counts["ok"], counts["params"]) == (4, 2) and re.search(r" \d+\.\d s", last[-1])


@pytest.mark.parametrize(("words", "number"), [((), 3), (("--node", "0"), 0)])
def test_a_served_node_has_the_number_of_the_option_or_else_of_the_scene(
    root, tmp_path, words, number
):
    """--port selects the port. A bound socket that does not listen reserves it."""
    (path := tmp_path / "own.ini").write_text(f"{OWN_SCENE}node = 3\n")
    with socket.socket() as reserved:
        reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        reserved.bind(("127.0.0.1", 0))
        port = str(reserved.getsockname()[1])
        words = ("--scene", str(path), "--port", port, *words)
        with started(root, *words) as (lines, _), opened(lines) as bus:
            asked(bus, number)
    assert lines[0].startswith(f"node    {number} ") and f"port={port}" in lines[1]
    assert lines[2].endswith(f" --node {number}\n") or number == 0


# --- the node of a scene, in this process ---------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_the_node_has_the_model_and_settings_of_its_scene(dahl, tmp_path, model):
    lines, friction = MODELS[model]
    words = f"[friction]\n{lines}theta_per_count = {THETA}\n"
    kept = "gain = 0.5\nlimit = 0.25\nramp_ms = 300\nmax_step = 700\ntimeout_ms = 9000\n"
    (tmp_path / "own.ini").write_text(f"{words}{kept}[status]\nperiod_ms = 40\n")
    found: dict[Param, codec.ParamReply] = {}

    def ask() -> None:
        with can.Bus(interface="virtual", channel=model) as bus:
            while bus.recv(60).arbitration_id != codec.Status.base:
                pass
            for param in Param:
                found[param] = node.ask(bus, ParamWrite(param), timeout=60)
        os.kill(os.getpid(), signal.SIGINT)

    client = threading.Thread(target=ask)
    client.start()
    done = dahl("node", "--scene", "own.ini", "-i", "virtual", "-c", model, "--seconds", 120)
    client.join()
    assert done.returncode == 0, done.stderr
    settings = {"gain": 0.5, "limit": 0.25, "ramp": 0.3, "max_step": 700, "timeout": 9}
    alike = Node(friction, **settings, status_period=0.04)
    for param in Param:
        reply = codec.unpack(alike.receive(codec.pack(ParamWrite(param))))
        assert found[param] == reply, param


# --- the bus --------------------------------------------------------------------------------------


@pytest.mark.parametrize("status", [(), ("--set", "status.period_ms=1000")])
def test_a_second_node_of_the_same_number_is_refused(tmp_path, dahl, status):
    """Clients would get two answers with one identifier. The first node sends no Status or rarely,
    and has had no angle, but it answers a read.
    """
    hub = ("--role", "node", "--set", "friction.node=3", *status)
    (scene := tmp_path / "own.ini").write_text(OWN_SCENE)
    with serving(tmp_path / "loop", scene, *hub) as (_, port):
        with client(port) as bus:  # the Status after power-on is over
            node.ask(bus, ParamWrite(Param.MODEL), 3, timeout=60)
        done = dahl("node", *OWN, *bus_of(port), "--node", "3", "--seconds", "0.1")
        code, said = complaint(done)
        assert (code, done.stdout) == (1, "") and "3" in said and "--node" in said
        other = dahl("node", *OWN, *bus_of(port), "--node", "4", "--seconds", "0.1")
        assert other.returncode == 0 and other.stdout.startswith("node    4 ")


def test_the_printed_lines_name_the_same_bus(dahl):
    words = ("-i", "virtual", "-c", "a rig", "-b", "500000", "--fd", "--data-bitrate", "2000000")
    words += ("--timing", *TIMING, "--bus-kwargs", "preserve_timestamps=True", "rx_queue_size=7")
    done = dahl("node", *OWN, *words, "--node", "3", "--seconds", "0.05")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines(keepends=True)
    assert lines[-1].startswith("ended after 0.") and not counted(lines)
    assert any(line.startswith("note ") for line in lines)  # that python-can's bus stays in here
    with opened(lines) as bus:
        assert (bus.channel_id, bus.preserve_timestamps, bus.queue.maxsize) == ("a rig", True, 7)
    (watch,) = [shlex.split(line)[2:] for line in lines if line.startswith("watch ")]
    for k, word in enumerate(words):
        name = {"-i": "--interface", "-c": "--channel", "-b": "--bitrate"}.get(word, word)
        assert {word, name} & {*watch}, word
        assert k == 0 or words[k - 1][0] != "-" or watch[watch.index(word) - 1][0] == "-"
    assert watch[-2:] == ["--node", "3"]
    silent = dahl(
        "monitor", *watch[1:], "--seconds", "0.05"
    )  # it opens the bus and receives no frame
    assert silent.returncode == 1 and "a rig" in complaint(silent)[1]


def test_a_node_alone_on_its_bus_runs_and_counts_what_the_bus_refuses(dahl, monkeypatch):
    def refuse(*_: object) -> None:
        raise can.CanOperationError("nobody acknowledges")

    monkeypatch.setattr(can.interfaces.virtual.VirtualBus, "send", refuse)
    done = dahl("node", *OWN, "-i", "virtual", "-c", "alone", "--seconds", "0.05")
    assert (done.returncode, done.stderr) == (0, "")
    assert counted(done.stdout.splitlines())["sent"] >= 1  # not sent


@pytest.mark.parametrize("good", [0, 1, 3])
@pytest.mark.parametrize("code", [errno.ENETDOWN, errno.ENODEV, errno.ENXIO])
def test_a_node_whose_interface_goes_down_ends(dahl, monkeypatch, code, good):
    """The kernel reports it once, to the next call on the socket: here to the send of a read, which
    looks for a second node, or of a Status. The interface may be down from the start.
    """
    sends = iter([*[None] * good, OSError(code, os.strerror(code))])

    def send(*_: object) -> None:
        if error := next(sends, None):
            raise can.CanOperationError(f"Failed to transmit: {error.strerror}") from error

    monkeypatch.setattr(can.interfaces.virtual.VirtualBus, "send", send)
    done = dahl("node", *OWN, "-i", "virtual", "-c", "down", "--seconds", 120)
    code_of_exit, said = complaint(done)
    assert code_of_exit == 1 and "bus has gone" in said and os.strerror(code) in said


def test_a_listener_whose_interface_goes_down_passes_that_to_its_notifier(monkeypatch):
    def send(*_: object) -> None:
        raise OSError(errno.ENETDOWN, "Network is down")

    with can.Bus(interface="virtual", channel="down 2") as bus:
        monkeypatch.setattr(bus, "send", send)
        listener = node.Listener(bus, Node(PLAN))
        wait_until(lambda: listener.traffic.refused)
        with pytest.raises(RunError, match="Network is down"):
            listener(codec.pack(EncoderState(0, 0)))
        listener.stop()


@pytest.mark.parametrize("way", ["options", "scene"])
def test_a_wrong_unit_has_a_note_and_a_node(dahl, tmp_path, way):
    """In N m/rad and rad; the encoder of 16384 counts is in degrees."""
    text = OWN_SCENE.replace("3.8e-4", "0.02197265625")
    (tmp_path / "own.ini").write_text("[scene]\ntitle = t\n[status]\nperiod_ms = 100\n" + text)
    words = [*OWN[:-1], "0.02197265625"] if way == "options" else ["--scene", tmp_path / "own.ini"]
    done = dahl("node", *words, "-i", "virtual", "-c", f"units {way}", "--seconds", "0.05")
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)
    assert done.stderr.startswith("note: ") and "16384 counts per turn" in done.stderr


def test_an_error_of_the_server_is_passed_on(dahl, monkeypatch, tmp_path):
    script = "echo 'socketcand 127.0.0.1:5 serves'\nsleep 0.3\necho error: no rig >&2\nexit 1\n"
    (program := tmp_path / "loop").write_text(f"#!/bin/sh\n{script}")
    program.chmod(0o755)
    monkeypatch.setenv("DAHL_LOOP", str(program))
    done = dahl("node", *OWN, "--host", "127.0.0.1", "--seconds", "300")
    assert complaint(done) == (1, "no rig")


# --- firmware, replaced by a node in Python -------------------------------------------------------

STEP, TIMEOUT, STATUS = Param.STEP, Param.TIMEOUT, Param.STATUS


@contextlib.contextmanager
def attached(
    kept: list[Node], counters: tuple[int, ...], core, params, folder, port, number
) -> Iterator[None]:
    """Join the served bus as firmware does. Another member sends angles with these counters; the
    second one has a wrong CRC.
    """
    settings = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": port}
    kept.append(Node(Plan(*params), number))
    with can.Bus(**settings) as bus, can.Bus(**settings) as other:
        with pytest.raises(RunError, match=f"node {number} "):
            node.ask(bus, ParamWrite(Param.MODEL), number, timeout=0.2)
        notifier = can.Notifier(bus, [node.Listener(bus, kept[0])])
        angles = [codec.pack(EncoderState(0, counter), number) for counter in counters]
        if angles:
            angles[1].data[0] ^= 1
            other.send_periodic(angles, 0.02)
        try:
            yield
        finally:
            other.stop_all_periodic_tasks()
            notifier.stop()


@pytest.fixture
def run_firmware(dahl, monkeypatch, tmp_path):
    """Run `dahl node --target`. The emulator takes seconds, so its two calls are replaced."""

    def run(number: int, scene: str, *counters: int) -> tuple[subprocess.CompletedProcess, Node]:
        kept: list[Node] = []
        monkeypatch.setattr("dahl.target.firmware.build", lambda core: tmp_path / "node_image")
        attach = partial(attached, kept, counters)
        monkeypatch.setattr("dahl.target.firmware.attach_firmware", attach)
        (tmp_path / "own.ini").write_text(OWN_SCENE + scene)
        words = ("--scene", "own.ini", "--target", "m4f", "--node", number, "--seconds", 1)
        return dahl("node", *words), kept[0]

    return run


@pytest.mark.parametrize("number", [0, 15])
def test_firmware_gets_the_settings_of_its_scene(run_firmware, number):
    """Angles are lost, spoiled and too far ahead."""
    scene = "max_step = 2000\ntimeout_ms = 9000\n[status]\nperiod_ms = 70\n"
    done, kept = run_firmware(number, scene, 0, 2, 4, 6, 15)
    assert done.returncode == 0, done.stderr
    for param, value in {STEP: 2000, TIMEOUT: 9, STATUS: 0.07}.items():
        reply = codec.unpack(kept.receive(codec.pack(ParamWrite(param), number)))
        assert reply.si == pytest.approx(value)
    counts = counted(done.stdout.splitlines())
    assert 0 < counts["answers"] < counts["frames"] and 0 < counts["lost"] <= kept.counts.lost
    assert 0 < counts["corrupt"] <= kept.counts.crc
    assert 0 < counts["out_of_step"] <= kept.counts.repeated + kept.counts.wrong_sequence
    assert counts.keys() == {"frames", "answers", "lost", "corrupt", "out_of_step"}


def test_firmware_that_gets_no_frame_and_sends_none(run_firmware):
    done, _ = run_firmware(0, "[status]\nperiod_ms = 60000\n")
    assert done.returncode == 0 and done.stdout.endswith(" s: no frame came\n")


def test_firmware_that_cannot_hold_a_setting_is_refused(run_firmware):
    """Its timeout is in whole ms."""
    done, _ = run_firmware(0, "timeout_ms = 9000.4\n")
    code, said = complaint(done)
    assert code == 2 and "timeout = 9.0004" in said and said.endswith(" 9")
