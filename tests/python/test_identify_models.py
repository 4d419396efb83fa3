# SPDX-License-Identifier: MIT
"""Which model a log asks for: made logs of each model with their truth, what is then said and
claimed of Dahl's numbers, and what header, scene, table and JSON carry of the model.
"""

from __future__ import annotations

import configparser
import json
import subprocess
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, built
from dahl.identify.log import Log
from identify_cases import A, chirp, of
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    caller,
    dahl_torque,
    noise_of,
    seen,
    sine,
    springs,
    told,
)
from identify_truth import general

pytestmark = pytest.mark.usefixtures("library")

MOTION = sine(2, rows=4000, cycles=9)
INSTRUCTIONS = json.loads((ROOT / "tests" / "target" / "budgets.json").read_text())[
    "instructions at most"
]["m3"]


def each_way(theta: np.ndarray, sigma0: float, forward: float, backward: float) -> np.ndarray:
    """Dahl's model with another limit each way, the exact step of each row."""
    F, drawn = 0.0, []  # noqa: N806
    for move in np.diff(theta, prepend=theta[0]):
        limit, side = (forward if move > 0 else backward), np.sign(move)
        F = side * limit - (side * limit - F) * np.exp(-sigma0 * abs(move) / limit)  # noqa: N806
        drawn.append(F)
    return np.array(drawn)


def bent(exponent: float) -> Log:
    return of(MOTION, general(MOTION, exponent), 0.02, 0.0)


def partly_slipping(part: float) -> Log:
    torque = (1 - part) * dahl_torque(MOTION) + part * springs(MOTION, (SIGMA0, FC))
    return of(MOTION, torque, 0.02, 0.0)


MADE: dict[str, Callable[[], Log]] = {
    "Dahl": lambda: bent(1.0),
    "slip K=1": lambda: of(MOTION, springs(MOTION, (SIGMA0, FC)), 0.02, 0.0),
    "slip K=2": lambda: of(MOTION, springs(MOTION, (150, 0.3), (40, 0.5)) + 0.15, 0.01, 0.0),
    "Dahl K=2": lambda: of(
        MOTION, dahl_torque(MOTION, 90, 0.15) + dahl_torque(MOTION, 60, 0.6), 0.01, 0.0
    ),
    "asymmetric": lambda: of(MOTION, each_way(MOTION, SIGMA0, 0.6, 0.4) + 0.1, 0.02, 0.0),
    "asymmetric, little": lambda: of(MOTION, each_way(MOTION, SIGMA0, 0.51, 0.49) + 0.1, 0.02, 0.0),
    "exponent .45": lambda: bent(0.45),
    "exponent .95": lambda: bent(0.95),
    "exponent 1.1": lambda: bent(1.1),
    "exponent 1.7": lambda: bent(1.7),
    "a tenth slips": lambda: partly_slipping(0.1),
    "three tenths slip": lambda: partly_slipping(0.3),
    "slip at many speeds": lambda: of(chirp(), springs(chirp(), (SIGMA0, FC)), 0.02, 0.0),
}


@cache
def facts_of(name: str) -> dict[str, Any]:
    return seen(MADE[name]())


def model_of(facts: dict[str, Any], name: str) -> dict[str, Any]:
    (one,) = (model for model in facts["models"] if model["name"] == name)
    return one


@pytest.mark.parametrize(
    ("name", "chosen", "elements", "offset"),
    [
        ("Dahl", "Dahl", [("dahl", SIGMA0, FC)], 0.0),
        ("slip K=1", "slip K=1", [("slip", SIGMA0, FC)], 0.0),
        ("slip at many speeds", "slip K=1", [("slip", SIGMA0, FC)], 0.0),
        ("slip K=2", "slip K=2", [("slip", 40, 0.5), ("slip", 150, 0.3)], 0.15),
        ("Dahl K=2", "Dahl K=2", [("dahl", 60, 0.6), ("dahl", 90, 0.15)], 0.0),
        ("asymmetric", "asymmetric", [("asymmetric", SIGMA0, 0.6, 0.4)], 0.1),
        ("asymmetric, little", "asymmetric", [("asymmetric", SIGMA0, 0.51, 0.49)], 0.1),
    ],
)
def test_the_model_that_a_log_asks_for(name, chosen, elements, offset):
    """With its numbers, and without a delay or a viscous part that Dahl's would need for it."""
    facts = facts_of(name)
    one = model_of(facts, chosen)
    assert facts["model"] == chosen
    assert [model["name"] for model in facts["models"] if model["chosen"]] == [chosen]
    found = sorted((tuple(part.values()) for part in one["elements"]), key=lambda part: part[1])
    for part, true in zip(found, elements, strict=True):
        assert part[0] == true[0]
        assert part[1:] == pytest.approx(true[1:], rel=0.06 if "K=2" in chosen else 0.01)
    assert one["terms"].get("offset", 0.0) == pytest.approx(offset, abs=2e-3)
    assert one["delay_rows"] == 0 and one["in_library"]
    assert not {"viscous", "inertia"} & set(one["terms"])
    if chosen != "Dahl":
        r2 = [model_of(facts, each)["r2"] for each in (chosen, "Dahl")]
        more, less = told(facts, f"{chosen} explains more")[-2:]
        assert more > less and (more, less) == pytest.approx(r2, abs=5e-5)


@pytest.mark.parametrize(("name", "exponent"), [("exponent .45", 0.45), ("exponent 1.7", 1.7)])
def test_a_general_exponent_is_found_and_is_no_plan(name, exponent):
    """The library has none; what is carried is one that it has."""
    facts = facts_of(name)
    one = model_of(facts, "general exponent")
    assert one["elements"][0]["exponent"] == pytest.approx(exponent, abs=0.15)
    assert one["elements"][0]["sigma0"] == pytest.approx(SIGMA0, rel=0.03)
    assert not one["in_library"] and not one["chosen"] and one["instructions_m3"] is None
    assert model_of(facts, facts["model"])["in_library"]


@pytest.mark.parametrize(
    ("name", "claims", "more"),
    [
        ("Dahl", (True, True), False),
        ("exponent .95", (True, True), False),
        ("exponent 1.1", (True, True), True),
        ("a tenth slips", (True, True), True),
        ("three tenths slip", (False, True), True),
        ("exponent 1.7", (False, True), True),
        ("slip K=2", (False, True), True),
        ("Dahl K=2", (False, True), True),
    ],
)
def test_how_far_another_model_moves_the_claim(name, claims, more):
    """A model that explains more than Dahl's is named, and widens the intervals to its numbers and
    half beyond; where that is too far nothing is claimed, and the verdict says what it hangs on.
    """
    facts = facts_of(name)
    assert tuple(facts["identifiable"].values()) == claims
    assert (told(facts, "explains more") is not None) is more
    hanging = told(facts, "sigma0 hangs on")
    assert (hanging is not None) is not claims[0]
    for parameter, true in (("sigma0", SIGMA0), ("Fc", FC)):
        low, high = facts["ci95"][parameter]
        assert "K=2" in name or 0.996 * low <= true <= 1.004 * high
    plausible = [one for one in facts["choices"] if one["plausible"]]
    for one in plausible:
        for parameter in ("sigma0", "Fc"):
            low, high = facts["ci95"][parameter]
            assert low * 0.999 <= one[parameter] <= high * 1.001
            if one["model"] != "Dahl" and one[parameter] > facts[parameter]:
                assert high >= 0.995 * one[parameter] ** 1.5 / facts[parameter] ** 0.5
    assert {one["model"] for one in facts["choices"] if one["taken"]} == {"Dahl"}


def test_the_simplest_model_is_chosen():
    """Of those that the library has: whatever has fewer parameters explains what was left out
    worse, by 3 % of the error for each parameter more.
    """
    sizes = {"Coulomb": 1, "Dahl": 2, "slip K=1": 2, "asymmetric": 4, "slip K=2": 4, "Dahl K=2": 4}
    sizes |= {f"{kind} K={count}": 2 * count for kind in ("slip", "mixed") for count in (2, 3, 4)}
    for name in MADE:
        facts = facts_of(name)
        own = [one for one in facts["models"] if one["in_library"]]
        size = {one["name"]: sizes[one["name"]] for one in own}
        for one in own:
            size[one["name"]] += len(one["terms"]) - (one["name"] == "asymmetric")
        best = max(own, key=lambda one: one["r2"])
        for one in own:
            if size[one["name"]] < size[facts["model"]]:
                more = max(size[best["name"]] - size[one["name"]], 0)
                assert 1 - one["r2"] >= (1 - best["r2"]) * (1 + 0.03 * more), (name, one["name"])


def test_instructions_of_a_tick_are_those_that_were_counted():
    """In QEMU, at most (tests/target/budgets.json)."""
    shown = {
        one["name"]: one["instructions_m3"] for name in MADE for one in facts_of(name)["models"]
    }
    counted = {
        "Dahl": "one_count_q30",
        "asymmetric": "asymmetric_q30",
        "slip K=2": "slip_2_q30",
        "slip K=4": "slip_4_q30",
        "Dahl K=2": "parallel_2_q30",
        "mixed K=2": "mixed_2_q30",
        "mixed K=4": "mixed_4_q30",
    }
    assert {name: shown[name] for name in counted} == {
        name: INSTRUCTIONS[key] for name, key in counted.items()
    }
    assert shown["Coulomb"] is None


# --- what is left of a model ----------------------------------------------------------------------

NAMES = {
    "dahl": ("Dahl", "dahl", [""]),
    "slip-2": ("slip K=2", "slip", [""]),
    "slip-4": ("slip K=4", "slip", [""]),
    "dahl-2": ("Dahl K=2", "parallel", ["_1", "_2"]),
    "mixed-3": ("mixed K=3", "parallel", ["_1", "_slip"]),
    "asymmetric": ("asymmetric", "asymmetric", [""]),
    "coulomb": ("Coulomb", "dahl", [""]),
}


@pytest.fixture(scope="module")
def asked_for(tmp_path_factory, library):
    """A log with an offset, and what each --model leaves of it."""
    folder = tmp_path_factory.mktemp("models")
    torque = dahl_torque(MOTION, 60, 0.3) + springs(MOTION, (90, 0.2)) + 0.1
    log = of(MOTION, torque, 0.01)
    table = np.column_stack((log.time, log.theta, log.torque))
    head = "time_s,theta_rad,torque_Nm"
    np.savetxt(folder / "log.csv", table, "%.12g", ",", header=head, comments="")
    return folder, log


@pytest.mark.parametrize("option", NAMES)
def test_header_scene_and_table_carry_the_model_that_is_asked_for(asked_for, capsys, option):
    """Scene and header have its elements, the header as the library prepares them; the scene's log
    is the torque that these draw.
    """
    folder, log = asked_for
    name, model, endings = NAMES[option]
    words = ("--model", option, "--name", "x", "-o", folder / option, "--force")
    done = caller(capsys)("identify", folder / "log.csv", *words, "--counts-per-turn", 16384)
    assert done.returncode == 0, done.stderr
    facts = json.loads((folder / option / "x.json").read_text())
    one = model_of(facts, name)
    assert facts["model"] == name and one["chosen"]
    carried = [part for part in one["elements"] if option != "coulomb"]
    carried = carried or [{"kind": "dahl", "sigma0": facts["sigma0"], "Fc": facts["Fc"]}]
    scene = configparser.ConfigParser(inline_comment_prefixes=";")
    scene.read(folder / option / "x.ini")
    friction = scene["friction"]
    assert friction["model"] == model
    sizes = {key: [float(word) for word in friction[key].split()] for key in ("sigma0", "Fc")}
    forces = [part.get("Fc") or part["Fc_forward"] for part in carried]
    backward = [part["Fc_backward"] for part in carried if "Fc_backward" in part]
    if option != "dahl":  # whose numbers are those of all rows
        assert sizes == {"sigma0": [part["sigma0"] for part in carried], "Fc": forces + backward}
    kinds = friction.get("kinds", " ".join(part["kind"] for part in carried)).split()
    assert kinds == [part["kind"] for part in carried]
    way, torque = np.loadtxt(folder / option / "x.csv", delimiter=",", skiprows=1).T
    left = torque - float(scene["measured"]["offset"]) - drawn_by(kinds, sizes, way)
    assert np.std(left[500:]) < (0.1 if option == "coulomb" else 0.05) * FC
    tables = tables_of(kinds, sizes, facts["plan"]["theta_per_count"])
    assert list(tables) == endings and is_header_of(folder / option, tables.values())
    assert ("Coulomb" in " ".join(facts["plan"]["against"])) is (option == "coulomb")
    shown = next(line for line in done.stdout.splitlines() if f"│ {name} (" in line)
    assert "-" in shown if option == "coulomb" else str(one["instructions_m3"]) in shown


def drawn_by(kinds: list[str], sizes: dict[str, list[float]], way: np.ndarray) -> np.ndarray:
    if kinds == ["asymmetric"]:
        return each_way(way, *sizes["sigma0"], *sizes["Fc"])
    drawn = np.zeros(len(way))
    for kind, sigma0, limit in zip(kinds, sizes["sigma0"], sizes["Fc"], strict=True):
        drawn += (
            springs(way, (sigma0, limit)) if kind == "slip" else dahl_torque(way, sigma0, limit)
        )
    return drawn


TABLE = """    {{
        static const dahl_{kind}params_t params = {{{numbers}}};
        dahl_{kind}plan_t plan;
        memset(&plan, 0, sizeof plan);
        if (dahl_{kind}prepare(&plan, &params) != DAHL_OK) {{ return 2; }}
        if (memcmp(&plan, &dahl_plan_x{ending}, sizeof plan) != 0) {{ return 1; }}
    }}
"""


def listed(*numbers: float) -> str:
    return ", ".join(f"{np.float32(one):.9e}f" for one in numbers)


def tables_of(kinds: list[str], sizes: dict[str, list[float]], count: float) -> dict[str, str]:
    """What a header has to hold, by the ending of its name: C that compares it."""
    if kinds == ["asymmetric"]:
        numbers = listed(*sizes["sigma0"], *sizes["Fc"], count)
        return {"": TABLE.format(kind="asymmetric_", numbers=numbers, ending="")}
    parts = list(zip(kinds, sizes["sigma0"], sizes["Fc"], strict=True))
    dahls, slips = ([part[1:] for part in parts if part[0] == kind] for kind in ("dahl", "slip"))
    several, found = len(dahls) > 1 or bool(dahls and slips), {}
    for number, pair in enumerate(dahls, 1):
        ending = f"_{number}" * several
        found[ending] = TABLE.format(kind="", numbers=listed(*pair, count), ending=ending)
    if slips:
        each = "}, {".join(listed(*one) for one in zip(*slips, strict=True))
        numbers, ending = f"{len(slips)}, {listed(count)}, {{{each}}}", "_slip" * several
        found[ending] = TABLE.format(kind="slip_", numbers=numbers, ending=ending)
    return found


def is_header_of(folder: Path, tables: Iterable[str]) -> bool:
    """Whether dahl_plan_x.h compiles without a word and holds what the library makes of these."""
    body = "".join(tables)
    head = '#include <string.h>\n#include "dahl_plan_x.h"\n'
    (folder / "main.c").write_text(f"{head}int main(void)\n{{\n{body}    return 0;\n}}\n")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-I", folder, "-I", ROOT / "lib/include"]
    command = ["cc", *strict, folder / "main.c", built("lib", "libdahl.a"), "-lm"]
    subprocess.run([*command, "-o", folder / "same"], check=True, timeout=60)
    return subprocess.run([folder / "same"], check=False, timeout=10).returncode == 0


def test_no_plan_is_left_of_coulombs_model_and_none_without_an_encoder(dahl, tmp_path):
    """Coulomb's has no plan; one of slip elements goes by counts alone."""
    facts = facts_of("slip K=1")
    assert all(facts["identifiable"].values()) and facts["r2_plan"] > 0.99
    assert len(facts["plan"]["against"]) == 1 and "encoder" in facts["plan"]["against"][0]
    assert facts_of("Dahl")["plan"]["against"] == []
    log = of(MOTION, dahl_torque(MOTION) + 0.02 * FC * noise_of(1, 4000))
    table = np.column_stack((log.theta, log.torque))
    head = "theta_rad,torque_Nm"
    np.savetxt("x.csv", table[:2000], "%.9g", ",", header=head, comments="")
    done = dahl("identify", "x.csv", "--model", "coulomb", "-o", "out")
    assert done.returncode == 0 and not list((tmp_path / "out").glob("*.h"))
    wrong = dahl("identify", "x.csv", "--model", "slop", "--no-files")
    assert wrong.returncode == 2 and "--model slop" in wrong.stderr


def test_a_coulomb_friction_has_no_stiffness_to_claim():
    """A bare sign: Coulomb's model is chosen, and sigma0 has no upper end."""
    theta = sine(1, rows=2000, cycles=8)
    facts = seen(of(theta, FC * np.sign(np.gradient(theta)), 0.02))
    assert facts["model"] == "Coulomb" and facts["ci95"]["sigma0"][1] is None
    assert model_of(facts, "Coulomb")["elements"][0]["Fc"] == pytest.approx(FC, rel=0.01)
    assert facts["a"] > 5 * A and facts["resolution"] == COUNT
