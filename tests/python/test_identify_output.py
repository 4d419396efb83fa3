# SPDX-License-Identifier: MIT
"""What `dahl identify` leaves: a plan whose words are dahl_prepare()'s, a scene that replays the
log, JSON, picture, and the command's own manners.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import asdict, replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from conftest import built
from dahl import core, paths, plan_header, scene
from dahl.identify import draw, output, pipeline
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    caller,
    dahl_torque,
    noise_of,
    sine,
    synthetic,
    write_csv,
)

pytestmark = pytest.mark.usefixtures("library")

PROGRAM = """#include <stdio.h>
#include <string.h>
#include "dahl_plan_shaft.h"
int main(void)
{
    static const dahl_params_t params = {.sigma0 = %sf, .Fc = %sf, .theta_per_count = %sf};
    dahl_plan_t plan;
    memset(&plan, 0, sizeof plan);
    if (dahl_prepare(&plan, &params) != DAHL_OK) { return 2; }
    return memcmp(&plan, &dahl_plan_shaft, sizeof plan) != 0;
}
"""


@pytest.fixture(scope="module")
def found():
    return pipeline.identify([synthetic(1)])


@pytest.mark.parametrize("stem", ["$\\undefined$", "ä ö", "(1)", "+"])
def test_a_log_may_have_any_name(tmp_path, stem, capsys):
    """Dollars are no formula, and what has no letter of C is "log"."""
    log = synthetic(1, rows=2000, cycles=8)
    write_csv(tmp_path / f"{stem}.csv", log.theta, log.torque)
    run = caller(capsys)("identify", tmp_path / f"{stem}.csv", "-o", tmp_path / "out")
    assert run.returncode == 0, run.stderr
    name = {"ä ö": "log", "+": "log", "(1)": "1"}.get(stem, "undefined")
    assert (tmp_path / "out" / f"{name}.png").is_file()


def compiled(folder, root, *params: float) -> subprocess.CompletedProcess:
    """Build a program that compares dahl_plan_shaft.h with dahl_prepare(), and run it."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    assert compiler, "no C compiler"
    texts = [f"{np.float32(one):.9e}" for one in params]
    (folder / "main.c").write_text(PROGRAM % tuple(texts))
    command = [
        compiler,
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-pedantic",
        "-I",
        folder,
        "-I",
        root / "lib" / "include",
        folder / "main.c",
        built("lib", "libdahl.a"),
        "-lm",
        "-o",
        folder / "same",
    ]
    subprocess.run(list(map(str, command)), check=True, capture_output=True, timeout=60)
    return subprocess.run([folder / "same"], check=False, timeout=10)


@pytest.mark.parametrize(
    "params",
    [(SIGMA0, FC, COUNT), (36449.1, 2.69, 1e-7), (3.0, 7.5, 0.0), (1.0, 2e3, 1e-3)],
)
def test_the_plan_is_that_of_dahl_prepare(tmp_path, root, params):
    text = plan_header.text("shaft", core.Plan(*params), ["for a test"])
    (tmp_path / "dahl_plan_shaft.h").write_text(text)
    assert compiled(tmp_path, root, *params).returncode == 0
    (tmp_path / "dahl_plan_shaft.h").write_text(re.sub(r"(\d+u),", r"1u + \1,", text, count=1))
    assert compiled(tmp_path, root, *params).returncode == 1  # the comparison can fail


def test_the_plan_says_what_it_rests_on(found):
    text = output.header(found, "shaft")
    assert found.verdict.text in text
    assert "95 %" in text
    assert all(len(line) <= 160 for line in text.splitlines())


@pytest.mark.parametrize(("spikes", "good"), [(0, True), (600, False)])
def test_the_plan_has_an_r2_of_its_own_on_the_raw_motion(spikes, good, tmp_path):
    """Friction alone, from the counts as they were read, by the tests' own torque: a fit
    may take spikes out of the angle, a firmware does not.
    """
    log = synthetic(1)
    log.theta[np.random.default_rng(0).choice(log.rows, spikes, replace=False)] += 50 * COUNT
    result = pipeline.identify([log], pipeline.Options(terms=()))
    drawn = dahl_torque(log.theta, result.estimate.sigma0, result.estimate.Fc)
    settled = slice(1000, None)  # the torque at the first row is forgotten
    left = np.sum((log.torque - drawn)[settled] ** 2) / np.sum(log.torque[settled] ** 2)
    assert result.plan.r2 == pytest.approx(1 - left, abs=0.02)
    assert result.r2 > 0.98
    kept = json.loads(output.as_json(result))
    assert kept["r2_plan"] == result.plan.r2
    assert f"{result.plan.r2:.4f}" in output.header(result, "shaft")
    assert (output.write_all(result, "shaft", tmp_path)[-1].suffix == ".h") is good
    assert bool(kept["plan"]["against"]) is not good


def test_a_plan_that_is_forced_says_so(tmp_path):
    log = synthetic(1)
    log.torque = log.torque + FC * noise_of(1, log.rows)
    result = pipeline.identify([log])
    assert result.plan.against
    assert output.write_all(result, "shaft", tmp_path)[-1].suffix != ".h"
    plan = output.write_all(result, "shaft", tmp_path, force=True)[-1]
    assert "FORCED" in plan.read_text()


@pytest.mark.parametrize("counts", [0, 4096, 65536])
def test_the_plan_is_for_the_encoder_of_the_target(counts):
    result = pipeline.identify([synthetic(1)], pipeline.Options(target_counts=counts))
    assert result.plan.theta_per_count == pytest.approx(2 * np.pi / (counts or 16384))
    (said,) = re.findall(r"theta_per_count = ([0-9.e-]+);", output.header(result, "x"))
    assert float(said) == pytest.approx(result.plan.theta_per_count)
    assert json.loads(output.as_json(result))["plan"]["of_target"] is bool(counts)


def test_all_files(found, tmp_path):
    files = output.write_all(found, "shaft", tmp_path)
    assert [path.name for path in files] == [
        "shaft.json",
        "shaft.png",
        "shaft.ini",
        "dahl_plan_shaft.h",
    ]
    kept = json.loads((tmp_path / "shaft.json").read_text())
    assert kept["verdict"] == found.verdict.text
    assert kept["ci95"]["sigma0"][0] < kept["sigma0"] < kept["ci95"]["sigma0"][1]
    assert matplotlib.image.imread(tmp_path / "shaft.png").std() > 0.05


def test_the_picture_shows_what_was_taken_out_of_the_log():
    """Odd rows and the travel of backlash, at their own rows; a short linear motion in mm."""
    theta = sine(1, rows=400, cycles=2)
    log = replace(synthetic(1, rows=400, cycles=2), theta=theta, linear=True, resolution=0.0)
    log.weight, log.free_moves = np.ones(400), log.moves.copy()
    log.weight[30:40], log.free_moves[100:120] = 0.1, 0.0
    result = pipeline.identify([synthetic(1)], pipeline.Options(terms=()))
    shown = draw.shown_of(replace(result, logs=[log], raw=[log]), 0)
    (_, odd, _), (_, free, _) = draw.marks_of(shown)
    assert np.flatnonzero(odd).tolist() == list(range(30, 40))
    assert set(np.flatnonzero(free)) == set(range(100, 120))
    assert shown.unit == "mm"
    assert np.ptp(shown.angle) == pytest.approx(1e3 * np.ptp(log.theta))
    assert shown.speed[10:-10] == pytest.approx(1e3 * np.gradient(log.theta, 1e-3)[10:-10], abs=20)


def test_json_says_how_the_numbers_came_about(found):
    kept = json.loads(output.as_json(found))
    assert kept["options"] == asdict(pipeline.Options())
    assert kept["pieces"] == [log.rows for log in found.logs]
    assert kept["median_rows"] == found.median
    assert len(kept["cycles"]["Fc"]) == len(kept["cycles"]["first_row"]) == 9
    assert kept["cycles"]["Fc"] == pytest.approx([FC] * 9, rel=0.02)
    assert kept["version"]


def test_no_plan_where_it_cannot_be_trusted(tmp_path):
    log = synthetic(1)
    log.torque = noise_of(1, log.rows)
    (tmp_path / "dahl_plan_noise.h").write_text("an old one")
    files = output.write_all(pipeline.identify([log]), "noise", tmp_path)
    assert all(path.suffix != ".h" for path in files)
    assert not (tmp_path / "dahl_plan_noise.h").exists()


def test_an_interrupted_run_leaves_whole_files(found, tmp_path, monkeypatch):
    """Cut off while each file in turn is put in its place: the old one is there, or the new one."""
    output.write_all(found, "shaft", tmp_path)
    whole = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    put = Path.replace
    for last in ("shaft.json", "shaft.csv", "shaft.ini", "dahl_plan_shaft.h"):

        def cut(part, target, last=last):
            if target.name == last:
                raise KeyboardInterrupt
            return put(part, target)

        monkeypatch.setattr(Path, "replace", cut)
        with pytest.raises(KeyboardInterrupt):
            output.write_all(found, "shaft", tmp_path)
        for name, content in whole.items():
            if name.endswith((".json", ".csv", ".ini")):
                assert (tmp_path / name).read_bytes() == content
        assert not (tmp_path / "dahl_plan_shaft.h").exists()


def test_json_has_no_infinity(tmp_path):
    log = synthetic(1)
    log.torque = noise_of(1, log.rows)
    text = output.as_json(pipeline.identify([log]))
    assert json.loads(text, parse_constant=pytest.fail)


def test_the_scene_replays_the_log(found, tmp_path, run_dahl, dahl_loop):
    output.write_all(found, "shaft", tmp_path)
    played = scene.read(tmp_path / "shaft.ini")
    assert (played.sigma0, played.Fc) == (found.estimate.sigma0, found.estimate.Fc)
    run = subprocess.run(
        [
            dahl_loop,
            "--scene",
            tmp_path / "shaft.ini",
            "--virtual",
            "--seconds",
            "3",
            "--log",
            tmp_path / "run.log",
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    from dahl import logs, report

    trace = report.trace_of(logs.read_candump(tmp_path / "run.log"))
    recorded = scene.read_log(played, tmp_path / "shaft.csv")
    assert report.fit(played, trace, recorded)["r2_measured"] > 0.99


def test_offset_and_spring_go_into_the_scene(found, tmp_path):
    terms = {"offset": 0.25, "spring": 4.0, "viscous": 0.5}
    output.write_scene(replace(found, estimate=replace(found.estimate, terms=terms)), "x", tmp_path)
    measured = scene.read(tmp_path / "x.ini").measured
    assert (measured.offset, measured.spring) == (0.25, 4.0)


def test_the_command(run_dahl, tmp_path):
    theta = np.floor(sine(1) / COUNT) * COUNT
    path = write_csv(
        tmp_path / "my shaft.csv",
        theta,
        dahl_torque(theta) + 0.03 * FC * noise_of(1, len(theta)),
    )
    done = run_dahl(
        "identify",
        path,
        "--counts-per-turn",
        "16384",
        "-o",
        tmp_path / "out",
        "--json",
        tmp_path / "numbers.json",
    )
    assert done.returncode == 0, done.stderr
    assert "sigma0 and Fc identifiable" in done.stdout
    found = json.loads((tmp_path / "numbers.json").read_text())
    assert found["resolution"] == pytest.approx(COUNT)
    assert (tmp_path / "out" / "dahl_plan_my_shaft.h").is_file()
    assert "-Werror" not in done.stdout
    check = run_dahl("identify", path, "--check", path, "--json", "-", "--no-files")
    assert json.loads(check.stdout)["checks"][str(path)] > 0.98


def test_help_is_quick_to_import(run_dahl):
    """The heavy packages are not imported for --help."""
    done = run_dahl("identify", "--help")
    assert done.returncode == 0
    assert "examples:" in done.stdout
    code = (
        "import sys; from dahl.cli import build_parser; build_parser();"
        "print([m for m in ('scipy', 'pandas', 'asammdf', 'dask', 'joblib', 'can')"
        " if m in sys.modules])"
    )
    import os
    import sys

    loaded = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        cwd=paths.ROOT,
        env=os.environ,
    )
    assert loaded.stdout.strip() == "[]"


def test_no_file_of_someone_else_is_overwritten(dahl, tmp_path):
    """A table or a scene of the name of the log is spared; those of an earlier run are replaced."""
    log = synthetic(1, rows=2000, cycles=8)
    write_csv(Path("rig.tsv"), log.theta, log.torque)
    Path("rig.ini").write_text("[scene]\ntitle = mine\n")
    done = dahl("identify", "rig.tsv", "-o", ".")
    words = "there already, and not written by dahl; use --name\n"
    assert (done.returncode, done.stderr) == (2, f"error: rig.ini: {words}")
    assert dahl("identify", "rig.tsv", "-o", ".", "--no-files").returncode == 0
    Path("rig.ini").rename("rig.csv")
    done = dahl("identify", "rig.tsv", "-o", ".")
    assert (done.returncode, done.stderr) == (2, f"error: rig.csv: {words}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.csv", "rig.tsv"]
    for _ in range(2):
        assert dahl("identify", "rig.tsv", "-o", ".", "--name", "a").returncode == 0


@pytest.mark.parametrize("end", ["csv", "json"])
def test_no_file_that_is_written_is_a_log_that_is_read(dahl, end):
    log = synthetic(1, rows=2000, cycles=8)
    write_csv(Path("rig.csv"), log.theta, log.torque)
    before = Path("rig.csv").read_bytes()
    way = {"csv": ("-o", "."), "json": ("--json", "./rig.csv", "--no-files")}[end]
    done = dahl("identify", "rig.csv", *way)
    what = {"csv": "what is written into .", "json": "--json ./rig.csv"}[end]
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: rig.csv: {what} would destroy it")
    assert Path("rig.csv").read_bytes() == before
