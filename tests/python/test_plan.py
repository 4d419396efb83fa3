# SPDX-License-Identifier: MIT
"""`dahl plan`: a plan for flash from known numbers, which every compiler takes without a warning,
and bit for bit what dahl_prepare() makes.
"""

from __future__ import annotations

import itertools
import math
import re
import shlex
import subprocess
from functools import partial

import pytest
from conftest import ROOT, built, need
from dahl import __version__
from dahl.binding import models
from identify_tools import caller, complaint

pytestmark = pytest.mark.usefixtures("library")

STRICT = ["-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{ROOT}/lib/include"]
ENCODER = ["--theta-per-count", "3.8e-4"]
DAHL = "dahl_params_t params = {{{0!r}f, {1!r}f, (float){2!r}}};".format
BREAKAWAY = models.with_key("breakaway").name
MODELS = {  # options, how C makes the same, and what the header tells
    "dahl": (
        ["--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384"],
        DAHL(100.0, 0.5, 2 * math.pi / 16384),
        "sigma0 = 100, Fc = 0.5, theta_per_count = 0.000383495208",
    ),
    "a fine count": (
        ["--sigma0", "36449.1", "--fc", "2.69", "--theta-per-count", "1e-7"],
        DAHL(36449.1, 2.69, 1e-7),
        "sigma0 = 36449.1016, Fc = 2.69000006, theta_per_count = 1.00000001e-07",
    ),
    "no counts": (
        ["--sigma0", "3", "--fc", "7.5", "--theta-per-count", "0"],
        DAHL(3.0, 7.5, 0.0),
        "sigma0 = 3, Fc = 7.5, theta_per_count = 0",
    ),
    "part of a count": (
        ["--sigma0", "1", "--fc", "2e3", "--counts-per-turn", "4096.5"],
        DAHL(1.0, 2e3, 2 * math.pi / 4096.5),
        "sigma0 = 1, Fc = 2000, theta_per_count = 0.00153379352",
    ),
    "slip": (
        ["--model", "slip", "--sigma0", "100,40,7", "--fc", "0.5,0.3,1.25", *ENCODER],
        "dahl_slip_params_t params = {3, 3.8e-4f, {100, 40, 7}, {0.5f, 0.3f, 1.25f}};",
        "sigma0 = 100 40 7, Fc = 0.5 0.300000012 1.25, theta_per_count = 0.000380000012",
    ),
    "asymmetric": (
        ["--model", "asymmetric", "--sigma0", "100", "--fc", "0.5,0.3", *ENCODER],
        "dahl_asymmetric_params_t params = {100, 0.5f, 0.3f, 3.8e-4f};",
        "sigma0 = 100, Fc_forward = 0.5, Fc_backward = 0.300000012,"
        " theta_per_count = 0.000380000012",
    ),
    "asymmetric backward": (
        ["--model", "asymmetric", "--sigma0", "100", "--fc", "0.25,0.5", *ENCODER],
        "dahl_asymmetric_params_t params = {100, 0.25f, 0.5f, 3.8e-4f};",
        "sigma0 = 100, Fc_forward = 0.25, Fc_backward = 0.5, theta_per_count = 0.000380000012",
    ),
    BREAKAWAY: (
        ["--model", BREAKAWAY, "--sigma0", "100", "--fc", "0.5", "--breakaway", "0.7", *ENCODER],
        "dahl_params_t params = {100, 0.5f, 3.8e-4f};",
        "sigma0 = 100, Fc = 0.5, theta_per_count = 0.000380000012, breakaway = 0.699999988",
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
KNOWN = MODELS["dahl"][0]
MAJOR_MINOR = __version__.rpartition(".")[0]


@pytest.fixture
def plan(capsys, monkeypatch, tmp_path):
    """Call `dahl plan` in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return partial(caller(capsys), "plan")


@pytest.mark.parametrize(
    ("compiler", "standard"),
    [
        *itertools.product(["gcc", "clang"], ["c99", "c11"]),
        *itertools.product(["g++", "clang++"], ["c++11", "c++14", "c++17", "c++20"]),
    ],
)
def test_no_compiler_has_a_word_to_say(compiler, standard, plan, tmp_path):
    need(compiler, f"a plan compiles as {standard}")
    plan(*KNOWN, "-o", "plan.h")
    source = tmp_path / ("tick.cpp" if "+" in standard else "tick.c")
    source.write_text('#include "plan.h"\nconst dahl_plan_t *used = &dahl_plan_plan;\n')
    command = [compiler, f"-std={standard}", *STRICT, "-c", source, "-o", tmp_path / "tick.o"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("case", MODELS)
def test_the_words_are_those_that_c_prepares(case, plan, tmp_path):
    """No warning as C99, C++11 and C++17; and what is there is made again, as it is a plan."""
    options, params, told = MODELS[case]
    model = f"{case.split()[0]}_" if "--model" in options else ""
    for _ in range(2):
        assert plan(*options, "-o", "plan.h").returncode == 0
    assert (
        f" * dahl_{model}prepare() of {told}; keep it const.\n" in (tmp_path / "plan.h").read_text()
    )
    (tmp_path / "tick.c").write_text(
        f'#include "plan.h"\nconst dahl_{model}plan_t *used = &dahl_plan_plan;\n'
    )
    more = ", 0.7f" if case == BREAKAWAY else ""
    (tmp_path / "same.cpp").write_text(SAME.format(model=model, params=params, more=more))
    library = built("lib", "libdahl.a")
    for command in (
        ["gcc", "-std=c99", *STRICT, "-c", "tick.c", "-o", "tick.o"],
        *(["g++", f"-std=c++{n}", *STRICT, "same.cpp", library, "-o", "same"] for n in (11, 17)),
        ["./same"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


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
    done = subprocess.run(
        ["gcc", "-fsyntax-only", f"-I{tmp_path}", f"-I{ROOT}/lib/include", tmp_path / "plan.h"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0 and f"made for dahl {MAJOR_MINOR}" in done.stderr


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["-o", "-"], "shaft"),
        (["--name", "left wheel", "-o", "-"], "left_wheel"),
        (["--name", "Achse S\u00fcd 2", "-o", "-"], "achse_s_d_2"),
        (["-o", "dahl_plan_rod.h"], "rod"),
    ],
)
def test_standard_output_and_a_name(words, name, plan, tmp_path):
    done = plan(*KNOWN, *words, "--model", "dahl")
    if "-" in words:
        assert list(tmp_path.iterdir()) == []
    else:
        assert done.stdout.startswith("dahl_plan_rod.h: Plan(sigma0=100.0, Fc=0.5, theta_per_")
    text = done.stdout if "-" in words else (tmp_path / "dahl_plan_rod.h").read_text()
    assert f"static const dahl_plan_t dahl_plan_{name} = {{" in text
    assert text.count(f"DAHL_PLAN_{name.upper()}_H") == 3
    assert max(map(len, text.splitlines())) <= 96
    plan(*KNOWN, "--name", name, "-o", "x.h")
    assert (tmp_path / "x.h").read_text() == text


REFUSED = [  # options, and the names, values and limits in the line
    ("--model=slip --sigma0=1,2 --fc=1", "sigma0 ... 2 ... Fc 1"),
    ("--model=slip --sigma0=1,-2 --fc=1,1", "element 1: sigma0 = -2"),
    ("--model=slip --sigma0=1,1,1,1,1,1,1,1,1 --fc=1,1,1,1,1,1,1,1,1", "9 elements ... 8"),
    ("--model=asymmetric --fc=1,0", "Fc_backward = 0"),
    (f"--model={BREAKAWAY} --breakaway=1", "breakaway = 1"),
    (f"--model={BREAKAWAY} --breakaway=0", "breakaway = 0"),
    (f"--model={BREAKAWAY} --breakaway=b", "--breakaway b ... 0 < breakaway < 1"),
    (f"--model={BREAKAWAY}", f"--breakaway ... --model {BREAKAWAY}"),
    ("--breakaway=0.5", f"--breakaway ... --model {BREAKAWAY}"),
    ("--breakaway=0", f"--breakaway ... --model {BREAKAWAY}"),
    ("--model=asymmetric --fc=1,2 --breakaway=0.5", f"--breakaway ... --model {BREAKAWAY}"),
    ("--model=lugre", "'lugre'"),
    ("--sigma0=-1", "sigma0 = -1 ... 2^-64 <= sigma0 < 2^64"),
    ("--sigma0=0", "sigma0 = 0 ... 2^-64 <= sigma0 < 2^64"),
    ("--sigma0=1e30", "sigma0 = 1e+30 ... 2^-64 <= sigma0 < 2^64"),
    ("--sigma0=soft", "--sigma0 soft ... 2^-64 <= sigma0 < 2^64"),
    ("--sigma0=1,2", "--sigma0 1,2 ... 2 ... --model dahl ... 1"),
    ("--fc=nan", "Fc = nan ... 2^-64 <= Fc < 2^64"),
    ("--fc=", "--fc : ... 2^-64 <= Fc < 2^64"),
    ("--fc=1,2", "--fc 1,2 ... 2 ... --model dahl ... 1"),
    ("--fc=1,,2", "--fc : "),
    ("--model=asymmetric", "--fc 0.5 ... 1 ... --model asymmetric ... 2"),
    ("--model=asymmetric --fc=1,2,3", "--fc 1,2,3 ... 3 ... --model asymmetric ... 2"),
    ("--counts-per-turn=0", "--counts-per-turn 0: ... above 0"),
    ("--counts-per-turn=inf", "--counts-per-turn inf: ... above 0"),
    ("--counts-per-turn=many", "--counts-per-turn many: ... above 0"),
    ("--counts-per-turn=1e14", "2^-30 <= travel < 2^20"),
    (
        "--counts-per-turn=DROP --theta-per-count=x",
        "--theta-per-count x: ... 2^-64 <= theta_per_count",
    ),
    ("--counts-per-turn=DROP", "--counts-per-turn ... --theta-per-count"),
    ("--theta-per-count=1", "--theta-per-count ... --counts-per-turn"),
    ("--name=++", "--name ++"),
    ("--output=none/plan.h", "none/plan.h: "),
]


@pytest.mark.parametrize(("changed", "words"), REFUSED)
def test_bad_values_are_one_line_with_the_limit(changed, words, plan, tmp_path):
    known = dict(zip(KNOWN[::2], KNOWN[1::2], strict=True)) | {"--output": "plan.h"}
    known |= {one.partition("=")[0]: one.partition("=")[2] for one in changed.split(" ")}
    code, said = complaint(
        plan(*(f"{key}={each}" for key, each in known.items() if each != "DROP"))
    )
    assert code == (1 if "none/" in changed else 2)
    assert re.search(".*".join(map(re.escape, words.split(" ... "))), said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "kept",
    [
        "int main(void) { return 0; }\n",
        "static const dahl_plan_t x;\n",
        "int mine;\n/* dahl_prepare() of one */\n#ifndef DAHL_PLAN_X_H\n",
        "\udcff",
    ],
)
def test_only_a_plan_is_overwritten(kept, plan, tmp_path):
    path = tmp_path / "main.c"
    path.write_text(kept, errors="surrogateescape")
    before = path.read_bytes()
    done = plan(*KNOWN, "-o", "main.c")
    code, said = complaint(done)
    assert code == 2 and said.startswith("main.c: ") and "--force" in said
    assert path.read_bytes() == before
    assert plan(*KNOWN, "--force", "-o", "main.c").returncode == 0
    made = path.read_bytes()
    assert plan("--sigma0", "2", *KNOWN[2:], "-o", "main.c").returncode == 0  # its own
    assert path.read_bytes() != made


def test_the_examples_of_the_help_work(plan, tmp_path):
    examples = [
        line for line in plan("--help").stdout.splitlines() if line.startswith("  dahl plan")
    ]
    assert len(examples) == 4
    for line in examples:
        assert plan(*shlex.split(line)[2:]).returncode == 0
    assert (tmp_path / "dahl_plan_shaft.h").exists()
