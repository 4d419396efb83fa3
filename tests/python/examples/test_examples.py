# SPDX-License-Identifier: MIT
"""The examples run as their pages describe."""

import ctypes
import json
import math
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import can
import dahl
import pytest
from conftest import need
from dahl.codec import EncoderState
from dahl.node import ask
from firmware_examples import expected_torques
from programs import STRICT, run, shared_object
from sources import CORE


@pytest.fixture
def node(dahl_loop, root):
    command = [sys.executable, "-m", "dahl", "loop", "--scene", "segments", "--role", "node"]
    command += ["--bus", "socketcand:0", "--wait-clients", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        port = re.search(r":(\d+) ", process.stdout.readline())[1]
        where = {"channel": "vcan0", "host": "127.0.0.1", "port": int(port)}
        with can.Bus(interface="socketcand", **where) as bus:
            ask(bus, EncoderState(count=0, counter=9))
        time.sleep(0.3)  # its timeout is 0.1 s
        yield port
        process.kill()


def test_python_can_asks_a_node(node, root, tmp_path):
    text = (root / "examples/python_can/test_node.py").read_text()
    assert '"port": 28600' in text
    (tmp_path / "test_node.py").write_text(text.replace("28600", node))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    command += ["--rootdir", tmp_path, tmp_path / "test_node.py"]
    assert "1 passed" in run(*command, cwd=root, timeout=60)


def test_asyncio_asks_a_node(node, root):
    said = run(sys.executable, root / "examples/python_can/asyncio_node.py", node, timeout=60)
    found = [float(ratio) for ratio in re.findall(r"F/Fc ([+-][\d.]+)", said)]
    assert len(found) == 10 and found[0] == 0
    assert max(found) > 0.99 and min(found) < -0.99 and max(map(abs, found)) <= 1
    assert "states: " in said and "OK" in said


@pytest.fixture
def shaft(root: Path, tmp_path: Path) -> ctypes.CDLL:
    example = root / "examples/change_parameters/friction.c"
    lib = shared_object(tmp_path, f"-I{root}/lib/include", example, *CORE)
    lib.friction_set.restype, lib.friction_tick.restype = ctypes.c_bool, ctypes.c_float
    return lib


def test_the_next_tick_uses_new_parameters(shaft) -> None:
    """Bad parameters, and parameters before the last ones were used, change nothing. With an
    interrupt: tests/target/change_parameters.c.
    """
    bearing, waiting, err, chance = None, None, ctypes.c_int(), random.Random(1)
    refused = early = 0
    for tick in range(3000):
        for _ in range(chance.randrange(3) if tick else 1):
            good = tick == 0 or chance.random() < 0.7
            params = (chance.uniform(30, 170), chance.uniform(0.2, 1) if good else -1.0, 4e-4)
            words = (ctypes.c_float * 3)(*params)
            accepted = shaft.friction_set(words, ctypes.byref(err))
            assert accepted == (good and waiting is None)
            assert (err.value != 0) == (not good and waiting is None)
            refused, early = refused + (err.value != 0), early + (waiting is not None)
            waiting = dahl.Plan(*words) if accepted else waiting
        if bearing is None:
            bearing = dahl.Friction(waiting)
        elif waiting is not None:
            bearing.change_plan(waiting)
        waiting, move = None, chance.randint(-20, 20)
        assert shaft.friction_tick(move) == bearing.step_counts(move)
    assert refused > 100 and early > 100


def test_the_encoder_example_passes_the_wrap_of_its_timer(root, tmp_path) -> None:
    flags = ["-G", "Ninja", "-DCMAKE_C_FLAGS=-Wall -Wextra -pedantic -Werror"]
    example = root / "examples/encoder_16bit_timer"
    run("cmake", "-S", example, "-B", tmp_path, *flags)
    run("cmake", "--build", tmp_path)
    printed = run(tmp_path / example.name)
    rows = [(int(a), float(b)) for a, b in re.findall(r"timer +(\d+) +([+-][\d.]+) N m", printed)]
    readings = [reading for reading, _ in rows]
    assert max(readings) > 65000 and min(readings[:-1]) < 100
    bearing = dahl.Friction(dahl.Plan(100, 0.5, 2 * math.pi / 10000))
    for (before, _), (now, torque) in zip(rows, rows[1:-1], strict=False):
        due = bearing.step_counts((now - before + 32768) % 65536 - 32768)
        assert torque == pytest.approx(due, abs=1e-4)
    assert rows[-1][1] == rows[-2][1] and printed.strip().endswith("jumps 1")


@pytest.mark.checks
def test_an_example_without_a_node_ends_with_one_line(root):
    """python-can tries for 10 s and logs each of 100,000 attempts."""
    said = run(sys.executable, root / "examples/python_can/asyncio_node.py", "1", code=1)
    assert "connect" in said and said.count("\n") == 1


def add_own_sources(project: Path, *names: str) -> tuple[str, ...]:
    """Add files of the user with names of the library's; main calls them, and they the library."""
    main, calls = (project / "main.c").read_text(), ""
    for number, name in enumerate(names):
        (project / name).parent.mkdir(exist_ok=True)
        (project / name).write_text(
            "#include <dahl_compensator.h>\n"
            f"int32_t own_{number}(void);\nint32_t own_{number}(void)\n"
            "{ static const dahl_compensator_plan_t plan; static dahl_compensator_t state;\n"
            "  return dahl_compensator_move(&plan, &state, 1, 1); }\n"
        )
        main = f"#include <stdint.h>\nint32_t own_{number}(void);\n{main}"
        calls += f"own_{number}(); "
    (project / "main.c").write_text(
        main.replace("start_systick(CORE", f"{calls}start_systick(CORE")
    )
    return names


@pytest.mark.checks
def test_a_plain_makefile_builds_a_firmware_that_runs(root: Path, tmp_path: Path) -> None:
    for tool in ("arm-none-eabi-gcc", "make", "qemu-system-arm"):
        need(tool, "a Makefile builds a firmware that runs")
    project = shutil.copytree(root / "examples/makefile_firmware", tmp_path / "project")
    own = add_own_sources(project, "encoder.c", "model/encoder.c", "compensator/tick.c")

    make = ["sh", "-c", '"$@" 2>&1', "sh", "make", f"DAHL={root}", "CC=arm-none-eabi-gcc -Werror"]
    make.append(f"SOURCES=main.c startup.c {' '.join(own)}")
    said = re.findall(r"tick +(\d+) +(-?\d+) nN m", run(*make, "run", cwd=project))
    found = {int(tick): int(torque) * 1e-9 for tick, torque in said}
    assert found == pytest.approx(expected_torques(), abs=1e-7)
    names = run("arm-none-eabi-nm", project / "build/firmware.elf")
    assert " T dahl_step_counts_q30\n" in names  # in assembly: the C is weak, W
    shutil.copy(root / "tests/target/start_up.c", project / "main.c")
    run(*make, "run", cwd=project)  # its exit code says that no spoiled word is left in RAM


def test_the_example_for_esp_idf_prints_torques_of_the_model(root: Path, tmp_path: Path) -> None:
    (main := tmp_path / "main.c").write_text(
        "void app_main(void);\nint main(void) { app_main(); }\n"
    )
    example, program = root / "examples/esp_idf/main/main.c", tmp_path / "program"
    run("gcc", *STRICT, f"-I{root}/lib/include", main, example, *CORE, "-o", program)
    said = run(program)
    found = {int(t): float(F) for t, F in re.findall(r"tick (\d+) (\S+) N m", said)}
    assert found == pytest.approx(expected_torques(), abs=1e-6)


@pytest.mark.checks
def test_the_notebook_goes_from_a_log_to_the_bus(dahl_loop, root: Path, tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    book = nbformat.read(root / "examples/notebook/log_to_bus.ipynb", 4)
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in book.cells)
    where = {"metadata": {"path": tmp_path}}
    done = nbclient.NotebookClient(book, timeout=120, resources=where).execute()
    found = json.loads((tmp_path / "log_to_bus/rig.json").read_text())
    assert found["sigma0"] == pytest.approx(120.0, rel=0.01)
    assert found["Fc"] == pytest.approx(0.8, rel=0.01)
    run = json.loads((tmp_path / "log_to_bus/run/summary.json").read_text())
    assert run["ticks"] == 8000 and run["max_error_ulp_Fc"] < 0.6 and run["r2_measured"] > 0.99
    shown = [out for cell in done.cells for out in cell.get("outputs", []) if "data" in out]
    assert sum("image/png" in out["data"] for out in shown) == 3


def test_the_notebook_goes_from_a_log_to_a_compensator(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run its cells without Jupyter, on an axis whose friction it steps itself."""
    matplotlib = pytest.importorskip("matplotlib", reason="unproven: log_to_compensator.ipynb")
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    book = json.loads((root / "examples/notebook/log_to_compensator.ipynb").read_text())
    cells = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    names: dict[str, Any] = {}
    for cell in cells:
        exec(compile("".join(cell["source"]), "the notebook", "exec"), names)
    (still, _), _, (moved, _) = names["ends"].values()
    assert still < 0.01 and moved > 0.5 and max(speed for _, speed in names["ends"].values()) < 0.02
    assert names["step"] <= names["law"].slew * names["law"].period * (1 + 1e-6)
    assert names["after"] < 0.3 * names["before"]
    assert f"{names['law'].Fc_low:.6f}" in names["header"]


@pytest.mark.checks
def test_the_hinge_in_mujoco_is_held_and_drawn(root, tmp_path) -> None:
    pytest.importorskip("mujoco.rollout", reason="unproven: examples/mujoco: mujoco is missing")
    printed = run(sys.executable, root / "examples/mujoco/hold.py", tmp_path / "hold.png")
    native, own = map(float, re.findall(r"([\d.]+) rad", printed))
    assert native > 3 and own == pytest.approx(0.1235, rel=2e-2)
    assert (tmp_path / "hold.png").stat().st_size > 10000
