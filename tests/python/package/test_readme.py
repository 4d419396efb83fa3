# SPDX-License-Identifier: MIT
"""Pages: their C compiles, their Python runs, and each mark of a generated table has its end."""

import re
from pathlib import Path

import pytest
from conftest import ROOT
from programs import run

PAGES = [path for path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md")) if path.exists()]
BLOCKS = [
    pytest.param(block, id=f"{path.stem}-{number}")
    for path in PAGES
    for number, block in enumerate(re.findall(r"```c\n(.*?)```", path.read_text(), re.DOTALL), 1)
]
SCRIPTS = [  # test_pytest_plugin.py runs those of pytest, test_park_steer.py that of its scene
    pytest.param(
        block,
        id=f"{path.stem}-{number}",
        marks=pytest.mark.checks if re.search("import (mujoco|jax)", block) else (),
    )
    for path in PAGES
    for number, block in enumerate(
        re.findall(r"```python\n(.*?)```", path.read_text(), re.DOTALL), 1
    )
    if "def test_" not in block and "park_steer." not in block
]


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_block_of_python_runs_and_prints(
    script: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(script, "the page", "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_of_c_compiles_also_as_cpp(block: str, tmp_path: Path) -> None:
    from dahl.binding import plan_header
    from dahl.binding.friction import Plan
    from dahl.report.commission import Report
    from dahl.sim.axis import Shaft, commission, simulated

    plan = plan_header.text("rig", Plan(37349, 2.666, 1e-7), ["rig"])
    plan += plan_header.bounds("rig", 2.6, 7.3e-5, 38000, "N m", "rad")
    (tmp_path / "dahl_plan_rig.h").write_text(plan)
    done = commission(simulated(), Shaft())
    (tmp_path / "dahl_plan_axis.h").write_text(Report(done, "simulated").header("axis"))
    (tmp_path / "block.c").write_text(block)
    mocks = ROOT / "tests/python/examples/zephyr_mock"
    folders = (tmp_path, ROOT / "lib", ROOT / "lib/include", mocks)
    includes = [f"-I{folder}" for folder in folders]
    strict = ["-Wall", "-Wextra", "-Werror", "-fsyntax-only", *includes, tmp_path / "block.c"]
    run("cc", "-std=c99", *strict)
    run("c++", "-std=c++20", "-x", "c++", *strict, "-Wno-missing-field-initializers")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_marks_of_generated_tables_have_their_end(page: Path) -> None:
    marks = re.findall(r"<!-- (/?)([\w:]+) -->", page.read_text())
    opened = [name for slash, name in marks if not slash]
    assert marks == [(slash, name) for name in opened for slash in ("", "/")]
