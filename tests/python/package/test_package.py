# SPDX-License-Identifier: MIT
"""The Python package of a user: wheel and sdist by `python -m build`, installed into a new
environment that reads no file of the tree.
"""

import importlib.metadata
import json
import os
import re
import shutil
import sys
import sysconfig
import tarfile
import zipfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import programs
import pytest

pytestmark = pytest.mark.checks

OURS = ("PYTHONPATH", "DAHL_BUILD_DIR", "DAHL_LIBRARY", "DAHL_LOOP", "DAHL_DATA")
ISSUE = (
    "import dahl; print(dahl.Friction(dahl.Plan(sigma0=100, Fc=.5, theta_per_count=1e-4))"
    ".step_counts(100))"
)
MOST = 120e6  # bytes of dahl and what it needs, installed
NEEDED = ("numpy", "cffi", "pycparser")  # dependencies of the core, and theirs
PLAN = ["plan", "--sigma0", "100", "--fc", "0.5", "--counts-per-turn", "16384", "-o", "-"]


# Without the environment variables of this tree.
CLEAN = {name: value for name, value in os.environ.items() if name not in OURS}
run = partial(programs.run, env=CLEAN, timeout=240)


class Environment:
    def __init__(self, folder: Path, wheel: Path, packages: Sequence[str] = ()) -> None:
        run(sys.executable, "-m", "venv", "--without-pip", folder)
        self.folder, self.bin = folder, folder / "bin"
        (self.site,) = folder.glob("lib/python3*/site-packages")
        for file in (file for name in NEEDED for file in importlib.metadata.files(name) or ()):
            if ".." not in file.parts and "__pycache__" not in file.parts:
                (self.site / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file.locate(), self.site / file)
        if packages:  # folders with the packages of the extras
            (self.site / "extras.pth").write_text("\n".join(packages))
        pip = [sys.executable, "-m", "pip", "--python", self.bin / "python", "install", "--quiet"]
        run(*pip, "--no-index", "--no-deps", "--no-warn-script-location", wheel)

    def metadata(self) -> importlib.metadata.Distribution:
        return importlib.metadata.Distribution.at(only(self.site, "dahl-*.dist-info"))

    def dahl(self, *words: object, **more: object) -> str:
        return run(self.bin / "dahl", *words, cwd=self.folder, **more)

    def python(self, *words: object, **more: object) -> str:
        return run(self.bin / "python", *words, cwd=self.folder, **more)


@pytest.fixture(scope="module")
def dist(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the sdist, its wheel, and in tree/ the wheel of the tree."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, root)
    wheel = [sys.executable, "-m", "build", "--no-isolation", "--wheel"]
    run(*wheel, "--outdir", folder / "tree", root)
    return folder


def only(folder: Path, pattern: str) -> Path:
    (found,) = folder.glob(pattern)
    return found


@pytest.fixture(scope="module")
def core(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    return Environment(tmp_path_factory.mktemp("core"), only(dist, "*.whl"))


@pytest.fixture(scope="module")
def full(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    here = [path for path in sys.path if path.endswith("-packages")]
    return Environment(tmp_path_factory.mktemp("full"), only(dist / "tree", "*.whl"), here)


def listed(*folders: object) -> set[Path]:
    return {path for folder in folders for path in Path(str(folder)).rglob("*")}


SHARED = {f"dahl/share/{name}" for name in ("dahl.dbc", "include/dahl.h", "scenes/steering.ini")}
SHARED |= {"dahl/share/LICENSE"}
SHARED |= {"dahl/share/fmu/fmu.c", "dahl/share/mujoco/plugin.c"}
SHARED |= {"dahl/share/simulators/friction.c", "dahl/share/lib/model/prepare.c"}
SHARED |= {"dahl/py.typed", "dahl/commands/demo.py", "dahl/binding/declarations.cdef"}


def test_both_wheels_have_the_same_files_and_twine_accepts_them(dist: Path) -> None:
    said = run(sys.executable, "-m", "twine", "check", "--strict", *dist.glob("dahl-*"))
    assert said.count("PASSED") == 2
    first, second = (
        {one.filename: one.CRC for one in zipfile.ZipFile(path).infolist()}
        for path in (only(dist, "*.whl"), only(dist / "tree", "*.whl"))
    )
    built = {"dahl/lib/libdahl.so", "dahl/lib/_dahl.abi3.so", "dahl/bin/dahl-loop"}
    built |= {"dahl/lib/dahl_fmu.so"}
    built |= {"dahl/lib/dahl_fmu.dll"} & first.keys()  # MinGW-w64 may be missing
    assert first.keys() == second.keys() >= built | SHARED
    differ = {name for name in first if first[name] != second[name]}
    libraries = {name for name in first if re.search(r"\.so(\.|$)", name)}
    assert libraries == {one for one in built if ".so" in one}  # no library of others
    assert differ <= built | {name for name in first if name.endswith("/RECORD")}


def test_the_sdist_has_only_the_files_that_it_needs(dist: Path) -> None:
    with tarfile.open(only(dist, "*.tar.gz")) as sdist:
        files = {name.partition("/")[2] for name in sdist.getnames()}
    assert {"tools/wheel.cmake", "tools/dahl/cli.py"} <= files
    assert not any(name.startswith(("tools/bench", "tools/requirements")) for name in files)
    assert {name.partition("/")[0] for name in files} == {
        *("CHANGELOG.md", "CMakeLists.txt", "LICENSE", "PKG-INFO", "README.md", "host_sim", "lib"),
        *("port", "pyproject.toml", "tools"),
    }


def test_the_core_works_anywhere_with_its_dependencies_alone(core: Environment) -> None:
    assert float(core.python("-c", ISSUE)) == pytest.approx(0.4323323, rel=1e-6)
    assert core.dahl("--help").startswith("usage: dahl")
    assert "dahl_plan_t dahl_plan_shaft = {" in core.dahl(*PLAN)
    assert "--node" in core.dahl("monitor", "--help")
    core.dahl("fmu", "--sigma0", "120", "--fc", "1.8", "-o", "friction.fmu")
    needs = core.metadata().requires
    assert [one.partition(">")[0] for one in needs if "extra ==" not in one] == [
        "numpy",
        "cffi",
        "shtab",
    ]
    (everything,) = [one for one in needs if re.search("extra == .all.$", one)]
    extras = set(core.metadata().metadata.get_all("Provides-Extra"))
    assert {*re.search(r"\[(.*)\]", everything)[1].split(","), "all"} == extras
    assert sum(path.stat().st_size for path in listed(core.site) if path.is_file()) < MOST


def test_the_installed_package_opens_no_file_of_the_tree(core: Environment, root: Path) -> None:
    """An audit hook of the interpreter records the files."""
    watched = f"""
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0]))
                 if event in ("open", "ctypes.dlopen", "os.listdir", "os.scandir") else None)
from dahl.cli import main
import dahl
from dahl.sim import scene
codes = [main({PLAN!r}), main(["data", "tribometer"]), main(["demo"])]
scene.read(scene.find("steering"))
print("\\n".join(one for one in opened if one.startswith({str(root)!r})))
assert any(one.endswith("libdahl.so") for one in opened) and codes[0] == 0
"""
    said = core.python("-c", watched)
    assert [line for line in said.splitlines() if line.startswith(str(root))] == []


def test_the_demo_runs_from_the_wheel(full: Environment) -> None:
    """It writes below the current folder only, neither into the environment nor into the base
    interpreter.
    """
    full.dahl("demo", "--scene", "steering", "--seconds", "0.5")
    base = sysconfig.get_paths(vars={"base": sys.base_prefix, "platbase": sys.base_prefix})
    folders = [full.site / "dahl", full.bin, base["purelib"], base["scripts"]]
    before = listed(*folders)
    full.dahl("demo", "--scene", "steering", "--seconds", "0.5")
    assert listed(*folders) == before
    folder = full.folder / "dahl-out/demo"
    known = json.loads((folder / "summary.json").read_text())
    assert known["ticks"] == 500
    assert 0 < known["max_error_ulp_Fc"] < 0.6
    assert Path(known["scene_file"]).is_relative_to(full.site)
    full.dahl("report", folder)
    full.dahl("plot", folder)
    said = full.dahl("demo", "--target", "m4f", "--output", full.folder / "m4f", code=1)
    assert said.startswith("error: ") and "checkout" in said


def test_the_plugin_of_mujoco_is_compiled_from_the_wheel(full: Environment, tmp_path: Path) -> None:
    pytest.importorskip("mujoco.rollout", reason="unproven: the plugin in a wheel: no mujoco")
    cache = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    full.python("-c", "import dahl.mujoco", env=cache)
    assert only(tmp_path, "dahl/mujoco/*.so").stat().st_size > 1000


def test_the_test_of_the_readme_finds_its_fixtures(root: Path, full: Environment) -> None:
    readme = (root / "README.md").read_text()
    (example,) = re.findall(r"```python\n(from dahl.*?)```", readme, re.DOTALL)
    (full.folder / "test_readme.py").write_text(example)
    said = full.python("-m", "pytest", "-q", "-p", "no:cacheprovider", "test_readme.py")
    assert "1 passed" in said
    assert "--dahl-interface" in full.python("-m", "pytest", "--help")
