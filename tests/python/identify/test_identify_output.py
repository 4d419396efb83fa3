# SPDX-License-Identifier: MIT
"""The output of `dahl identify`: numbers in JSON, on the screen and in the header, a plan equal to
that of dahl_prepare(), a scene that replays the log, a picture of log and fit.

Most tests share a linear rig with known offset, spring, viscous friction and inertia.
"""

import configparser
import json
import re
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest
from dahl import Plan, __version__
from dahl.binding import plan_header
from dahl.binding.state_element import Asymmetric, Stribeck
from dahl.identify import Log, Options, export, identify, plot, report
from dahl.identify.laws import LAWS
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    dahl_torque,
    log_of,
    noise_of,
    replayed_r2,
    seen,
    sine,
    springs,
    turns_of,
    write_csv,
    write_table,
)
from log_reading import drawing, run

ROWS, NOISE = 3000, 0.02
TERMS = {"offset": 0.125, "spring": 4.5, "viscous": 0.25, "inertia": 0.0375}  # N, m and s
UNITS = {"offset": "N", "spring": "N/m", "viscous": "N s/m", "inertia": "N s2/m"}
TIME = np.arange(ROWS) * 1e-3


def way_of(seed: int) -> np.ndarray:
    """Return a sine of rising frequency around 0, m."""
    x = np.linspace(0, 1, ROWS)
    return 0.15 * np.sin(2 * np.pi * (2 * x + 5 * x**2) + seed)


def columns_of(seed: int) -> np.ndarray:
    """Return offset, spring, viscous friction and inertia with coefficients of 1: (ROWS, 4)."""
    way = way_of(seed)
    speed = np.gradient(way, TIME)
    return np.column_stack((np.ones(ROWS), way, speed, np.gradient(speed, TIME)))


def force_of(seed: int) -> np.ndarray:
    noise = NOISE * FC * noise_of(seed, ROWS)
    return dahl_torque(way_of(seed)) + noise + columns_of(seed) @ [*TERMS.values()]


def write_log(folder: Path, seed: int) -> Path:
    columns = {"t_s": TIME, "pos_mm": 1e3 * way_of(seed), "force_N": force_of(seed)}
    return write_table(folder / f"{seed} of the left rig in the second hall.csv", columns)


@pytest.fixture(scope="module")
def rig(tmp_path_factory, library):
    """One run over two logs that predicts a third one, and its output."""
    folder = tmp_path_factory.mktemp("rig")
    first, second, other = (write_log(folder, seed) for seed in (1, 2, 3))
    words = ("--model", "dahl", "--terms", ",".join(TERMS), "--counts-per-turn", "10", "--force")
    out = ("-o", folder / "out", "--name", "x", "--json", folder / "numbers.json")
    with drawing() as figures:
        done = run("identify", first, second, "--check", other, *words, *out)
    assert done.returncode == 0, done.stderr
    out, text = folder / "out", (folder / "numbers.json").read_text()
    assert (out / "x.json").read_text() == text and text.endswith("}\n")
    return SimpleNamespace(
        logs=[first, second],
        check=str(other),
        out=out,
        kept=json.loads(text, parse_constant=pytest.fail),
        shown=done.stdout,
        figure=figures[0],
    )


MOTION = sine(2, rows=2400, cycles=9)


SPEED = np.gradient(MOTION, 1e-3)
SLOW = np.exp(-((SPEED / (0.15 * np.abs(SPEED).max())) ** 2))


def each_way() -> np.ndarray:
    limits = np.where(np.diff(MOTION, prepend=MOTION[0]) > 0, 1.25 * FC, 0.75 * FC)
    return dahl_torque(MOTION, SIGMA0, limits)


# --- JSON -----------------------------------------------------------------------------------------


def within(low: float, high: float) -> Any:
    return pytest.approx((low + high) / 2, abs=(high - low) / 2)


def statistics() -> SimpleNamespace:
    """Return statistics of both logs by the true friction and least squares."""
    ways, force = [way_of(1), way_of(2)], np.concatenate([force_of(1), force_of(2)])
    terms = np.concatenate([columns_of(1), columns_of(2)])
    friction = np.concatenate([dahl_torque(way) for way in ways])
    speed = np.concatenate([np.gradient(way) for way in ways])

    def rms_left_by(*columns: np.ndarray) -> float:
        _, (left,), *_ = np.linalg.lstsq(np.column_stack((*columns, terms)), force, rcond=None)
        return np.sqrt(left / len(force))

    near = [(1.01 * SIGMA0, FC), (0.99 * SIGMA0, FC), (SIGMA0, 1.01 * FC), (SIGMA0, 0.99 * FC)]
    varied = [np.concatenate([dahl_torque(way, *params) for way in ways]) for params in near]
    by_both = [(varied[0] - varied[1]) / (0.02 * SIGMA0), (varied[2] - varied[3]) / (0.02 * FC)]
    jacobian = np.column_stack((*by_both, terms))
    errors = NOISE * FC * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    noise = force - friction - terms @ [*TERMS.values()]
    return SimpleNamespace(
        spread=force.std(),
        rms={"dahl": NOISE * FC, "coulomb": rms_left_by(np.sign(speed)), "none": rms_left_by()},
        errors=dict(zip(("sigma0", "Fc", *TERMS), errors.tolist(), strict=True)),
        turns=[k * ROWS + turns_of(way) for k, way in enumerate(ways)],
        steep=np.mean(1 - np.sign(speed) * friction / FC > 0.1),
        plan_r2=1 - np.sum(noise**2) / np.sum((noise + friction) ** 2),
    )


INSTRUCTIONS = {  # of docs/microcontroller.md; None if the library lacks the law
    "Dahl": 20,
    "asymmetric": 33,
    "slip K=1": 38,
    "slip K=2": 56,
    "Dahl K=2": 63,
    "mixed K=2": 91,
    **dict.fromkeys(("general exponent", "Bouc-Wen", "soft shaft"), None),
    "logarithm of speed": None,
    "Stribeck": 202,
}


def test_json_has_each_number_under_its_name(rig):
    """Compare all keys with the parameters of the rig and with statistics of its logs."""
    kept, s = rig.kept, statistics()
    truth = {"sigma0": SIGMA0, "Fc": FC, "a": SIGMA0 / FC}
    near = {name: pytest.approx(value, rel=0.02) for name, value in (truth | TERMS).items()}
    both, terms = ({name: near[name] for name in names} for names in (("sigma0", "Fc"), TERMS))
    of_r2 = {name: 1 - (rms / s.spread) ** 2 for name, rms in s.rms.items()}
    r2 = pytest.approx(of_r2["dahl"], abs=2e-5)
    held = {
        name: {"rmse": pytest.approx(rms, rel=0.1), "r2": pytest.approx(of_r2[name], abs=0.01)}
        for name, rms in s.rms.items()
    }
    of_dahl = held["dahl"]["rmse"]
    slip = {"rmse": within(1.5 * NOISE * FC, s.rms["coulomb"]), "r2": within(0.99, 1)}
    errors = {name: within(0.4 * s.errors[name], 12 * s.errors[name]) for name in TERMS}
    turns = sum(map(len, s.turns))
    ranges = [np.ptp(np.concatenate([columns_of(1)[:, k], columns_of(2)[:, k]])) for k in range(4)]
    sizes = {
        f"{name}_torque": pytest.approx(value * (size / 2 or 1), rel=0.1)
        for (name, value), size in zip(TERMS.items(), ranges, strict=True)
    }
    assert kept == {
        "logs": [*map(str, rig.logs)],
        "rows": 2 * ROWS,
        "pieces": [ROWS, ROWS],
        "units": {"sigma0": "N/m", "Fc": "N", "a": "1/m"},
        **{name: near[name] for name in truth},
        "ci95": {name: [within(0.96 * x, x), within(x, 1.04 * x)] for name, x in truth.items()},
        "Fc_low": kept["ci95"]["Fc"][0],
        "length_long": pytest.approx(1 / kept["ci95"]["a"][0]),
        "sigma0_high": kept["ci95"]["sigma0"][1],
        "uncertainty": {"sigma0": "noise", "Fc": "noise"},
        "identifiable": {"sigma0": True, "Fc": True},
        "extra": terms,
        "extra_standard_errors": errors,
        "r2": r2,
        "rmse": of_dahl,
        "held_out": {**held, "bilinear": slip},
        "r2_coulomb": kept["held_out"]["coulomb"]["r2"],
        "coulomb_extra": [*TERMS],
        "bilinear_sigma0": within(0.7 * SIGMA0, 1.1 * SIGMA0),
        "checks": {rig.check: r2},
        "reversals": turns,
        "rows_used": 2 * ROWS,
        "informs_sigma0": pytest.approx(s.steep, rel=0.1),
        "cycles_scored": turns // 2,
        "delay_rows_standard_error": within(0, 0.5),  # of fits with a skew of half a row
        "resolution": pytest.approx(1e-4),
        "r2_plan": pytest.approx(s.plan_r2, abs=0.02),
        "plan": {
            "sigma0": [near["sigma0"]],
            "Fc": [near["Fc"]],
            "theta_per_count": pytest.approx(1e-4),
            "of_target": False,
            "against": [],
        },
        "other_torques": sizes,
        "load": None,
        "version": __version__,
        "options": vars(Options(terms=[*TERMS], model="dahl")),
        "rows_weighing_less": within(0, 60),
        "sum_of_weights": within(1.7 * ROWS, 2 * ROWS),
        "exported_model_lost_r2": within(0, 1e-5),
        "cycles": dict.fromkeys(("first_row", "sigma0", "Fc", "offset"), ANY),
        **dict.fromkeys(("linear", "angle_between_counts"), True),
        **dict.fromkeys(("delay_rows", "backlash", "median_rows"), 0),
        **dict.fromkeys(("torque_sign", "rows_per_sample"), 1),
        **dict.fromkeys(("reasons", "findings"), []),
        "next_steps": {},
        "against_bounds": "",
        **dict.fromkeys(("model", "exported_model"), "Dahl"),
        **dict.fromkeys(("verdict", "notes", "models", "choices"), ANY),
    }
    cycles = kept["cycles"]
    for name in both:
        low, high = kept["ci95"][name]
        assert low < truth[name] < high and high - low > 3 * s.errors[name]
    for name in ("sigma0", "Fc", "offset"):
        assert np.median(cycles[name]) == near[name]
    to_turns = np.array(cycles["first_row"])[1:, None] - np.concatenate(s.turns)
    assert (np.diff(cycles["first_row"]) > 0).all() and np.median(np.abs(to_turns).min(axis=1)) < 3
    best = {one["model"]: one["r2"] for one in sorted(kept["choices"], key=lambda one: one["r2"])}
    for one in kept["models"]:
        name, ticks = one["name"], INSTRUCTIONS[one["name"]]
        assert one == {
            "name": name,
            "chosen": name == "Dahl",
            "parts": [{"kind": "dahl", **both}] if name == "Dahl" else ANY,
            "r2": pytest.approx(best[name], abs=1e-6) if name in best else within(0.999, 1),
            "delay_rows": within(-0.5, 0.5),
            "extra": {term: pytest.approx(x, rel=0.06) for term, x in TERMS.items()},
            "instructions_m3": ticks,
            "in_library": ticks is not None,
        }
    taken = {"model": "Dahl", "lag": "none", "angle": "between counts", "terms": [*TERMS]}
    taken |= {"r2": r2, **both, "plausible": True, "taken": True}
    assert [one for one in kept["choices"] if one["taken"]] == [taken]


POWERS = {  # of the units of torque, angle and time, by the last name in a path of JSON
    **dict.fromkeys("sigma0 spring bilinear_sigma0 sigma0_high".split(), (1, -1, 0)),
    **dict.fromkeys("Fc rmse offset Fc_low Fc_forward Fc_backward".split(), (1, 0, 0)),
    **dict.fromkeys(
        (f"{name}_torque" for name in ("offset", "spring", "viscous", "inertia")), (1, 0, 0)
    ),
    **dict.fromkeys("length_long resolution theta_per_count backlash".split(), (0, 1, 0)),
    "viscous": (1, -1, 1),
    "inertia": (1, -1, 2),
    "a": (0, -1, 0),
}


def numbers_in(kept: object, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers of JSON with the last name of their path."""
    if isinstance(kept, (dict, list)):
        pairs = kept.items() if isinstance(kept, dict) else ((name, one) for one in kept)
        for key, one in pairs:
            yield from numbers_in(one, key)
    elif isinstance(kept, (int, float)) and not isinstance(kept, bool):
        yield name, float(kept)


def test_all_numbers_follow_the_units_of_torque_angle_and_time():
    """64 times the torque by a turned sensor, an eighth of the angle and four times the seconds
    give the same fits; another origin changes the results by roundings.
    """
    log = log_of(MOTION, each_way() + 4 * MOTION)
    other = replace(log, torque=-64 * log.torque, theta=log.theta / 8, resolution=COUNT / 8)
    shifted = replace(log, theta=log.theta + 4321 * COUNT, time=log.time + 5)
    logs = log, replace(other, time=4 * log.time), shifted
    options = {"terms": tuple(TERMS), "delay": False, "trust_units": True}
    first, second, third = (seen(one, **options) for one in logs)
    for name in ("sigma0", "Fc", "r2", "r2_plan"):
        assert third[name] == pytest.approx(first[name], rel=1e-3)
    assert (first["torque_sign"], second.pop("torque_sign")) == (1, -first.pop("torque_sign"))
    pairs = [*zip(numbers_in(first), numbers_in(second), strict=True)]
    assert len(pairs) > 200 and first["model"] == second["model"] == "asymmetric"
    for (name, one), (same, two) in pairs:
        torque, angle, time = POWERS.get(name, (0, 0, 0))
        factor = 64**torque / 8**angle * 4**time
        assert name == same and two == pytest.approx(one * factor, rel=1e-6), name


# --- screen and header ----------------------------------------------------------------------------


def cells_of(shown: str) -> dict[str, str]:
    found: dict[str, str] = {}
    name = ""
    for line in shown.splitlines():
        if line.count("│") == 3:
            first, words = (cell.strip() for cell in line.split("│")[1:3])
            name = first or name
            found[name] = f"{found.get(name, '')} {words}".strip()
    return found


def test_the_screen_begins_with_the_verdict_and_has_each_number_with_its_unit(rig):
    shown, kept = cells_of(rig.shown), rig.kept
    assert next(iter(shown)) == "verdict"
    rows = {"verdict": kept["verdict"], "law": kept["model"], "note": " ".join(kept["notes"])}
    for name, unit in kept["units"].items():
        low, high = kept["ci95"][name]
        rows[name] = f"{kept[name]:.5g} {unit}, 95 %: {low:.5g} to {high:.5g}"
    bounds = f"Fc_low {kept['Fc_low']:.5g} N, length_long {kept['length_long']:.5g} m"
    bounds += f", sigma0_high {kept['sigma0_high']:.5g} N/m"
    rows |= {name: f"{kept['extra'][name]:.4g} {unit}" for name, unit in UNITS.items()}
    left_out = f"{kept['held_out']['dahl']['r2']:.4f} of {kept['cycles_scored']} cycles"
    rows |= {"compensator": bounds, "R2, cycles left out": left_out}
    rows["check 3 of the le…ond hall.csv"] = f"R2 {kept['checks'][rig.check]:.4f}, not fitted"
    found = f"{kept['reversals'] // 2} cycles found, {kept['cycles_scored']} scored"
    rows["rows"] = f"{2 * ROWS} read, {kept['rows_used']} used; {found}"
    scene, sizes = scene_of(rig.out / "x.ini")["friction"], kept["other_torques"]
    rows["header and scene"] = ", ".join(
        f"{name} {float(scene[name]):.5g} {kept['units'][name]}" for name in ("sigma0", "Fc")
    )
    rows["header and scene"] += "."
    others = ", ".join(
        f"{name} {sizes[f'{name}_torque']:.3g} N" for name in TERMS if name != "offset"
    )
    rows["other torques"] = f"{others} (half of the range)"
    rows["R2 of the plan alone"] = f"{kept['r2_plan']:.4f} on the raw motion"
    assert shown == rows
    lines = [line.split("│")[1:-1] for line in rig.shown.splitlines() if line.count("│") == 5]
    laws = {name.strip(): [cell.strip() for cell in cells] for name, *cells in lines}
    for one in kept["models"]:
        parts = [[f"{x:.4g}" for x in [*part.values()][1:]] for part in one["parts"]]
        numbers = "; ".join(map(", ".join, parts))
        words = [numbers, f"{one['r2']:.4f}", str(one["instructions_m3"] or "-")]
        assert laws.pop(one["name"] + " (chosen)" * one["chosen"]) == words
    assert not laws and all(str(path) in rig.shown for path in (*rig.out.iterdir(),))
    assert all(path.name in " ".join(rig.shown.split()) for path in rig.logs)
    tables = [line for line in rig.shown.splitlines() if set(line) & set("│┃┏└┡├")]
    assert tables and max(map(len, tables)) <= 80


def plan_text(*params: float) -> str:
    """Return the plan of a header; tests/python/cli/test_plan.py compares it with C bit for bit."""
    return plan_header.text("x", {"": Plan(*params)}, []).partition("*/")[2].strip()


def params_of(kept: dict) -> tuple[float, float, float]:
    (one,) = (one for one in kept["models"] if one["name"] == "Dahl")
    return one["parts"][0]["sigma0"], one["parts"][0]["Fc"], kept["plan"]["theta_per_count"]


def comment_of(header: Path) -> str:
    text = header.read_text().partition("*/")[0]
    return " ".join(text.replace("*", " ").split())


def test_the_header_has_the_plan_and_its_numbers(rig):
    kept, header = rig.kept, rig.out / "dahl_plan_x.h"
    params = params_of(kept)
    assert params[:2] == pytest.approx((kept["sigma0"], kept["Fc"]), rel=1e-6)
    assert plan_text(*params) in header.read_text()
    words = comment_of(header)
    for name in ("sigma0", "Fc"):
        low, high = kept["ci95"][name]
        assert f"{name} [{kept['units'][name]}]: 95 % within {low:.5g} to {high:.5g}" in words
    macros = dict(re.findall(r"#define DAHL_PLAN_X_(\w+) (\S+)f ", header.read_text()))
    Fc_low, length_long = kept["Fc_low"], kept["length_long"]  # noqa: N806
    assert (1 - 1e-6) * Fc_low <= float(macros["FC_LOW"]) <= Fc_low * (1 + 1e-9)
    assert length_long * (1 - 1e-9) <= float(macros["LENGTH_LONG"]) <= (1 + 1e-6) * length_long
    sigma0_high = kept["sigma0_high"]
    assert sigma0_high * (1 - 1e-9) <= float(macros["SIGMA0_HIGH"]) <= (1 + 1e-6) * sigma0_high
    wanted = (kept["verdict"], f"{kept['r2_plan']:.4f}", *(path.name for path in rig.logs))
    for words_wanted in (*wanted, *(f"FORCED, although {one}" for one in kept["plan"]["against"])):
        assert words_wanted in words
    assert all(len(line) <= 160 for line in header.read_text().splitlines())


# --- scene ----------------------------------------------------------------------------------------


def scene_of(path: Path) -> configparser.ConfigParser:
    played = configparser.ConfigParser(inline_comment_prefixes=(";",))
    played.read(path)
    return played


def test_the_log_of_the_scene_is_the_first_one_without_its_timed_terms(rig):
    text = (rig.out / "x.ini").read_text().partition("[scene]")[0]
    assert rig.kept["verdict"] in " ".join(text.replace("\n;", " ").split())
    assert max(map(len, text.splitlines())) < 198  # the limit of a scene
    played, extra, way = scene_of(rig.out / "x.ini"), rig.kept["extra"], way_of(1)
    motion, measured = played["motion"], played["measured"]
    assert float(played["friction"]["theta_per_count"]) == pytest.approx(1e-4)
    assert (float(measured["torque_scale"]), float(measured["angle_scale"])) == (1, 1000)
    assert measured["label_angle"].endswith("[mm]") and measured["label_torque"].endswith("[N]")
    table = np.genfromtxt(rig.out / "x.csv", delimiter=",", names=True)
    assert table[motion["angle"]] == pytest.approx(way - way[0], abs=1e-9)
    speed, inner = np.gradient(way, TIME), slice(50, -50)
    timed = extra["viscous"] * speed + extra["inertia"] * np.gradient(speed, TIME)
    assert table[measured["torque"]][inner] == pytest.approx((force_of(1) - timed)[inner], abs=0.01)
    gone = np.cumsum(np.abs(np.diff(way, prepend=way[0])))[int(measured["settle"])]
    assert gone == pytest.approx(6 / rig.kept["a"], rel=0.05)


def test_the_scene_replays_the_log(rig, dahl_loop, tmp_path):
    """The torque of the node explains the log as well as the fit does."""
    assert replayed_r2(rig.out / "x.ini", tmp_path) > 0.998


# --- picture --------------------------------------------------------------------------------------

PANELS = ("loop", "by angle", "by speed", "autocorrelation", "plausible", "sigma0", "Fc")


def panels_of(figure) -> dict:
    return dict(zip(PANELS, figure.axes, strict=True))


def units_of(figure, panel: str) -> tuple[str, str]:
    axes = panels_of(figure)[panel]
    labels = axes.get_xlabel(), axes.get_ylabel()
    return tuple("".join(re.findall(r"\[(.*)\]", words)) for words in labels)


def band_of(axes, number: int = 0):
    return axes.patches[number].get_extents().transformed(axes.transData.inverted())


def test_the_picture_shows_the_fit_over_the_measurement(rig):
    panels, way, force = panels_of(rig.figure), way_of(1), force_of(1)
    assert (rig.out / "x.png").read_bytes().startswith(b"\x89PNG")
    legend = [text.get_text() for text in panels["loop"].get_legend().get_texts()]
    assert legend[:2] == ["measured", f"fitted: {rig.kept['model']}"]
    curves = {line.get_label(): line.get_xydata().T for line in panels["loop"].lines}
    measured, fitted = (curves[name] for name in legend[:2])
    turns = np.array([0, *turns_of(way)])  # inertia is larger than friction, which is drawn alone
    last = turns[np.searchsorted(turns[1:], np.arange(ROWS), side="right")]
    assert measured[0] == pytest.approx(1e3 * (way - way[last]), abs=0.2)  # mm, between counts
    friction = force - columns_of(1) @ [*TERMS.values()]
    assert (measured[1] - friction)[:-100].std() < 0.02 * FC
    start = ROWS - fitted.shape[1]  # until the torque at the first row is forgotten
    assert 0 < start < ROWS // 4 and np.array_equal(fitted[0], measured[0][start:])
    of_both = [line.get_xdata() for line in panels["loop"].lines[2:4]]  # of the second log
    assert of_both[1].tolist() == of_both[0][-len(of_both[1]) :].tolist()
    left = (measured[1][start:] - fitted[1])[:-100]  # the last acceleration is a guess
    assert left.std() == pytest.approx(rig.kept["rmse"], rel=0.15)
    for name in ("by angle", "by speed"):
        drawn = panels[name].lines[0].get_ydata()
        assert drawn.std() == pytest.approx(rig.kept["rmse"], rel=0.1) and len(drawn) < 2 * ROWS
    assert units_of(rig.figure, "loop") == units_of(rig.figure, "by angle") == ("mm", "N")
    assert units_of(rig.figure, "by speed") == ("mm/s", "N")
    assert units_of(rig.figure, "plausible") == ("N/m", "N")


@pytest.mark.parametrize("origin", [0.0, 3.0, -3.0])
@pytest.mark.parametrize(
    ("span", "linear", "shown"),
    [(0.5, True, (1e-3, "mm")), (1.5, True, (1.0, "m")), (0.5, False, (1.0, "rad"))],
)
def test_the_unit_of_the_angle_follows_the_span_from_any_origin(origin, span, linear, shown):
    theta = origin + np.linspace(0, span, 9)
    assert Log("x", theta, theta, linear=linear).shown_in == shown


def test_the_picture_shows_the_numbers_and_their_intervals(rig):
    panels, kept, title = panels_of(rig.figure), rig.kept, rig.figure.get_suptitle()
    assert f"{kept['sigma0']:.4g} N/m" in title and title.endswith(f"{kept['Fc']:.4g} N")
    assert kept["model"] in title and panels["loop"].get_title(loc="left") == kept["verdict"]
    for name in ("sigma0", "Fc"):
        axes, ends = panels[name], kept["ci95"][name]
        whole, each = axes.lines
        assert whole.get_ydata()[0] == kept[name]
        assert each.get_ydata().tolist() == kept["cycles"][name]
        assert each.get_xdata().tolist() == [*range(1, len(kept["cycles"][name]) + 1)]
        band = band_of(axes)
        assert (band.y0, band.y1) == pytest.approx(ends, rel=1e-6)
        assert units_of(rig.figure, name)[1] == kept["units"][name]
    points = [line.get_xydata()[0].tolist() for line in panels["plausible"].lines]
    assert [kept["sigma0"], kept["Fc"]] in points
    across, along = (band_of(panels["plausible"], k) for k in (0, 1))
    assert (across.x0, across.x1) == pytest.approx(kept["ci95"]["sigma0"], rel=1e-6)
    assert (along.y0, along.y1) == pytest.approx(kept["ci95"]["Fc"], rel=1e-6)
    bars = [bar.get_height() for bar in panels["autocorrelation"].patches[:-1]]
    assert len(bars) >= 20 and np.abs(bars).max() < 0.2  # white noise


# --- a turning shaft, another sign, no clock ------------------------------------------------------


def test_a_shaft_without_a_clock_is_in_newton_metres_and_its_sign_is_noted(tmp_path):
    """Spikes of the torque are marked in the picture."""
    spikes, theta = np.arange(100, 2400, 40), np.floor(sine(1, rows=2400, cycles=8) / COUNT) * COUNT
    torque = -dahl_torque(theta) - 0.02 * FC * noise_of(1, 2400)
    torque[spikes] += 20 * FC
    path = write_csv(tmp_path / "shaft.csv", theta, torque, "number,angle_deg,torque_Nm")
    with drawing() as figures:
        done = run("identify", path, "-o", tmp_path, "--name", "x", "--terms", "none")
    kept, played = json.loads((tmp_path / "x.json").read_text()), scene_of(tmp_path / "x.ini")
    assert kept["units"] == {"sigma0": "N m/rad", "Fc": "N m", "a": "1/rad"}
    assert (kept["torque_sign"], kept["linear"], kept["extra"]) == (-1.0, False, {})
    assert any("other sign" in note for note in kept["notes"])
    assert any("one speed" in note for note in kept["notes"]) is kept["identifiable"]["sigma0"]
    assert cells_of(done.stdout)["note"] == " ".join(kept["notes"])
    assert units_of(figures[0], "by speed") == ("rad/row", "N m")
    measured, *_, odd = panels_of(figures[0])["loop"].lines
    assert measured.get_ydata() == pytest.approx(-torque, abs=1e-6)
    rows = np.flatnonzero(np.isin(measured.get_ydata(), odd.get_ydata()))
    assert {*spikes.tolist()} <= {*rows.tolist()} and len(rows) < len(spikes) + 20
    assert kept["rows_weighing_less"] >= len(spikes)
    assert played["measured"]["torque"] == "torque_Nm" and played["motion"]["angle"] == "theta_rad"


# --- other models ---------------------------------------------------------------------------------

EXPORTED = {  # model of the scene: torque, chosen law, plan in the header
    "slip": (lambda: springs(MOTION, (80, 0.2), (20, 0.3)), "slip K=2", "dahl_plan_x"),
    "asymmetric": (each_way, "asymmetric", "dahl_plan_x"),
    "stribeck": (lambda: dahl_torque(MOTION, Fc=FC * (1 + 0.3 * SLOW)), "Stribeck", "dahl_plan_x"),
    "parallel": (
        lambda: dahl_torque(MOTION, 60, 0.2) + springs(MOTION, (25, 0.3)),
        "",
        "dahl_plan_x_1",
    ),
}


def check_stribeck(kept: dict[str, Any], header: str) -> None:
    """The plan has the limits and the speed of the truth, and stands in the header."""
    plan, speed = kept["plan"], 0.15 * np.abs(SPEED).max()
    assert plan["Fc"] == pytest.approx([1.3 * FC, FC], rel=0.03)
    assert plan["stribeck"] == pytest.approx(speed * 1e-3, rel=0.1)
    assert plan["period"] == pytest.approx(1e-3) and kept["r2_plan"] > 0.99
    values = plan["sigma0"][0], *plan["Fc"], plan["theta_per_count"]
    same = plan_header.text("x", {"": Stribeck(*values, plan["stribeck"])}, [])
    assert same.partition("*/")[2].strip() in header


@pytest.mark.parametrize("model", EXPORTED)
def test_the_chosen_model_is_exported(model, tmp_path, root):
    torque, law, plan = EXPORTED[model]
    log = log_of(MOTION, torque(), 0.01, COUNT / (16 if model == "stribeck" else 1))
    path = write_csv(tmp_path / "x.csv", log.theta, log.torque)
    out = ("-o", tmp_path / "out", "--name", "x", "--force", "--terms", "offset")
    assert run("identify", path, *out).returncode == 0
    kept = json.loads((tmp_path / "out" / "x.json").read_text(), parse_constant=pytest.fail)
    assert not law or kept["model"] == kept["exported_model"] == law
    assert scene_of(tmp_path / "out" / "x.ini")["friction"]["model"] == model
    (chosen,) = (one for one in kept["models"] if one["chosen"])
    header = (tmp_path / "out" / "dahl_plan_x.h").read_text()
    if model == "asymmetric":
        (part,), count = chosen["parts"], kept["plan"]["theta_per_count"]
        both = part["Fc_forward"], part["Fc_backward"]
        assert both == pytest.approx((1.25 * FC, 0.75 * FC), rel=0.02)
        same = plan_header.text("x", {"": Asymmetric(part["sigma0"], *both, count)}, [])
        assert same.partition("*/")[2].strip() in header
    elif model == "stribeck":
        check_stribeck(kept, header)
    else:
        for name in ("sigma0", "Fc"):
            total = sum(part[name] for part in chosen["parts"])
            assert total == pytest.approx(kept[name], rel=0.02)
    assert re.search(rf"\b{plan}\b", header)
    words = "gcc -std=c99 -Wall -Wextra -Werror -pedantic -Wno-unused-const-variable -fsyntax-only"
    places = f"-I{root / 'lib' / 'include'}", tmp_path / "out" / "dahl_plan_x.h"
    subprocess.run([*words.split(), *places], check=True, timeout=60)


def test_rows_without_a_reading_are_no_outliers_of_the_picture(fitted, tmp_path):
    weight = np.where(np.arange(fitted.samples.rows) % 7, 1.0, 0.0)
    result = replace(fitted, samples=replace(fitted.samples, weight=weight))
    with drawing(rendered=False) as figures:
        plot.draw(tmp_path / "x.png", result, "x")
    assert len(panels_of(figures[0])["loop"].get_legend().get_texts()) == 2


def test_the_bounds_cover_all_plausible_limits():
    """Fc_low counts the least Fc of all plausible fits of the law, length_long the largest."""
    result = identify([log_of(MOTION, each_way())], Options(terms=("offset",), delay=False))
    one, place = result.chosen, np.arange(len(result.chosen.p))
    for skews in ((0.4, 0.1), (0.1, 0.4), (0.1,)):
        fits = [replace(one, p=np.where(place == 1, skew, one.p)) for skew in skews]
        plausible = replace(result.plausible, fits=fits)
        found = replace(result, plausible=plausible, claimed=(True, True))
        skew = max(*skews, one.p[1])
        wanted = (1 - skew) * result.Fc.low, (1 + skew) / result.a.low
        *known, sigma0_high = found.compensator_bounds
        assert known == pytest.approx(list(wanted), rel=1e-9)
        assert sigma0_high > SIGMA0


def test_the_nearest_runnable_model_is_named_with_what_it_loses():
    """The library has no general exponent."""
    moves = np.diff(MOTION, prepend=MOTION[0])
    w = LAWS["exponent"].along(moves, [slice(0, len(moves))], [SIGMA0 / FC], [2.2])[0]
    log = log_of(MOTION, FC * w + 4 * MOTION, 0.002, 0.0)
    kept = seen(log, terms=("offset", "spring"), delay=False)
    assert kept["model"] != kept["exported_model"] and kept["r2_plan"] > 0.998
    assert 0 < kept["exported_model_lost_r2"] < 0.1
    (chosen,) = (one for one in kept["models"] if one["chosen"])
    assert not chosen["in_library"] and chosen["instructions_m3"] is None


@pytest.fixture(scope="module")
def fitted(library):
    return identify([log_of(MOTION, dahl_torque(MOTION))])


@pytest.mark.parametrize(("counts", "linear", "turn"), [(4096, False, 2 * np.pi), (20, True, 1e-3)])
def test_the_plan_is_for_the_encoder_of_the_target(fitted, counts, linear, turn):
    logs = [replace(log, linear=linear) for log in fitted.logs]
    result = replace(fitted, logs=logs, options=Options(target_counts=counts, model="dahl"))
    kept, model = report.numbers(result), export.runnable_model(result)
    friction = model.friction
    assert kept["plan"]["theta_per_count"] == pytest.approx(turn / counts)
    assert kept["plan"]["of_target"] and kept["resolution"] == COUNT
    assert plan_text(*friction.sigma0, *friction.Fc, turn / counts) in export.header(model, "x", "")


def test_each_reason_alone_is_against_a_plan(fitted):
    (log,) = fitted.logs
    coarse = [replace(log, resolution=2 * COUNT)]
    noisy = [replace(log, torque=log.torque + FC * noise_of(2, log.rows))]
    for change, reason in (
        ({}, ""),
        ({"claimed": (True, False)}, "identifiable"),
        ({"claimed": (False, True)}, "identifiable"),
        ({"options": Options(model="coulomb")}, "Coulomb"),
        ({"logs": noisy}, " is the least"),
        ({"logs": coarse}, "a grid of 16384 counts a turn"),
        ({"logs": coarse, "options": Options(trust_units=True)}, ""),
        ({"logs": coarse, "options": Options(target_counts=4096)}, ""),
    ):
        against = export.runnable_model(replace(fitted, **change)).against
        assert len(against) == bool(reason) and reason in "".join(against), change


def test_noise_leaves_no_plan_and_json_has_no_infinity(tmp_path):
    """A plan of an earlier run is removed."""
    theta = np.floor(sine(1, rows=1500, cycles=8) / COUNT) * COUNT
    path = write_csv(tmp_path / "noise.csv", theta, noise_of(1, 1500))
    (tmp_path / "dahl_plan_x.h").write_text("an old one")
    done = run("identify", path, "-o", tmp_path, "--name", "x")
    assert done.returncode == 0 and not (tmp_path / "dahl_plan_x.h").exists()
    kept = json.loads((tmp_path / "x.json").read_text(), parse_constant=pytest.fail)
    assert kept["identifiable"] == {"sigma0": False, "Fc": False} and kept["plan"]["against"]
    assert all(why in done.stdout for why in kept["plan"]["against"])
