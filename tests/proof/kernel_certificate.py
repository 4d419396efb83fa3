# SPDX-License-Identifier: MIT
"""A certificate of the relative error of the kernel for each a and each angle.

* Sollya bounds the polynomials against 1 - 2^-v (supnorm), piece by piece.
* Gappa bounds the error of the fixed-point evaluation for each mantissa of a piece: each shift and
  each upper half of a product rounds down. If Gappa's bound is too wide, the mantissas of the piece
  are enumerated.
* Interval arithmetic (mpmath) adds the rounding of a and of a |dtheta|, and joins the parts.

The constants are those of the kernel's generator. The certified function is `model`;
test_kernel_proof.py compares its bits with the library.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpmath import iv, mp, mpf

mp.prec = iv.prec = 160
UNIT = mpf(2) ** -32
LN2 = iv.log(iv.mpf(2))


class CertificateError(Exception):
    """The generator prints other constants, or a tool failed."""


@dataclass(frozen=True)
class Constants:
    """Factors of the kernel and of the plan; polynomials from order 0 on, in Q32."""

    small: tuple[int, ...]
    part: tuple[int, ...]
    tiny: int
    table: tuple[int, ...]
    log2_e: int


@dataclass(frozen=True)
class Piece:
    """A certified range of the relative error of g for v in [low, high]."""

    name: str
    low: mpf
    high: mpf
    error: object  # iv.mpf


def constants_of(sollya: str, generator: Path) -> Constants:
    """The constants that the kernel's generator prints."""
    said = run([sollya, str(generator)], "")
    numbers = {(name, int(i)): int(n) for name, i, n in re.findall(r"(\w+) (\d+) = (\d+) u", said)}

    def row(name: str, length: int) -> tuple[int, ...]:
        return tuple(numbers[name, i] for i in range(length))

    if len(numbers) != 5 + 4 + 16:
        raise CertificateError(f"{generator.name} prints other constants: {said[-400:]}")
    small = row("small", 5)
    log2_e = int(mp.ceil(mpf(2) ** 31 / mp.ln2))
    return Constants(small, row("part", 4), small[0], row("H", 16), log2_e)


WORD = 2**32 - 1


def model(c: Constants, mantissa: int, shift: int) -> int:
    """g in Q64 for v = mantissa 2^(-32 - shift): the certified function, in integers."""
    if shift < -5:
        return 2**64 - 1
    if shift < 2:
        return model_large(c, mantissa, shift) << 32
    if shift < 32:
        r = horner_model(c.small, mantissa >> (shift - 2))
        return (mantissa * r >> 32) << (32 - shift) | 2
    return (mantissa * c.tiny >> shift) + 2 if shift < 64 else 0


def horner_model(coefficients: tuple[int, ...], y: int) -> int:
    """c0 - y (c1 - y (c2 - ..)) in Q32, cut at each product; the last factor is y's upper half."""
    *rest, last, tail = coefficients
    r = last - ((y >> 16) * tail >> 16)
    for k in reversed(rest):
        r = k - (y * r >> 32)
    return r


def model_large(c: Constants, mantissa: int, shift: int) -> int:
    """The upper word of g for 1/4 <= v < 32."""
    whole, y = mantissa >> (28 + shift), mantissa << (4 - shift) & WORD
    h = c.table[whole & 15]
    part = y * horner_model(c.part, y) >> 32
    g = h + ((~(h >> 1) & WORD) * part >> 35)
    return WORD - ((WORD - (g >> 1)) >> (whole >> 4))


def run(command: list[str], script: str) -> str:
    """The output of Sollya or Gappa for a script."""
    done = subprocess.run(
        command, input=script, capture_output=True, text=True, timeout=120, check=False
    )
    return done.stdout + done.stderr


def polynomial(coefficients: tuple[int, ...], x: str, unit: str) -> str:
    """c0 - x (c1 - x (c2 - ..)) as text for Sollya and Gappa, each number with its unit."""
    *rest, text = [f"{c}{unit}" for c in coefficients]
    for c in reversed(rest):
        text = f"({c} - {x} * {text})"
    return text


def supnorms(sollya: str, coefficients: tuple[int, ...], steps: int, pieces: list) -> list:
    """For each piece (low, high) of y: a range of P(y) v/(1 - 2^-v) - 1, v = y/steps.

    supnorm certifies the distance from 1 + c, with c near the middle of the piece.
    """
    script = [f"prec = 200; verbosity = 0; P = {polynomial(coefficients, '_x_', '*2^-32')};"]
    for low, high in pieces:
        v = (low + high) / 2 / steps
        p = sum((-1) ** i * c * UNIT * (v * steps) ** i for i, c in enumerate(coefficients))
        centre = int(mp.nint((p * v / (1 - mpf(2) ** -v) - 1) * mpf(2) ** 60))
        ends = f"[{sollya_text(low)}; {sollya_text(high)}]"
        target = f"(1 - 2^(-_x_ / {steps})) * (1 + {centre} * 2^-60)"
        script.append(
            f"b = supnorm(P * _x_ / {steps}, {target}, {ends}, relative, 2^-10);"
            f'print("bound", {centre}, ceil(sup(b) * 2^80));'
        )
    text = run([sollya], "\n".join(script) + "\nquit;\n")
    found = re.findall(r"bound (-?\d+) (\d+)", text)
    if len(found) != len(pieces):
        raise CertificateError(f"sollya gave {len(found)} bounds of {len(pieces)}: {text[-400:]}")
    return [
        (1 + iv.mpf(int(c)) / 2**60) * (1 + iv.mpf([-int(b), int(b)]) / 2**80) - 1 for c, b in found
    ]


def gappa_range(gappa: str, script: str) -> object:
    """The interval that Gappa proves for the goal of a script."""
    text = re.sub(r"{[^}]*}", "", run([gappa], script))
    numbers = re.findall(r"(-?\d+)(?:b(-?\d+))?[ ,\]]", text.split(" in ")[-1])
    if len(numbers) < 2 or " in [" not in text:
        raise CertificateError(f"gappa proved nothing: {text[-400:]}")
    ends = [mpf(int(n)) * mpf(2) ** int(e or 0) for n, e in numbers[:2]]
    return iv.mpf(ends)


DOWN = "fixed<-32,dn>"


def horner(coefficients: tuple[int, ...]) -> tuple[str, str]:
    """The evaluation as text for Gappa, and the name of its result."""
    *rest, last, tail = coefficients
    lines = ["yh = fixed<-16,dn>(y);", f"r0 = {last}b-32 - {DOWN}(yh * {tail}b-32);"]
    for i, c in enumerate(reversed(rest)):
        lines.append(f"r{i + 1} = {c}b-32 - {DOWN}(y * r{i});")
    return "\n".join(lines), f"r{len(rest)}"


def small_script(c: Constants, shift: int | None, m: tuple[str, str]) -> str:
    """g - m P(4 v) for mantissas m in a range; shift None: 12 and more, m and v independent."""
    text, r = horner(c.small)
    Y = "Yx" if shift is None else f"m * 1b{2 - shift}"
    bound = f"m in [{m[0]}, {m[1]}]" + (" /\\ Y in [0, 1b-10]" if shift is None else "")
    return f"""
m = {DOWN}(mx);
Y = {Y};
y = {DOWN}(Y);
{text}
g = {DOWN}(m * {r});
{{ {bound} -> g - m * {polynomial(c.small, "Y", "b-32")} in ? }}
"""


def large_script(c: Constants, j: int, y: tuple[str, str]) -> str:
    """The upper half of g, minus 1 - E + E y/16 P(y), with E = 2^(-j/16) to 2^-100."""
    text, r = horner(c.part)
    h = c.table[j]
    e = int(mp.nint(mpf(2) ** (100 - mpf(j) / 16)))
    return f"""
y = {DOWN}(yx);
{text}
t = {DOWN}(y * {r});
g = {h}b-33 + fixed<-33,dn>({DOWN}({2**32 - 1 - (h >> 1)}b-32 * t) * 1b-4);
half = {DOWN}(g);
{{ y in [{y[0]}, {y[1]}] ->
   half - ({2**100 - e}b-100 + ({e}b-100 * (y * {polynomial(c.part, "y", "b-32")})) * 1b-4) in ? }}
"""


def enumerated_loss(c: Constants, m: tuple[mpf, mpf]) -> object:
    """The same error for shift 2, where Y is the mantissa: for each mantissa, in integers.

    The exact polynomial is in double, within 2^-50.
    """
    low, high = (int(end * 2**32) for end in m)
    loss = [0.0, 0.0]
    for first in range(low, high + 1, 2**18):
        m_all = np.arange(first, min(first + 2**18, high + 1, 2**32), dtype=np.uint64)
        r = np.uint64(c.small[3]) - ((m_all >> 16) * np.uint64(c.small[4]) >> 16)
        y = m_all.astype(float) * 2.0**-32
        p = np.full(len(y), c.small[4] * 2.0**-32)
        for k in (2, 1, 0):
            r = np.uint64(c.small[k]) - (m_all * r >> 32)
        for k in (3, 2, 1, 0):
            p = c.small[k] * 2.0**-32 - y * p
        lost = (m_all * r >> 32).astype(float) * 2.0**-32 - y * p
        loss = [min(loss[0], lost.min()), max(loss[1], lost.max())]
    return iv.mpf([loss[0] - 2.0**-50, loss[1] + 2.0**-50])


def g_of(v: object) -> object:
    return 1 - iv.exp(-v * LN2)


def hull(low: object, high: object) -> object:
    return iv.mpf([min(low.a, high.a), max(low.b, high.b)])


def plan_error(c: Constants) -> object:
    """Relative error of a/ln 2 in the plan: that of the constant, and the cut to 32 bits.

    The quotient and the products before it lose at most 2^-60.
    """
    constant = iv.mpf(c.log2_e) / 2**31 * LN2 - 1
    return iv.mpf([(constant - iv.mpf(2) ** -31 - iv.mpf(2) ** -60).a, constant.b])


def with_travel(c: Constants, error: object, low: mpf, m_low: mpf) -> object:
    """Add the error of v: g(v(1 + t))/g(v) - 1 is from 0 to t times the elasticity v g'(v)/g(v),
    which falls with v. The mantissa of the product is cut to 32 bits.
    """
    t = (1 + plan_error(c)) * (1 - iv.mpf([0, (UNIT / m_low)])) - 1
    v = iv.mpf(low) * (1 - iv.mpf(2) ** -28)
    elasticity = v * LN2 / (iv.exp(v * LN2) - 1) if low > 0 else iv.mpf(1)
    growth = iv.mpf([(1 + 2 * t * t + t * elasticity.b).a, 1])
    ratio = hull(iv.mpf(growth.a) - iv.mpf(2) ** -58, iv.mpf((1 + t * elasticity.b).b))
    return (1 + error) * ratio - 1


ENOUGH = mpf(2) ** -29
CUTS = {2: 64, 3: 4}  # the polynomial's error is steep near its end, v = 1/4


def small_pieces(c: Constants, sollya: str, gappa: str) -> Iterator[Piece]:
    """v in [2^-30, 1/4): shifts 2 to 11 in pieces, all others in one."""
    cases: list[tuple[int | None, mpf, mpf]] = [
        (shift, mpf(cuts + i) / (2 * cuts), mpf(cuts + i + 1) / (2 * cuts))
        for shift in range(2, 12)
        for cuts in (CUTS.get(shift, 2),)
        for i in range(cuts)
    ]
    ys = [(low * mpf(2) ** (2 - s), high * mpf(2) ** (2 - s)) for s, low, high in cases]
    near = (mpf(2) ** -30, mpf(2) ** -10)
    fits = supnorms(sollya, c.small, 4, [*ys, near])
    below = below_all(c.small[0], c.small[1], mpf(2) ** -32)
    for (shift, m_low, m_high), y, fit in zip(
        [*cases, (None, mpf(1) / 2, mpf(1))], [*ys, (mpf(0), near[1])], fits, strict=True
    ):
        lost = gappa_range(gappa, small_script(c, shift, binary_texts((m_low, m_high))))
        fit_all = fit if shift is not None else hull(fit, below)
        piece = small_piece(c, f"small {shift}", y, m_low, lost, fit_all)
        if shift == 2 and -piece.error.a > ENOUGH:
            lost = enumerated_loss(c, (m_low, m_high))
            piece = small_piece(c, f"small {shift} enumerated", y, m_low, lost, fit_all)
        yield piece


def small_piece(
    c: Constants, name: str, y: tuple[mpf, mpf], m_low: mpf, lost: object, fit: object
) -> Piece:
    """Join polynomial and evaluation: g = m P(Y) (1 + lost/(m P)), v = Y/4."""
    Y = iv.mpf([y[0], y[1]])
    p = sum(Y**i * UNIT * (-1) ** i * k for i, k in enumerate(c.small))
    error = (1 + fit) * (1 + lost / (p * m_low)) - 1
    low, high = y[0] / 4, y[1] / 4
    return Piece(name, low, high, with_travel(c, error, low, m_low))


def below_all(c0: int, c1: int, v: mpf) -> object:
    """P(4v) v/(1 - 2^-v) - 1 for v near 0, from v ln 2 (1 - v) < 1 - 2^-v < v ln 2."""
    slope = iv.mpf([1 - v, 1]) * LN2
    return (c0 - iv.mpf([0, 4 * v]) * c1) * UNIT / slope - 1


def tiny_piece(c: Constants) -> Piece:
    """v < 2^-30: one upper half, cut; the kernel adds two units, which exceed the cut."""
    lost = iv.mpf([-2 / mpf(c.tiny), 0])
    error = (1 + below_all(c.tiny, 0, mpf(2) ** -30)) * (1 + lost) - 1
    return Piece("tiny", mpf(0), mpf(2) ** -30, with_travel(c, error, mpf(0), mpf(1) / 2))


def large_pieces(c: Constants, sollya: str, gappa: str) -> Iterator[Piece]:
    """v in [1/4, 32): each entry of the table, with y in pieces."""
    (fit,) = supnorms(sollya, c.part, 16, [(mpf(2) ** -30, mpf(1))])
    fit = hull(fit, below_all(c.part[0], c.part[1], mpf(2) ** -34))
    for j in range(16):
        cuts = 2 if j >= 4 else 1
        for i in range(cuts):
            y = (mpf(i) / cuts, mpf(i + 1) / cuts)
            lost = gappa_range(gappa, large_script(c, j, binary_texts(y)))
            yield from large_piece(c, j, y, lost + iv.mpf([-1, 1]) * mpf(2) ** -90, fit)


def large_piece(
    c: Constants, j: int, y: tuple[mpf, mpf], lost: object, fit: object
) -> Iterator[Piece]:
    """k = 0: the error of g. k > 0: g is ~(~half >> k), so its error is at least
    2^-k lost - 2^-32 (1 - 2^-k), and the shift rounds it up by at most that.
    """
    E = iv.exp(-iv.mpf(j) / 16 * LN2)
    low, high = ((j + end) / mpf(16) for end in y)
    # 1 - 2^-v from the polynomial's value Q = E y/16 P: g = 1 - E + Q/(1 + fit)
    Q = E * g_of(iv.mpf([y[0], y[1]]) / 16)
    drift = Q * fit
    if j >= 4:
        error = (lost + drift) / g_of(iv.mpf([low, high]))
        m_low = low if low >= mpf(1) / 2 else 2 * low
        yield Piece(f"large 0 {j}", low, high, with_travel(c, error, low, m_low))
    for k in range(1, 32):
        half = iv.mpf(2) ** -k
        total = half * (lost + drift) + iv.mpf([-UNIT, 0]) * (1 - half)
        error = total / g_of(iv.mpf([k + low, k + high]))
        yield Piece(f"large {k} {j}", k + low, k + high, with_travel(c, error, k + low, mpf(1) / 2))


def beyond_piece(c: Constants) -> Piece:
    """v >= 32: all ones."""
    error = iv.mpf([-(mpf(2) ** -63), mpf(2) ** -31.9])
    return Piece("all", mpf(32), mp.inf, with_travel(c, error, mpf(31), mpf(1) / 2))


def sollya_text(x: mpf) -> str:
    """A dyadic number as text for Sollya."""
    return f"{int(x * 2**40)} * 2^-40"


def binary_texts(ends: tuple[mpf, mpf]) -> tuple[str, str]:
    """Dyadic numbers as text for Gappa."""
    return tuple(f"{int(end * 2**40)}b-40" for end in ends)  # type: ignore[return-value]


def certificate(c: Constants, sollya: str, gappa: str) -> list[Piece]:
    """The pieces of v in (0, infinity)."""
    pieces = [tiny_piece(c), *small_pieces(c, sollya, gappa), *large_pieces(c, sollya, gappa)]
    return [*pieces, beyond_piece(c)]


def worst(pieces: list[Piece]) -> Piece:
    """The piece with the largest error."""
    return max(pieces, key=lambda piece: max(-piece.error.a, piece.error.b))
