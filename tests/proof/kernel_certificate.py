# SPDX-License-Identifier: MIT
"""A certificate of the relative error of the kernel for each a and each angle.

* Sollya bounds each cubic against Q(f) = (1 - 2^-f)/f (supnorm).
* Gappa bounds the error of its fixed-point evaluation: each product rounds down.
* Interval arithmetic (mpmath) adds the cuts of f, of the last product, of a and of a |dtheta|, and
  joins the parts.

The constants are those of the kernel's generator. The certified function is `model`;
test_kernel_proof.py compares its bits with the library.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mpmath import iv, mp, mpf
from programs import call

mp.prec = iv.prec = 160
UNIT = mpf(2) ** -32
LN2 = iv.log(iv.mpf(2))
CUBICS = 16
WORD = 2**32 - 1
LEAST_USUAL = mpf(2) ** -31  # a smaller g is also cut to Q64, which docs/accuracy.md adds


class CertificateError(Exception):
    """The generator prints other constants, or a tool failed."""


@dataclass(frozen=True)
class Constants:
    """The cubics, with coefficients from order 0 on in Q32, and the factor of the plan."""

    cubics: tuple[tuple[int, ...], ...]
    log2_e: int


@dataclass(frozen=True)
class Piece:
    """A certified range of the relative error of g for v in [low, high]."""

    name: str
    low: mpf
    high: mpf
    error: object  # iv.mpf


def constants_of(sollya: str, generator: Path) -> Constants:
    text = run([sollya, str(generator)], "")
    rows = re.findall(r"{(-?\d+), (-?\d+), (-?\d+), (\d+)u}", text)
    if len(rows) != CUBICS:
        raise CertificateError(f"{generator.name} prints other constants: {text[-400:]}")
    cubics = tuple(tuple(int(c) for c in reversed(row)) for row in rows)
    return Constants(cubics, int(mp.ceil(mpf(2) ** 31 / mp.ln2)))


def model(c: Constants, mantissa: int, shift: int) -> tuple[int, int]:
    """Return (m, s) of g = m 2^(-32 - s), for v = mantissa 2^(-32 - shift)."""
    if shift < -8:
        return WORD, 0
    if shift < 0:
        return model_large(c, mantissa, shift), 0
    missing = 32 - mantissa.bit_length()
    mantissa, shift = mantissa << missing, shift + missing
    m = mantissa * model_q(c, mantissa >> shift) >> 32
    return (m, shift) if shift < 32 else (m >> (shift - 32), 32)


def model_q(c: Constants, f: int) -> int:
    """Return Q(f) in Q32."""
    *rest, r = c.cubics[f >> 28]
    y = f & 2**28 - 1
    for k in reversed(rest):
        r = k + (y * r >> 32)
    return r


def model_large(c: Constants, mantissa: int, shift: int) -> int:
    """Return g in Q32 for 1/2 <= v < 256."""
    k, f = mantissa >> (32 + shift), mantissa << -shift & WORD
    product = (f | k) * model_q(c, f | k) >> 32
    return WORD - ((WORD - product) >> k)


def run(command: list[str], script: str) -> str:
    """Return the output of Sollya or Gappa for a script."""
    done = call(*command, input=script, timeout=120)
    return done.stdout + done.stderr


def polynomial(coefficients: tuple[int, ...], x: str, unit: str) -> str:
    """Return c0 + x (c1 + x (c2 + ..)) for Sollya and Gappa, each number with its unit."""
    *rest, text = [f"{c}{unit}" for c in coefficients]
    for c in reversed(rest):
        text = f"({c} + {x} * {text})"
    return text


def fits(c: Constants, sollya: str) -> list:
    """Return a range of P(f) f/(1 - 2^-f) - 1 for each cubic.

    supnorm certifies the distance from 1 + centre, with the centre near the middle of the piece.
    It needs f > 0: below 2^-30, P and (1 - 2^-f)/f change by less than 2^-61.
    """
    script = ["prec = 200; verbosity = 0;"]
    for j, row in enumerate(c.cubics):
        f = (mpf(j) + mpf(1) / 2) / CUBICS
        p = sum(k * UNIT * (mpf(1) / 2 / CUBICS) ** i for i, k in enumerate(row))
        centre = int(mp.nint((p * f / (1 - mpf(2) ** -f) - 1) * mpf(2) ** 60))
        P = polynomial(row, f"(_x_ - {j} / {CUBICS})", " * 2^-32")  # noqa: N806
        low = f"{j} / {CUBICS}" if j else "2^-30"
        script.append(
            f"b = supnorm({P} * _x_, (1 - 2^(-_x_)) * (1 + {centre} * 2^-60), "
            f"[{low}; {j + 1} / {CUBICS}], relative, 2^-10);"
            f'print("bound", {centre}, ceil(sup(b) * 2^80));'
        )
    text = run([sollya], "\n".join(script) + "\nquit;\n")
    found = re.findall(r"bound (-?\d+) (\d+)", text)
    if len(found) != CUBICS:
        raise CertificateError(f"sollya gave {len(found)} bounds of {CUBICS}: {text[-400:]}")
    slack = 1 + iv.mpf([-1, 1]) * mpf(2) ** -60
    return [
        (1 + iv.mpf(int(c)) / 2**60) * (1 + iv.mpf([-int(b), int(b)]) / 2**80) * slack - 1
        for c, b in found
    ]


def gappa_range(gappa: str, script: str) -> object:
    """Return the interval that Gappa proves for the goal of a script."""
    text = re.sub(r"{[^}]*}", "", run([gappa], script))
    numbers = re.findall(r"(-?\d+)(?:b(-?\d+))?[ ,\]]", text.split(" in ")[-1])
    if len(numbers) < 2 or " in [" not in text:
        raise CertificateError(f"gappa proved nothing: {text[-400:]}")
    ends = [mpf(int(n)) * mpf(2) ** int(e or 0) for n, e in numbers[:2]]
    return iv.mpf(ends)


def horner_script(row: tuple[int, ...]) -> str:
    """Return the script that bounds the evaluated cubic minus the exact one, y below 1/16."""
    *rest, tail = row
    lines = ["@down = fixed<-32,dn>;", "y = down(yx);", f"r0 = {tail}b-32;"]
    for i, k in enumerate(reversed(rest)):
        lines.append(f"r{i + 1} = {k}b-32 + down(y * r{i});")
    exact = polynomial(row, "y", "b-32")
    return "\n".join([*lines, f"{{ y in [0, 1b-4] -> r{len(rest)} - {exact} in ? }}"])


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


def with_travel(c: Constants, error: object, low: mpf, cut: mpf) -> object:
    """Add the error of v: g(v(1 + t))/g(v) - 1 is from 0 to t times the elasticity v g'(v)/g(v),
    which falls with v. The product of the mantissas loses at most `cut` of v.
    """
    t = (1 + plan_error(c)) * (1 - iv.mpf([0, cut])) - 1
    v = iv.mpf(low) * (1 - iv.mpf(2) ** -28)
    elasticity = v * LN2 / (iv.exp(v * LN2) - 1) if low > 0 else iv.mpf(1)
    growth = iv.mpf([(1 + 2 * t * t + t * elasticity.b).a, 1])
    ratio = hull(iv.mpf(growth.a) - iv.mpf(2) ** -58, iv.mpf((1 + t * elasticity.b).b))
    return (1 + error) * ratio - 1


@dataclass(frozen=True)
class Cubic:
    """A cubic with certified errors: its fit, and its evaluation in absolute terms."""

    fit: object
    lost: object


def small_pieces(c: Constants, cubics: list[Cubic]) -> Iterator[Piece]:
    """v in (0, 1), in pieces with mantissas in an eighth of [1/2, 1)."""
    for shift in range(12):
        for i in range(8):
            m_low, m_high = mpf(8 + i) / 16, mpf(9 + i) / 16
            low, high = m_low * mpf(2) ** -shift, m_high * mpf(2) ** -shift
            yield small_piece(c, cubics, f"small {shift} {i}", (low, high), m_low)
    for i in range(8):
        ends = (LEAST_USUAL / 2, mpf(2) ** -12)
        yield small_piece(c, cubics, f"small 12.. {i}", ends, mpf(8 + i) / 16)


def small_piece(
    c: Constants, cubics: list[Cubic], name: str, ends: tuple[mpf, mpf], m_low: mpf
) -> Piece:
    """g = m Q(f), m the mantissa of v. f is v cut to Q32, which can only increase Q, by less than
    ln 2/2 of a unit, relative. The last product loses less than a unit of g/v m.
    """
    low, high = ends
    cubic = cubics[int(low * CUBICS)]
    least = (g_of(iv.mpf(high)) / iv.mpf(high)).a  # of Q, which falls from ln 2
    evaluated = 1 + cubic.lost / (iv.mpf([least, LN2.b]) * (1 + cubic.fit))
    of_f = iv.mpf([1, (1 + LN2 * UNIT / 2).b])
    product = 1 - iv.mpf([0, UNIT / (m_low * least * (1 - mpf(2) ** -28))])
    error = (1 + cubic.fit) * evaluated * of_f * product - 1
    return Piece(name, low, high, with_travel(c, error, low, 2 * UNIT / m_low))


def large_pieces(c: Constants, cubics: list[Cubic]) -> Iterator[Piece]:
    """v in [1/2, 32), in pieces of a thirty-second of f."""
    for i in range(32):
        f = (mpf(i) / 32, mpf(i + 1) / 32)
        for k in range(32):
            if k > 0 or i >= 16:
                yield large_piece(c, cubics[i // 2], k, f)


def large_piece(c: Constants, cubic: Cubic, k: int, ends: tuple[mpf, mpf]) -> Piece:
    """p = f Q(f) is 1 - 2^-f with an error `lost`: that of the cubic, of its evaluation, of the cut
    of the product, and of k, which was added to f in units. The error of g is 2^-k of that, and the
    shift of the complement loses at most 1 - 2^-k units.
    """
    low, high = k + ends[0], k + ends[1]
    f = iv.mpf([ends[0], ends[1]])
    G = g_of(f)  # noqa: N806
    added = iv.mpf([0, ((1 - G) * LN2 * (k * UNIT)).b])
    lost = G * cubic.fit + (f + k * UNIT) * cubic.lost + iv.mpf([-UNIT, 0]) + added * (1 + UNIT)
    half = iv.mpf(2) ** -k
    error = (half * lost + iv.mpf([-UNIT, 0]) * (1 - half)) / g_of(iv.mpf([low, high]))
    cut = UNIT * (2 / low if low < 1 else 4)
    return Piece(f"large {k} {float(ends[0])}", low, high, with_travel(c, error, low, cut))


def beyond_piece(c: Constants) -> Piece:
    """v >= 32: all ones."""
    error = iv.mpf([-UNIT, mpf(2) ** -32])
    return Piece("all", mpf(32), mp.inf, with_travel(c, error, mpf(31), 4 * UNIT))


def certificate(c: Constants, sollya: str, gappa: str) -> list[Piece]:
    """The pieces of v in [2^-32, infinity)."""
    lost = [gappa_range(gappa, horner_script(row)) for row in c.cubics]
    cubics = [Cubic(*errors) for errors in zip(fits(c, sollya), lost, strict=True)]
    return [*small_pieces(c, cubics), *large_pieces(c, cubics), beyond_piece(c)]


def worst(pieces: list[Piece]) -> Piece:
    return max(pieces, key=lambda piece: max(-piece.error.a, piece.error.b))
