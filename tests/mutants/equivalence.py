# SPDX-License-Identifier: MIT
"""That a mutant means the same as the original: proven by a bit-vector solver from compiled code.

Both are compiled with the whole core, and every function that then reads differently has to give
the same value and leave the same bytes, for all arguments and all memory that its contract allows
(`CONTRACTS`). Products of two unknown words are slow for a solver; here they are any function of
both that is 0 where one is 0, has the bounds of a product, and takes its factors in any order. What
holds for all such functions holds for the product.
"""

from __future__ import annotations

import functools
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import z3
from mutate import Mutant
from workshop import CORE, ROOT

sys.path.insert(0, str(ROOT / "tests" / "proof"))
import bitvectors  # noqa: E402  (a module of the proofs beside)

UNROLL = 300
sys.setrecursionlimit(100_000)  # terms are as deep as loops are long
ONE_WORD = 1 << 32


@dataclass(frozen=True)
class Answer:
    """Whether it is the same, and what was said of each function that reads differently."""

    proven: bool
    said: tuple[str, ...]


# ---------------------------------------------------------------- contracts


def word_at(object_: str, offset: int, size: int = 4) -> Any:
    place = z3.BitVecVal(offset, bitvectors.WORD)
    return bitvectors.loaded(bitvectors.bytes_named(object_), place, 8 * size, 8 * size)


def is_plan(plan: Any) -> list[Any]:
    """What dahl_prepare makes: entry 0 is 0, mantissas are normal, exponents those of its range."""
    a_mantissa, Fc_mantissa, scale = word_at(plan, 0), word_at(plan, 8), word_at(plan, 12)
    exponent = z3.LShR(scale, 24)
    return [
        word_at(plan, 16, 8) == 0,
        z3.UGE(a_mantissa, 1 << 31),
        z3.UGE(Fc_mantissa, 1 << 31),
        Fc_mantissa & 0xFF == 1,
        scale & 0xFFFFFF == 1,
        z3.UGE(exponent, 159 - 31 - 64),
        z3.ULE(exponent, 159 - 31 + 63),
    ]


def is_state(state: Any) -> list[Any]:
    """|w| <= 2^62 + 2^31, which no step leaves."""
    w, most = word_at(state, 0, 8), (1 << 62) + (1 << 31)
    return [w <= most, w >= -most]


def is_far(dcounts: Any) -> list[Any]:
    """Beyond the entries for single counts."""
    return [z3.Or(dcounts > 8, dcounts < -8)]


def is_normal(bits: Any) -> list[Any]:
    return [z3.UGE(bits, 1 << 31)]


def is_size(size: Any) -> list[Any]:
    """Of a state that is not 0."""
    return [size != 0, z3.ULE(size, (1 << 62) + (1 << 31))]


def is_q63(mantissa: Any) -> list[Any]:
    return [z3.UGE(mantissa, 1 << 63)]


Contract = Callable[[Any], list[Any]]
CONTRACTS: dict[str, tuple[Contract, ...]] = {
    "dahl_step_counts": (is_plan, is_state),
    "dahl_step_counts_q30": (is_plan, is_state),
    "dahl_step": (is_plan, is_state),
    "dahl_move_digits": (is_plan, is_state, is_far),
    "dahl_step_far": (is_plan, is_state),
    "dahl_torque": (is_plan, is_state),
    "dahl_torque_of": (is_plan,),
    "dahl_set_torque": (is_plan, is_state),
    "dahl_change_plan": (is_plan, is_plan, is_state),
    "scaled": (is_size, is_q63),
    "dahl_quotient_q63": (is_normal, is_normal),
}


# ---------------------------------------------------------------- products


def narrow(term: Any) -> Any:
    """The term before zeros were put before it."""
    while z3.is_app_of(term, z3.Z3_OP_ZERO_EXT):
        term = term.arg(0)
    return term


class Products:
    """Products as an unknown function of two words."""

    def __init__(self) -> None:
        self.known: dict[int, Any] = {}
        self.facts: list[Any] = []
        self.keep: list[Any] = []  # terms whose ids are in use

    def away(self, term: Any) -> Any:
        """The term without products of unknowns."""
        if term.get_id() in self.known:
            return self.known[term.get_id()]
        self.keep.append(term)
        children = [self.away(child) for child in term.children()]
        unknown = [child for child in children if not z3.is_bv_value(child)]
        if z3.is_app_of(term, z3.Z3_OP_BMUL) and len(unknown) > 1:
            new = functools.reduce(self.product, unknown)
            for child in children:
                new = new * child if z3.is_bv_value(child) else new
        else:
            new = term.decl()(*children) if children else term
        self.known[term.get_id()] = new
        return new

    def product(self, a: Any, b: Any) -> Any:
        """Of words that were widened, whatever to, it is one of 64 bits, widened."""
        short, size = (narrow(a), narrow(b)), a.size()
        if size > 64 and short[0].size() + short[1].size() <= 64:
            wide = self.product(*(z3.ZeroExt(64 - x.size(), x) for x in short))
            return z3.ZeroExt(size - 64, wide)
        sort = a.sort()
        function = z3.Function(f"product{sort.size()}", sort, sort, sort)
        r = function(a, b)
        self.facts += [r == function(b, a), z3.Implies(z3.Or(a == 0, b == 0), r == 0)]
        if sort.size() == 64:
            words = z3.And(z3.ULT(a, ONE_WORD), z3.ULT(b, ONE_WORD))
            bounds = z3.And(*map(self.bounds, (a, b), (b, a), (r, r)))
            self.facts.append(z3.Implies(words, bounds))
        return r

    def bounds(self, a: Any, b: Any, r: Any) -> Any:
        """At most all but one of a; at least half of it where b has its top bit set."""
        least = z3.Implies(z3.UGE(b, ONE_WORD >> 1), z3.UGE(r, a << 31))
        return z3.And(z3.ULE(r, (a << 32) - a), least)


# ---------------------------------------------------------------- proofs


def core_in(folder: Path) -> bitvectors.Module:
    sources = [folder / "lib" / f"{name}.c" for name in CORE]
    flags = (*bitvectors.PLAIN, "-fno-inline")  # so that only what is mutated reads differently
    return bitvectors.compile_c(*sources, flags=flags, include=(folder / "lib",), unroll=UNROLL)


@functools.cache
def original() -> bitvectors.Module:
    return core_in(ROOT)


def with_mutant(mutant: Mutant) -> bitvectors.Module:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "lib", folder / "lib")
        path = folder / mutant.file
        path.write_bytes(mutant.apply(path.read_bytes()))
        return core_in(folder)


def contract_of(name: str, arguments: Sequence[Any]) -> list[Any]:
    terms: list[Any] = []
    for contract, argument in zip(CONTRACTS.get(name, ()), arguments, strict=False):
        terms += contract(argument)
    return terms


def same(one: Any, other: Any, name: str, seconds: float, at: dict[int, int]) -> bitvectors.Verdict:
    """Whether both functions do the same within the contract; `at` sets arguments to numbers."""
    arguments = one.symbols()
    for place, value in at.items():
        arguments[place] = z3.BitVecVal(value, arguments[place].size())
    a, b = one(*arguments), other(*arguments)
    place = z3.BitVec("place", bitvectors.WORD)
    objects = [object_ for object_ in arguments if isinstance(object_, str)]
    equal = [z3.Select(a.memory[o], place) == z3.Select(b.memory[o], place) for o in objects]
    if z3.is_bv(a.value):
        equal.append(a.value == b.value)
    products = Products()
    claim = products.away(bitvectors.all_of(z3.Not(b.fault), z3.Not(b.beyond), *equal))
    given = [z3.Not(a.fault), z3.Not(a.beyond), *contract_of(name, arguments)]
    given = [products.away(term) for term in given]
    return bitvectors.prove(claim, [*given, *products.facts], seconds)


NEIGHBOURS = ({"<", "<="}, {">", ">="})


def is_boundary(mutant: Mutant) -> bool:
    """Whether only a comparison is moved by one: then both differ nowhere but where its sides are
    equal."""
    found = re.search(r" relational: (.+) -> (.+?)(?: #\d+)?$", mutant.id)
    if not found:
        return False
    before, after = (re.search(r"[<>]=?", text) for text in found.groups())
    return bool(before and after and {before[0], after[0]} in NEIGHBOURS)


def prove_equivalent(
    mutant: Mutant, seconds: float = 60, at: dict[int, int] | None = None
) -> Answer:
    """Compares all functions of the core that read differently with the mutant in. `at` proves it
    only for some arguments, which is enough where a comparison is moved by one."""
    if at and not is_boundary(mutant):
        return Answer(False, ("`at` is for a comparison that is moved by one",))
    one, other = original(), with_mutant(mutant)
    said, proven = [], True
    for name, code in one.functions.items():
        if str(code) == str(other.functions.get(name)):
            continue
        verdict = same(one[name], other[name], name, seconds, at or {})
        said.append(f"{name}: {str(verdict)[:200]}")
        proven = proven and verdict.proven
    return Answer(proven, tuple(said))
