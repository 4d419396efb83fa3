# SPDX-License-Identifier: MIT
"""The class dahl.Node: its torques, its copies, and the arguments that it refuses. Against the
program dahl-loop: sim/test_loop_models.py.
"""

import copy

import dahl
import numpy as np
import pytest
from dahl import codec
from dahl.binding import models
from dahl.codec import EncoderState, Param, ParamWrite, Write
from model_examples import THETA, keys, made, numbers, whole
from strategies import COPIES

PLAN = dahl.Plan(100, 0.7, THETA)
MODELS = {name: (keys(model), made(model)) for name, model in models.table().items()}


def move(node: dahl.Node, *counts: int) -> list[codec.FrictionTorque]:
    first = node.counts.ok
    messages = (codec.pack(EncoderState(c, (first + k) % 16)) for k, c in enumerate(counts))
    return [codec.unpack(node.receive(message)) for message in messages]


@pytest.mark.parametrize("model", MODELS)
def test_a_node_answers_with_the_torque_of_its_friction(model):
    """Bits are equal. The C adds the elements of a mix in another order."""
    given = MODELS[model][1]
    alone = dahl.Friction(given) if isinstance(given, dahl.Plan) else copy.deepcopy(given)
    one, random, count, load = dahl.Node(given), np.random.default_rng(1), 0, ()
    row = models.table()[model]
    sums = (sum(numbers(row)[0]), whole(row), THETA)
    for param, value in zip((Param.SIGMA0, Param.FC, Param.THETA), sums, strict=True):
        reply = codec.unpack(one.receive(codec.pack(ParamWrite(param))))
        assert reply.si == pytest.approx(value, rel=1e-3)
    for k, move in enumerate([0, *random.integers(-200, 201, 1000).tolist(), 10**8]):
        if model == "loaded" and k % 7 == 0:
            raw = int(random.integers(0, 2**16 + 1))
            one.receive(codec.pack(ParamWrite(Param.LOAD, raw, Write.WRITE)))
            load = (raw / 2**16,)
        count += move
        answer = codec.unpack(one.receive(codec.pack(EncoderState(count, k % 16))))
        wanted = alone.step_counts_q30(move, *load)
        assert abs(answer.torque_q30 - wanted) <= (4 if model == "parallel" else 0), k


@pytest.mark.parametrize("model", MODELS)
def test_a_node_keeps_its_own_state_of_any_model(model):
    """It does not move with the friction that it was made of, nor with a copy of itself."""
    given = copy.deepcopy(MODELS[model][1])
    one, other = (dahl.Node(given, number=0) for _ in range(2))
    move(one, 0, 40, 30), move(other, 0, -40, 30)
    assert one != other and one.friction == MODELS[model][1] and "state=OK, ok=3" in repr(one)
    for same in (copied(one) for copied in COPIES):
        assert same == one and same.counts == one.counts
        assert move(same, 900) == move(copy.copy(one), 900) and same != one
    if hasattr(given, "run_counts"):
        given.run_counts(*[[1]] * (2 if model == "loaded" else 1))
        assert one.friction != given


LIMITS = {  # of each setting: a value just beyond, and the limit in the message
    "number": [(-1, "0"), (16, "15")],
    "gain": [(-0.001, "0"), (1.001, "1")],
    "limit": [(-0.001, "0"), (1.001, "1")],
    "ramp": [(-0.001, "0"), (60.01, "60")],
    "timeout": [(0, "0.001"), (0.0009, "0.001"), (60.01, "60")],
    "status_period": [(-0.001, "0"), (60.01, "60")],
    "max_step": [(-1, "0"), (2**31, "2147483647")],
}
SLIPS = [dahl.Slip([1] * 5, [1] * 5, theta) for theta in (1e-3, 1e-3, 2e-3)]
NO_FRICTION = [
    (dahl.Plan(1, 1), "theta_per_count = 0"),
    (dahl.Loaded(PLAN, fixed_stiffness=True), "fixed_stiffness"),
    (dahl.Parallel(), "0 elements"),
    (dahl.Parallel(*SLIPS[:2]), "10 elements"),
    (dahl.Parallel(dahl.Slip([1], [1], 1e-3), dahl.Slip([1], [1], 2e-3)), "theta_per_count"),
]


def test_a_setting_beyond_its_limits_or_a_wrong_friction_is_refused():
    for name, beyond in LIMITS.items():
        for value, limit in beyond:
            with pytest.raises(dahl.Error, match=rf"{name} = {value}\b.* {limit}\b"):
                dahl.Node(PLAN, **{name: value})
            dahl.Node(PLAN, **{name: float(limit)})
    for friction, word in NO_FRICTION:
        with pytest.raises(dahl.Error, match=word):
            dahl.Node(friction)
    for elements in (1, 8):
        dahl.Node(dahl.Parallel(dahl.Slip([1] * elements, [1] * elements, 1e-3)))


@pytest.mark.parametrize("identifier", [2**29, -1, 256.5, None, "256"])
def test_a_wrong_frame_or_time_is_refused_and_changes_nothing(identifier):
    one, before = dahl.Node(PLAN), dahl.Node(PLAN)
    message = codec.pack(EncoderState(5))
    message.arbitration_id = identifier
    for call in (codec.unpack, one.receive):
        wrong = dahl.InputError if isinstance(identifier, (int, float)) else TypeError
        with pytest.raises(wrong, match="arbitration_id = "):
            call(message)
    for junk in ("x", float("nan"), 1.001e300, -1e308, []):
        wrong = dahl.InputError if isinstance(junk, float) else TypeError
        with pytest.raises(wrong):
            one.tick(junk)
        with pytest.raises(TypeError):
            one.receive(junk, 0.0)
    assert one == before
