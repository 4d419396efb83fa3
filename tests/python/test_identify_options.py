# SPDX-License-Identifier: MIT
"""Each option of `dahl identify` does what it says, and each number is left under its own name: in
the JSON, in the table, in the scene and in the picture.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pytest
from dahl import logs, plots, scene
from dahl.cli import build_parser
from dahl.identify import draw, output, pipeline
from dahl.identify.finding import Finding
from dahl.identify.fit import Interval
from dahl.identify.terms import torque_of
from identify_tools import COUNT, FC, SIGMA0, caller, dahl_torque, noise_of, sine, synthetic
from log_writers import DBC
from rich.console import Console

pytestmark = pytest.mark.usefixtures("library")

ROWS, LATE, OFFSET = 2000, 6, 0.2


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Path:
    """A log with an offset and a torque that comes late; the last column is the torque again, with
    a row without a number.
    """
    theta = sine(1, rows=ROWS + LATE, cycles=5)
    torque = dahl_torque(theta)[:ROWS] + OFFSET + 0.02 * FC * noise_of(1, ROWS)
    angle = np.degrees(np.floor(theta[LATE:] / COUNT) * COUNT)
    holed = np.where(np.arange(ROWS) == 700, np.nan, 2 * torque)
    path = tmp_path_factory.mktemp("rig") / "rig.csv"
    table = np.column_stack((np.arange(ROWS) * 1e-3, angle, torque, holed))
    header = "t,angle_deg,torque_Nm,friction_holed_Nm"
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def found_by(run_dahl, *words: object) -> dict:
    done = run_dahl("identify", *words, "--json", "-", "--no-files")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def usual(rig, library) -> dict:
    from dahl.identify import readers

    return output.numbers(pipeline.identify([readers.read(rig, readers.Source())]))


def test_the_log_of_these_tests_has_something_to_find(usual):
    assert usual["delay_rows"] == pytest.approx(LATE, abs=2.5)
    assert usual["extra"] == {"offset": pytest.approx(OFFSET, abs=0.01)}
    assert usual["sigma0"] == pytest.approx(SIGMA0, rel=0.15)


def scaled(usual: dict, sigma0: float, Fc: float) -> dict:  # noqa: N803
    """Both parameters in other units."""
    wanted = {"sigma0": sigma0 * usual["sigma0"], "Fc": Fc * usual["Fc"]}
    return {name: pytest.approx(value, rel=0.02) for name, value in wanted.items()}


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("--terms", "none"), lambda _: {"extra": {}}),
        (("--terms", "viscous"), lambda _: {"extra": {"viscous": pytest.approx(0, abs=1)}}),
        (("--no-delay",), lambda _: {"delay_rows": 0}),
        (("--torque-unit", "mNm"), lambda usual: scaled(usual, 1e-3, 1e-3)),
        (("--angle-unit", "rad", "--trust-units"), lambda usual: scaled(usual, np.pi / 180, 1.0)),
        (("--angle-unit", "mm"), lambda usual: {"linear": True, **scaled(usual, np.pi / 0.18, 1)}),
        (("--counts-per-turn", 8192), lambda _: {"resolution": pytest.approx(2 * COUNT)}),
        (("--torque", "4", "--skip-gaps"), lambda u: {"rows": ROWS - 1, **scaled(u, 2, 2)}),
        (("--torque", "friction_holed_Nm", "--skip-gaps"), lambda u: scaled(u, 2, 2)),
    ],
)
def test_each_option_does_what_it_says(run_dahl, rig, usual, words, wanted):
    found = found_by(run_dahl, rig, *words)
    for name, value in wanted(usual).items():
        assert found[name] == value, name


def test_a_running_median_of_so_many_rows(run_dahl, rig):
    for rows in (9, 15):
        (note,) = (
            text for text in found_by(run_dahl, rig, "--median", rows)["notes"] if "median" in text
        )
        assert f" {rows} rows" in note


def test_the_time_is_the_column_that_was_named(run_dahl, rig):
    """The torque, as a clock, goes backward; the angle is none."""
    words = ("--torque", "angle_deg", "--angle", "t", "--angle-unit", "deg", "--torque-unit", "Nm")
    done = run_dahl("identify", rig, "--time", "torque_Nm", *words, "--no-files")
    assert done.returncode == 2 and "backward" in done.stderr
    done = run_dahl("identify", rig, "--time", "angle_deg", "--no-files")
    assert done.returncode == 2 and "cannot be both angle and time" in done.stderr


def test_a_log_to_check_is_read_with_the_same_options(run_dahl, rig):
    units = ("--torque-unit", "mNm", "--torque", "4", "--skip-gaps")
    for words in ((), units):
        found = found_by(run_dahl, rig, *words, "--check", rig)
        assert found["checks"] == {str(rig): pytest.approx(found["r2"], abs=0.02)}


def test_files_go_where_they_are_asked_to(run_dahl, rig, tmp_path):
    """With --force: this torque comes late, which no plan draws."""
    words = ("--name", "my rig", "-o", tmp_path / "out", "--json", tmp_path / "numbers.json")
    words += ("--force",)
    assert run_dahl("identify", rig, *words).returncode == 0
    left = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert left == sorted(
        ["my_rig.json", "my_rig.png", "my_rig.ini", "my_rig.csv", "dahl_plan_my_rig.h"]
    )
    kept = (tmp_path / "out" / "my_rig.json").read_text()
    assert (tmp_path / "numbers.json").read_text() == kept
    done = run_dahl("identify", rig, "--no-files", "-o", tmp_path / "none")
    assert (done.returncode, (tmp_path / "none").exists()) == (0, False)


def test_the_options_hold_for_each_log_of_a_folder_too(run_dahl, rig, tmp_path, usual, monkeypatch):
    jobs, parallel = [], joblib.Parallel
    monkeypatch.setattr(
        joblib, "Parallel", lambda n_jobs, **how: jobs.append(n_jobs) or parallel(n_jobs=1, **how)
    )
    words = ("--each", rig.parent, "-o", tmp_path, "--jobs", "3", "--torque-unit", "mNm")
    done = run_dahl("identify", *words)
    assert (done.returncode, jobs) == (0, [3]), done.stderr
    with (tmp_path / "each.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["log"] == "rig.csv"
    assert {name: float(row[name]) for name in ("sigma0", "Fc")} == scaled(usual, 1e-3, 1e-3)


def test_a_cluster_that_is_not_there_is_a_failed_run(run_dahl, rig, tmp_path, monkeypatch):
    monkeypatch.setattr("dahl.identify.folder_runs.PATIENCE", 0.5)
    words = ("--each", rig.parent, "-o", tmp_path, "--dask", "tcp://127.0.0.1:9")
    done = run_dahl("identify", *words)
    assert done.returncode == 1
    assert "tcp://127.0.0.1:9" in done.stderr


def test_following_ends_after_the_time_that_was_given(run_dahl, tmp_path):
    (tmp_path / "bus.dbc").write_text(DBC)
    words = ("--dbc", tmp_path / "bus.dbc", "--angle", "Angle", "--torque", "Torque")
    done = run_dahl(
        "identify", "--follow", "-i", "virtual", "-c", "silent", *words, "--seconds", "0.3"
    )
    assert done.returncode == 2
    assert "0 valid frames" in done.stderr


@pytest.mark.parametrize(
    ("words", "taken", "refused"),
    [
        ("identify x.csv --median", ("0", "99"), ("-1", "100", "5.0")),
        ("identify --each x --jobs", ("-1", "1024"), ("-2", "1025")),
        (
            "identify --follow -i virtual -c x --within",
            ("1e-30", "1e30"),
            ("0", "-1", "nan", "inf"),
        ),
        ("identify --follow -i virtual -c x --frames", ("1", str(2**63)), ("0", str(2**63 + 1))),
        ("identify --follow -i virtual -c x --seconds", ("0.001", "1e9"), ("0.0009", "1.1e9")),
    ],
)
def test_both_sides_of_the_limits_of_a_number(words, taken, refused, capsys):
    name = words.split()[-1].strip("-")
    for text in taken:
        args = build_parser().parse_args([*words.split(), text])
        assert getattr(args, name) == float(text)
    for text in refused:
        with pytest.raises(SystemExit) as end:
            build_parser().parse_args([*words.split(), text])
        assert end.value.code == 2
        assert f"{text}: " in capsys.readouterr().err


# --- each number under its name -------------------------------------------------------------------


@pytest.fixture(scope="module")
def result(library):
    """What was found in two logs of linear motion, with a number of its own at each place."""
    made = [replace(synthetic(seed, rows=1500, cycles=5), linear=True) for seed in (1, 2)]
    made[0].notes.append("a note")
    found = pipeline.identify(made)
    terms = {"offset": 0.125, "spring": 4.5, "viscous": 0.25, "inertia": 0.0375}
    held = {"dahl": 0.9125, "coulomb": 0.5225, "none": 0.1325, "bilinear": 0.7425}
    models = replace(
        found.models,
        r2=held,
        rmse={name: part / 8 for name, part in held.items()},
        r2_coulomb=0.6125,
        bilinear_sigma0=77.0,
        terms={"dahl": list(terms), "coulomb": ["spring"]},
    )
    return replace(
        found,
        estimate=replace(found.estimate, terms=terms),
        models=models,
        r2=0.9525,
        rmse=0.0215,
        reversals=19,
        informs=0.34,
        delay=2.5,
        backlash=0.004,
        checks={"there/b.csv": 0.8325},
    )


def test_json_has_each_number_under_its_name(result):
    kept, estimate, log = (json.loads(output.as_json(result)), result.estimate, result.logs[0])
    ends = {name: [one.low, one.high] for name, one in estimate.ci95.items()}
    assert kept["ci95"] == ends
    assert kept["ci95"]["sigma0"][0] < kept["sigma0"] < kept["ci95"]["sigma0"][1]
    wanted = {
        "logs": [one.name for one in result.logs],
        "rows": 3000,
        "linear": True,
        "units": {"sigma0": "N/m", "Fc": "N", "a": "1/m"},
        "Fc": estimate.Fc,
        "a": pytest.approx(kept["sigma0"] / kept["Fc"]),
        "extra": {"offset": 0.125, "spring": 4.5, "viscous": 0.25, "inertia": 0.0375},
        "r2": 0.9525,
        "rmse": 0.0215,
        "r2_coulomb": 0.6125,
        "coulomb_extra": ["spring"],
        "bilinear_sigma0": 77.0,
        "checks": {"there/b.csv": 0.8325},
        "reversals": 19,
        "informs_sigma0": 0.34,
        "delay_rows": 2.5,
        "backlash": 0.004,
        "resolution": log.resolution,
        "identifiable": result.verdict.identifiable,
        "verdict": result.verdict.text,
        "reasons": result.verdict.reasons,
        "notes": result.notes,
    }
    assert {name: kept[name] for name in wanted} == wanted
    assert {name: one["r2"] for name, one in kept["held_out"].items()} == result.models.r2
    assert {name: one["rmse"] for name, one in kept["held_out"].items()} == result.models.rmse
    turning = replace(result, logs=[replace(one, linear=False) for one in result.logs])
    assert output.numbers(turning)["units"] == {"sigma0": "N m/rad", "Fc": "N m", "a": "1/rad"}


def test_the_table_has_each_number_under_its_name(result):
    """With its unit; which words name the models is not asked here."""
    text = io.StringIO()
    Console(file=text, width=250).print(output.table(result))
    cells = [line.split("│")[1:3] for line in text.getvalue().splitlines() if "│" in line]
    shown = {name.strip(): value.strip() for name, value in cells}
    assert all(Path(one.name).name in text.getvalue() for one in result.logs)
    for name, unit in (("sigma0", "N/m"), ("Fc", "N"), ("a", "1/m")):
        ends = result.estimate.ci95[name]
        assert shown[name].startswith(f"{getattr(result.estimate, name):.5g} {unit} ")
        assert shown[name].endswith(f"{ends.low:.5g} to {ends.high:.5g}")
    units = {"offset": "N", "spring": "N/m", "viscous": "N s/m", "inertia": "N s2/m"}
    for name, unit in units.items():
        assert shown[name] == f"{result.estimate.terms[name]:.4g} {unit}"
    for word, name in (("Dahl", "dahl"), ("Coulomb", "coulomb"), ("bilinear", "bilinear")):
        (row,) = (value for key, value in shown.items() if word in key)
        numbers = (result.models.r2[name], result.models.rmse[name])
        assert f"{numbers[0]:.4f}" in row and f"{numbers[1]:.3g} N" in row
    assert shown["verdict"] == result.verdict.text
    assert shown["reversals"] == "19"
    assert any("b.csv" in key and "0.8325" in value for key, value in shown.items())
    assert any("0.9525" in value and "0.0215 N" in value for value in shown.values())
    assert any(value.startswith("34 %") for value in shown.values())
    assert any("a note" in value for _, value in cells)


def test_the_rows_of_the_table_that_have_names_alike(result):
    text = io.StringIO()
    quality = replace(result.plan, r2=0.7775)
    Console(file=text, width=250).print(output.table(replace(result, plan=quality)))
    rows = [[cell.strip() for cell in line.split("│")[1:3]] for line in text.getvalue().split("\n")]
    shown = dict(row for row in rows if len(row) == 2)
    none = result.models
    assert shown["held out: no friction"] == f"R2 0.1325, rms {none.rmse['none']:.3g} N"
    assert shown["R2 of the plan, raw motion"] == "0.7775, friction alone"


def comment_of(header: str) -> str:
    """The words of the first comment, on one line."""
    return " ".join(header.partition("*/")[0].replace("*", " ").split())


def test_the_header_says_what_its_plan_rests_on(result):
    """Each number with its unit, each note, each objection; nothing of a fit that is not so."""
    quality = replace(result.plan, r2=0.7775, against=["it is wrong", "it is */ odd"])
    found = replace(result, plan=quality)
    words, ends = comment_of(output.header(found, "x")), result.estimate.ci95
    sigma0, force = ends["sigma0"], ends["Fc"]
    for wanted in (
        f"identified from {', '.join(Path(log.name).name for log in result.logs)}: ",
        f"{result.verdict.text}.",
        f"sigma0 [N/m] 95 %: {sigma0.low:.5g} to {sigma0.high:.5g};",
        f"Fc [N] 95 %: {force.low:.5g} to {force.high:.5g}.",
        "R2 held out 0.9125; of this plan alone on the raw motion 0.7775.",
        "theta_per_count is that of the encoder in the log",
        "FORCED, although it is wrong.",
        "FORCED, although it is / odd.",
        "Note: a note.",
    ):
        assert wanted in words
    for change, wanted in (
        ({"of_target": True}, "theta_per_count is the target's"),
        ({"theta_per_count": 0.0}, "The log shows no encoder: this plan is for dahl_step() alone."),
    ):
        words = comment_of(output.header(replace(found, plan=replace(quality, **change)), "x"))
        assert wanted in words and "of the encoder in the log" not in words
    calm = comment_of(output.header(replace(result, plan=replace(quality, against=[])), "x"))
    assert "FORCED" not in calm
    open_end = replace(ends["Fc"], high=np.inf)
    estimate = replace(result.estimate, ci95={**ends, "Fc": open_end})
    words = comment_of(output.header(replace(found, estimate=estimate), "x"))
    assert f"Fc [N] 95 %: {force.low:.5g} to no end." in words


def test_the_scene_says_what_it_rests_on(result, tmp_path):
    """No number without its verdict; the plan's own numbers, in the units of the log."""
    path = output.write_scene(result, "x", tmp_path)
    assert path == tmp_path / "x.ini"
    first, *_ = path.read_text().splitlines()
    assert first == f"; written by dahl identify: {result.verdict.text}"
    played = scene.read(path)
    assert (played.title, played.model, played.log) == ("x, identified", "dahl", "x.csv")
    assert (played.sigma0, played.Fc) == (result.estimate.sigma0, result.estimate.Fc)
    assert played.measured.label_torque == "friction [N]"
    assert (played.measured.offset, played.measured.spring) == (0.125, 4.5)
    turning = replace(result, logs=[replace(log, linear=False) for log in result.logs])
    output.write_scene(turning, "y", tmp_path)
    played = scene.read(tmp_path / "y.ini")
    assert (played.motion["angle"], played.measured.torque) == ("theta_rad", "torque_Nm")
    assert played.measured.label_angle.endswith("[rad]")
    assert played.measured.label_torque == "friction [N m]"


def test_the_scene_of_a_log_without_an_encoder_counts_finely(result, tmp_path):
    """A thousandth of a presliding length; what is short of five lengths is not left out."""
    log = replace(result.logs[0], resolution=0.0).head(20)
    bare = replace(result, logs=[log])
    output.write_scene(bare, "x", tmp_path)
    played = scene.read(tmp_path / "x.ini")
    assert played.theta_per_count == pytest.approx(1e-3 / result.estimate.a)
    assert float(played.motion["counts_per_unit"]) == pytest.approx(1e3 * result.estimate.a)
    assert np.abs(log.moves).sum() < 5 / result.estimate.a and played.measured.settle == 0


def test_a_scene_replays_the_first_rows_of_a_long_log(result, tmp_path, monkeypatch):
    monkeypatch.setattr(output, "REPLAYED", 1000)
    output.write_scene(result, "x", tmp_path)
    assert len((tmp_path / "x.csv").read_text().splitlines()) == 1001


@pytest.mark.parametrize(("inner", "median"), [(True, 1), (False, 9)])
def test_json_says_how_a_log_was_treated(result, inner, median):
    """Under its own name, what the fit did: weights, pieces, findings, options, sign."""
    weights = np.ones(1500)
    weights[:7] = 0.5
    name = result.logs[0].name  # two pieces of one log
    logs = [replace(result.logs[0], weight=weights), replace(result.logs[1].head(400), name=name)]
    said = [Finding("this", ("Fc",)), Finding("that")]
    found = replace(result, logs=logs, findings=said, sign=-1.0, inner=inner, median=median)
    options = {"terms": ["offset"], "delay": False, "median": 0, "model": ""}
    kept = json.loads(output.as_json(replace(found, options=options)))
    wanted = {
        "logs": [name],
        "rows": 1900,
        "pieces": [1500, 400],
        "rows_weighing_less": 7,
        "sum_of_weights": result.estimate.rows,
        "torque_sign": -1.0,
        "angle_between_counts": inner,
        "median_rows": median,
        "options": options,
        "findings": [{"text": "this", "doubts": ["Fc"]}, {"text": "that", "doubts": []}],
        "r2_plan": result.plan.r2,
        "plan": {
            "theta_per_count": result.plan.theta_per_count,
            "of_target": False,
            "against": result.plan.against,
        },
    }
    assert {name: kept[name] for name in wanted} == wanted
    assert kept["cycles"]["first_row"] == result.cycles.rows.tolist()
    for name in ("Fc", "sigma0", "offset"):
        assert kept["cycles"][name] == result.cycles.value[name].tolist()


def test_the_scene_and_its_log_are_those_of_the_first_log(result, tmp_path):
    """From its first angle, without the terms that a scene does not know."""
    log, estimate = result.logs[0], result.estimate
    output.write_scene(result, "x", tmp_path)
    played = scene.read(tmp_path / "x.ini")
    table = logs.read_table(tmp_path / played.log, [played.motion["angle"], played.measured.torque])
    angle, torque = table.values()
    assert angle == pytest.approx(log.theta - log.theta[0], abs=1e-9)
    timed = {name: estimate.terms[name] for name in ("viscous", "inertia")}
    assert torque == pytest.approx(log.torque - torque_of(log, timed), abs=1e-7)
    assert played.theta_per_count == pytest.approx(log.resolution)
    assert float(played.motion["counts_per_unit"]) == pytest.approx(1 / log.resolution)
    assert (played.measured.unit, played.measured.torque_scale) == ("N", 1.0)
    assert played.measured.label_angle == "position from the start [mm]"
    assert played.measured.angle_scale == 1000.0
    gone = np.cumsum(np.abs(log.moves))[played.measured.settle]
    assert gone == pytest.approx(5 / estimate.a, rel=0.05)


@pytest.fixture
def picture(tmp_path, monkeypatch):
    """The panels of the picture of a result by what they show."""
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path: figures.append(figure))

    def panels(result):
        draw.draw(tmp_path / "x.png", result)
        names = ("residual", "by speed", "Fc", "sigma0", "loop", "cost")
        return dict(zip(names, figures[-1].axes, strict=True))

    return panels


@pytest.mark.parametrize("timed", [True, False])
def test_the_picture_shows_the_log_and_its_fit(result, picture, timed):
    log, raw = result.logs[0], result.raw[0]
    kept = log if timed else replace(log, time=None)
    sign, load = (1.0, -1.0)[timed], {"offset": 0.125, "spring": 4.5}
    result = replace(result, logs=[kept, *result.logs[1:]], sign=sign)
    panels = picture(result)
    loop, size = panels["loop"], 1e-3 if "[mm]" in panels["loop"].get_xlabel() else 1.0
    legend = [text.get_text() for text in loop.get_legend().get_texts()]
    lines = dict(zip(legend, (line.get_xydata().T for line in loop.lines), strict=True))
    way = np.sign(np.diff(log.theta, prepend=log.theta[0]))
    slides = way != 0  # where it rests, the sign of the last move stays
    coulomb = result.estimate.Fc * way + load["offset"] + load["spring"] * (log.theta - log.zero)
    assert lines["Coulomb"][1][slides] == pytest.approx(coulomb[slides])
    for name, theta, torque in (
        ("as measured", raw.theta, sign * raw.torque),
        ("fitted", log.theta, result.predicted[0]),
        ("Coulomb", log.theta, lines["Coulomb"][1]),
    ):
        assert lines[name][0] == pytest.approx((theta - raw.theta[0]) / size)
        assert lines[name][1] == pytest.approx(torque)
    assert loop.get_ylabel().endswith("[N]")
    x, left = panels["residual"].lines[0].get_xydata().T
    assert x == pytest.approx((raw.theta - raw.theta[0]) / size)
    assert left == pytest.approx(log.torque - result.predicted[0])
    speed, same = panels["by speed"].lines[0].get_xydata().T
    smooth = np.convolve(log.theta, np.full(9, 1 / 9), mode="same") / size
    apart = np.gradient(smooth, 1e-3 if timed else 1)
    assert speed[9:-9] == pytest.approx(apart[9:-9]) and same.tolist() == left.tolist()
    assert panels["by speed"].get_xlabel().endswith("/s]" if timed else "/row]")


@pytest.mark.parametrize(
    ("linear", "way", "push"),
    [(True, "position {} [mm]", "force [N]"), (False, "angle {} [rad]", "torque [N m]")],
)
def test_the_axes_of_the_picture_say_what_they_show(result, picture, linear, way, push):
    both = {"logs": result.logs, "raw": result.raw}
    kinds = {name: [replace(log, linear=linear) for log in logs] for name, logs in both.items()}
    panels = picture(replace(result, **kinds))
    axes = {name: (one.get_xlabel(), one.get_ylabel()) for name, one in panels.items()}
    way, unit = way.format("from the start"), "N" if linear else "N m"
    assert axes["loop"] == (way, push)
    assert axes["residual"] == (way, f"residual [{unit}]")
    assert axes["by speed"] == (f"speed [{'mm' if linear else 'rad'}/s]", f"residual [{unit}]")
    assert axes["cost"][0] == f"sigma0 [{'N/m' if linear else 'N m/rad'}]"
    assert (axes["Fc"][1], axes["sigma0"][1]) == (f"Fc [{unit}]", axes["cost"][0])


def test_the_cost_is_drawn_beyond_a_wide_interval(result, picture):
    """From 0.7 of its lower to 1.3 of its upper end, at most from a fifth to 5 times sigma0."""
    sigma0 = result.estimate.sigma0
    for low, high, first, last in ((0.5, 3, 0.35, 3.9), (0.1, 9, 0.2, 5)):
        ci95 = result.estimate.ci95 | {"sigma0": Interval(low * sigma0, high * sigma0)}
        cost = picture(replace(result, estimate=replace(result.estimate, ci95=ci95)))["cost"]
        values = cost.lines[0].get_xdata() / sigma0
        assert (values[0], values[-1]) == pytest.approx((first, last))
        span = cost.patches[0].get_extents().transformed(cost.transData.inverted())
        ends = (max(low, first) * sigma0, min(high, last) * sigma0)
        assert (span.x0, span.x1) == pytest.approx(ends)


def test_the_picture_shows_the_numbers_and_their_interval(result, picture):
    panels = picture(result)
    loop, cost = panels["loop"], panels["cost"]
    ends, estimate = result.estimate.ci95["sigma0"], result.estimate
    span = cost.patches[0].get_extents().transformed(cost.transData.inverted())
    assert (span.x0, span.x1) == pytest.approx((ends.low, ends.high), rel=1e-6)
    values, least = cost.lines[0].get_xydata().T
    assert values[np.argmin(least)] == pytest.approx(estimate.sigma0, rel=0.02)
    assert least.min() == pytest.approx(1, abs=1e-3)  # over the least of all
    assert cost.get_xlabel().endswith("[N/m]")
    title = loop.figure.get_suptitle()
    assert f"{estimate.sigma0:.4g} N/m" in title and f"{estimate.Fc:.4g} N" in title
    assert loop.get_title(loc="left") == result.verdict.text
    for name, unit in (("sigma0", "N/m"), ("Fc", "N")):
        axes, ends = panels[name], estimate.ci95[name]
        whole, each = axes.lines
        assert whole.get_ydata()[0] == getattr(estimate, name)
        assert each.get_xdata().tolist() == list(range(1, len(result.cycles) + 1))
        assert each.get_ydata().tolist() == result.cycles.value[name].tolist()
        band = axes.patches[0].get_extents().transformed(axes.transData.inverted())
        assert (band.y0, band.y1) == pytest.approx((ends.low, ends.high), rel=1e-6)
        assert axes.get_ylabel() == f"{name} [{unit}]"
