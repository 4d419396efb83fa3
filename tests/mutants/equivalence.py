# SPDX-License-Identifier: MIT
"""That a mutant means the same as the original: proven by a bit-vector solver from compiled code.

Both are compiled with the whole core, and every function that then reads differently has to give
the same value and leave the same bytes, for all arguments and all memory that its contract allows
(`CONTRACTS`). Products of two unknown words are slow for a solver; here they are any function of
both that is 0 where one is 0, has the bounds of a product, and takes its factors in any order. What
holds for all such functions holds for the product. So is what doubles do; only a whole number as a
double is bit by bit what it is.
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
from mutate import PARSER, Mutant, Node, blanked, text_of
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
    a_mantissa, Fc_mantissa, scale = (
        word_at(plan, 0),
        word_at(plan, 8),
        word_at(plan, 12),
    )
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


def is_w(w: Any) -> list[Any]:
    """As is_state, of the number itself."""
    most = (1 << 62) + (1 << 31)
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


def is_travel(table: Any) -> list[Any]:
    """Entry 0 holds the shift of a travel in range, or that of none."""
    shift = word_at(table, 4)
    return [z3.Or(shift == 255, z3.And(z3.UGT(shift, 43), z3.ULE(shift, 93)))]


Contract = Callable[[Any], list[Any]]
CONTRACTS: dict[str, tuple[Contract, ...]] = {
    "dahl_step_counts": (is_plan, is_state),
    "dahl_step_counts_q30": (is_plan, is_state),
    "dahl_step": (is_plan, is_state),
    "dahl_move_digits": (is_plan, is_state, is_far),
    "dahl_step_far": (is_plan, is_state),
    "dahl_batch_product": (is_w,),
    "dahl_batch_move": (is_plan,),
    "dahl_torque": (is_plan, is_state),
    "dahl_torque_of": (is_plan, is_w),
    "dahl_torque_here": (is_plan, is_w),
    "dahl_set_torque": (is_plan, is_state),
    "dahl_change_plan": (is_plan, is_plan, is_state),
    "scaled": (is_size, is_q63),
    "dahl_quotient_q63": (is_normal, is_normal),
    "fill_table": (is_travel,),
}


# ---------------------------------------------------------------- products


def narrow(term: Any) -> Any:
    """The term before zeros were put before it."""
    while z3.is_app_of(term, z3.Z3_OP_ZERO_EXT):
        term = term.arg(0)
    return term


def in_order(a: Any, b: Any) -> tuple[Any, Any]:
    """Whichever way round they come, the same: for functions of which the order does not matter."""
    return (a, b) if a.get_id() <= b.get_id() else (b, a)


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
        a, b = in_order(a, b)
        r = function(a, b)
        self.facts += [r == function(b, a), z3.Implies(z3.Or(a == 0, b == 0), r == 0)]
        self.facts += [z3.Implies(a == 1, r == b), z3.Implies(b == 1, r == a)]
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


SHARED = ("lib/bits.h", "lib/gap.h", "lib/torque.h", "lib/fixed.h", "lib/multiply.h")


def units_for(file: str) -> list[tuple[str, ...]]:
    """What is compiled, each as one, to see what a mutant of this file changes."""
    core = [] if file.startswith("lib/batch") else [CORE]
    return [*core, ("batch",)] if not core or file in SHARED else core


def code_in(folder: Path, units: Sequence[str]) -> bitvectors.Module:
    sources = [folder / "lib" / f"{name}.c" for name in units]
    flags = (
        *bitvectors.PLAIN,
        "-fno-inline",
    )  # so that only what is mutated reads differently
    return bitvectors.compile_c(*sources, flags=flags, include=(folder / "lib",), unroll=UNROLL)


@functools.cache
def original(units: tuple[str, ...] = CORE) -> bitvectors.Module:
    return code_in(ROOT, units)


def with_mutant(mutant: Mutant, units: tuple[str, ...] = CORE) -> bitvectors.Module:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "lib", folder / "lib")
        path = folder / mutant.file
        path.write_bytes(mutant.apply(path.read_bytes()))
        return code_in(folder, units)


def contract_of(name: str, arguments: Sequence[Any]) -> list[Any]:
    terms: list[Any] = []
    for contract, argument in zip(CONTRACTS.get(name, ()), arguments, strict=False):
        terms += contract(argument)
    return terms


# ---------------------------------------------------------------- functions known by lemmas

Lemma = tuple[tuple[Any, Any], list[Any]]  # arguments that give the same; facts about the result


def of_high_product(r: Any, a: Any, b: Any) -> Lemma:
    """Either order; 1 at least where one factor is 2 and the other 2^63, or more."""
    least = [z3.And(z3.UGE(x, 2), z3.UGE(y, 1 << 63)) for x, y in ((a, b), (b, a))]
    return in_order(a, b), [z3.Implies(z3.Or(*least), z3.UGE(r, 1))]


def of_quotient(r: Any, n: Any, d: Any) -> Lemma:
    """The lowest bits do not matter; of two equal ones it is 1."""
    n, d = (z3.simplify(z3.LShR(x, 1)) for x in (n, d))
    return (n, d), [z3.Implies(z3.And(n == d, z3.UGE(n, 1 << 30)), r == 1 << 63)]


LEMMAS: dict[str, Callable[[Any, Any, Any], Lemma]] = {
    "dahl_mulhi64": of_high_product,
    "dahl_quotient_q63": of_quotient,
}
SYMMETRIC = ("dahl_mulhi64",)


def prove_lemmas(seconds: float = 60) -> dict[str, bitvectors.Verdict]:
    """What LEMMAS says of each function, from its code."""
    core, verdicts = original(), {}
    for name, other in (("dahl_mulhi64", "swapped"), ("dahl_quotient_q63", "cut")):
        function = core[name]
        a, b = function.symbols()
        outcome = function(a, b)
        alike = {"swapped": (b, a), "cut": (a & -2, b & -2)}[other]
        claim = [function(*alike).value == outcome.value, z3.Not(outcome.fault)]
        facts = LEMMAS[name](outcome.value, a, b)[1]
        products = Products()
        terms = [products.away(term) for term in (*claim, *facts)]
        verdicts[name] = bitvectors.prove(z3.And(*terms), products.facts, seconds)
    return verdicts


class KnownByLemmas(bitvectors.Run):
    """Runs code, but of functions named in `known` it takes only what their lemma says."""

    def __init__(self, module: bitvectors.Module, known: set[str]) -> None:
        super().__init__(module)
        self.known, self.facts = known, list[Any]()

    def call(self, function: Any, arguments: Any, state: Any) -> Any:
        if function.name not in self.known:
            return super().call(function, arguments, state)
        a, b = (argument.term for argument in arguments)
        r = z3.BitVec("r", 64)
        args, facts = LEMMAS[function.name](r, a, b)
        name = z3.Function(function.name, a.sort(), b.sort(), r.sort())
        result = name(*args)
        self.facts += [z3.substitute(fact, (r, result)) for fact in facts]
        if function.name in SYMMETRIC:
            self.facts.append(name(*reversed(args)) == result)
        poison = bitvectors.any_of(*(argument.poison for argument in arguments))
        return bitvectors.Value(result, poison), state

    def instruction(self, i: Any, kind: str, state: Any) -> Any:
        """Doubles: of a whole number its bits, else an unknown function of the operands."""
        if kind not in (*DOUBLES, "sitofp", "uitofp"):
            return super().instruction(i, kind, state)
        given = [self.value(operand, state) for operand in i.operands]
        terms = [value.term for value in given]
        if kind in DOUBLES:
            size = z3.BitVecSort(bitvectors.bits_of(str(i.type)))
            name = f"{kind}{size.size()}"
            term = z3.Function(name, *(t.sort() for t in terms), size)(*terms)
        else:
            term = double_of(terms[0], kind == "sitofp")
        return bitvectors.Value(term, bitvectors.any_of(*(value.poison for value in given)))


DOUBLES = ("fmul", "fadd", "fsub", "fptrunc", "fpext")


def double_of(x: Any, signed: bool) -> Any:
    """The bits of a whole number as a double, rounded to the nearest, half to even."""
    x = z3.SignExt(64 - x.size(), x) if signed else z3.ZeroExt(64 - x.size(), x)
    negative = z3.And(signed, x < 0)
    size = z3.If(negative, -x, x)
    zeros = bitvectors.leading_zeros(size)
    top = size << zeros
    mantissa, rest = z3.LShR(top, 11), top & 0x7FF
    up = z3.Or(z3.UGT(rest, 0x400), z3.And(rest == 0x400, mantissa & 1 == 1))
    bits = (1023 + 62 - zeros << 52) + mantissa + z3.If(up, z3.BitVecVal(1, 64), 0)
    return z3.If(x == 0, z3.BitVecVal(0, 64), bits | z3.If(negative, z3.BitVecVal(1 << 63, 64), 0))


def called(
    function: bitvectors.Function, arguments: Sequence[Any], known: set[str]
) -> tuple[bitvectors.Outcome, list[Any]]:
    """As Function.__call__, with the facts about the functions known by lemmas."""
    kinds = [kind for _, kind in function.parameters()]
    values = [bitvectors.as_value(a, k) for a, k in zip(arguments, kinds, strict=True)]
    memory = {v.object: bitvectors.bytes_named(v.object) for v in values if v.object}
    run = KnownByLemmas(function.module, known - {function.code.name})
    value, state = run.call(
        function.code, values, bitvectors.State(bitvectors.TRUE, {}, dict(memory))
    )
    parts = value.parts if isinstance(value, bitvectors.Group) else (value,)
    fault = bitvectors.any_of(run.fault, *(part.poison for part in parts))
    terms = [part.term for part in parts]
    term = z3.Concat(*terms) if len(terms) > 1 else terms[0]
    outcome = bitvectors.Outcome(term, fault, run.beyond, state.memory, list(arguments))
    return outcome, run.facts


def callees(module: bitvectors.Module, name: str) -> set[str]:
    """The function and all that it calls."""
    found, waiting = set[str](), {name}
    while waiting:
        here = waiting.pop()
        found.add(here)
        names = re.findall(r"call[^\n@]*@(\w+)\(", str(module.functions[here]))
        waiting |= {n for n in names if n in module.functions} - found
    return found


def same(
    one: Any,
    other: Any,
    seconds: float,
    at: dict[int, int],
    known: set[str],
    far: bool = False,
) -> bitvectors.Verdict:
    """Whether both functions do the same within the contract; `at` sets arguments to numbers."""
    name, arguments = one.code.name, one.symbols()
    for place, value in at.items():
        arguments[place] = z3.BitVecVal(value, arguments[place].size())
    (a, facts), (b, more) = (called(function, arguments, known) for function in (one, other))
    place = z3.BitVec("place", bitvectors.WORD)
    objects = [object_ for object_ in arguments if isinstance(object_, str)]
    equal = [z3.Select(a.memory[o], place) == z3.Select(b.memory[o], place) for o in objects]
    if z3.is_bv(a.value):
        equal.append(a.value == b.value)
    products = Products()
    claim = products.away(bitvectors.all_of(z3.Not(b.fault), z3.Not(b.beyond), *equal))
    given = [
        z3.Not(a.fault),
        z3.Not(a.beyond),
        *contract_of(name, arguments),
        *facts,
        *more,
    ]
    given += is_far(arguments[2]) if far else []
    given = [products.away(term) for term in given]
    return bitvectors.prove(claim, [*given, *products.facts], seconds)


# ---------------------------------------------------------------- comparisons moved by one

COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "<": lambda x, y: x < y,
    "<=": lambda x, y: x <= y,
    ">": lambda x, y: x > y,
    ">=": lambda x, y: x >= y,
    "==": lambda x, y: x == y,
    "!=": lambda x, y: x != y,
}


def around(node: Node, start: int, end: int) -> list[Node]:
    """The nodes around a range of bytes, outermost first."""
    inner = [c for c in node.children if c.start_byte <= start and end <= c.end_byte]
    return [node, *(around(inner[0], start, end) if inner else [])]


def comparison(text: str) -> tuple[str, Any] | None:
    """Of `name < 0` and its like: the name, and the comparison of an int32_t as a term."""
    found = re.fullmatch(r"(\w+) (<|<=|>|>=|==|!=) (-?\d+)", text)
    if not found:
        return None
    return found[1], COMPARISONS[found[2]](z3.BitVec("x", 32), z3.BitVecVal(int(found[3]), 32))


def is_left_alone(name: str, body: str) -> bool:
    """Whether nothing in the text changes what has that name."""
    changes = rf"&{name}\b|(\+\+|--){name}\b|\b{name}(\+\+|--| (<<|>>|[-+*/%&|^])?=(?!=))"
    return not re.search(changes, body)


def keeps(function: Node, name: str) -> int | None:
    """Which parameter of type int32_t has that name, if nothing in the function changes it."""
    declarator = function.child_by_field_name("declarator")
    while declarator is not None and declarator.type != "function_declarator":
        declarator = declarator.child_by_field_name("declarator")
    parameters = declarator.child_by_field_name("parameters") if declarator else None
    texts = [text_of(p) for p in parameters.named_children] if parameters else []
    body = text_of(function.child_by_field_name("body"))
    if f"int32_t {name}" not in texts or not is_left_alone(name, body):
        return None
    return texts.index(f"int32_t {name}")


def differs_only_at(mutant: Mutant, at: dict[int, int]) -> bool:
    """Whether the mutant changes a comparison of a parameter with a number, and that only for the
    value that `at` has: seen by the solver for all numbers."""
    source = (ROOT / mutant.file).read_bytes()
    tree = PARSER.parse(blanked(source.decode("latin-1")).encode("latin-1"))
    nodes = around(tree.root_node, mutant.start, mutant.end)
    outer = [node for node in nodes if node.type == "binary_expression"]
    functions = [node for node in nodes if node.type == "function_definition"]
    if not outer or not functions or len(at) != 1:
        return False
    node, (place, value) = outer[-1], *at.items()
    start, end = mutant.start - node.start_byte, mutant.end - node.start_byte
    text = text_of(node)
    before, after = (
        comparison(text),
        comparison(text[:start] + mutant.text + text[end:]),
    )
    if not before or not after or before[0] != after[0]:
        return False
    claim = z3.Implies(before[1] != after[1], z3.BitVec("x", 32) == value)
    return keeps(functions[-1], before[0]) == place and bitvectors.prove(claim).proven


# ---------------------------------------------------------------- the proofs


def callers(module: bitvectors.Module, name: str) -> set[str]:
    return {
        f for f, code in module.functions.items() if re.search(rf"call[^\n]*@{name}\(", str(code))
    }


def by_functions(mutant: Mutant, seconds: float = 60, at: dict[int, int] | None = None) -> Answer:
    """Compares all functions of the core that read differently with the mutant in; where one of a
    single file differs, its callers. `at` proves it only for some arguments, which is enough where
    the mutant differs only there."""
    if at and not differs_only_at(mutant, at):
        return Answer(False, ("`at` is for a comparison that changes for that value only",))
    answers = [in_units(mutant, units, seconds, at) for units in units_for(mutant.file)]
    said = tuple(line for answer in answers for line in answer.said)
    return Answer(all(answer.proven for answer in answers), said)


def in_units(
    mutant: Mutant, units: tuple[str, ...], seconds: float, at: dict[int, int] | None
) -> Answer:
    one, other = original(units), with_mutant(mutant, units)
    waiting = {n for n, code in one.functions.items() if str(code) != str(other.functions.get(n))}
    lemmas = [name for name in LEMMAS if name in one.functions]
    known = {name for name in lemmas if not callees(one, name) & waiting}
    said, done = [], set[str]()
    while waiting:
        name = waiting.pop()
        done.add(name)
        verdict = same(one[name], other[name], seconds, at or {}, known)
        if not verdict.proven and known and (at or "internal" not in str(one.functions[name])):
            verdict = same(one[name], other[name], seconds, at or {}, set())
        said.append(f"{name}: {str(verdict)[:200]}")
        if not verdict.proven and (at or "internal" not in str(one.functions[name])):
            return Answer(False, tuple(said))
        if not verdict.proven:
            waiting |= callers(one, name) - done
    return Answer(True, tuple(said))


def nodes_at(mutant: Mutant) -> list[Node]:
    source = (ROOT / mutant.file).read_bytes()
    tree = PARSER.parse(blanked(source.decode("latin-1")).encode("latin-1"))
    return around(tree.root_node, mutant.start, mutant.end)


def by_symmetry(mutant: Mutant, seconds: float = 60) -> Answer:
    """Of a function of two arguments, which the mutant swaps: that it gives the same either way."""
    calls = [node for node in nodes_at(mutant) if node.type == "call_expression"]
    if " arguments: " not in mutant.id or not calls:
        return Answer(False, ("not a swap of arguments",))
    given = calls[-1].child_by_field_name("arguments")
    name = text_of(calls[-1].child_by_field_name("function"))
    if (
        given is None
        or len(given.named_children) != 2
        or re.search(r"\(|=|\+\+|--", text_of(given)[1:])
    ):
        return Answer(False, ("arguments are more than two, or have effects",))
    function = original()[name]
    a, b = function.symbols()
    products = Products()
    claim = products.away(function(a, b).value == function(b, a).value)
    verdict = bitvectors.prove(claim, products.facts, seconds)
    return Answer(verdict.proven, (f"{name}: {verdict}",))


SIMPLE: dict[str, Callable[[Any, Any], Any]] = {
    "lsrs": z3.LShR,
    "lsls": lambda x, y: x << y,
    "uxth": lambda _, y: y & 0xFFFF,
    "movs": lambda _, y: y,
    "muls": lambda x, y: x * y,
}


def run_assembly(begin: str, end: str, registers: dict[str, Any], macros: dict[str, str]) -> None:
    """Runs the strings between two marks of multiply_v6m.h, instruction by instruction."""
    text = (ROOT / "lib" / "multiply_v6m.h").read_text()
    text = text[text.index(begin) :]
    text = text[: text.index(end)]
    for name, operation in macros.items():
        text = re.sub(rf'\b{name} "', f'"{operation}', text)
    strings = re.findall(r'"((?:[^"\\]|\\.)*)"', text)
    carry = z3.BitVecVal(0, 33)
    for line in "".join(strings).replace("\\t", "").split("\\n"):
        operation, *names = re.findall(r"\w+", line)
        if operation == "syntax":
            continue
        values = [z3.BitVecVal(int(n), 32) if n.isdigit() else registers.get(n) for n in names]
        x, y = values[-2:]
        if operation in SIMPLE:
            registers[names[0]] = SIMPLE[operation](x, y)
            continue
        y = y if operation.startswith("ad") else ~y
        first = z3.BitVecVal(0 if operation == "adds" else 1, 33)
        whole = z3.ZeroExt(1, x) + z3.ZeroExt(1, y)
        whole += first if operation in ("adds", "subs") else carry
        carry, registers[names[0]] = z3.LShR(whole, 32), z3.Extract(31, 0, whole)


def product_of_m0(a: Any, b: Any) -> Any:
    """What dahl_mul of multiply_v6m.h makes of two words."""
    registers = {"a": a, "b": b}
    run_assembly("#define DAHL_MULTIPLY_SPLIT", ": [a]", registers, {})
    return z3.Concat(registers["b1"], registers["x"])


def sum_of_m0(z: Any, g: Any, add: str, add_carry: str) -> Any:
    """What DAHL_ACCUMULATE makes of any low, high and part."""
    low, high, part = z3.BitVecs("low high part", 32)
    registers = {"z0": z, "g0": g, "low": low, "high": high, "x": part}
    macros = {"add": add, "add_carry": add_carry}
    run_assembly("#define DAHL_ACCUMULATE", ": [low]", registers, macros)
    return z3.Concat(registers["high"], registers["low"])


def by_assembly(mutant: Mutant, seconds: float = 60) -> Answer:
    """That the products of a Cortex-M0 are the same when their factors are swapped."""
    swaps = r" arguments: .*-> (dahl_mul\(b, a\)|dahl_mulhi\(g_low, z\)|.* high, g_high, z, part\))"
    swap = re.search(swaps, mutant.id)
    if mutant.file != "lib/multiply_v6m.h" or not swap:
        return Answer(False, ("not a swap of two factors",))
    a, b = z3.BitVecs("a b", 32)
    pairs = [(product_of_m0(a, b), product_of_m0(b, a))]
    for signs in (("adds", "adcs"), ("subs", "sbcs")):
        pairs.append((sum_of_m0(a, b, *signs), sum_of_m0(b, a, *signs)))
    products = Products()
    claim = products.away(z3.And(*(one == other for one, other in pairs)))
    verdict = bitvectors.prove(claim, products.facts, seconds)
    return Answer(verdict.proven, (f"products in assembly: {verdict}",))


def by_counts(mutant: Mutant, seconds: float = 60) -> Answer:
    """As by_functions for those of a plan, a state and a count: for each count of the table alone,
    and for all beyond together."""
    one, other = original(), with_mutant(mutant)
    changed = [n for n, code in one.functions.items() if str(code) != str(other.functions.get(n))]
    for name in changed:
        if name not in ("dahl_step_counts", "dahl_step_counts_q30"):
            return Answer(False, (f"{name} reads differently",))
        ask = functools.partial(same, one[name], other[name], seconds, known=set(LEMMAS))
        verdicts = [ask(at={2: n}) for n in range(-8, 9)] + [ask(at={}, far=True)]
        if not all(verdict.proven for verdict in verdicts):
            return Answer(False, (f"{name}: {[str(v) for v in verdicts if not v.proven]}",))
    return Answer(True, (f"{', '.join(changed)}: the same for each count",))


# ---------------------------------------------------------------- loops and shortcuts


def around_mutant(mutant: Mutant, kind: str) -> tuple[str, str, Node] | None:
    """The innermost node of a kind around the mutant: as it reads, mutated, and itself."""
    nodes = [node for node in nodes_at(mutant) if node.type == kind]
    if not nodes:
        return None
    text, shift = text_of(nodes[-1]), nodes[-1].start_byte
    return text, text[: mutant.start - shift] + mutant.text + text[mutant.end - shift :], nodes[-1]


LOOP = r"for \(size_t (\w+) = 0; \1 < ([\w>-]+); \1(\+\+| \+= (\w+))\)"


def by_loop(mutant: Mutant, seconds: float = 60) -> Answer:
    """Of `for (size_t i = 0; i < n; i++)`, or by steps of at most what is left: that `i < n` is
    `i != n` at each turn. By induction: 0 <= n, and i < n gives i + step <= n without wrapping."""
    loop = around_mutant(mutant, "for_statement")
    found = re.match(LOOP, loop[0]) if loop else None
    if not loop or not found:
        return Answer(False, ("not a loop of that form",))
    i, n, _, rows = found.groups()
    head, body = found[0], loop[0][found.end() :]
    if not loop[1].startswith(head.replace(f"{i} < {n}", f"{i} != {n}")):
        return Answer(False, ("not its end",))
    fixed = [name for name in (i, n) if not is_left_alone(name, body)]
    x, end, step = z3.BitVecs("x end step", 64)
    is_step = step == 1
    if rows:
        least = re.search(rf"{rows} = {n} - {i} < (\w+) \? {n} - {i} : \1;", body)
        if not least or not is_left_alone(rows, body.replace(least[0], "")):
            return Answer(False, ("steps that are not known",))
        most = z3.BitVec("most", 64)
        is_step = step == z3.If(z3.ULT(end - x, most), end - x, most)
    goes_on = z3.And(z3.ULE(x, end), x != end)
    claim = z3.And(
        z3.Implies(z3.ULE(x, end), (x != end) == z3.ULT(x, end)),
        z3.Implies(z3.And(goes_on, is_step), z3.And(z3.ULE(x + step, end), z3.ULE(x, x + step))),
    )
    verdict = bitvectors.prove(claim, (), seconds)
    return Answer(verdict.proven and not fixed, (f"{head}: {verdict}", *fixed))


class Unsigned:
    """A C expression of unsigned words, as a term."""

    def __init__(self, term: Any) -> None:
        self.term = z3.BitVecVal(term, 64) if isinstance(term, int) else term

    def __add__(self, other: Any) -> Unsigned:
        return Unsigned(self.term + as_unsigned(other))

    def __sub__(self, other: Any) -> Unsigned:
        return Unsigned(self.term - as_unsigned(other))

    def __lt__(self, other: Any) -> Any:
        return z3.ULT(self.term, as_unsigned(other))

    def __le__(self, other: Any) -> Any:
        return z3.ULE(self.term, as_unsigned(other))

    def __gt__(self, other: Any) -> Any:
        return z3.UGT(self.term, as_unsigned(other))

    def __ge__(self, other: Any) -> Any:
        return z3.UGE(self.term, as_unsigned(other))

    def __eq__(self, other: object) -> Any:  # type: ignore[override]
        return self.term == as_unsigned(other)

    def __ne__(self, other: object) -> Any:  # type: ignore[override]
        return self.term != as_unsigned(other)

    __hash__ = object.__hash__


def as_unsigned(value: Any) -> Any:
    return value.term if isinstance(value, Unsigned) else z3.BitVecVal(value, 64)


def condition_of(text: str) -> Any:
    """A condition of names and numbers as a term; the macros by their numbers in lib/."""
    names = {"DAHL_LIKELY": lambda c: c}
    for name in re.findall(r"[A-Za-z_]\w*", text.replace("job->", "")):
        names.setdefault(name, Unsigned(z3.BitVec(name, 64)))
    for name, file in (("CHUNK", "batch_channels.c"), ("DAHL_DENSE", "gap.h")):
        found = re.search(rf"#define {name} (\d+)", (ROOT / "lib" / file).read_text())
        names[name] = Unsigned(int(found[1]) if found else -1)
    value = eval(text.replace("job->", ""), {"__builtins__": {}}, names)  # noqa: S307
    return value if z3.is_bool(value) else z3.BoolVal(bool(value))


def rows_are_one(_: Mutant, seconds: float) -> bitvectors.Verdict:
    """Rows of `width` without a gap between them, taken one by one or as one: the same places."""
    rows, width, t, c, i = z3.Ints("rows width t c i")
    given = [rows > 0, width > 0]
    within = z3.And(t >= 0, t < rows, c >= 0, c < width)
    place = t * width + c
    to = z3.Implies(within, z3.And(place >= 0, place < rows * width))
    back = z3.Implies(
        z3.And(i >= 0, i < rows * width, t == i / width, c == i % width), z3.And(within, place == i)
    )
    verdicts = [bitvectors.prove(claim, given, seconds, "z3") for claim in (to, back)]
    return next((v for v in verdicts if not v.proven), verdicts[0])


def branches_are_one(mutant: Mutant, _: float) -> bitvectors.Verdict:
    """Both branches are the same call, where one side of the condition `a == b` stands for b."""
    found = around_mutant(mutant, "if_statement")
    text = " ".join(found[0].split()) if found else ""
    sides = re.fullmatch(r"if \((\S+) == (\S+)\) \{ (.*?) \} else \{ (.*?) \}", text)
    same = bool(sides) and sides[3].replace(sides[2], sides[1]) == sides[4]
    return bitvectors.Verdict(same, None, 0.0, "as text")


def short_moves_are_far(mutant: Mutant, seconds: float) -> bitvectors.Verdict:
    """Of each count that has an entry, the move is the same with the mutant in."""
    one, other = original(("batch",)), with_mutant(mutant, ("batch",))
    ask = functools.partial(same, one["dahl_batch_move"], other["dahl_batch_move"], seconds)
    verdicts = [ask(at={2: n}, known=set()) for n in range(-8, 9)]
    return next((v for v in verdicts if not v.proven), verdicts[0])


# By file and function: what holds wherever the condition does, so that the longer way does as well.
SHORTCUTS: dict[tuple[str, str], Callable[[Mutant, float], bitvectors.Verdict]] = {
    ("lib/batch.h", "dahl_batch_move"): short_moves_are_far,
    ("lib/batch_channels.c", "run"): branches_are_one,
    ("lib/batch_throughput_channels.c", "run_known"): branches_are_one,
    ("lib/batch_throughput_channels.c", "largest"): rows_are_one,
}


def by_shortcut(mutant: Mutant, seconds: float = 60) -> Answer:
    """That the shortcut is taken less often: the mutated condition implies the original one; and
    that the way round gives the same. `width` is never more than `stride`."""
    lemma = SHORTCUTS.get((mutant.file, mutant.id.split()[1]))
    found = around_mutant(mutant, "if_statement") or around_mutant(mutant, "conditional_expression")
    if not lemma or not found:
        return Answer(False, ("no shortcut that is known",))
    condition = found[2].child_by_field_name("condition")
    start, end = condition.start_byte, condition.end_byte
    if not (start <= mutant.start and mutant.end <= end):
        return Answer(False, ("not its condition",))
    source = (ROOT / mutant.file).read_bytes()
    before = source[start:end].decode()
    mutated = source[start : mutant.start] + mutant.text.encode() + source[mutant.end : end]
    width, stride = z3.BitVecs("width stride", 64)
    claim = z3.Implies(condition_of(mutated.decode()), condition_of(before))
    implied = bitvectors.prove(claim, [z3.ULE(width, stride)], seconds)
    right = lemma(mutant, seconds)
    said = f"{before}: {implied}", f"{mutant.id.split()[1]}: {right}"
    return Answer(implied.proven and right.proven, said)


def with_wrappers(source: bytes, wrappers: str) -> bitvectors.Module:
    """A file of lib/ as `source` has it, with functions for the solver after it."""
    with tempfile.TemporaryDirectory() as name:
        unit = Path(name) / "unit.c"
        unit.write_bytes(source + wrappers.encode())
        return bitvectors.compile_c(unit, flags=(*bitvectors.PLAIN, "-w"))


CHANNELS = "lib/batch_channels.c"
A_STEP = "int64_t a_step(int64_t w, uint64_t to, uint64_t g) { return step(w, to, g); }\n"
OF_TWO = """
uint32_t of_two(int64_t w, uint64_t to, uint32_t eights, int64_t w1, uint64_t to1, uint32_t eights1)
{
    chunk_t chunk;
    chunk.w[0] = w, chunk.backward[0][0] = to, chunk.eights[0][0] = eights;
    chunk.w[1] = w1, chunk.backward[0][1] = to1, chunk.eights[0][1] = eights1;
    return open_digits(&chunk, 2, 0);
}
"""
FAR = """
int goes_on(uint64_t w, uint32_t rest) { return (ORIGINAL) ? 1 : 0; }
int mutated(uint64_t w, uint32_t rest) { return (MUTATED) ? 1 : 0; }
uint64_t a_step(uint64_t w, uint32_t hi, uint32_t lo)
{
    dahl_q64_t g = {.hi = hi, .lo = lo};
    return dahl_batch_forward(w, g);
}
"""


def a_channel(of: str) -> tuple[list[Any], list[Any]]:
    """State, direction and digits of one, and what is known of them."""
    w, to, eights = z3.BitVecs(f"w{of} to{of}", 64) + z3.BitVecs(f"eights{of}", 32)
    return [w, to, eights], [*is_w(w), z3.Or(to == 0, to == -1)]


class Asked:
    """Calls of functions, all of which must neither trap nor go on for ever."""

    def __init__(self) -> None:
        self.claims: list[Any] = []

    def value(self, function: bitvectors.Function, *arguments: Any) -> Any:
        outcome = function(*arguments)
        self.claims += [z3.Not(outcome.fault), z3.Not(outcome.beyond)]
        return outcome.value

    def verdict(self, given: Sequence[Any], seconds: float) -> bitvectors.Verdict:
        products = Products()
        claim = products.away(bitvectors.all_of(*self.claims))
        return bitvectors.prove(claim, [*given, *products.facts], seconds)


def digits_are_idle(source: bytes, seconds: float) -> bitvectors.Verdict:
    """Of two channels, which stand for any where the loop over them is the original's: a digit that
    open_digits of that source leaves out is a step that keeps the state, whatever the table; so is
    one by g = 0."""
    a_step = with_wrappers((ROOT / CHANNELS).read_bytes(), A_STEP)["a_step"]
    of_two = with_wrappers(source, OF_TWO)["of_two"]
    (one, given), (other, more) = a_channel("0"), a_channel("1")
    asked, g, none = Asked(), z3.BitVec("g", 64), z3.BitVecVal(0, 64)
    kept = asked.value(of_two, *one, *other)
    for w, to, eights in (one, other):
        asked.claims.append(z3.Or(eights & ~kept == 0, asked.value(a_step, w, to, g) == w))
        asked.claims.append(asked.value(a_step, w, to, none) == w)
    return asked.verdict([*given, *more], seconds)


LOOKS = r"if \(\(digit & (0x[0-9a-f]+)u\) != 0\) \{\s+rest &= open_digits\(chunk, count, t\);\s+\}"


def is_digit_more(mutant: Mutant, source: str) -> bool:
    """The first digits of take_rows: 1, or all, of which open_digits is asked before there is none
    in the table."""
    looks, size = re.search(LOOKS, source), re.search(r"#define DIGITS (\d+)", source)
    mask = int(looks[1], 16) if looks else 0
    asked = 0 < mask & -mask < 1 << int(size[1] if size else 0)
    first = source[: mutant.start].endswith("    uint32_t digits = ")
    return first and (mutant.text == "1" or (mutant.text == "-1" and asked))


def is_where_it_looks(mutant: Mutant) -> bool:
    """Of move_row: whether open_digits is asked after a digit, which nothing else hangs on."""
    found = around_mutant(mutant, "if_statement")
    condition = found[2].child_by_field_name("condition") if found else None
    if not found or not condition or not re.fullmatch(LOOKS, found[0]):
        return False
    within = condition.start_byte <= mutant.start and mutant.end <= condition.end_byte
    effect = r"[A-Za-z_]\w*\s*\(|\+\+|--|(<<|>>|[^=!<>])=[^=]"
    return within and not re.search(effect, found[1].partition("{")[0].removeprefix("if ("))


def in_head(mutant: Mutant) -> bool:
    """Of a loop."""
    found = around_mutant(mutant, "for_statement")
    return found is not None and mutant.start < found[2].child_by_field_name("body").start_byte


def far_digits_are_idle(mutant: Mutant, source: bytes, seconds: float) -> bitvectors.Verdict:
    """Of a far move's loop: the mutant goes on wherever the original does; where it goes on though
    the original does not, a digit is left, the step keeps the state, whatever the table, and the
    original does not go on with the digits after it either."""
    found = around_mutant(mutant, "for_statement")
    head = found[2].child_by_field_name("condition") if found else None
    if not head or not (head.start_byte <= mutant.start and mutant.end <= head.end_byte):
        return bitvectors.Verdict(False, None, 0.0, "not its condition")
    start, end = head.start_byte, head.end_byte
    mutated = source[start : mutant.start] + mutant.text.encode() + source[mutant.end : end]
    wrappers = FAR.replace("ORIGINAL", source[start:end].decode())
    module = with_wrappers(source, wrappers.replace("MUTATED", mutated.decode()))
    asked, w, (rest, hi, lo) = Asked(), z3.BitVec("w", 64), z3.BitVecs("rest hi lo", 32)
    before, next_, after = (
        asked.value(module[name], w, of) != 0
        for name, of in (("goes_on", rest), ("goes_on", rest & (rest - 1)), ("mutated", rest))
    )
    kept = asked.value(module["a_step"], w, hi, lo) == w
    more = z3.And(after, z3.Not(before))
    asked.claims += [z3.Implies(before, after), z3.Implies(more, z3.And(rest != 0, kept))]
    asked.claims.append(z3.Implies(z3.Not(before), z3.Not(next_)))
    return asked.verdict(is_w(w), seconds)


def by_idle_digit(mutant: Mutant, seconds: float = 60) -> Answer:
    """That digits more change nothing: their steps keep every state."""
    source = (ROOT / mutant.file).read_bytes()
    verdict = bitvectors.Verdict(False, None, 0.0, "not a digit more")
    if mutant.id.startswith("lib/batch.h dahl_batch_far "):
        verdict = far_digits_are_idle(mutant, source, seconds)
    elif mutant.file == CHANNELS and " open_digits " in mutant.id and not in_head(mutant):
        verdict = digits_are_idle(mutant.apply(source), seconds)
    elif mutant.file == CHANNELS and (
        is_where_it_looks(mutant) or is_digit_more(mutant, source.decode("latin-1"))
    ):
        verdict = digits_are_idle(source, seconds)
    return Answer(verdict.proven, (f"a step by nothing: {verdict}",))


SIGNS = {  # all that a file says of the words whose top bit says that a torque is close
    "lib/batch_channels.c": (
        r"\bclose\b[^;]*;",
        ["close = 0;", "close |= dahl_batch_close(torque);", "close >> 63 != 0;"],
    ),
    "lib/batch.h": (
        r"\bdahl_batch_close\(torque\)[^{]*",
        ["dahl_batch_close(torque) >> 63 == 0)) "],
    ),
}


def by_sign(mutant: Mutant, seconds: float = 60) -> Answer:
    """Of the words that say by their top bit that a torque is close: that the other bits looked at
    say the same, in each and so in all of them or-ed together; or that the first has none of them.
    """
    source = (ROOT / mutant.file).read_bytes()
    uses, known = SIGNS.get(mutant.file, ("", ["none"]))
    before = source[: mutant.start]
    looked = before.endswith((b"close >> ", b"dahl_batch_close(torque) >> "))
    first = before.endswith(b" close = ")
    if not (looked or first) or re.findall(uses, source.decode()) != known:
        return Answer(False, ("not such a word",))
    shift = int(mutant.text) if looked else 63
    wrapper = "uint64_t word(dahl_double_t of) { return dahl_batch_close(of); }\n"
    asked, (so_far, bits) = Asked(), z3.BitVecs("so_far bits", 64)
    begin, one, other = (
        z3.And(shift < 64, (z3.LShR(x, shift) == 0) == (z3.LShR(x, 63) == 0))
        for x in (
            z3.BitVecVal(0 if looked else int(mutant.text), 64),
            so_far,
            so_far | asked.value(with_wrappers(source, wrapper)["word"], bits),
        )
    )
    asked.claims += [begin, z3.Implies(one, other)]
    verdict = asked.verdict((), seconds)
    return Answer(verdict.proven, (f"the bits above: {verdict}",))


SHIFTS = (*range(44, 94), 255)  # of travel that dahl_prepare takes, and of none


def table_for(module: bitvectors.Module, shift: int) -> Any:
    """What fill_table makes of a travel with that shift and any mantissa."""
    table, word = bitvectors.bytes_named("table"), z3.BitVecVal(shift, 32)
    for k in range(4):
        byte = z3.simplify(z3.Extract(8 * k + 7, 8 * k, word))
        table = z3.Store(table, z3.BitVecVal(4 + k, bitvectors.WORD), byte)
    run = KnownByLemmas(module, set(LEMMAS))
    state = bitvectors.State(bitvectors.TRUE, {}, {"table": table})
    values = [bitvectors.as_value("table", "ptr")]
    return run.call(module["fill_table"].code, values, state)[1].memory["table"]


def by_tables(mutant: Mutant, seconds: float = 60) -> Answer:
    """That fill_table makes the same: of the shift that stands for no counts and another, if it is
    that which changes; else of every shift that it is given."""
    if "set_scales constant: 255 -> " in mutant.id:
        pairs = [(table_for(original(), 255), table_for(original(), int(mutant.text)))]
    elif " fill_table " in mutant.id:
        other = with_mutant(mutant)
        pairs = [(table_for(original(), shift), table_for(other, shift)) for shift in SHIFTS]
    else:
        return Answer(False, ("not of the table",))
    places = [z3.BitVecVal(k, bitvectors.WORD) for k in range(37 * 8)]
    for a, b in pairs:
        claim = z3.And(*(z3.Select(a, place) == z3.Select(b, place) for place in places))
        products = Products()
        claim = products.away(z3.simplify(claim))
        verdict = bitvectors.prove(claim, products.facts, seconds)
        if not verdict.proven:
            return Answer(False, (f"fill_table: {verdict}",))
    return Answer(True, (f"fill_table: the same for {len(pairs)} shifts",))


CODES = (0, -1, -2)
THROUGHPUT_CHECK = ROOT / "lib" / "batch_throughput_check.c"
CALLERS = ("prepare", "float", "batch_throughput", "batch_throughput_channels")
CALLERS = (*(f"lib/{name}.c" for name in CALLERS), "host_sim/node.c")


def names_codes(file: Path) -> bool:
    """Whether the last function of the file returns nothing but codes by their names."""
    body = file.read_text().rpartition("dahl_err_t ")[2]
    returned = re.findall(r"\breturn\b([^;]*);", body)
    return bool(returned) and {" DAHL_OK", " DAHL_ERR_PARAM", " DAHL_ERR_RANGE"} >= set(returned)


def by_codes(mutant: Mutant, seconds: float = 60) -> Answer:
    """That a comparison of a code with DAHL_OK is the same for all codes that check and set_scales
    return, which are closed under or; so dahl_prepare returns one of them. What
    dahl_throughput_check returns is read: codes by their names."""
    nodes = [node for node in nodes_at(mutant) if node.type == "binary_expression"]
    if not nodes or mutant.file not in CALLERS or not names_codes(THROUGHPUT_CHECK):
        return Answer(False, ("not a comparison of a code",))
    text, shift = text_of(nodes[-1]), nodes[-1].start_byte
    after = text[: mutant.start - shift] + mutant.text + text[mutant.end - shift :]
    calls = re.compile(r"\bdahl_prepare\([^()]*\)")
    terms = [comparison(calls.sub("err", t.replace("DAHL_OK", "0"))) for t in (text, after)]
    if terms[0] is None or terms[1] is None or terms[0][0] != "err" or terms[1][0] != "err":
        return Answer(False, ("not a comparison of a code",))
    x, claims = (
        z3.BitVec("x", 32),
        [z3.BoolVal(all(a | b in CODES for a in CODES for b in CODES))],
    )
    for name in ("check", "set_scales"):
        function = original()[name]
        value = called(function, function.symbols(), set(LEMMAS))[0].value
        claims.append(z3.Or(*(value == code for code in CODES)))
    claims.append(z3.Implies(z3.Or(*(x == code for code in CODES)), terms[0][1] == terms[1][1]))
    products = Products()
    verdict = bitvectors.prove(products.away(z3.And(*claims)), products.facts, seconds)
    return Answer(verdict.proven, (f"{text}: {verdict}",))


PROOFS: dict[str, Callable[..., Answer]] = {
    "solver": by_functions,
    "symmetry": by_symmetry,
    "assembly": by_assembly,
    "counts": by_counts,
    "tables": by_tables,
    "codes": by_codes,
    "loop": by_loop,
    "shortcut": by_shortcut,
    "idle": by_idle_digit,
    "sign": by_sign,
}


def prove_equivalent(
    mutant: Mutant,
    seconds: float = 60,
    at: dict[int, int] | None = None,
    proof: str = "solver",
) -> Answer:
    return PROOFS[proof](mutant, seconds, **({"at": at} if at else {}))
