# SPDX-License-Identifier: MIT
"""The facts that dahl-loop and the Python package share: keys of scenes, models, the period."""

from __future__ import annotations

import re

import cantools
import pytest
from conftest import ROOT
from dahl import Error
from dahl.sim import scene, scene_keys, timing
from loop_tools import SCENES, run_program, setting
from test_scene_errors import LIMITS, beyond


@pytest.mark.parametrize(("section", "name"), scene_keys.keys())
def test_dahl_loop_has_each_key(section, name):
    """An empty value is refused by each type of key, in place of the key as unknown."""
    done = run_program("--scene", SCENES / "steering.ini", *setting(f"{section}.{name}="))
    assert done.returncode == 2 and f"[{section}] {name}" in done.stderr, done.stderr


def test_keys_for_plots_are_those_that_are_read():
    """With the same defaults."""
    rows = scene_keys.plot_keys()
    defaults = {name: type(value)(rows["measured", name]) for name, value in MEASURED.items()}
    assert defaults == MEASURED and len(rows) == len(MEASURED)


MEASURED = vars(scene.Measured())


def test_sections_have_keys_and_keys_have_sections():
    sections = {name for name, _ in scene_keys.rows("SECTION")}
    assert sections == {section for section, _ in (*scene_keys.keys(), *scene_keys.plot_keys())}


def test_shipped_scenes_have_known_keys():
    for path in SCENES.glob("*.ini"):
        section = ""
        for line in path.read_text().splitlines():
            if found := re.match(r"\[(\w+)\]", line):
                section = found[1]
            elif found := re.match(r"(\w+) =", line):
                assert found[1] in scene_keys.names(section), (path, line)


ELSEWHERE = {  # keys whose own limits other limits hide: see SCENE_ERRORS
    "friction.sigma0",
    "friction.Fc",
    "friction.theta_per_count",
    "motion.counts_per_unit",
}


def test_each_number_has_a_case_at_its_limits():
    keys = scene_keys.keys().values()
    numbers = {f"{key.section}.{key.name}" for key in keys if key.type != "TEXT"}
    assert numbers == {key for _, key, *_ in LIMITS} | ELSEWHERE


def test_the_period_is_the_cycle_time_of_the_bus():
    database = cantools.database.load_file(ROOT / "lib/node/dahl.dbc")
    cycle_ms = database.get_message_by_name("EncoderState").cycle_time
    assert cycle_ms * 1000 == timing.period_us()


PLAIN = "[friction]\nsigma0 = 100\nFc = 0.5\ntheta_per_count = 1e-3\n"
NODE_LIMITS = [
    (key, low, high)
    for _, key, low, high in LIMITS
    if key == "status.period_ms" or key.removeprefix("friction.") in scene.NODE_KEYS
]


@pytest.mark.usefixtures("library")
@pytest.mark.parametrize(("key", "low", "high"), NODE_LIMITS)
def test_a_node_in_python_has_the_limits_of_dahl_loop(tmp_path, key, low, high):
    section, _, name = key.partition(".")
    path = tmp_path / "own.ini"

    def make(value: object) -> None:
        own = f"{name} = {value}\n"
        path.write_text(PLAIN + (own if section == "friction" else f"[{section}]\n{own}"))
        scene.element(scene.read(path))

    for value in (low, high):
        make(value)
    whole = scene_keys.keys()[section, name].type == "WHOLE"
    values = [beyond(low, -1, whole), beyond(high, 1, whole), "nan", "-inf", *["1.5"] * whole]
    for value in values:
        with pytest.raises(Error, match=rf"own\.ini: \[{section}\] {name} = "):
            make(value)
