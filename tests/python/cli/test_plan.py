# SPDX-License-Identifier: MIT
"""`dahl plan` writes a plan for flash that compiles without a warning and equals the result of
dahl_prepare() bit for bit.
"""

import math
import re
from functools import partial

import numpy as np
import pytest
from conftest import ROOT, built
from dahl import __version__
from dahl.binding import models, plan_header
from identify_tools import caller
from programs import run

STRICT = ["-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{ROOT}/lib/include"]
ENCODER = "--theta-per-count 3.8e-4"
DAHL = "dahl_params_t params = {{{0!r}f, {1!r}f, (float){2!r}}};".format
BREAKAWAY = models.with_key("breakaway").name
MODELS = {  # options, the same parameters in C
    "dahl": ("--sigma0 100 --fc 0.5 --counts-per-turn 16384", DAHL(100.0, 0.5, math.tau / 16384)),
    "a fine count": (
        "--sigma0 36449.1 --fc 2.69 --theta-per-count 1e-7",
        DAHL(36449.1, 2.69, 1e-7),
    ),
    "no counts": ("--sigma0 3 --fc 7.5 --theta-per-count 0", DAHL(3.0, 7.5, 0.0)),
    "slip": (
        f"--model slip --sigma0 100,40,7 --fc 0.5,0.3,1.25 {ENCODER}",
        "dahl_slip_params_t params = {3, 3.8e-4f, {100, 40, 7}, {0.5f, 0.3f, 1.25f}};",
    ),
    "asymmetric": (
        f"--model asymmetric --sigma0 100 --fc 0.25,0.5 {ENCODER}",
        "dahl_asymmetric_params_t params = {100, 0.25f, 0.5f, 3.8e-4f};",
    ),
    BREAKAWAY: (
        f"--model {BREAKAWAY} --sigma0 100 --fc 0.5 --breakaway 0.7 {ENCODER}",
        "dahl_params_t params = {100, 0.5f, 3.8e-4f};",
    ),
}
SAME = """
#include <cstring>
#include "plan.h"
int main() {{
    {params}
    static dahl_{model}plan_t made;
    if (dahl_{model}prepare(&made, &params{more}) != DAHL_OK) return 2;
    return std::memcmp(&made, &dahl_plan_plan, sizeof made) != 0;
}}
"""
KNOWN = MODELS["dahl"][0].split()
MAJOR_MINOR = __version__.rpartition(".")[0]


@pytest.fixture
def plan(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return partial(caller(capsys), "plan")


@pytest.mark.parametrize("case", MODELS)
def test_a_plan_equals_the_result_of_prepare(case, plan, tmp_path):
    """As C99, C11, C++11 and C++20. The second call overwrites the plan of the first."""
    options, params = MODELS[case]
    model = f"{case}_" if "--model" in options else ""
    for _ in range(2):
        assert plan(*options.split(), "-o", "plan.h").returncode == 0
    text = (tmp_path / "plan.h").read_text()
    assert f" * dahl_{model}prepare() of sigma0 = " in text
    assert max(len(line) for line in text.splitlines() if line.endswith(",")) <= 96
    (tmp_path / "tick.c").write_text(
        f'#include "plan.h"\nconst dahl_{model}plan_t *used = &dahl_plan_plan;\n'
    )
    more = ", 0.7f" if case == BREAKAWAY else ""
    (tmp_path / "same.cpp").write_text(SAME.format(model=model, params=params, more=more))
    library = built("lib", "libdahl.a")
    for command in (
        *(["gcc", f"-std=c{n}", *STRICT, "-c", "tick.c", "-o", "tick.o"] for n in (99, 11)),
        *(["g++", f"-std=c++{n}", *STRICT, "same.cpp", library, "-o", "same"] for n in (11, 20)),
        ["./same"],
    ):
        run(*command, cwd=tmp_path)


@pytest.mark.parametrize("change", [(0, -1), (0, 1), (1, 0)])
def test_a_plan_of_another_version_is_refused_by_the_compiler(change, plan, tmp_path):
    plan(*KNOWN, "-o", "plan.h")
    header = (ROOT / "lib/include/dahl.h").read_text()
    for name, more in zip(("MAJOR", "MINOR"), change, strict=True):
        number = re.search(rf"#define DAHL_VERSION_{name} (\d+)", header)
        header = header.replace(
            number[0], number[0][: -len(number[1])] + str(int(number[1]) + more)
        )
    (tmp_path / "dahl.h").write_text(header)
    words = ("-fsyntax-only", f"-I{tmp_path}", f"-I{ROOT}/lib/include", tmp_path / "plan.h")
    assert f"made for dahl {MAJOR_MINOR}" in run("gcc", *words, code=1)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["-o", "-"], "shaft"),
        (["--name", "left wheel", "-o", "-"], "left_wheel"),
        (["--name", "Achse S\u00fcd 2", "-o", "-"], "achse_s_d_2"),
        (["-o", "dahl_plan_rod.h"], "rod"),
    ],
)
def test_a_plan_has_the_name_of_its_option_or_file(words, name, plan, tmp_path):
    done = plan(*KNOWN, *words, "--model", "dahl")
    if "-" in words:
        assert list(tmp_path.iterdir()) == []
    else:
        assert done.stdout.startswith("dahl_plan_rod.h: Plan(sigma0=100.0, Fc=0.5, theta_per_")
    text = done.stdout if "-" in words else (tmp_path / "dahl_plan_rod.h").read_text()
    assert f"static const dahl_plan_t dahl_plan_{name} = {{" in text
    assert text.count(f"DAHL_PLAN_{name.upper()}_H") == 3
    assert "prepare() of sigma0 = 100, Fc = 0.5, theta_per_count = 0.000383495208; keep" in text
    assert max(map(len, text.splitlines())) <= 96
    plan(*KNOWN, "--name", name, "-o", "x.h")
    assert (tmp_path / "x.h").read_text() == text


@pytest.mark.parametrize(("low", "long"), [(0.5, 0.25), (0.1, 0.1), (0.3, 0.3), (2.0**-70, 1e-30)])
def test_bounds_are_the_nearest_floats_on_the_safe_side(low, long):
    """Those of an own float are itself. The lower bound is not above its value."""
    text = plan_header.bounds("rig", low, long, long, "N m", "rad")
    found = {name: np.float32(value) for name, value in re.findall(r"RIG_(\w+) (\S+)f ", text)}
    above = np.nextafter(found["FC_LOW"], np.float32(np.inf))
    below = np.nextafter(found["LENGTH_LONG"], np.float32(0))
    assert float(found["FC_LOW"]) <= low < float(above)  # NumPy compares a float as a float32
    assert float(found["LENGTH_LONG"]) >= long > float(below)
    assert found["SIGMA0_HIGH"] == found["LENGTH_LONG"] and "_HIGH" in text.split("N m/rad")[0]


def test_force_overwrites_any_file_and_a_plan_needs_no_force(plan, tmp_path):
    path = tmp_path / "main.c"
    path.write_text("int main(void) { return 0; }\n")
    assert plan(*KNOWN, "-o", "main.c").returncode == 2
    assert plan(*KNOWN, "--force", "-o", "main.c").returncode == 0
    made = path.read_bytes()
    assert plan("--sigma0", "2", *KNOWN[2:], "-o", "main.c").returncode == 0
    assert path.read_bytes() != made


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ("--sigma0 100 --fc 0.5 --counts-per-turn 16384", ""),
        ("--sigma0 1 --fc 0.5 --theta-per-count 4096", "counts per turn"),
        ("--sigma0 100 --fc 0.5 --theta-per-count 0.02197265625", "16384 counts per turn"),
        ("--sigma0 0.5 --fc 100 --theta-per-count 3.8e-4", "200 rad"),
        ("--model slip --sigma0 100,1 --fc 0.5,300 --theta-per-count 3.8e-4", "300 rad"),
        ("--model asymmetric --sigma0 100 --fc 0.5,1e-3 --theta-per-count 3.8e-4", "38 presliding"),
    ],
)
def test_a_wrong_unit_has_a_note_and_a_plan(options: str, word: str, plan, tmp_path) -> None:
    done = plan(*options.split(), "-o", "plan.h")
    assert done.returncode == 0 and (tmp_path / "plan.h").exists()
    assert (done.stderr.count("note: "), word in done.stderr) == (bool(word), True)
