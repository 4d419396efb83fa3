# SPDX-License-Identifier: MIT
"""A user's project gets the library in each of the ways that the README names, and the README's
snippet compiles.
"""

import math
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CONSUMER = ROOT / "tests/consume"
# Eq. 7: F = Fc (1 - exp(-sigma0/Fc theta)), sigma0 = 100, Fc = 0.5, theta = 100 counts of 14 bits.
EXPECTED = 0.5 * (1 - math.exp(-100 / 0.5 * 100 * 2 * math.pi / 16384))


def run(*command: object, **more: object) -> str:
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library alone, installed somewhere."""
    build, prefix = tmp_path_factory.mktemp("build"), tmp_path_factory.mktemp("prefix")
    run("cmake", "-S", ROOT, "-B", build, "-G", "Ninja", f"-DCMAKE_INSTALL_PREFIX={prefix}")
    run("cmake", "--build", build)
    run("cmake", "--install", build)
    return prefix


@pytest.mark.parametrize("way", ["add_subdirectory", "FetchContent", "find_package"])
def test_cmake(way: str, prefix: Path, tmp_path: Path) -> None:
    where = f"-DCMAKE_PREFIX_PATH={prefix}" if way == "find_package" else f"-DDAHL_ROOT={ROOT}"
    run("cmake", "-S", CONSUMER, "-B", tmp_path, "-G", "Ninja", f"-DWAY={way}", where)
    run("cmake", "--build", tmp_path)
    for program in ("consumer", "consumer_cxx"):
        assert float(run(tmp_path / program)) == pytest.approx(EXPECTED, rel=1e-6)


@pytest.mark.parametrize("way", ["add_subdirectory", "find_package"])
def test_cmake_with_the_node(way: str, tmp_path: Path) -> None:
    """dahl::node, asked for by DAHL_BUILD_NODE, with headers that no other file stands beside."""
    where = f"-DDAHL_ROOT={ROOT}"
    if way == "find_package":
        install = (f"-DCMAKE_INSTALL_PREFIX={tmp_path}/prefix", "-DDAHL_BUILD_NODE=ON")
        run("cmake", "-S", ROOT, "-B", tmp_path / "lib", "-G", "Ninja", *install)
        run("cmake", "--build", tmp_path / "lib", "--target", "install")
        names = {path.name for path in (tmp_path / "prefix/include").iterdir()}
        assert names == {"dahl.h", "dahl_node.h", "dahl_frames.h", "dahl_can_bus.h"}
        where = f"-DCMAKE_PREFIX_PATH={tmp_path}/prefix"
    words = ("-G", "Ninja", f"-DWAY={way}", "-DNODE=ON", "-DDAHL_BUILD_NODE=ON", where)
    run("cmake", "-S", CONSUMER, "-B", tmp_path / "b", *words)
    run("cmake", "--build", tmp_path / "b", "--target", "consumer_node")
    assert float(run(tmp_path / "b/consumer_node")) == pytest.approx(2 * EXPECTED, rel=1e-6)


def test_pkg_config(prefix: Path, tmp_path: Path) -> None:
    (config,) = prefix.rglob("dahl.pc")
    flags = run("pkg-config", "--cflags", "--libs", config).split()
    run("gcc", CONSUMER / "main.c", "-o", tmp_path / "consumer", *flags)
    assert float(run(tmp_path / "consumer")) == pytest.approx(EXPECTED, rel=1e-6)


def test_an_installed_tree_names_no_place_of_this_machine(prefix: Path) -> None:
    for file in prefix.rglob("*"):
        if file.suffix in (".pc", ".cmake", ".h"):
            assert str(ROOT) not in file.read_text() and str(prefix) not in file.read_text(), file
