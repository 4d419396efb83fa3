# SPDX-License-Identifier: MIT
"""Scenes of every model: exact over the bus, against its differential equation solved in 100 bits
from reversal to reversal, and what the summary says of them.
"""

from __future__ import annotations

from dataclasses import replace

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


LOADED = "[friction]\nmodel = loaded\nsigma0 = 100\nFc = 0.7\ntheta_per_count = 3.8e-4\n"


def told_loads(log):
    """Raw parameter Load of each ParamWrite, and how many were refused."""
    writes, refused = [], 0
    message = report.database().get_message_by_name("ParamWrite")
    reply = report.database().get_message_by_name("ParamReply")
    with can.CanutilsLogReader(log) as frames:
        for frame in frames:
            if frame.arbitration_id == message.frame_id:
                said = message.decode(frame.data, scaling=False)
                assert said["Counter"] == len(writes) % 16
                writes.append(said["Load"])
            if frame.arbitration_id == reply.frame_id:
                refused += str(reply.decode(frame.data)["Result"]) != "Done"
    return writes, refused


def check_loaded(result, path):
    """Exact by an independent solution, and not that of a constant load."""
    assert result.code == 0, result.err
    with can.CanutilsLogReader(result.log) as frames:
        trace = report.trace_of(frames)
    known = read(path)
    error = report.max_error_ulp(known, trace)
    assert error is not None
    assert error <= 0.55
    constant = report.max_error_ulp(known, replace(trace, load=None))
    assert constant is not None
    assert constant > 1000
    return trace


def test_friction_follows_a_load_of_the_log(tmp_path):
    ticks = np.arange(1500)
    load = 3 + 5 * np.cos(ticks / 91)  # of both signs: its size counts; clamped at 1, as at first
    load[900:] = 0
    angle = np.round(400 * np.sin(ticks / 57))
    rows = [f"{a:.0f},{c:.9f}" for a, c in zip(angle, load, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["angle,carried", *rows]) + "\n")
    path = tmp_path / "loaded.ini"
    path.write_text(
        LOADED + "[load]\ncolumn = carried\nfull = 5\nrest = 0.125\n"
        "[motion]\nkind = log\nfile = log.csv\nangle = angle\ncounts_per_unit = 1\n"
    )
    result = run(tmp_path, path, "--virtual")
    trace = check_loaded(result, path)
    share = np.minimum(1, 0.125 + np.abs(load) / 5)
    assert np.abs(trace.load / 65536 - share).max() <= 0.5 / 65536 + 1e-9
    assert np.abs(trace.torque(read(path))).max() <= 0.7
    assert np.abs(trace.torque(read(path))[1450:]).max() <= 0.125 * 0.7 * (1 + 1e-6)
    writes, refused = told_loads(result.log)
    assert refused == 0
    told = np.diff(trace.load, prepend=65536) != 0
    told[999::1000] = True  # again, for a node that missed it
    assert writes == trace.load[told].tolist()


def test_friction_follows_the_motors_torque(tmp_path):
    """Of a shaft that is driven, and the shaft's own friction with it."""
    path = tmp_path / "loaded.ini"
    path.write_text(
        LOADED + "[load]\nfull = 4\nrest = 0.25\n"
        "[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = 0.7\n"
        "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n"
    )
    result = run(tmp_path, path, "--virtual", "--trace", tmp_path / "trace.csv")
    trace = check_loaded(result, path)
    motor, friction = np.loadtxt(
        tmp_path / "trace.csv", delimiter=",", skiprows=1, usecols=(4, 5)
    ).T
    carried = 0.25 + np.abs(motor[1:]) / 4  # row 0 keeps no torque of before
    assert np.abs(trace.load[1:] / 65536 - carried).max() < 1e-5
    assert np.abs(friction[1:]).max() < 0.7 * 0.76
    assert (np.abs(friction[2:]) <= 0.7 * (carried[:-1] + 1 / 65536)).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LOADED, "model = loaded needs [load]"),
        ("[load]\nfull = 1\n", "[load] needs [friction]"),
        (LOADED + "[load]\nfull = 1\n", "[load] needs a [rotor], or [motion] kind = log"),
        (LOADED + "[load]\nfull = 0\n", ":7: [load] full = 0: outside 1e-09 to"),
        (LOADED + "[load]\nfull = 1\nrest = 1.5\n", ":8: [load] rest = 1.5: outside 0 to 1"),
        (LOADED + "[load]\nrest = 1\n", '[load] has no key "full"'),
        (
            LOADED.replace("loaded", "dahl") + "[load]\nfull = 1\n",
            "[load] has no meaning for model = dahl",
        ),
    ],
)
def test_a_load_that_cannot_be_is_one_line(tmp_path, text, words):
    motion = (
        "[motion]\nkind = steering\namplitude = 900\nsweep_s = 0.7\ntremor = 20\n"
        "tremor_s = 0.05\nseconds = 3\n"
    )
    path = tmp_path / "bad.ini"
    path.write_text(text + motion)
    result = run(tmp_path, path, "--virtual")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert words in result.err


@pytest.mark.parametrize(
    ("header", "column", "words"),
    [
        ("angle,load", "", '[load] has no key "column"'),
        ("angle,other", "column = load\n", 'no column "load"; there is "angle", "other"'),
        ("load,angle,load", "column = load\n", 'two columns "load"'),
        ("angle,load", "column = load\n", ':3: column "load": "x" is not a finite number'),
        ("angle", "column = angle\n", '"x" is not a finite number'),  # as both: told once
    ],
)
def test_a_column_of_a_load_that_is_not_there_is_one_line(tmp_path, header, column, words):
    rows = (",".join(["0"] * header.count(",") + [cell]) for cell in "0x")
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    path = tmp_path / "bad.ini"
    path.write_text(
        LOADED + f"[load]\nfull = 1\n{column}"
        "[motion]\nkind = log\nfile = log.csv\nangle = angle\ncounts_per_unit = 1\n"
    )
    result = run(tmp_path, path, "--virtual")
    assert (result.code, result.err.count("\n")) == (2, 1) and words in result.err


def test_where_the_references_end():
    """Far in one direction each stands at its Fc; and none of them is another."""
    far, elements = [10**6], [(100.0, 0.2), (100.0, 0.7)]
    travel = reference.travel_per_count(100.0, 0.7, 1e-3)
    back = [-(10**6)]
    lower = float(np.float32(0.2)) / float(np.float32(0.7))  # the parameters are floats, as in C
    forward = float(reference.exact_asymmetric_ratios(far, elements, 1e-3)[0])
    assert forward == pytest.approx(lower, rel=1e-12)
    assert float(reference.exact_asymmetric_ratios(back, elements, 1e-3)[0]) == -1
    assert float(reference.exact_elastoplastic_ratios(back, travel, 0.5)[0]) == -1
    assert float(reference.exact_elastoplastic_ratios([3], travel, 0.5)[0]) == pytest.approx(
        float(3 * travel)
    )
    kinds = ["dahl", "slip"]
    assert float(reference.exact_parallel_ratios(far, elements, kinds, 1e-3)[0]) == 1
