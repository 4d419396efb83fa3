# SPDX-License-Identifier: MIT
"""What the theorems need of a product of two words of 32 bits.

Solvers take minutes for one product; so theorems take it as a function p(a, b) of which only these
laws are known (a, b, c < 2^32, so that p in 64 bits is the product itself):

    bounded     p(a, b) + a <= 2^32 a
    ordered     b < c:  p(a, b) + a <= p(a, c)
    half        a >= 2^31:  p(a, b) >= 2^31 b
    known       p(K, b) = K b for some numbers K, near a half and near 1

and that it commutes; of a remainder that it is below the divisor. `lemmas` are the laws as
statements about whole numbers, for z3 to prove.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product as pairs_of
from typing import Any

import z3
from bitvectors import inner_first

LIMIT = 1 << 32


def lemmas() -> Iterator[tuple[str, Any, Sequence[Any]]]:
    """Name of each law, the law, and what it supposes."""
    a, b, c = z3.Ints("a b c")
    words = [z3.And(0 <= x, x < LIMIT) for x in (a, b, c)]
    yield "one word of 64 bits", z3.And(0 <= a * b, a * b < LIMIT * LIMIT), words
    yield "commutes", a * b == b * a, words
    yield "bounded", a * b + a <= LIMIT * a, words
    yield "half", a * b >= LIMIT // 2 * b, [*words, a >= LIMIT // 2]
    yield "ordered", a * b + a <= a * c, [*words, b < c]


KNOWN = (1 << 31, (1 << 31) + 1, LIMIT - 1, LIMIT - 2, LIMIT - 3)


def without_remainders(terms: Sequence[Any]) -> list[Any]:
    """The terms, with each remainder as any number that is below the divisor (or that is 0)."""
    kinds = (z3.Z3_OP_BUREM, z3.Z3_OP_BUREM_I)
    found = [t for t in inner_first(terms) if any(z3.is_app_of(t, k) for k in kinds)]
    found = [t for t in found if not z3.is_bv_value(t.arg(1))]
    claim, *given = terms
    for x in found:
        rest = z3.Function("rest", *3 * [x.sort()])(x.arg(0), x.arg(1))
        claim, *given = (z3.substitute(t, (x, rest)) for t in (claim, *given))
        given.append(z3.Implies(x.arg(1) != 0, z3.ULT(rest, x.arg(1))))
    return [claim, *given]


def facts(terms: Sequence[Any]) -> list[Any]:
    """The laws for all products in terms that `without_products` made."""
    found = [t for t in inner_first(terms) if t.decl().name() == "product64"]
    ways = [(p.arg(i), p.arg(1 - i), p) for p in found for i in (0, 1)]
    laws = [small_law(a, b, p) for a, b, p in ways]
    for (a, b, p), (d, c, q) in pairs_of(ways, ways):
        if a.eq(d) and not p.eq(q):
            small = z3.And(z3.ULT(a, LIMIT), z3.ULT(b, c), z3.ULT(c, LIMIT))
            laws.append(z3.Implies(small, z3.And(z3.ULE(p + a, q), z3.ULE(p, p + a))))
    return laws


def small_law(a: Any, b: Any, p: Any) -> Any:
    """Bounded, half and known."""
    half = z3.Implies(z3.UGE(a, 1 << 31), z3.UGE(p, b << 31))
    known = [z3.Implies(a == k, p == k * b) for k in KNOWN]
    small = z3.And(z3.ULT(a, LIMIT), z3.ULT(b, LIMIT))
    return z3.Implies(small, z3.And(z3.ULE(p, (a << 32) - a), half, *known))


def bounded_by(factor: Any, terms: Sequence[Any]) -> list[Any]:
    """The terms, each product as any number that is bounded by the words of one factor."""
    found = [t for t in inner_first(terms) if t.decl().name() == "product64"]
    pairs, laws = [], []
    for k, p in enumerate(found):
        part = p.arg(0) if any(t.eq(factor) for t in inner_first([p.arg(0)])) else p.arg(1)
        pairs.append((p, z3.BitVec(f"product!{k}", 64)))
        laws.append(z3.ULE(pairs[-1][1], (part << 32) - part))
    return [*(z3.substitute(t, *pairs) for t in terms), *laws]
