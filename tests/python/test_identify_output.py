# SPDX-License-Identifier: MIT
"""What `dahl identify` leaves: numbers under their own names in JSON, on the screen and in the
header, a plan that is dahl_prepare()'s, a scene that replays the log, a picture of log and fit.

One rig, linear, with an offset, a spring, viscous friction and inertia, all of them known.
"""

from __future__ import annotations

import configparser
import json
import re
import subprocess
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import built
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, springs, write_csv
from log_reading import drawing, run

pytestmark = pytest.mark.usefixtures("library")

ROWS, NOISE = 6000, 0.02
TERMS = {"offset": 0.125, "spring": 4.5, "viscous": 0.25, "inertia": 0.0375}  # N, m and s
UNITS = {"offset": "N", "spring": "N/m", "viscous": "N s/m", "inertia": "N s2/m"}
TIME = np.arange(ROWS) * 1e-3


def way_of(seed: int) -> np.ndarray:
    """A sine whose frequency grows, m."""
    x = np.linspace(0, 1, ROWS)
    return 0.15 * np.sin(2 * np.pi * (2 * x + 5 * x**2) + seed)


def force_of(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Friction alone, and what the sensor shows."""
    way = way_of(seed)
    speed = np.gradient(way, TIME)
    beside = TERMS["offset"] + TERMS["spring"] * (way - way_of(1)[0])
    beside = beside + TERMS["viscous"] * speed + TERMS["inertia"] * np.gradient(speed, TIME)
    friction = dahl_torque(way) + NOISE * FC * noise_of(seed, ROWS)
    return friction, friction + beside


def write_log(folder: Path, seed: int) -> Path:
    path, table = folder / f"{seed}.csv", np.column_stack((TIME, 1e3 * way_of(seed)))
    table = np.column_stack((table, force_of(seed)[1]))
    np.savetxt(path, table, "%.12g", ",", header="t_s,pos_mm,force_N", comments="")
    return path


@pytest.fixture(scope="module")
def rig(tmp_path_factory, library):
    """One run over two logs with two more predicted, and all that it leaves."""
    folder = tmp_path_factory.mktemp("rig")
    first, second, *others = (write_log(folder, seed) for seed in (1, 2, 3, 4))
    words = ("--model", "dahl", "--terms", ",".join(TERMS), "--counts-per-turn", "10", "--force")
    out = ("-o", folder / "out", "--name", "x", "--json", folder / "numbers.json")
    with drawing() as figures:
        check = [word for other in others for word in ("--check", other)]
        done = run("identify", first, second, *check, *words, *out)
    assert done.returncode == 0, done.stderr
    out, text = folder / "out", (folder / "numbers.json").read_text()
    assert (out / "x.json").read_text() == text
    return SimpleNamespace(
        logs=[first, second],
        checks=[*map(str, others)],
        out=out,
        kept=json.loads(text, parse_constant=pytest.fail),
        shown=done.stdout,
        figure=figures[0],
    )


# --- JSON -----------------------------------------------------------------------------------------


def test_json_has_each_number_under_its_name(rig):
    """By the truth of the rig, and by what its rows say with that truth."""
    kept, near = rig.kept, partial(pytest.approx, rel=0.01)
    assert kept["logs"] == [*map(str, rig.logs)] and kept["rows"] == 2 * ROWS
    assert kept["pieces"] == [ROWS, ROWS] and kept["linear"] is True
    assert kept["units"] == {"sigma0": "N/m", "Fc": "N", "a": "1/m"}
    assert (kept["sigma0"], kept["Fc"], kept["a"]) == (near(SIGMA0), near(FC), near(SIGMA0 / FC))
    for name, truth in {"sigma0": SIGMA0, "Fc": FC, "a": SIGMA0 / FC}.items():
        low, high = kept["ci95"][name]
        assert low < kept[name] < high and low < truth < high < 1.02 * low
    assert kept["extra"] == {name: near(value) for name, value in TERMS.items()}
    force = np.array([force_of(seed)[1] for seed in (1, 2)])
    assert kept["rmse"] == pytest.approx(NOISE * FC, rel=0.1)
    spread = np.mean((force - force.mean()) ** 2)
    assert 1 - kept["r2"] == pytest.approx(kept["rmse"] ** 2 / spread, rel=0.1)
    for name, one in kept["held_out"].items():
        assert 1 - one["r2"] == pytest.approx(one["rmse"] ** 2 / spread, rel=0.1), name
    held = [kept["held_out"][name]["rmse"] for name in ("dahl", "bilinear", "coulomb", "none")]
    assert held == sorted(held) and held[0] < 1.1 * kept["rmse"] < held[1]
    assert kept["r2_coulomb"] == pytest.approx(kept["held_out"]["coulomb"]["r2"], abs=0.005)
    assert 0.8 * SIGMA0 < kept["bilinear_sigma0"] < 1.4 * SIGMA0
    assert kept["bilinear_sigma0"] != pytest.approx(kept["sigma0"], rel=0.01)
    turns = sum(np.count_nonzero(np.diff(np.sign(np.diff(way_of(seed))))) for seed in (1, 2))
    assert kept["reversals"] == turns
    assert kept["resolution"] == kept["plan"]["theta_per_count"] == pytest.approx(1e-4)
    assert (kept["delay_rows"], kept["backlash"], kept["load"]) == (0, 0, None)
    assert kept["checks"] == dict.fromkeys(rig.checks, pytest.approx(kept["r2"], abs=0.001))
    assert kept["identifiable"] == {"sigma0": True, "Fc": True} and kept["verdict"]


def test_json_says_how_the_numbers_came_about(rig):
    kept = rig.kept
    assert kept["options"] == {
        "terms": [*TERMS],
        "delay": True,
        "median": 0,
        "trust_units": False,
        "target_counts": 0.0,
        "model": "dahl",
    }
    told = (kept["median_rows"], kept["torque_sign"], kept["angle_between_counts"])
    assert told == (1, 1.0, False)
    assert 0 < kept["rows_weighing_less"] < 60
    assert 2 * ROWS - kept["rows_weighing_less"] < kept["sum_of_weights"] < 2 * ROWS
    cycles = kept["cycles"]
    assert cycles["first_row"] == sorted(cycles["first_row"]) and len(cycles["Fc"]) == 12
    assert cycles["Fc"] == pytest.approx([FC] * 12, rel=0.02)
    assert cycles["sigma0"] == pytest.approx([SIGMA0] * 12, rel=0.05)
    assert cycles["offset"] == pytest.approx([0] * 12, abs=0.02)
    named = [note for note in kept["notes"] if note.startswith(str(rig.logs[0]))]
    assert named and len(named) < len(kept["notes"])
    assert kept["version"]
    (taken,) = (one for one in kept["choices"] if one["taken"])
    assert taken["terms"] == [*TERMS] and taken["plausible"]


def test_the_plan_alone_has_an_r2_of_its_own(rig):
    """Friction alone by the tests' own torque on the raw counts, offset and spring taken off."""
    lost = spread = 0.0
    for seed in (1, 2):
        way = np.round((way_of(seed) - way_of(seed)[0]) / 1e-4) * 1e-4
        extra = rig.kept["extra"]
        seen = force_of(seed)[1] - extra["offset"]
        seen = seen - extra["spring"] * (way_of(seed) - way_of(1)[0])
        drawn = dahl_torque(way, rig.kept["sigma0"], rig.kept["Fc"])
        start = np.exp(-rig.kept["a"] * np.cumsum(np.abs(np.diff(way, prepend=way[0]))))
        left = seen - drawn
        left = left - start * (start @ left) / (start @ start)
        lost, spread = lost + left @ left, spread + np.sum((seen - seen.mean()) ** 2)
    assert rig.kept["r2_plan"] == pytest.approx(1 - lost / spread, abs=0.002)
    (against,) = rig.kept["plan"]["against"]
    assert f"{100 * rig.kept['r2_plan']:.0f} %" in against and "90 %" in against


# --- screen and header ----------------------------------------------------------------------------


def test_the_screen_has_each_number_with_its_unit(rig):
    cells = [line.split("│")[1:3] for line in rig.shown.splitlines() if line.count("│") == 3]
    shown, kept = {name.strip(): value.strip() for name, value in cells}, rig.kept
    assert all(path.name in rig.shown for path in rig.logs)
    for name, unit in kept["units"].items():
        low, high = kept["ci95"][name]
        assert shown[name].startswith(f"{kept[name]:.5g} {unit} ")
        assert shown[name].endswith(f"{low:.5g} to {high:.5g}")
    for name, unit in UNITS.items():
        assert shown[name] == f"{kept['extra'][name]:.4g} {unit}"
    words = {"Dahl": "dahl", "Coulomb": "coulomb", "bilinear": "bilinear", "no friction": "none"}
    for word, name in words.items():
        (row,) = (value for key, value in shown.items() if key.startswith("held") and word in key)
        one = kept["held_out"][name]
        assert f"{one['r2']:.4f}" in row and f"{one['rmse']:.3g} N" in row
    values = [*shown.values()]
    assert shown["verdict"] == kept["verdict"] and shown["reversals"] == str(kept["reversals"])
    assert any(f"{kept['r2']:.4f}" in one and f"{kept['rmse']:.3g} N" in one for one in values)
    assert any(one.startswith(f"{100 * kept['informs_sigma0']:.0f} %") for one in values)
    assert f"{kept['r2_plan']:.4f}" in next(v for k, v in shown.items() if "plan" in k)
    for path in rig.checks:
        (row,) = (value for name, value in shown.items() if Path(path).name in name)
        assert f"{kept['checks'][path]:.4f}" in row
    assert all(note in rig.shown for note in kept["notes"])
    assert all(str(path) in rig.shown for path in rig.out.iterdir())


SAME = """#include <string.h>
#include "dahl_plan_x.h"
int main(void)
{
    static const dahl_params_t params = {%.9ef, %.9ef, %.9ef};
    dahl_plan_t plan;
    memset(&plan, 0, sizeof plan);
    if (dahl_prepare(&plan, &params) != DAHL_OK) { return 2; }
    return memcmp(&plan, &dahl_plan_x, sizeof plan) != 0;
}
"""


def is_plan_of(folder: Path, include: Path, *params: float) -> bool:
    """Whether dahl_plan_x.h compiles without a word and is what dahl_prepare() makes of these."""
    (folder / "main.c").write_text(SAME % tuple(map(np.float32, params)))
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{folder}", f"-I{include}"]
    command = ["gcc", *strict, folder / "main.c", built("lib", "libdahl.a"), "-lm"]
    subprocess.run([*command, "-o", folder / "same"], check=True, timeout=60)
    return subprocess.run([folder / "same"], check=False, timeout=10).returncode == 0


def comment_of(header: Path) -> str:
    """The words of the first comment, on one line."""
    text = header.read_text().partition("*/")[0]
    return " ".join(text.replace("*", " ").split())


def test_the_header_is_the_plan_of_the_numbers_and_says_what_it_rests_on(rig, root):
    kept, header = rig.kept, rig.out / "dahl_plan_x.h"
    params = (kept["sigma0"], kept["Fc"], kept["plan"]["theta_per_count"])
    assert is_plan_of(rig.out, root / "lib/include", *params)
    assert not is_plan_of(rig.out, root / "lib/include", 1.001 * params[0], *params[1:])
    words = comment_of(header)
    for name in ("sigma0", "Fc"):
        low, high = kept["ci95"][name]
        assert f"{name} [{kept['units'][name]}] 95 %: {low:.5g} to {high:.5g}" in words
    for wanted in (
        *(path.name for path in rig.logs),
        kept["verdict"],
        f"{kept['held_out']['dahl']['r2']:.4f}",
        f"{kept['r2_plan']:.4f}",
        *(f"FORCED, although {one}" for one in kept["plan"]["against"]),
        *(note.partition(": ")[2] for note in kept["notes"]),
    ):
        assert wanted in words
    assert all(len(line) <= 160 for line in header.read_text().splitlines())


# --- scene ----------------------------------------------------------------------------------------


def test_the_scene_has_the_numbers_and_its_log_is_the_first_one(rig):
    """From its first angle, without the terms that a scene does not know."""
    text = (rig.out / "x.ini").read_text()
    assert rig.kept["verdict"] in text.splitlines()[0]
    played = configparser.ConfigParser(inline_comment_prefixes=(";",))
    played.read_string(text)
    friction, motion, measured = (played[name] for name in ("friction", "motion", "measured"))
    for name in ("sigma0", "Fc"):
        assert float(friction[name]) == rig.kept[name]
    assert float(friction["theta_per_count"]) == pytest.approx(1e-4)
    assert float(motion["counts_per_unit"]) == pytest.approx(1e4)
    assert (friction["model"], motion["file"]) == ("dahl", "x.csv")
    assert played["scene"]["title"].startswith("x")
    assert {name: float(measured[name]) for name in ("offset", "spring")} == {
        name: rig.kept["extra"][name] for name in ("offset", "spring")
    }
    assert (float(measured["torque_scale"]), float(measured["angle_scale"])) == (1, 1000)
    assert measured["label_angle"].endswith("[mm]") and measured["label_torque"].endswith("[N]")
    table = np.genfromtxt(rig.out / "x.csv", delimiter=",", names=True)
    way = way_of(1)
    assert table[motion["angle"]] == pytest.approx(way - way[0], abs=1e-9)
    speed, extra = np.gradient(way, TIME), rig.kept["extra"]
    timed = extra["viscous"] * speed + extra["inertia"] * np.gradient(speed, TIME)
    inner = slice(50, -50)
    assert table[measured["torque"]][inner] == pytest.approx(
        (force_of(1)[1] - timed)[inner], abs=0.01
    )
    gone = np.cumsum(np.abs(np.diff(way, prepend=way[0])))[int(measured["settle"])]
    assert gone == pytest.approx(5 / rig.kept["a"], rel=0.05)


def test_the_scene_replays_the_log(rig, dahl_loop, tmp_path):
    """What the node then answers explains the log as the fit does."""
    words = [dahl_loop, "--scene", rig.out / "x.ini", "--virtual", "--log", tmp_path / "run.log"]
    subprocess.run([*words, "--seconds", "5"], check=True, capture_output=True, timeout=60)
    with drawing() as figures:
        done = run("plot", tmp_path / "run.log", "--scene", rig.out / "x.ini")
    assert done.returncode == 0, done.stderr
    caption = figures[0].axes[0].get_title(loc="left")
    assert float(re.search(r"R² = (\S+)", caption)[1]) > 0.999
    assert re.search(r"100\.\d+ N/m, .*0\.50\d+ N,", caption)


# --- picture --------------------------------------------------------------------------------------


def panels_of(figure) -> dict:
    names = ("residual", "by speed", "Fc", "sigma0", "loop", "cost")
    return dict(zip(names, figure.axes, strict=True))


def curves_of(axes) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_xydata().T for line in axes.lines}


def test_the_picture_shows_the_log_and_its_fit(rig):
    panels, way, (_, force) = panels_of(rig.figure), way_of(1), force_of(1)
    assert (rig.out / "x.png").read_bytes().startswith(b"\x89PNG")
    from_start, extra = 1e3 * (way - way[0]), rig.kept["extra"]
    curves = curves_of(panels["loop"])
    for name in ("as measured", "fitted", "Coulomb"):
        assert curves[name][0] == pytest.approx(from_start, abs=1e-6), name
    assert curves["as measured"][1] == pytest.approx(force, abs=1e-9)
    sign = np.sign(np.diff(way, prepend=way[0]))[1:]
    coulomb = rig.kept["Fc"] * sign + extra["offset"] + extra["spring"] * (way - way[0])[1:]
    assert curves["Coulomb"][1][1:] == pytest.approx(coulomb)
    left = force - curves["fitted"][1]
    assert left.std() == pytest.approx(rig.kept["rmse"], rel=0.05)
    for panel, x in (("residual", from_start), ("by speed", None)):
        drawn = panels[panel].lines[0].get_xydata().T
        assert drawn[1] == pytest.approx(left, abs=1e-9)
        assert x is None or drawn[0] == pytest.approx(x, abs=1e-6)
    speed = 1e3 * np.gradient(way, TIME)
    assert drawn[0][9:-9] == pytest.approx(speed[9:-9], abs=0.01 * np.abs(speed).max())


def test_the_picture_shows_the_numbers_and_their_intervals(rig):
    panels, kept = panels_of(rig.figure), rig.kept
    title = rig.figure.get_suptitle()
    assert f"{kept['sigma0']:.4g} N/m" in title and f"{kept['Fc']:.4g} N" in title
    assert panels["loop"].get_title(loc="left") == kept["verdict"]
    for name in ("sigma0", "Fc"):
        axes, ends = panels[name], kept["ci95"][name]
        whole, each = axes.lines
        assert whole.get_ydata()[0] == kept[name]
        assert each.get_xdata().tolist() == list(range(1, 13))
        assert each.get_ydata().tolist() == kept["cycles"][name]
        band = axes.patches[0].get_extents().transformed(axes.transData.inverted())
        assert (band.y0, band.y1) == pytest.approx(ends, rel=1e-6)
    cost, (low, high) = panels["cost"], kept["ci95"]["sigma0"]
    values, least = cost.lines[0].get_xydata().T
    assert (values[0], values[-1]) == pytest.approx((0.7 * low, 1.3 * high))
    assert values[np.argmin(least)] == pytest.approx(kept["sigma0"], rel=0.02)
    assert least.min() == pytest.approx(1, abs=1e-3)  # over the least of all
    band = cost.patches[0].get_extents().transformed(cost.transData.inverted())
    assert (band.x0, band.x1) == pytest.approx((low, high), rel=1e-6)


def labels_of(figure) -> dict[str, tuple[str, str]]:
    """The unit in brackets of either axis of each panel."""
    panels = panels_of(figure).items()
    return {
        name: tuple(
            "".join(re.findall(r"\[(.*)\]", words))
            for words in (one.get_xlabel(), one.get_ylabel())
        )
        for name, one in panels
    }


def test_the_axes_of_the_picture_have_their_units(rig):
    assert labels_of(rig.figure) == {
        "loop": ("mm", "N"),
        "residual": ("mm", "N"),
        "by speed": ("mm/s", "N"),
        "Fc": ("", "N"),
        "sigma0": ("", "N/m"),
        "cost": ("N/m", ""),
    }


# --- a turning shaft, another sign, no clock ------------------------------------------------------


SPIKES = np.arange(100, 4000, 40)
FITTED = {"dahl": "fitted", "slip-2": "slip K=2"}


@pytest.fixture(scope="module")
def shaft(tmp_path_factory, library):
    """A shaft without a clock, its torque with the other sign and spikes; all that it leaves."""
    folder = tmp_path_factory.mktemp("shaft")
    theta = np.floor(sine(1, rows=4000, cycles=8) / COUNT) * COUNT
    torque = -dahl_torque(theta) - 0.02 * FC * noise_of(1, 4000)
    torque[SPIKES] += 20 * FC
    path = write_csv(folder / "shaft.csv", theta, torque, "number,angle_deg,torque_Nm")
    with drawing() as figures:
        done = run("identify", path, "-o", folder, "--name", "x", "--terms", "none")
    assert done.returncode == 0, done.stderr
    kept = json.loads((folder / "x.json").read_text())
    return SimpleNamespace(out=folder, kept=kept, figure=figures[0], theta=theta, torque=torque)


def test_a_shaft_is_in_newton_metres_and_its_sign_is_told(shaft):
    kept, ini = shaft.kept, (shaft.out / "x.ini").read_text()
    assert kept["units"] == {"sigma0": "N m/rad", "Fc": "N m", "a": "1/rad"}
    assert (kept["torque_sign"], kept["linear"], kept["extra"]) == (-1.0, False, {})
    assert labels_of(shaft.figure)["by speed"] == ("rad/row", "N m")
    assert labels_of(shaft.figure)["loop"] == ("rad", "N m")
    curves = curves_of(panels_of(shaft.figure)["loop"])
    assert curves["as measured"][1] == pytest.approx(-shaft.torque, abs=1e-6)
    (odd,) = (line for name, line in curves.items() if name.startswith("weighs less"))
    rows = [np.argmin(np.abs(curves["as measured"].T - one).sum(axis=1)) for one in odd.T]
    assert {*SPIKES.tolist()} <= {*rows} and len(rows) < len(SPIKES) + 20
    assert "torque = torque_Nm" in ini and "angle = theta_rad" in ini and "[rad]" in ini


@pytest.mark.parametrize(("counts", "turn"), [(4096, 2 * np.pi), (65536, 2 * np.pi), (20, 1e-3)])
def test_the_plan_is_for_the_encoder_of_the_target(shaft, rig, counts, turn, root, tmp_path):
    """Counts a turn, of a linear motion counts a millimetre."""
    log, one = (rig.logs[0], rig) if turn == 1e-3 else (shaft.out / "shaft.csv", shaft)
    words = ("--model", "dahl", "--target-counts-per-turn", counts, "-o", tmp_path, "--name", "x")
    words += ("--terms", ",".join(one.kept["extra"]) or "none", "--no-delay", "--force")
    assert run("identify", log, *words).returncode == 0
    kept = json.loads((tmp_path / "x.json").read_text())
    assert kept["plan"]["theta_per_count"] == pytest.approx(turn / counts)
    assert (kept["plan"]["of_target"], one.kept["plan"]["of_target"]) == (True, False)
    assert turn == 1e-3 or kept["resolution"] == pytest.approx(COUNT)
    params = (kept["sigma0"], kept["Fc"], turn / counts)
    assert is_plan_of(tmp_path, root / "lib/include", *params)


def test_noise_leaves_no_plan_and_json_has_no_infinity(tmp_path):
    """One of an earlier run goes; nothing that is not a number is in the JSON."""
    theta = np.floor(sine(1, rows=4000, cycles=8) / COUNT) * COUNT
    path = write_csv(tmp_path / "noise.csv", theta, noise_of(1, 4000))
    (tmp_path / "dahl_plan_x.h").write_text("an old one")
    done = run("identify", path, "-o", tmp_path, "--name", "x")
    assert done.returncode == 0 and not (tmp_path / "dahl_plan_x.h").exists()
    kept = json.loads((tmp_path / "x.json").read_text(), parse_constant=pytest.fail)
    assert kept["identifiable"] == {"sigma0": False, "Fc": False} and kept["plan"]["against"]
    assert all(why in done.stdout for why in kept["plan"]["against"])


def test_a_log_without_an_encoder_has_a_scene_that_counts_finely(tmp_path):
    """A thousandth of a presliding length; its header is for dahl_step() alone."""
    theta = sine(1, rows=4000, cycles=8)
    path = write_csv(
        tmp_path / "free.csv", theta, dahl_torque(theta) + 0.01 * FC * noise_of(1, 4000)
    )
    words = ("--model", "dahl", "-o", tmp_path, "--name", "x", "--force")
    assert run("identify", path, *words).returncode == 0
    kept = json.loads((tmp_path / "x.json").read_text())
    (count,) = re.findall(r"theta_per_count = (\S+)", (tmp_path / "x.ini").read_text())
    assert float(count) == pytest.approx(1e-3 / kept["a"])
    assert kept["plan"]["theta_per_count"] == 0
    assert "dahl_step() alone" in comment_of(tmp_path / "dahl_plan_x.h")


@pytest.mark.parametrize("model", ["", "dahl"])
def test_the_headline_has_the_numbers_of_the_model_that_was_chosen(tmp_path, model):
    """Of the one that the plan carries first, with its R2, then Dahl's, each by its name; on the
    screen too. If Dahl's is chosen there is one line.
    """
    theta = sine(5, rows=3000, cycles=8)
    torque = springs(theta, (70, 0.3), (30, 0.3)) + 0.02 * FC * noise_of(5, 3000)
    path = write_csv(tmp_path / "slip.csv", theta, torque)
    words = ("--model", model) if model else ()
    with drawing() as figures:
        done = run("identify", path, "-o", tmp_path, "--name", "x", *words)
    kept = json.loads((tmp_path / "x.json").read_text())
    lines = figures[0].get_suptitle().replace("\n", " ").partition("slip.csv ")[2]
    head, _, dahls = lines.rpartition("Dahl: ")
    assert f"{kept['sigma0']:.4g} N m/rad" in dahls and f"{kept['Fc']:.4g} N m," in dahls
    assert f"R2 {kept['r2']:.4f}" in dahls
    chosen = next(one for one in kept["models"] if one["chosen"])
    assert (chosen["name"] == "Dahl") is (head == "") is bool(model)
    if not model:
        assert head.startswith(chosen["name"]) and f"R2 {chosen['r2']:.4f}" in head
        numbers = [part[name] for part in chosen["elements"] for name in ("sigma0", "Fc")]
        assert all(f"{number:.4g}" in head for number in numbers)
        assert head.strip() in done.stdout
    assert ("(Dahl)" in done.stdout) is (not model)


@pytest.mark.parametrize("rows", [9, -9])
@pytest.mark.parametrize("model", FITTED)
def test_each_curve_of_the_picture_lies_on_the_log_that_came_late(tmp_path, rows, model):
    """Dahl's as well as that of another model, and the marks of the rows that weigh less."""
    theta = sine(5, rows=3200, cycles=8.5)
    torque = np.roll(dahl_torque(theta), rows)[100:-100] + 0.02 * FC * noise_of(5, 3000)
    spikes = SPIKES[SPIKES < 2900]
    torque[spikes] += 2 * FC
    path = write_csv(tmp_path / "late.csv", theta[100:-100], torque)
    with drawing() as figures:
        done = run("identify", path, "-o", tmp_path, "--name", "x", "--model", model)
    assert done.returncode == 0, done.stderr
    kept = json.loads((tmp_path / "x.json").read_text())
    assert kept["delay_rows"] == pytest.approx(rows, abs=0.3)
    curves = curves_of(panels_of(figures[0])["loop"])
    (fitted,) = (one[1] for name, one in curves.items() if name.startswith(FITTED[model]))
    plain = np.isfinite(fitted)
    plain[spikes] = False
    left = (torque - fitted)[plain]
    assert plain.sum() > 2850
    assert 1 - left.var() / torque[plain].var() > 0.997  # 9 rows off: .955
    (odd,) = (curve for name, curve in curves.items() if name.startswith("weighs less"))
    on_spikes = [np.abs(odd[1] - torque[row]).min() < 1e-6 for row in spikes]
    assert np.mean(on_spikes) > 0.9


@pytest.mark.parametrize("model", ["slip-1", "dahl-2", "mixed-2", "asymmetric"])
def test_a_plan_that_goes_by_counts_alone_is_forced_with_the_count_of_the_scene(
    model, root, tmp_path
):
    """The log shows no encoder: without --force there is no plan; with it the header compiles and
    names the count, that of the scene.
    """
    theta = sine(1, rows=4000, cycles=8)
    torque = springs(theta, (60, 0.4), (40, 0.1)) + 0.01 * FC * noise_of(1, 4000)
    path = write_csv(tmp_path / "free.csv", theta, torque)
    words = ("--model", model, "-o", tmp_path, "--name", "x")
    header, scene = tmp_path / "dahl_plan_x.h", tmp_path / "x.ini"
    assert run("identify", path, *words).returncode == 0 and not header.exists()
    done = run("identify", path, *words, "--force")
    assert done.returncode == 0, done.stderr
    (against,) = (
        one
        for one in json.loads((tmp_path / "x.json").read_text())["plan"]["against"]
        if "no encoder" in one
    )
    (count,) = re.findall(r"theta_per_count = (\S+)", scene.read_text())
    (named,) = re.findall(r"theta_per_count = (\S+) rad", comment_of(header))
    assert float(named) == pytest.approx(float(count), rel=1e-5)
    assert f"FORCED, although {against}" in comment_of(header)
    check = ["gcc", "-std=c99", "-Wall", "-Werror", "-Wno-unused-const-variable", "-fsyntax-only"]
    command = [*check, f"-I{root / 'lib/include'}", "-x", "c", header]
    subprocess.run(command, check=True, timeout=60)
