# SPDX-License-Identifier: MIT
"""Theorems about one step, for every state and every 64-bit g, on the code that clang makes of the
library (steps.c). docs/verification.md says them in words, and why one step suffices.

Each is seen to bite: a planted bug (a copy of the library with one line changed) must refute it, by
values for which the compiled C itself gives what the solver says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import products
import pytest
import z3
from bitvectors import (
    CHECKED,
    PLAIN,
    Module,
    Outcome,
    Verdict,
    compile_c,
    prove,
    without_products,
)
from conftest import need

STEPS = Path(__file__).with_name("steps.c")
ONE = 1 << 62
LOWEST, HIGHEST = -ONE - (1 << 31), ONE + (1 << 31) - 1  # the states that a step keeps
ONE_Q30 = 1 << 30

w = z3.BitVec("w", 64)
g_high, g_low, h_high, h_low = z3.BitVecs("g_high g_low h_high h_low", 32)
IN_RANGE = (w >= LOWEST, w <= HIGHEST)


@dataclass
class Steps:
    """The compiled functions, and which calls a theorem made of them."""

    module: Module
    calls: list[tuple[str, Outcome]] = field(default_factory=list)

    def __call__(self, name: str, *arguments: Any) -> Outcome:
        outcome = self.module[name](*arguments)
        self.calls.append((name, outcome))
        return outcome


Statement = tuple[Any, Sequence[Any]]  # a claim and what it supposes
THEOREMS: dict[str, Callable[[Steps], Statement]] = {}
LONG = {
    *("no_overflow_backward", "odd_complement", "odd_negative"),
    *("whole_travel_forward", "whole_travel_backward", "way_forward", "counts_between"),
    *("join_x", "join_y"),
}
EXACT = {"identity", "whole_travel_forward", "whole_travel_backward", "check"}


def theorem(statement: Callable[[Steps], Statement]) -> Callable[[Steps], Statement]:
    THEOREMS[statement.__name__] = statement
    return statement


def tie(x: Any, at: int = 1 << 31) -> Any:
    """Whether x is half way between two values in Q30."""
    return z3.Extract(31, 0, x) == at


@theorem
def no_overflow_forward(steps: Steps) -> Statement:
    return z3.Not(steps("forward", w, g_high, g_low).fault), IN_RANGE


@theorem
def no_overflow_backward(steps: Steps) -> Statement:
    return z3.Not(steps("backward", w, g_high, g_low).fault), IN_RANGE


@theorem
def range_forward(steps: Steps) -> Statement:
    after = steps("forward", w, g_high, g_low).value
    return z3.And(w <= after, after <= HIGHEST), IN_RANGE


@theorem
def range_backward(steps: Steps) -> Statement:
    after = steps("backward", w, g_high, g_low).value
    return z3.And(LOWEST <= after, after <= w), IN_RANGE


@theorem
def range_q30(steps: Steps) -> Statement:
    shown = steps("q30", w).value
    return z3.And(-ONE_Q30 <= shown, shown <= ONE_Q30), IN_RANGE


@theorem
def identity(steps: Steps) -> Statement:
    forward, backward = (steps(name, w, 0, 0).value for name in ("forward", "backward"))
    return z3.And(forward == w, backward == w), ()


@theorem
def saturation_forward(steps: Steps) -> Statement:
    after, shown = steps("forward", w, g_high, g_low).value, steps("q30", w).value
    return z3.And(after == w, shown == ONE_Q30), [w >= ONE - (1 << 31), w <= HIGHEST]


@theorem
def saturation_backward(steps: Steps) -> Statement:
    after, shown = steps("backward", w, g_high, g_low).value, steps("q30", w).value
    return z3.And(after == w, shown == -ONE_Q30), [w < -ONE + (1 << 31), w >= LOWEST]


@theorem
def whole_travel_forward(steps: Steps) -> Statement:
    claims = []
    for low in (2**32 - 1, 2**32 - 2):
        shown = steps("q30", steps("forward", w, 2**32 - 1, low).value).value
        other = z3.And(tie(w), w < ONE - (1 << 31))
        claims.append(shown == z3.If(other, ONE_Q30 - 1, z3.BitVecVal(ONE_Q30, 32)))
    return z3.And(*claims), IN_RANGE


@theorem
def whole_travel_backward(steps: Steps) -> Statement:
    claims = []
    for low in (2**32 - 1, 2**32 - 2):
        shown = steps("q30", steps("backward", w, 2**32 - 1, low).value).value
        other = z3.And(tie(w, 2**31 - 1), w >= -ONE + (1 << 31))
        claims.append(shown == z3.If(other, -ONE_Q30 + 1, z3.BitVecVal(-ONE_Q30, 32)))
    return z3.And(*claims), IN_RANGE


@theorem
def odd_complement(steps: Steps) -> Statement:
    forward = steps("forward", ~w, g_high, g_low).value
    return forward == ~steps("backward", w, g_high, g_low).value, ()


@theorem
def odd_negative(steps: Steps) -> Statement:
    forward = steps("forward", -w, g_high, g_low).value
    return forward == -steps("backward", w, g_high, g_low).value, [z3.Not(tie(w))]


@theorem
def low_product(steps: Steps) -> Statement:
    """A step goes by z g_high, and less than z more; so words of g can be compared one by one."""
    z, way = z3.BitVec("z", 32), steps("gap_times", z3.BitVec("z", 32), g_high, g_low).value
    high, wide = z3.ZeroExt(32, z) * z3.ZeroExt(32, g_high), z3.ZeroExt(32, z)
    return z3.And(z3.ULE(high, way), z3.ULE(way - high, wide)), [z3.ULE(z, 1 << 31)]


@theorem
def monotone_low(steps: Steps) -> Statement:
    z = z3.BitVec("z", 32)
    one, two = (steps("gap_times", z, g_high, low).value for low in (g_low, h_low))
    return z3.ULE(one, two), [z3.ULE(z, 1 << 31), z3.ULE(g_low, h_low)]


@theorem
def monotone_high(steps: Steps) -> Statement:
    """By low_product, of which `far` and `near` are what it says of the two ways."""
    z, far, near = z3.BitVec("z", 32), *z3.BitVecs("far near", 64)
    wide = z3.ZeroExt(32, z)
    one, two = (wide * z3.ZeroExt(32, high) for high in (g_high, h_high))
    given = [z3.ULE(one, near), z3.ULE(near - one, wide), z3.ULE(two, far)]
    return z3.ULE(near, far), [z3.ULE(z, 1 << 31), z3.ULT(g_high, h_high), *given]


@theorem
def way_forward(steps: Steps) -> Statement:
    """A step is the state and its way: what is monotone in the way is so in the state after."""
    z = z3.BitVecVal(ONE_Q30, 32) - steps("q30", w).value
    way = steps("gap_times", z, g_high, g_low).value
    claim = z3.And(way >= 0, steps("forward", w, g_high, g_low).value == w + way)
    return claim, IN_RANGE


@theorem
def way_backward(steps: Steps) -> Statement:
    z = z3.BitVecVal(ONE_Q30, 32) + steps("q30", w).value
    way = steps("gap_times", z, g_high, g_low).value
    claim = z3.And(way >= 0, steps("backward", w, g_high, g_low).value == w - way)
    return claim, IN_RANGE


c_x, c_y = z3.BitVecs("c_x c_y", 64)


@theorem
def join_x(steps: Steps) -> Statement:
    c = steps("joined", c_x, c_y).value
    return z3.And(z3.UGE(c, 1), z3.ULE(c, c_x)), [c_x != 0]


@theorem
def join_y(steps: Steps) -> Statement:
    c = steps("joined", c_x, c_y).value
    return z3.And(z3.UGE(c, 1), z3.ULE(c, c_y)), [c_y != 0]


@theorem
def check(steps: Steps) -> Statement:
    """The codes of dahl.h, by the solver's own floating point."""
    bits = z3.BitVec("bits", 32)
    x = z3.fpBVToFP(bits, z3.Float32())
    least, most = z3.FPVal(2.0**-64, z3.Float32()), z3.FPVal(2.0**64, z3.Float32())
    senseless = z3.Or(z3.fpIsNaN(x), z3.fpIsInf(x), z3.fpLEQ(x, z3.FPVal(0, z3.Float32())))
    inside = z3.And(z3.fpGEQ(x, least), z3.fpLT(x, most))
    code = z3.If(inside, z3.BitVecVal(0, 32), z3.If(senseless, z3.BitVecVal(-1, 32), -2))
    return steps("checked", bits).value == code, ()


@theorem
def counts_between(steps: Steps) -> Statement:
    before, now, n = z3.BitVecs("before now n", 32)
    call = steps("dahl_counts_between", before, now, n)
    moved, turn = z3.SignExt(2, call.value), z3.ZeroExt(2, n)
    way = z3.ZeroExt(2, z3.URem(now, n)) - z3.ZeroExt(2, z3.URem(before, n))
    same = z3.Or(moved == way, moved == way + turn, moved == way - turn)
    counter = z3.And(n == 0, call.value == now - before)
    wheel = z3.And(n != 0, same, -turn <= moved << 1, moved << 1 < turn)
    return z3.And(z3.Not(call.fault), z3.Or(counter, wheel)), ()


def torque(steps: Steps, state: Any, bits: Any) -> Outcome:
    """The torque for Fc of these bits, by what dahl_prepare makes of it."""
    mantissa = 0x80000000 | bits << 8 | 1
    return steps("torque_bits", mantissa, scale_of(bits), state)


def scale_of(bits: Any) -> Any:
    return (z3.LShR(bits, 23) - 127 - 31 + 159) << 24 | 1


FC = z3.BitVec("Fc", 32)
IS_FC = (z3.ULE(63 << 23, FC), z3.ULT(FC, 191 << 23))


@theorem
def torque_saturates(steps: Steps) -> Statement:
    call = torque(steps, w, FC)
    near = z3.Or(w >= ONE - (1 << 31) - 1, w <= -ONE + (1 << 31))
    sign = z3.If(w < 0, z3.BitVecVal(1 << 31, 32), 0)
    return z3.And(z3.Not(call.fault), call.value == sign | FC), [*IN_RANGE, *IS_FC, near]


@theorem
def torque_range(steps: Steps) -> Statement:
    call = torque(steps, w, FC)
    size = call.value & 0x7FFFFFFF
    normal = z3.Or(z3.And(call.value == 0, w == 0), z3.UGE(size, 1 << 23))
    sign = z3.Or(w == 0, (call.value < 0) == (w < 0))
    claim = z3.And(z3.Not(call.fault), z3.ULE(size, FC), normal, sign)
    return claim, [*IN_RANGE, *IS_FC]


# ---------------------------------------------------------------- proofs


def settle(name: str, steps: Steps, seconds: float, solver: str = "bitwuzla") -> Verdict:
    """The verdict on a theorem; products are taken by their laws, where it is not exact."""
    claim, given = THEOREMS[name](steps)
    if name in EXACT:
        return prove(claim, given, seconds, solver)
    terms, commutes = without_products(products.without_remainders([claim, *given]))
    if name.startswith("join"):
        terms = products.bounded_by(c_x if name == "join_x" else c_y, terms)
        return prove(terms[0], terms[1:], seconds, solver)
    return prove(terms[0], [*terms[1:], *commutes, *products.facts(terms)], seconds, solver)


@pytest.fixture(scope="module")
def compiled() -> Module:
    need("clang-19", "one step")
    return compile_c(STEPS, flags=PLAIN + CHECKED)


def marked(name: str) -> Any:
    return pytest.param(name, marks=pytest.mark.long) if name in LONG else name


@pytest.mark.parametrize("name", [marked(name) for name in THEOREMS])
def test_theorems(compiled: Module, name: str) -> None:
    verdict = settle(name, Steps(compiled), 150)
    assert verdict.proven, f"{name}: {verdict}"


@pytest.mark.parametrize("lemma", list(products.lemmas()), ids=lambda lemma: lemma[0])
def test_theorems_products(lemma: tuple[str, Any, Sequence[Any]]) -> None:
    name, claim, given = lemma
    verdict = prove(claim, given, 30, "z3")
    assert verdict.proven, f"{name}: {verdict}"


@pytest.mark.parametrize("name", ["range_forward", "range_backward"])
def test_theorems_by_another_solver(compiled: Module, name: str) -> None:
    verdict = settle(name, Steps(compiled), 120, "z3")
    assert verdict.proven, f"{name}: {verdict}"


# ---------------------------------------------------------------- planted bugs
