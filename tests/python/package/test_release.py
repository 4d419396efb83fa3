# SPDX-License-Identifier: MIT
"""The files of a release (tools/release.sh): each is unpacked into an empty folder and tried."""

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import dahl
import pytest
import test_consume
import yaml
from conftest import ROOT, need
from programs import call, run
from test_consume import EXPECTED
from test_package import ISSUE, PLAN, Environment

pytestmark = pytest.mark.checks
own_headers = test_consume.own_headers

ADDRESS = "https://host.name/owner/dahl"
BUILDER = ROOT / "tools/release/release.py"
NAME = f"dahl-{dahl.__version__}"
MAIN = """
#include <stdio.h>
#include "dahl.h"
int main(void)
{
    dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384};
    dahl_plan_t plan;
    dahl_state_t state = {0};
    if (dahl_prepare(&plan, &params) != DAHL_OK) {
        return 1;
    }
    printf("%.9g\\n", (double)dahl_step_counts(&plan, &state, 100));
    return 0;
}
"""


@pytest.fixture(scope="module")
def commit() -> str:
    """Return a commit with the files of the checkout as they are, also if they are changed."""
    git = ["git", "-C", ROOT, "-c", "user.name=test", "-c", "user.email=test"]
    return run(*git, "stash", "create").strip() or run(*git, "rev-parse", "HEAD").strip()


@pytest.fixture(scope="module")
def release(commit: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("release")
    words = ["-o", out, "--repository", ADDRESS, "--commit", commit, "--without-site"]
    said = run(ROOT / "tools/release.sh", *words)
    assert f"git tag -a v{dahl.__version__} {commit}" in said
    return out


def unpacked(archive: Path, folder: Path) -> Path:
    """Unpack an archive into an empty folder; return its only folder, or that folder."""
    if archive.suffix == ".zip":
        zipfile.ZipFile(archive).extractall(folder)
    else:
        with tarfile.open(archive) as tar:
            tar.extractall(folder, filter="data")
    inside = list(folder.iterdir())
    return inside[0] if len(inside) == 1 else folder


@pytest.fixture
def main(tmp_path: Path) -> Path:
    source = tmp_path / "main.c"
    source.write_text(MAIN)
    return source


def wheel_of(release: Path, machine: str = "") -> Path:
    """Return the wheel of a machine, by default of this one."""
    (wheel,) = release.glob(f"*_{machine or platform.machine()}.whl")
    return wheel


def gives_the_torque(program: Path) -> bool:
    return float(run(program)) == pytest.approx(EXPECTED, rel=1e-6)


def test_the_folder_has_all_files_and_their_sums(release: Path) -> None:
    made = {path.name for path in release.iterdir()}
    wheels = {path.name for path in release.glob("*.whl")}
    kinds = {re.sub(r"manylinux_2_\d+", "manylinux", name) for name in wheels}
    machines = {platform.machine()} | (
        {"aarch64"} if shutil.which("aarch64-linux-gnu-ld") else set()
    )
    assert kinds == {f"{NAME}-py3-none-manylinux_{machine}.whl" for machine in machines}
    endings = ("-source.tar.gz", "-amalgamation.zip", ".tar.gz", "-arduino.zip", ".cdx.json")
    endings += ("-platformio.tar.gz", "-esp-idf.tgz")
    assert made == {*wheels, "SHA256SUMS", *(f"{NAME}{ending}" for ending in endings)}
    said = run("sha256sum", "--check", "--strict", "SHA256SUMS", cwd=release)
    assert said.count(": OK\n") == len(made) - 1


def test_a_second_run_elsewhere_gives_equal_bytes(
    release: Path, commit: str, tmp_path: Path
) -> None:
    (tmp_path / "other/place").mkdir(parents=True)
    words = [BUILDER, "-o", tmp_path / "out", "--repository", ADDRESS, "--commit", commit]
    words += ["--without-aarch64"]  # it takes as long as all others
    more = {"TMPDIR": str(tmp_path / "other/place"), "TZ": "Asia/Kolkata", "LC_ALL": "C"}
    run(sys.executable, *words, env=os.environ | more, umask=0o077)
    first, second = (
        {name: value for value, name in map(str.split, (folder / "SHA256SUMS").open())}
        for folder in (release, tmp_path / "out")
    )
    bill = f"{NAME}.cdx.json"  # it has the sum of the wheel that is left out
    assert {name for name in second if first[name] != second[name]} <= {bill}
    assert len(second) == 8
    files = [without_aarch64(folder / bill) for folder in (release, tmp_path / "out")]
    assert files[0] == files[1]


def without_aarch64(bill: Path) -> dict[str, Any]:
    document = json.loads(bill.read_text())
    files = document["metadata"]["component"]["components"]
    files[:] = [one for one in files if "aarch64" not in one["name"]]
    return document


@pytest.mark.parametrize(
    "address",
    [
        *("", "https://example.org/dahl", "https://www.Example.com/dahl"),
        *("host.name/dahl", "https://host.name/dahl.git"),
    ],
)
def test_without_an_address_there_is_no_release(address: str, tmp_path: Path) -> None:
    """It is said before packages are installed."""
    words = ["-o", tmp_path, "--repository", address, "--without-site"]
    done = call(ROOT / "tools/release.sh", *words)
    said = done.stderr
    assert done.returncode == 1 and done.stdout == ""
    assert said.startswith("error: ") and f"'{address}'" in said and "pyproject.toml" in said
    assert not list(tmp_path.iterdir())


def test_a_folder_with_files_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine").touch()
    said = run(sys.executable, BUILDER, "-o", tmp_path, "--repository", ADDRESS, code=1)
    assert said.startswith("error: ") and str(tmp_path) in said


def test_each_package_carries_the_address_in_its_fields(release: Path, tmp_path: Path) -> None:
    pio = unpacked(release / f"{NAME}-platformio.tar.gz", tmp_path / "pio") / "library.json"
    manifest = json.loads(pio.read_text())
    assert manifest["repository"] == {"type": "git", "url": f"{ADDRESS}.git"}
    assert (manifest["homepage"], manifest["version"]) == (ADDRESS, dahl.__version__)
    idf = unpacked(release / f"{NAME}-esp-idf.tgz", tmp_path / "idf") / "idf_component.yml"
    component = yaml.safe_load(idf.read_text())
    assert (component["url"], component["repository"]) == (ADDRESS, f"{ADDRESS}.git")
    arduino = unpacked(release / f"{NAME}-arduino.zip", tmp_path / "arduino")
    assert arduino.name == "dahl"  # the IDE names the library by its folder
    assert f"\nurl={ADDRESS}\n" in (arduino / "library.properties").read_text()
    metadata = zipfile.ZipFile(wheel_of(release)).read(f"{NAME}.dist-info/METADATA").decode()
    assert f"\nProject-URL: Repository, {ADDRESS}\n" in metadata
    sdist = unpacked(release / f"{NAME}.tar.gz", tmp_path / "sdist")
    assert f"\nProject-URL: Repository, {ADDRESS}\n" in (sdist / "PKG-INFO").read_text()
    manifests = (pio, idf, arduino / "library.properties", sdist / "pyproject.toml")
    assert not [file for file in manifests if "example.org" in file.read_text()]


def test_the_source_archive_installs(release: Path, tmp_path: Path, main: Path) -> None:
    tree = unpacked(release / f"{NAME}-source.tar.gz", tmp_path / "source")
    assert tree.name == NAME
    options = ["-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug", f"-DCMAKE_INSTALL_PREFIX={tmp_path}/usr"]
    run("cmake", "-S", tree, "-B", tmp_path / "build", *options)
    run("cmake", "--build", tmp_path / "build")
    run("cmake", "--install", tmp_path / "build")
    (library,) = (tmp_path / "usr").rglob("libdahl.a")
    run("gcc", f"-I{tmp_path}/usr/include", main, library, "-o", tmp_path / "main")
    assert gives_the_torque(tmp_path / "main")


@pytest.mark.parametrize("selection", ["friction", "all"])
def test_the_amalgamation_compiles(
    selection: str, release: Path, commit: str, tmp_path: Path, main: Path
) -> None:
    folder = unpacked(release / f"{NAME}-amalgamation.zip", tmp_path / "zip") / selection
    head = (folder / "dahl.c").read_text()[:600]
    assert dahl.__version__ in head and f"commit       {commit}\n" in head
    run("gcc", f"-I{folder}", main, folder / "dahl.c", "-o", tmp_path / "main")
    assert gives_the_torque(tmp_path / "main")


def test_the_wheel_installs_and_runs(release: Path, tmp_path: Path) -> None:
    installed = Environment(tmp_path / "environment", wheel_of(release))
    assert float(installed.python("-c", ISSUE)) == pytest.approx(0.4323323, rel=1e-6)
    assert "dahl_plan_t dahl_plan_shaft = {" in installed.dahl(*PLAN)
    packages = [*release.glob("*.whl"), release / f"{NAME}.tar.gz"]
    said = run(sys.executable, "-m", "twine", "check", "--strict", *packages)
    assert said.count("PASSED") == len(packages)


def test_the_wheel_for_aarch64_has_programs_that_run(
    release: Path, tmp_path: Path, main: Path
) -> None:
    """In the emulator of a user program; its Python was not tried."""
    claim = "the wheel for aarch64"
    emulator = [need("qemu-aarch64-static", claim), "-L", "/usr/aarch64-linux-gnu"]
    need("aarch64-linux-gnu-ld", claim)
    zipfile.ZipFile(wheel_of(release, "aarch64")).extractall(tmp_path)
    folder = tmp_path / "dahl"
    headers = run("readelf", "-h", *folder.glob("lib/*.so"), folder / "bin/dahl-loop")
    assert headers.count("AArch64") == 4  # the library, the module of cffi, the FMU, dahl-loop
    (folder / "bin/dahl-loop").chmod(0o755)
    (folder / f"lib/libdahl.so.{test_consume.WANTED}").symlink_to("libdahl.so")
    words = ["clang", "--target=aarch64-linux-gnu", f"-I{folder}/share/include", main]
    run(*words, folder / "lib/libdahl.so", "-o", tmp_path / "main")
    library = ["-E", f"LD_LIBRARY_PATH={folder}/lib"]
    assert float(run(*emulator, *library, tmp_path / "main")) == pytest.approx(EXPECTED, rel=1e-6)
    assert run(*emulator, folder / "bin/dahl-loop", "--help").startswith("usage: dahl-loop")


def test_the_arduino_library_compiles(release: Path, tmp_path: Path) -> None:
    """test_arduino.py compiles the same folder with avr-gcc and runs a sketch."""
    library = unpacked(release / f"{NAME}-arduino.zip", tmp_path / "arduino")
    sources = sorted(library.glob("src/*/*.c"))
    assert len(sources) > 40
    (tmp_path / "main.cpp").write_text(MAIN.replace("dahl.h", "dahl.hpp"))
    objects = tmp_path / "objects"
    objects.mkdir()
    run("gcc", "-std=gnu11", "-c", f"-I{library}/src", *sources, cwd=objects)
    words = [f"-I{library}/src", tmp_path / "main.cpp", *objects.glob("*.o")]
    run("g++", "-std=gnu++11", *words, "-o", tmp_path / "main")
    assert gives_the_torque(tmp_path / "main")


@pytest.mark.parametrize(("way", "ending"), [("platformio", ".tar.gz"), ("esp_idf", ".tgz")])
def test_a_package_builds_a_project_as_its_tool_reads_it(
    way: str, ending: str, release: Path, own_headers: Path, tmp_path: Path
) -> None:
    archive = release / f"{NAME}-{way.replace('_', '-')}{ending}"
    package = unpacked(archive, tmp_path / "package")
    build = tmp_path / "build"
    words = [f"-DWAY={way}", f"-DOWN_HEADERS={own_headers}", f"-DDAHL_ROOT={package}"]
    run("cmake", "-S", test_consume.CONSUMER, "-B", build, "-G", "Ninja", *words)
    run("cmake", "--build", build)
    assert gives_the_torque(build / "consumer") and gives_the_torque(build / "consumer_cxx")


def test_the_bill_of_materials_lists_the_locked_packages_and_the_files(release: Path) -> None:
    """The package needs three packages, and cffi needs pycparser."""
    bill = json.loads((release / f"{NAME}.cdx.json").read_text())
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    listed = {(one["name"], one["version"]): one["scope"] for one in bill["components"]}
    lock = (ROOT / "tools/requirements.lock").read_text()
    pins = re.findall(r"^([\w.-]+)(?:\[[\w,]+\])?==(\S+)", lock, re.M)
    assert set(listed) == {(re.sub(r"[-_.]+", "-", name).lower(), ver) for name, ver in pins}
    scopes = {name: scope for (name, _), scope in listed.items()}
    required = {name for name, scope in scopes.items() if scope == "required"}
    assert required == {"numpy", "cffi", "pycparser", "shtab"}
    assert {scopes[name] for name in ("scipy", "pillow", "dask", "jaxlib")} == {"optional"}
    assert {scopes[name] for name in ("pytest", "sphinx", "ruff")} == {"excluded"}
    refs = {one["bom-ref"] for one in bill["components"]}
    graph = {one["ref"]: set(one["dependsOn"]) for one in bill["dependencies"]}
    itself = bill["metadata"]["component"]
    assert set(graph) == refs | {itself["bom-ref"]} and set().union(*graph.values()) <= refs
    assert len(graph[itself["bom-ref"]]) == 3
    sums = {one["name"]: one["hashes"][0]["content"] for one in itself["components"]}
    text = (release / "SHA256SUMS").read_text()
    assert set(sums) == {path.name for path in release.iterdir()} - {
        "SHA256SUMS",
        f"{NAME}.cdx.json",
    }
    assert all(f"{sums[name]}  {name}\n" in text for name in sums)


def test_options_that_cannot_be_met_are_refused_before_anything_is_built() -> None:
    for words in (["--nonsense"], ["-o"], ["--repository"], ["--commit", "f" * 40]):
        done = call(ROOT / "tools/release.sh", *words)
        assert done.returncode == 1 and words[-1] in done.stderr, words
    assert "SHA256SUMS" in subprocess.check_output([ROOT / "tools/release.sh", "--help"], text=True)
