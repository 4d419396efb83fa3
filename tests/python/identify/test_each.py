# SPDX-License-Identifier: MIT
"""`dahl identify --each`: many logs in parallel, resumed, on a Dask cluster."""

import contextlib
import csv
import os
import re
import shutil
from pathlib import Path

import joblib
import numpy as np
import pytest
from dahl.identify import batch
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, write_csv
from log_reading import run, signals
from log_writers import DBC, STEP
from log_writers import frames as write_frames


@pytest.fixture
def folder(tmp_path):
    """Three good logs, one of a bare sign, one broken, one that is no log."""
    place = tmp_path / "logs"
    place.mkdir()
    for seed in range(3):
        theta = np.floor(sine(seed, rows=1000, cycles=5) / COUNT) * COUNT
        torque = (1 + seed) * (dahl_torque(theta) + 0.02 * FC * noise_of(seed, 1000))
        write_csv(place / f"run{seed}.csv", theta, torque)
    theta = sine(1, rows=1500, cycles=7)
    write_csv(place / "sign.CSV", theta, FC * np.sign(np.gradient(theta)))
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
    jobs, parallel = [], joblib.Parallel
    monkeypatch.setattr(
        joblib, "Parallel", lambda n_jobs, **how: jobs.append(n_jobs) or parallel(n_jobs, **how)
    )
    monkeypatch.setenv("COLUMNS", "2000")
    rows, earlier = each(folder, "--jobs", "2", code=2)
    assert jobs == [2]
    names = ["broken.csv", "run0.csv", "run1.csv", "run2.csv", "sign.CSV"]
    assert sorted(rows) == names and earlier == 0
    assert rows["sign.CSV"]["sigma0_high"] == "" != rows["sign.CSV"]["Fc_high"]
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
    assert each(folder, code=2) == (rows, 5)
    (folder / "broken.csv").unlink()
    shutil.copy(folder / "run0.csv", folder / "run2.csv")
    again, earlier = each(folder)
    assert earlier == 3 and again.pop("run2.csv") == rows["run0.csv"] | {"log": "run2.csv"}
    assert again == {name: rows[name] for name in names[1:3] + names[4:]}


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
    assert 2 <= each(folder, code=2)[1] < 5


@pytest.fixture
def small(tmp_path):
    """Make a folder with one quick log; one of another Fc has the same size and time."""

    def make(name: str, part: float = 1.0):
        place = tmp_path / name
        place.mkdir(exist_ok=True)
        theta = np.floor(sine(1, rows=800, cycles=5) / COUNT) * COUNT
        torque = part * (dahl_torque(theta) + 0.01 * FC * noise_of(1, 800))
        table = np.column_stack((np.arange(800) * 1e-3, np.degrees(theta), torque))
        np.savetxt(place / "run.csv", table, "%+.9f", ",", header="t,angle_deg,torque_Nm")
        os.utime(place / "run.csv", (1e9, 1e9))
        return place

    return make


def test_a_result_belongs_to_the_content_the_path_and_the_options(small, each):
    first, second = small("a"), small("b", 0.5)
    assert (first / "run.csv").stat().st_size == (second / "run.csv").stat().st_size
    force = float(each(first)[0]["run.csv"]["Fc"])
    rows, earlier = each(second)
    assert float(rows["run.csv"]["Fc"]) == pytest.approx(force / 2, rel=1e-6) and earlier == 0
    for asked in (first, second, first / ".." / "a"):
        assert each(asked)[1] == 1
    for words, part in (("--no-delay", 1), ("--terms offset", 1), ("--torque-unit mNm", 1e-3)):
        rows, earlier = each(first, *words.split())
        assert float(rows["run.csv"]["Fc"]) == pytest.approx(part * force, rel=0.02)
        assert earlier == 0
    small("a", 0.25)
    rows, earlier = each(first)
    assert float(rows["run.csv"]["Fc"]) == pytest.approx(force / 4, rel=1e-6) and earlier == 0


def test_a_result_belongs_to_the_dbc(tmp_path, each):
    (tmp_path / "logs").mkdir()
    rows, found = np.arange(600), []
    theta = sine(1, rows=600, cycles=5)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)
    angle, torque = (np.rint(x / STEP).astype(int) for x in (np.degrees(theta), torque))
    write_frames(tmp_path / "logs" / "bus.log", rows * 1e-3, angle, torque)
    for factor in ("(0.0001,0) [-100|", "(0.0002,0) [-100|"):
        words = signals(tmp_path, dbc=DBC.replace("(0.0001,0) [-100|", factor))
        found.append(float(each(tmp_path / "logs", *words)[0]["bus.log"]["Fc"]))
    assert found[1] == pytest.approx(2 * found[0], rel=1e-6)


def test_a_result_that_is_damaged_or_cannot_be_stored_is_made_anew(small, tmp_path, each):
    folder = small("a")
    truth, _ = each(folder)
    (stored,) = (tmp_path / "out" / "each").iterdir()
    stored.write_bytes(stored.read_bytes()[:50])
    assert each(folder) == (truth, 0)
    assert each(folder) == (truth, 1)
    stored.unlink()
    stored.mkdir()
    assert each(folder) == each(folder) == (truth, 0)


@pytest.mark.parametrize("edited", ["identify/fit.py", "io/can_logs.py", "version"])
def test_a_result_belongs_to_the_code(small, each, tmp_path, monkeypatch, edited):
    """A copy of the modules that turn a log into numbers is edited."""
    folder, copy = small("a"), tmp_path / "copy"
    for module in (batch.estimate, batch.readers):
        place = copy / Path(module.__file__).parent.name
        shutil.copytree(Path(module.__file__).parent, place)
        monkeypatch.setattr(module, "__file__", str(place / Path(module.__file__).name))
    batch.method_version.cache_clear()
    assert [each(folder)[1] for _ in range(2)] == [0, 1]
    if edited == "version":
        monkeypatch.setattr(batch, "__version__", "another")
    else:
        (copy / edited).write_text((copy / edited).read_text() + "#\n")
    batch.method_version.cache_clear()
    assert each(folder)[1] == 0
    batch.method_version.cache_clear()


def test_a_dask_cluster_gives_the_same(folder, each, tmp_path, monkeypatch):
    """A cluster that does not answer is a failed run."""
    from dask.distributed import LocalCluster

    here, _ = each(folder, out="here", code=2)
    kind = {"processes": False, "dashboard_address": None}
    with LocalCluster(n_workers=1, threads_per_worker=2, **kind) as cluster:
        there, earlier = each(folder, "--dask", cluster.scheduler_address, out="there", code=2)
    assert (there, earlier) == (here, 0)
    # This limit has no option, and ten seconds are long for a test.
    monkeypatch.setattr("dahl.identify.batch.CLUSTER_TIMEOUT_S", 0.5)
    address = "tcp://127.0.0.1:9"
    words = ("--each", folder, "-o", tmp_path / "none", "--dask", address)
    done = run("identify", *words)
    assert done.returncode == 1 and f"error: --dask {address}" in done.stderr
