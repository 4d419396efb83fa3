# SPDX-License-Identifier: MIT
"""The keys of scenes and models that dahl-loop and the Python package share."""

from __future__ import annotations

import configparser

import dahl
import pytest
from dahl.sim import scene, scene_keys
from loop_tools import SCENES
from test_scene_errors import beyond

pytestmark = pytest.mark.usefixtures("library")

PLAN = dahl.Plan(100, 0.5, 1e-3)
FRICTION = "sigma0 = 100\nFc = 0.5\ntheta_per_count = 1e-3\n"


def test_keys_for_plots_are_those_that_are_read():
    rows, measured = scene_keys.plot_keys(), vars(scene.Measured())
    defaults = {name: type(value)(rows["measured", name]) for name, value in measured.items()}
    assert defaults == measured and len(rows) == len(measured)


def test_shipped_scenes_have_known_sections_and_keys():
    sections = {name for name, _ in scene_keys.rows("SECTION")}
    assert sections == {section for section, _ in (*scene_keys.keys(), *scene_keys.plot_keys())}
    for path in SCENES.glob("*.ini"):
        parser = configparser.ConfigParser(inline_comment_prefixes=(";",), interpolation=None)
        parser.optionxform = str
        parser.read(path)
        for section in parser.sections():
            assert {*parser[section]} <= {*scene_keys.names(section)}, (path, section)


SUMS = [  # keys of [friction], sigma0 and Fc at a torque ratio of 1
    ("sigma0 = 3\nFc = 2", (3, 2)),
    ("model = slip\nsigma0 = 3 4\nFc = 1 2", (7, 3)),
    ("model = asymmetric\nsigma0 = 5\nFc = 1 2", (5, 2)),
]


@pytest.mark.parametrize(("keys", "due"), SUMS)
def test_a_scene_sums_its_elements_or_has_the_larger_direction(tmp_path, keys, due):
    path = tmp_path / "own.ini"
    path.write_text(f"[friction]\n{keys}\ntheta_per_count = 1e-3\n")
    found = scene.read(path)
    assert (found.sigma0, found.Fc) == due


NODE_KEYS = [("friction", name) for name in scene.NODE_KEYS] + [("status", "period_ms")]


@pytest.mark.parametrize(("section", "name"), NODE_KEYS)
def test_a_scene_has_the_limits_of_a_node(tmp_path, section, name):
    """In dahl-loop: test_scene_errors.py."""
    key, path = scene_keys.keys()[section, name], tmp_path / "own.ini"

    def read(value: object) -> scene.Scene:
        sections = {"friction": FRICTION, section: FRICTION * (section == "friction")}
        sections[section] += f"{name} = {value}\n"
        path.write_text("".join(f"[{title}]\n{text}" for title, text in sections.items()))
        return scene.read(path)

    low, high = beyond(key)
    for value in (f"{key.low:.17g}", f"{key.high:.17g}"):
        scene.element(read(value))
        dahl.Node(PLAN, **scene.settings(read(value)))
    with pytest.raises(dahl.Error):
        dahl.Node(PLAN, **scene.settings(read(high)))
    for value in (low, high, "nan", "-inf", *["1.5"] * (key.type == "WHOLE")):
        with pytest.raises(dahl.Error, match=rf"own\.ini: \[{section}\] {name} = "):
            scene.element(read(value))
