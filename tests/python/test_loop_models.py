# SPDX-License-Identifier: MIT
"""Scenes of every model: exact over the bus, against its differential equation solved in 100 bits
from reversal to reversal, and what the summary says of them.
"""

from __future__ import annotations

import can
import numpy as np
import pytest
from dahl import reference, report
from dahl.scene import read
from loop_tools import run

MODELS = {  # keys, and what the ratio on the bus is of
    "dahl": ("sigma0 = 100\nFc = 0.7", 0.7),
    "slip": ("sigma0 = 100 30\nFc = 0.2 0.7", 0.9),
    "parallel": ("kinds = dahl slip dahl\nsigma0 = 100 30 50\nFc = 0.2 0.7 0.05", 0.95),
    "asymmetric": ("sigma0 = 100\nFc = 0.2 0.7", 0.7),
    "elastoplastic": ("sigma0 = 100\nFc = 0.7\nbreakaway = 0.6", 0.7),
}


def scene(folder, model, theta="3.8e-4"):
    path = folder / "model.ini"
    path.write_text(
        f"[friction]\nmodel = {model}\n{MODELS[model][0]}\ntheta_per_count = {theta}\n"
        "[motion]\nkind = steering\namplitude = 900\nsweep_s = 0.7\nhold_s = 0.1\n"
        "tremor = 20\ntremor_s = 0.05\nseconds = 3\n"
    )
    return path


@pytest.mark.parametrize("model", MODELS)
def test_every_model_is_exact_over_the_bus(tmp_path, model):
    path = scene(tmp_path, model)
    result = run(tmp_path, path, "--virtual")
    assert result.code == 0, result.err
    with can.CanutilsLogReader(result.log) as frames:
        trace = report.trace_of(frames)
    known = read(path)
    assert known.Fc == pytest.approx(MODELS[model][1])
    torque = trace.torque(known)
    assert len(torque) > 2000
    assert np.ptp(torque) > 0.7
    error = report.max_error_ulp(known, trace)
    assert error is not None
    assert error <= 0.55
    other = read(scene(tmp_path, model, theta="3.80001e-4"))  # a wrong model would be seen
    wrong = report.max_error_ulp(other, trace)
    assert wrong is not None
    assert wrong > 0.55
    numbers = report.summary(known, trace, None, {})
    assert (numbers["model"], len(numbers["elements"])) == (model, len(known.elements))
    assert numbers.get("kinds", []) == (["dahl", "slip", "dahl"] if model == "parallel" else [])


def test_where_the_references_end():
    """Far in one direction each stands at its Fc; and none of them is another."""
    far, elements = [10**6], [(100.0, 0.2), (100.0, 0.7)]
    travel = reference.travel_per_count(100.0, 0.7, 1e-3)
    back = [-(10**6)]
    assert float(reference.exact_asymmetric_ratios(far, elements, 1e-3)[0]) == pytest.approx(2 / 7)
    assert float(reference.exact_asymmetric_ratios(back, elements, 1e-3)[0]) == -1
    assert float(reference.exact_elastoplastic_ratios(back, travel, 0.5)[0]) == -1
    assert float(reference.exact_elastoplastic_ratios([3], travel, 0.5)[0]) == pytest.approx(
        float(3 * travel)
    )
    kinds = ["dahl", "slip"]
    assert float(reference.exact_parallel_ratios(far, elements, kinds, 1e-3)[0]) == 1
