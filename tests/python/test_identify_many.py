# SPDX-License-Identifier: MIT
"""`dahl identify --each`: many logs in parallel, resumed, on a Dask cluster; and --follow: a live
bus.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time

import can
import numpy as np
import pytest
from dahl import paths
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, write_csv
from log_writers import DBC, STEP
from log_writers import frames as write_frames
from loop_tools import serving

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture
def folder(tmp_path):
    """Three good logs, one broken, one that is no log."""
    place = tmp_path / "logs"
    place.mkdir()
    for seed in range(3):
        theta = np.floor(sine(seed, rows=1000, cycles=5) / COUNT) * COUNT
        torque = (1 + seed) * (dahl_torque(theta) + 0.02 * FC * noise_of(seed, 1000))
        write_csv(place / f"run{seed}.csv", theta, torque)
    (place / "broken.csv").write_text("t,angle_deg,torque_Nm\n0,1,2\n1,x,2\n")
    (place / "notes.md").write_text("no log")
    return place


@pytest.fixture
def each(tmp_path, dahl_here):
    """Run --each on a folder; return the rows of its table, and how many are of earlier runs."""

    def run(folder, *words, out="out", code=0) -> tuple[dict[str, dict[str, str]], int]:
        call = ("identify", "--each", folder, "-o", tmp_path / out, "--jobs", "1", *words)
        done = dahl_here(*call)
        assert done.returncode == code, done.stderr
        with (tmp_path / out / "each.csv").open(newline="") as file:
            rows = {row["log"]: row for row in csv.DictReader(file)}
        earlier, of = re.search(r"(\d+) of (\d+) \D*$", done.stdout.splitlines()[-1]).groups()
        assert int(of) == len(rows)
        run.done = done
        return rows, int(earlier)

    return run


def test_a_folder_is_a_table_and_results_are_stored(folder, each, monkeypatch):
    """A broken log is one line and code 2; the other logs are identified."""
    monkeypatch.setenv("COLUMNS", "2000")
    rows, earlier = each(folder, "--jobs", "2", code=2)
    assert sorted(rows) == ["broken.csv", "run0.csv", "run1.csv", "run2.csv"] and earlier == 0
    errors = [line for line in each.done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1 and "broken.csv:3" in errors[0]
    assert "broken.csv:3" in rows["broken.csv"]["error"] and rows["broken.csv"]["Fc"] == ""
    lines = [line.split("│")[1:-1] for line in each.done.stdout.splitlines() if "│" in line]
    shown = {name.strip(): [cell.strip() for cell in cells] for name, *cells in lines}
    assert shown["broken.csv"] == ["", "", "", "broken"]
    for seed in range(3):
        row = rows[f"run{seed}.csv"]
        for name, true in (("sigma0", SIGMA0), ("Fc", FC)):
            assert float(row[name]) == pytest.approx((1 + seed) * true, rel=0.03)
            assert float(row[f"{name}_low"]) < float(row[name]) < float(row[f"{name}_high"])
        sigma0, limit, r2 = (f"{float(row[name]):.5g}" for name in ("sigma0", "Fc", "r2"))
        numbers = [f"{sigma0} N m/rad", f"{limit} N m", r2]
        assert shown[row["log"]] == [*numbers, row["verdict"]]
        assert (row["sigma0_unit"], row["Fc_unit"]) == ("N m/rad", "N m")
        assert float(row["r2_coulomb"]) < float(row["r2"]) and row["reversals"] in ("9", "10")
    assert each(folder, code=2) == (rows, 4)
    (folder / "broken.csv").unlink()
    assert each(folder)[1] == 3


def test_an_interval_without_an_end_is_an_empty_cell(tmp_path, each):
    """The torque is a bare sign, so sigma0 has no upper end."""
    (tmp_path / "logs").mkdir()
    theta = sine(1, rows=1500, cycles=7)
    write_csv(tmp_path / "logs" / "a.csv", theta, FC * np.sign(np.gradient(theta)))
    ((row,), _) = each(tmp_path / "logs")[0].values(), 0
    assert row["sigma0_high"] == "" != row["Fc_high"]


def test_an_interrupted_run_is_resumed(folder, tmp_path, dahl_here, each, monkeypatch):
    from dahl.identify import estimate

    whole, count = estimate.identify, []

    def identify(logs, options):
        count.append(1)
        if len(count) == 2:
            raise KeyboardInterrupt
        return whole(logs, options)

    monkeypatch.setattr(estimate, "identify", identify)
    with contextlib.suppress(KeyboardInterrupt):
        done = dahl_here("identify", "--each", folder, "-o", tmp_path / "out", "--jobs", "1")
        assert done.returncode not in (0, 2)
    assert 2 <= each(folder, code=2)[1] < 4  # the broken one too


@pytest.fixture
def small(tmp_path):
    """Make a folder with one quick log; one of another Fc has the same size and time."""

    def make(name: str, part: float = 1.0):
        place = tmp_path / name
        place.mkdir(exist_ok=True)
        theta = np.floor(sine(1, rows=800, cycles=5) / COUNT) * COUNT
        torque = part * (dahl_torque(theta) + 0.01 * FC * noise_of(1, 800))
        rows = zip(np.arange(800) * 1e-3, np.degrees(theta), torque, strict=True)
        lines = [f"{now:.3f},{angle:+.9f},{force:+.9f}" for now, angle, force in rows]
        (place / "run.csv").write_text("\n".join(["t,angle_deg,torque_Nm", *lines]) + "\n")
        os.utime(place / "run.csv", (1e9, 1e9))
        return place

    return make


def test_a_result_belongs_to_the_content_the_path_and_the_options(small, each):
    """The two logs have the same name, size and time."""
    first, second = small("a"), small("b", 0.5)
    assert (first / "run.csv").stat().st_size == (second / "run.csv").stat().st_size
    force = float(each(first)[0]["run.csv"]["Fc"])
    rows, earlier = each(second)
    assert float(rows["run.csv"]["Fc"]) == pytest.approx(force / 2, rel=1e-6) and earlier == 0
    for asked in (first, second, first / ".." / "a"):
        assert each(asked)[1] == 1
    for words in (("--no-delay",), ("--terms", "offset"), ("--torque-unit", "mNm")):
        assert each(first, *words)[1] == 0
    small("a", 0.25)
    rows, earlier = each(first)
    assert float(rows["run.csv"]["Fc"]) == pytest.approx(force / 4, rel=1e-6) and earlier == 0


def test_a_result_belongs_to_the_dbc(tmp_path, each):
    (tmp_path / "logs").mkdir()
    theta = sine(1, rows=600, cycles=5)
    torque = (dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)) / STEP
    angle = np.rint(np.degrees(theta) / STEP).astype(int)
    columns = (np.arange(600) * 1e-3, angle, np.rint(torque).astype(int))
    write_frames(tmp_path / "logs" / "bus.log", *columns)
    dbc, found = tmp_path / "bus.dbc", []
    for factor in ("(0.0001,0) [-100|", "(0.0002,0) [-100|"):
        dbc.write_text(DBC.replace("(0.0001,0) [-100|", factor))
        words = ("--dbc", dbc, "--angle", "Angle", "--torque", "Torque")
        found.append(float(each(tmp_path / "logs", *words)[0]["bus.log"]["Fc"]))
    assert found[1] == pytest.approx(2 * found[0], rel=1e-6)


def test_a_damaged_result_is_made_anew(small, tmp_path, each):
    folder = small("a")
    truth, _ = each(folder)
    (stored,) = (tmp_path / "out" / "each").rglob("output.pkl")
    stored.write_bytes(stored.read_bytes()[:50])
    assert each(folder) == (truth, 0)
    assert each(folder) == (truth, 1)


THE_COPY = """import sys
from importlib.machinery import BuiltinImporter, FrozenImporter, PathFinder
sys.meta_path[:] = [BuiltinImporter, FrozenImporter, PathFinder]  # not what is installed in place
sys.path.insert(0, sys.argv.pop(1))
from dahl.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_result_belongs_to_the_code(small, tmp_path, root):
    """A copy of the package is edited in the modules that turn a log into numbers."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(root / "tools" / "dahl", tmp_path / "copy" / "dahl", ignore=ignored)
    words = ("identify", "--each", small("a"), "-o", tmp_path / "out", "--jobs", "1")
    command = [sys.executable, "-c", THE_COPY, tmp_path / "copy", *words]
    environment = {"DAHL_BUILD_DIR": str(root / "build" / "host"), **os.environ}
    for edited, earlier in (("", 0), ("", 1), ("identify/fit.py", 0), ("io/can_logs.py", 0)):
        if edited:
            source = tmp_path / "copy" / "dahl" / edited
            source.write_text(source.read_text() + "#\n")
        run = {"capture_output": True, "text": True, "timeout": 120, "env": environment}
        done = subprocess.run(list(map(str, command)), check=False, **run)
        assert f"{earlier} of 1 " in done.stdout, done.stderr


def test_a_dask_cluster_gives_the_same(folder, each):
    from dask.distributed import LocalCluster

    here, _ = each(folder, out="here", code=2)
    kind = {"processes": False, "dashboard_address": None}
    with LocalCluster(n_workers=1, threads_per_worker=2, **kind) as cluster:
        there, earlier = each(folder, "--dask", cluster.scheduler_address, out="there", code=2)
    assert (there, earlier) == (here, 0)


# --- a live bus -----------------------------------------------------------------------------------


class Rig(can.BusABC):
    """A bus of python-can with frames of a shaft: the angle, and 0.3 ms later the torque."""

    def __init__(self, rows: int, noise: float, cycle: int = 300, growth: float = 0.0) -> None:
        super().__init__("rig")
        grows = np.linspace(1, 1.5, rows)  # so that no cycle has the counts of another
        count = COUNT / 8
        theta = np.floor(sine(1, rows=rows, cycles=rows / cycle) * grows / count) * count
        self.torque = dahl_torque(theta) * np.linspace(1, 1 + growth, rows)
        self.torque += noise * FC * noise_of(1, rows)
        self.theta, self.row = theta, 0

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        row, is_load = divmod(self.row, 2)
        if row == len(self.theta):
            time.sleep(timeout or 0)
            return None, False
        self.row += 1
        value = self.torque[row] if is_load else np.degrees(self.theta[row])
        data = int(np.rint(value / STEP)).to_bytes(4, "little", signed=True)
        return can.Message(
            timestamp=row * 1e-3 + 3e-4 * is_load,
            arbitration_id=256 + is_load,
            is_extended_id=False,
            data=data + bytes(4),
        ), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError


@pytest.fixture
def follow(tmp_path, dahl_here, monkeypatch):
    """Follow a rig; return the estimates as (rows, words), and the JSON that is written."""
    (tmp_path / "bus.dbc").write_text(DBC)

    def run(rig: Rig, *words):
        monkeypatch.setattr("can.cli.create_bus_from_namespace", lambda *_, **__: rig)
        signals = ("--dbc", tmp_path / "bus.dbc", "--angle", "Angle", "--torque", "Torque")
        out = ("-o", tmp_path / "out", "-i", "virtual", "-c", "rig")
        done = dahl_here("identify", "--follow", *signals, *out, *words)
        assert done.returncode == 0, done.stderr
        looks = [line.split(" rows: ", 1) for line in done.stderr.splitlines()]
        found = json.loads((tmp_path / "out" / "bus.json").read_text())
        return [(int(rows), said) for rows, said in looks], found

    return run


def widths(said: str) -> list[float]:
    return [float(number) for number in re.findall(r"within (\S+) %", said)]


QUICK = ("--terms", "offset", "--no-delay")


def test_a_bus_is_followed_until_both_parameters_are_known(follow, tmp_path):
    """Each estimate has a quarter more rows; the last one has the numbers of the JSON."""
    looks, found = follow(Rig(6000, 0.03), "--within", "2", "--seconds", "60", *QUICK)
    rows = [row for row, _ in looks]
    assert rows[:4] == [500, 625, 781, 976]
    assert rows[1:] == [int(row * 1.25) for row in rows[:-1]]
    numbers = [widths(said)[:2] for _, said in looks]
    assert max(numbers[-1]) <= 2
    assert found["logs"] == ["bus"] and found["rows"] == rows[-1] < 5000
    for name, shown in zip(("sigma0", "Fc"), numbers[-1], strict=True):
        low, high = found["ci95"][name]
        assert shown == pytest.approx(50 * (high - low) / found[name], rel=0.05)
        assert f"{name} {found[name]:.5g} (" in looks[-1][1]
        assert found[name] == pytest.approx({"sigma0": SIGMA0, "Fc": FC}[name], rel=0.01)
    assert looks[-1][1].endswith(found["verdict"])
    assert (tmp_path / "out" / "dahl_plan_bus.h").is_file()


def test_following_needs_six_cycles_however_narrow_the_intervals(follow):
    looks, found = follow(Rig(6000, 0.01, cycle=400), "--within", "25", "--seconds", "60", *QUICK)
    assert 6 <= found["cycles_scored"] <= 8
    before = [max(widths(said)[:2]) for rows, said in looks if 1000 < rows < 2400]
    assert before and max(before) < 25


def test_following_needs_claims_however_narrow_the_intervals(follow):
    """The torque is noise alone."""
    rig = Rig(1500, 40.0, cycle=80)
    looks, found = follow(rig, "--within", "1000", "--frames", "2000", *QUICK)
    assert found["rows"] == 1000 and not any(found["identifiable"].values())
    assert found["reversals"] > 12 and len(looks) == 4


@pytest.mark.parametrize(
    ("words", "rows"), [(("--frames", "2400"), 1200), (("--seconds", "4"), 1500)]
)
def test_following_ends_with_its_limits(follow, words, rows):
    _, found = follow(Rig(1500, 0.1), "--within", "0.001", *words, *QUICK)
    assert found["rows"] == pytest.approx(rows, abs=1)


def test_following_needs_signals(dahl_here):
    done = dahl_here("identify", "--follow", "-i", "virtual", "-c", "x")
    assert done.returncode == 2 and "--dbc" in done.stderr and done.stderr.count("\n") == 1
    assert dahl_here("identify", "x.csv", "--follow").returncode == 2


@pytest.mark.checks
def test_following_a_running_loop(tmp_path, dahl_here):
    """The torque of a node is in Fc, so Fc is 1 and sigma0 is the scene's a."""
    guess = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384", "--within", "0.5")
    assert dahl_here("excite", *guess, "--name", "loop", "-o", tmp_path).returncode == 0
    words = ("--angle", "Count", "--angle-unit", "counts", "--counts-per-turn", "16384")
    pace = ("--wait-clients", "1", "--virtual")  # its clock has no gaps, however busy the machine
    with serving(tmp_path / "run", tmp_path / "loop.ini", *pace) as (_, port):
        bus = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", port)
        signals = ("--dbc", paths.DBC, *words, "--torque", "TorqueRatio", "--torque-unit", "Nm")
        out = ("--within", "2", "--seconds", "60", "-o", tmp_path / "out", "--name", "live")
        done = dahl_here("identify", "--follow", *bus, *signals, *out)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "live.json").read_text())
    assert all(found["identifiable"].values())
    assert found["rows"] < 30000  # before the motion ends
    assert found["sigma0"] == pytest.approx(SIGMA0 / FC, rel=0.005)
    assert found["Fc"] == pytest.approx(1, rel=0.005)
    assert max(widths(done.stderr.splitlines()[-1])) < 2
    assert (tmp_path / "out" / "dahl_plan_live.h").is_file()
