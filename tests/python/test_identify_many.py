# SPDX-License-Identifier: MIT
"""Many logs side by side, taken up again, on a Dask cluster; and a live bus."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import threading
import time
from unittest.mock import ANY

import can
import cantools
import joblib
import numpy as np
import pytest
from dahl import RunError, paths
from dahl import bus as dahl_bus
from dahl.identify import folder_runs, follow, pipeline, readers
from identify_tools import COUNT, FC, SIGMA0, caller, dahl_torque, noise_of, sine, write_csv
from log_writers import DBC, STEP
from log_writers import frames as write_frames
from loop_tools import serving

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


@pytest.fixture
def folder(tmp_path):
    """Three good logs, one broken, one that is no log."""
    place = tmp_path / "logs"
    place.mkdir()
    for seed in range(3):
        theta = np.floor(sine(seed, rows=3000, cycles=5) / COUNT) * COUNT
        torque = dahl_torque(theta) + 0.03 * FC * noise_of(seed, 3000)
        write_csv(place / f"run{seed}.csv", theta, torque)
    (place / "broken.csv").write_text("t,angle_deg,torque_Nm\n0,1\n")
    (place / "notes.md").write_text("no log")
    return place


def all_of(folder, kept, jobs=1, dask=None) -> tuple[dict, int]:
    rows, earlier = {}, 0
    for path, numbers, known in folder_runs.run(folder_runs.logs_in(folder), kept, jobs, dask):
        rows[path.name] = numbers
        earlier += known
    return rows, earlier


def kept_in(place) -> folder_runs.Kept:
    return folder_runs.Kept(place, readers.Source(), pipeline.Options())


def test_a_broken_log_stops_nothing_and_what_is_done_is_not_done_again(folder, tmp_path):
    rows, earlier = all_of(folder, kept_in(tmp_path / "kept"), jobs=2)
    assert earlier == 0
    assert sorted(rows) == ["broken.csv", "run0.csv", "run1.csv", "run2.csv"]
    assert "broken.csv:2" in rows["broken.csv"]["error"]
    for seed in range(3):
        assert rows[f"run{seed}.csv"]["sigma0"] == pytest.approx(SIGMA0, rel=0.03)
    again, earlier = all_of(folder, kept_in(tmp_path / "kept"))
    assert (again, earlier) == (rows, 4)


def test_a_run_that_was_interrupted_is_taken_up_again(folder, tmp_path):
    running = folder_runs.run(folder_runs.logs_in(folder), kept_in(tmp_path / "kept"), 1, None)
    next(running)
    running.close()
    _, earlier = all_of(folder, kept_in(tmp_path / "kept"))
    assert earlier >= 1


def fc_by_log(folder, out, run_dahl, *words) -> tuple[dict[str, float], str]:
    """What --each finds of Fc, and what it says of earlier runs."""
    done = run_dahl("identify", "--each", folder, "-o", out, "--jobs", "1", *words)
    assert done.returncode == 0, done.stderr
    lines = [line.split(",") for line in (out / "each.csv").read_text().splitlines()[1:]]
    return {line[0]: float(line[2]) for line in lines}, done.stdout.splitlines()[-1]


@pytest.fixture
def small(tmp_path):
    """A folder with one quick log; a call with another Fc makes one of the same size and time."""

    def make(name: str, part: float = 1.0):
        place = tmp_path / name
        place.mkdir(exist_ok=True)
        theta = np.floor(sine(1, rows=1000, cycles=5) / COUNT) * COUNT
        torque = part * (dahl_torque(theta) + 0.01 * FC * noise_of(1, 1000))
        rows = zip(np.arange(1000) * 1e-3, np.degrees(theta), torque, strict=True)
        lines = [f"{now:.3f},{angle:+.9f},{force:+.9f}" for now, angle, force in rows]
        (place / "run.csv").write_text("\n".join(["t,angle_deg,torque_Nm", *lines]) + "\n")
        os.utime(place / "run.csv", (1e9, 1e9))
        return place

    return make


def test_a_result_belongs_to_the_content_the_path_and_the_options(small, tmp_path, run_dahl):
    """Two logs of one name, size and time differ in nothing but what they say."""
    first, second, out = small("a"), small("b", 0.5), tmp_path / "out"
    assert (first / "run.csv").stat().st_size == (second / "run.csv").stat().st_size
    here, _ = fc_by_log(first, out, run_dahl)
    there, said = fc_by_log(second, out, run_dahl)
    assert there["run.csv"] == pytest.approx(here["run.csv"] / 2, rel=1e-6)
    assert said.endswith("0 of 1 from earlier runs")
    for asked in (first, second, first / ".." / "a"):
        assert fc_by_log(asked, out, run_dahl)[1].endswith("1 of 1 from earlier runs")
    for words in (("--no-delay",), ("--terms", "offset"), ("--torque-unit", "mNm")):
        assert fc_by_log(first, out, run_dahl, *words)[1].endswith("0 of 1 from earlier runs")
    small("a", 0.25)
    changed, said = fc_by_log(first, out, run_dahl)
    assert changed["run.csv"] == pytest.approx(here["run.csv"] / 4, rel=1e-6)
    assert said.endswith("0 of 1 from earlier runs")


def test_an_edited_dbc_is_another_question(tmp_path, run_dahl):
    (tmp_path / "logs").mkdir()
    theta = sine(1, rows=600, cycles=5)
    angle = np.degrees(theta) / STEP
    torque = (dahl_torque(theta) + 0.01 * FC * noise_of(1, 600)) / STEP
    columns = (np.arange(600) * 1e-3, np.rint(angle).astype(int), np.rint(torque).astype(int))
    write_frames(tmp_path / "logs" / "bus.log", *columns)
    dbc, found = tmp_path / "bus.dbc", []
    for factor in ("(0.0001,0) [-100|", "(0.0002,0) [-100|"):
        dbc.write_text(DBC.replace("(0.0001,0) [-100|", factor))
        words = ("--dbc", dbc, "--angle", "Angle", "--torque", "Torque")
        found.append(fc_by_log(tmp_path / "logs", tmp_path / "out", run_dahl, *words)[0]["bus.log"])
    assert found[1] == pytest.approx(2 * found[0], rel=1e-6)


@pytest.mark.parametrize("content", ["cut", "list", "dictionary", "interval"])
def test_a_kept_result_of_the_wrong_shape_is_made_anew(small, tmp_path, run_dahl, content):
    folder, out = small("a"), tmp_path / "out"
    truth, _ = fc_by_log(folder, out, run_dahl)
    (kept,) = (out / "each").rglob("output.pkl")
    wrong = {"list": [1, 2], "dictionary": {"sigma0": 1}}
    if content == "cut":
        kept.write_bytes(kept.read_bytes()[:50])
    else:
        whole = joblib.load(kept)
        joblib.dump(wrong.get(content, {**whole, "ci95": {"sigma0": [1], "Fc": None}}), kept)
    assert fc_by_log(folder, out, run_dahl) == (truth, ANY)
    assert fc_by_log(folder, out, run_dahl)[1].endswith("1 of 1 from earlier runs")


def test_another_version_of_the_method_is_done_again(small, tmp_path, monkeypatch):
    folder, place = small("a"), tmp_path / "kept"
    assert all_of(folder, kept_in(place))[1] == 0
    assert all_of(folder, kept_in(place))[1] == 1
    monkeypatch.setattr(folder_runs, "method", lambda: "another")
    assert all_of(folder, kept_in(place))[1] == 0


def test_the_method_is_all_that_turns_a_log_into_numbers(tmp_path, monkeypatch):
    package = tmp_path / "identify"
    package.mkdir()
    sources = [tmp_path / "logs.py", package / "readers.py", package / "fit.py"]
    for module, place in ((folder_runs.logs, sources[0]), (readers, sources[1])):
        monkeypatch.setattr(module, "__file__", str(place))
    versions = set()
    for edited in (*sources, *sources):
        for place in sources:
            place.write_text(place.read_text() if place.exists() else "")
        edited.write_text(edited.read_text() + "#\n")
        versions.add(folder_runs.method.__wrapped__())
    monkeypatch.setattr(folder_runs, "__version__", "next")
    assert len({*versions, folder_runs.method.__wrapped__()}) == 7


@pytest.mark.filterwarnings("error")
def test_what_cannot_be_kept_is_done_again(small, tmp_path, monkeypatch):
    """The disk is full, as far as results go: each run has its numbers, and no word of it."""
    write = joblib._store_backends.StoreBackendMixin._concurrency_safe_write

    def full(self, content, name, *words):
        if str(name).endswith("output.pkl"):
            raise OSError(28, "No space left on device")
        return write(self, content, name, *words)

    monkeypatch.setattr(joblib._store_backends.StoreBackendMixin, "_concurrency_safe_write", full)
    folder = small("a")
    for _ in range(2):
        rows, earlier = all_of(folder, kept_in(tmp_path / "kept"))
        assert earlier == 0 and all("Fc" in row for row in rows.values())


def test_a_dask_cluster_gives_the_same(folder, tmp_path):
    from dask.distributed import LocalCluster

    here, _ = all_of(folder, kept_in(tmp_path / "here"))
    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        there, earlier = all_of(folder, kept_in(tmp_path / "there"), 2, cluster.scheduler_address)
    assert earlier == 0
    assert there == here


def test_no_cluster(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(folder_runs, "PATIENCE", 1.0)
    with pytest.raises(RunError, match="no cluster answers"):
        all_of(folder, kept_in(tmp_path / "kept"), 1, "tcp://127.0.0.1:9")


def test_the_command(folder, tmp_path, run_dahl, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    done = run_dahl("identify", "--each", folder, "-o", tmp_path / "out", "--jobs", "2")
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert "broken.csv:2" in errors[0]
    with (tmp_path / "out" / "each.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["log"] for row in rows] == ["broken.csv", "run0.csv", "run1.csv", "run2.csv"]
    lines = [line.split("│")[1:-1] for line in done.stdout.splitlines() if "│" in line]
    shown = {name.strip(): [cell.strip() for cell in cells] for name, *cells in lines}
    assert shown["broken.csv"] == ["", "", "", "broken"]
    for row in rows[1:]:
        sigma0, limit, r2 = (f"{float(row[name]):.5g}" for name in ("sigma0", "Fc", "r2"))
        numbers = [f"{sigma0} N m/rad", f"{limit} N m", r2]
        assert shown[row["log"]] == [*numbers, row["verdict"]]
        assert (row["sigma0_unit"], row["Fc_unit"]) == ("N m/rad", "N m")
    assert run_dahl("identify", "--each", tmp_path / "none").returncode == 2
    (folder / "broken.csv").unlink()
    assert run_dahl("identify", "--each", folder, "-o", tmp_path / "out").returncode == 0


def test_one_broken_log_of_a_joint_fit_is_left_out(folder, run_dahl):
    done = run_dahl(
        "identify",
        folder / "run0.csv",
        folder / "broken.csv",
        folder / "run1.csv",
        "--json",
        "-",
        "--no-files",
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert len(json.loads(done.stdout)["logs"]) == 2


# --- a live bus -----------------------------------------------------------------------------------


def frames(rows: int, noise: float):
    """A log as frames of two messages, the torque 0.3 ms after the angle."""
    database = cantools.database.load_string(DBC)
    grows = np.linspace(1, 1.5, rows)  # so that no cycle has the counts of another
    theta = np.floor(sine(1, rows=rows, cycles=rows / 1000) * grows / COUNT) * COUNT
    torque = dahl_torque(theta) + noise * FC * noise_of(1, rows)
    for row in range(rows):
        for name, key, value, late in (
            ("Shaft", "Angle", np.degrees(theta[row]), 0.0),
            ("Load", "Torque", torque[row], 3e-4),
        ):
            message = database.get_message_by_name(name)
            yield can.Message(
                timestamp=row * 1e-3 + late,
                arbitration_id=message.frame_id,
                is_extended_id=False,
                data=message.encode({key: float(value)}),
            )


@pytest.fixture
def source(tmp_path):
    (tmp_path / "bus.dbc").write_text(DBC)
    return readers.Source(angle="Angle", torque="Torque", dbc=tmp_path / "bus.dbc")


def test_following_stops_when_the_interval_is_small_enough(source):
    looks = []
    result = follow.follow(
        frames(20_000, 0.03),
        source,
        pipeline.Options(),
        0.01,
        lambda rows, found, why: looks.append((rows, found, why)),
    )
    assert 1000 < looks[-1][0] < 15_000  # long before the end
    assert [rows for rows, _, _ in looks] == sorted(rows for rows, _, _ in looks)
    assert follow.small_enough(result, 0.01)
    assert not any(follow.small_enough(found, 0.01) for _, found, _ in looks[:-1] if found)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)


def test_following_ends_with_the_frames(source):
    result = follow.follow(frames(1500, 0.1), source, pipeline.Options(), 1e-4, lambda *_: None)
    assert result.logs[0].rows > 1400


def test_following_a_bus_with_python_can(source, monkeypatch):
    from dahl.bus import open_bus, received
    from dahl.interrupt import Stop

    def send() -> None:
        with can.Bus(interface="virtual", channel="follow", preserve_timestamps=True) as bus:
            for frame in frames(1200, 0.03):
                bus.send(frame)
                time.sleep(0)

    with open_bus(interface="virtual", channel="follow") as bus:
        sender = threading.Thread(target=send)
        sender.start()
        result = follow.follow(
            received(bus, Stop(), None, 2400), source, pipeline.Options(), 1e-4, lambda *_: None
        )
        sender.join()
    assert result.logs[0].rows > 1100


def test_the_command_says_a_line_of_each_look_at_a_bus(tmp_path, run_dahl, monkeypatch):
    """With the numbers of that moment, and the last with those that are left."""
    limits = []

    def received(bus, stop, *words):
        limits.append(words)
        yield from frames(9000, 0.03)

    monkeypatch.setattr("dahl.bus.open_from", lambda _: contextlib.nullcontext())
    monkeypatch.setattr("dahl.bus.received", received)
    (tmp_path / "bus.dbc").write_text(DBC)
    signals = ("--dbc", tmp_path / "bus.dbc", "--angle", "Angle", "--torque", "Torque")
    ends = ("--within", "0.5", "--seconds", "30", "--frames", "40000", "-o", tmp_path / "out")
    done = run_dahl("identify", "--follow", *signals, *ends)
    assert done.returncode == 0 and limits == [(30.0, 40_000)]
    looks = [line.split(": ", 1) for line in done.stderr.splitlines()]
    assert [rows for rows, _ in looks[:3]] == ["500 rows", "625 rows", "781 rows"]
    found = json.loads((tmp_path / "out" / "bus.json").read_text())
    assert found["logs"] == ["bus"] and f"{found['rows']} rows" == looks[-1][0]
    parts = []
    for name in ("sigma0", "Fc"):
        low, high = found["ci95"][name]
        width = 50 * (high - low) / found[name]
        assert width < 0.5
        parts.append(f"{name} {found[name]:.5g} (within {width:.2g} %)")
    assert looks[-1][1] == f"{', '.join(parts)}; {found['verdict']}"
    assert (tmp_path / "out" / "dahl_plan_bus.h").is_file()


@pytest.mark.checks
def test_following_a_running_loop(tmp_path, run_dahl):
    """The node answers over TCP; its torque is in Fc, so Fc is 1 and sigma0 is the scene's a."""
    guess = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384", "--within", "0.5")
    assert run_dahl("excite", *guess, "--name", "loop", "-o", tmp_path).returncode == 0
    words = ("--angle", "Count", "--angle-unit", "counts", "--counts-per-turn", "16384")
    pace = ("--wait-clients", "1", "--virtual")  # its clock has no gaps, however busy the machine
    with serving(tmp_path / "run", tmp_path / "loop.ini", *pace) as (_, port):
        bus = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", port)
        signals = ("--dbc", paths.DBC, *words, "--torque", "TorqueRatio")
        out = ("--torque-unit", "Nm", "--within", "2", "--seconds", "60", "-o", tmp_path / "out")
        done = run_dahl("identify", "--follow", *bus, *signals, *out, "--name", "live")
    assert done.returncode == 0, done.stderr
    looks = done.stderr.splitlines()
    assert looks[-1].endswith("sigma0 and Fc identifiable")
    said = re.search(r"sigma0 (\S+) \(within (\S+) %\), Fc (\S+) \(within (\S+) %\)", looks[-1])
    sigma0, width, most, _ = map(float, said.groups())
    found = json.loads((tmp_path / "out" / "live.json").read_text())
    assert int(looks[-1].split()[0]) == found["rows"] < 4000  # of 30000: it ended by itself
    assert found["sigma0"] == pytest.approx(SIGMA0 / FC, rel=0.005)
    assert found["Fc"] == pytest.approx(1, rel=0.005)
    assert (sigma0, most) == (float(f"{found['sigma0']:.5g}"), float(f"{found['Fc']:.5g}"))
    low, high = found["ci95"]["sigma0"]
    assert width == pytest.approx(50 * (high - low) / found["sigma0"], rel=0.1) and width < 2
    assert (tmp_path / "out" / "dahl_plan_live.h").is_file()


def test_frames_are_taken_while_somebody_works_on_one():
    """A server drops who reads too slowly. What ends the frames ends whoever waits for them."""
    taken, more = [], threading.Event()

    def frames():
        for number in range(100):
            taken.append(number)
            yield can.Message(arbitration_id=number)
        more.set()
        raise RunError("the bus has gone")

    ahead = dahl_bus.read_ahead(frames())
    assert next(ahead).arbitration_id == 0
    assert more.wait(10) and taken == list(range(100))
    assert [next(ahead).arbitration_id for _ in range(99)] == list(range(1, 100))
    with pytest.raises(RunError, match="the bus has gone"):
        next(ahead)
    assert list(dahl_bus.read_ahead(iter([None, None]))) == [None, None]


def test_who_has_enough_frames_takes_no_more():
    def frames():
        while True:
            time.sleep(0.001)
            yield None

    before = threading.active_count()
    with contextlib.closing(dahl_bus.read_ahead(frames())) as ahead:
        assert next(ahead) is None and threading.active_count() == before + 1
    assert threading.active_count() == before


def test_following_needs_signals(run_dahl):
    done = run_dahl("identify", "--follow", "-i", "virtual", "-c", "x")
    assert done.returncode == 2
    assert "--follow needs --dbc" in done.stderr
    assert run_dahl("identify", "x.csv", "--follow").returncode == 2


def test_the_table_has_each_number_under_its_name(tmp_path):
    shown = {"sigma0": 100.0, "Fc": 0.5, "r2": 0.9, "r2_coulomb": 0.8, "reversals": 9}
    ends = {"ci95": {"sigma0": [90.0, None], "Fc": [0.4, 0.6]}, "verdict": "good"}
    folder_runs.write_table(tmp_path / "x.csv", {"b": {"error": "no"}, "a": {**shown, **ends}})
    with (tmp_path / "x.csv").open(newline="") as file:
        first, second = csv.DictReader(file)
    named = ("log", "sigma0", "sigma0_low", "sigma0_high", "Fc_low", "Fc_high", "reversals")
    assert [first[name] for name in named] == ["a", "100.0", "90.0", "", "0.4", "0.6", "9"]
    assert (second["log"], second["sigma0_low"], second["error"]) == ("b", "", "no")
