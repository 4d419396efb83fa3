# SPDX-License-Identifier: MIT
"""From compiled C to terms of a bit-vector solver: what is proven is what the compiler made.

clang turns the library's own files into LLVM's intermediate code; `Function.__call__` runs that
with terms instead of numbers and gives back the value, the memory and what must not happen: `fault`
is where the code traps (compiled with -fsanitize, that is every undefined behaviour that clang can
check) or uses a value that LLVM calls poison; `beyond` is where a loop goes on past `unroll` turns.
Paths are joined where they meet, so that the term grows with the code, not with its paths.
Pointers that are handed in point to separate objects, each an array of bytes. Arithmetic on floats
is refused; their bits are not.

`prove` asks whether a claim holds for all values of its variables; `differ` where two functions do.
Terms are z3's; bitwuzla (the default) reads them as SMT-LIB, so that each claim can have both.

    step = compile_c(ROOT / "lib" / "model" / "step_large.c")["dahl_move_digits"]
    verdict = differ(step, compile_c(mutant)["dahl_move_digits"], seconds=60)
    assert verdict.proven, verdict
"""

from __future__ import annotations

import functools
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bitwuzla
import llvmlite.binding as llvm
import z3

ROOT = Path(__file__).resolve().parents[2]
PLAIN = ("-std=c99", "-O1", "-fno-vectorize", "-fno-slp-vectorize", "-fno-unroll-loops")
CHECKED = ("-fsanitize=undefined,float-cast-overflow", "-fsanitize-trap=all")
WORD = 64  # bits of an offset
TRUE, FALSE = z3.BoolVal(True), z3.BoolVal(False)


class Unsupported(Exception):
    """The code has something that the translation does not know; names the instruction."""


# ---------------------------------------------------------------- values


@dataclass(frozen=True)
class Value:
    """A term and the condition under which LLVM calls it poison. A pointer has an object."""

    term: Any
    poison: z3.BoolRef = FALSE
    object: str | None = None


@dataclass(frozen=True)
class Group:
    """What a struct in a register holds."""

    parts: tuple[Value, ...]


def any_of(*conditions: z3.BoolRef) -> z3.BoolRef:
    """Or, without the parts that are plainly false."""
    kept = [c for c in conditions if not z3.is_false(c)]
    if any(z3.is_true(c) for c in kept):
        return TRUE
    return FALSE if not kept else kept[0] if len(kept) == 1 else z3.Or(*kept)


def all_of(*conditions: z3.BoolRef) -> z3.BoolRef:
    """And, without the parts that are plainly true."""
    kept = [c for c in conditions if not z3.is_true(c)]
    if any(z3.is_false(c) for c in kept):
        return FALSE
    return TRUE if not kept else kept[0] if len(kept) == 1 else z3.And(*kept)


def number(term: Any) -> int | None:
    """The number that a term is, if it is one."""
    return term.as_long() if z3.is_bv_value(term) else None


def folded(term: Any) -> Any:
    """The term, computed where all that it is made of are numbers."""
    return z3.simplify(term) if all(map(z3.is_bv_value, term.children())) else term


SMALL = 300  # nodes of a term that is worth simplifying on the way
_sizes: dict[int, tuple[Any, int]] = {}  # of terms seen; holds them, so that their ids stay theirs


def size_of(term: Any) -> int:
    """Nodes of a term written out, at most one more than SMALL."""
    known = _sizes.get(term.get_id())
    if known is None:
        size = 1 + sum(map(size_of, term.children()))
        known = _sizes[term.get_id()] = (term, min(size, SMALL + 1))
    return known[1]


def tidy(term: Any) -> Any:
    """The term simplified, if it is small: loops end by it; a large one waits for the solver."""
    return term if size_of(term) > SMALL else z3.simplify(term)


def as_bit(condition: z3.BoolRef) -> Any:
    """A condition as a word of one bit."""
    condition = tidy(condition)
    if z3.is_true(condition) or z3.is_false(condition):
        return z3.BitVecVal(int(z3.is_true(condition)), 1)
    return z3.If(condition, z3.BitVecVal(1, 1), z3.BitVecVal(0, 1))


def is_set(term: Any) -> z3.BoolRef:
    """A word of one bit as a condition."""
    if z3.is_app_of(term, z3.Z3_OP_ITE) and number(term.arg(1)) == 1 and number(term.arg(2)) == 0:
        return term.arg(0)
    return tidy(term == 1)


def choose(condition: z3.BoolRef, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, for all kinds of values."""
    if yes is no or z3.is_true(condition):
        return yes
    if z3.is_false(condition):
        return no
    if isinstance(yes, Group):
        return Group(
            tuple(choose(condition, y, n) for y, n in zip(yes.parts, no.parts, strict=True))
        )
    if yes.object != no.object:
        raise Unsupported("a pointer into one of two objects")
    term = yes.term if yes.term.eq(no.term) else z3.If(condition, yes.term, no.term)
    poison = yes.poison if yes.poison.eq(no.poison) else z3.If(condition, yes.poison, no.poison)
    return Value(term, poison, yes.object)


# ---------------------------------------------------------------- instructions


def wide(operation: Callable[[Any, Any], Any], extend: Callable[[int, Any], Any]) -> Callable:
    """Whether an operation leaves its width: done in twice the width, the result does not fit."""

    def leaves(a: Any, b: Any) -> z3.BoolRef:
        n = a.size()
        return extend(n, operation(a, b)) != operation(extend(n, a), extend(n, b))

    return leaves


ADD, SUB, MUL = (lambda a, b: a + b), (lambda a, b: a - b), (lambda a, b: a * b)
BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "add": ADD, "sub": SUB, "mul": MUL, "shl": lambda a, b: a << b, "lshr": z3.LShR,
    "ashr": lambda a, b: a >> b, "and": lambda a, b: a & b, "or": lambda a, b: a | b,
    "xor": lambda a, b: a ^ b, "udiv": z3.UDiv, "urem": z3.URem, "sdiv": lambda a, b: a / b,
    "srem": z3.SRem,
}  # fmt: skip
COMPARE: dict[str, Callable[[Any, Any], z3.BoolRef]] = {
    "eq": lambda a, b: a == b, "ne": lambda a, b: a != b, "ugt": z3.UGT, "uge": z3.UGE,
    "ult": z3.ULT, "ule": z3.ULE, "sgt": lambda a, b: a > b, "sge": lambda a, b: a >= b,
    "slt": lambda a, b: a < b, "sle": lambda a, b: a <= b,
}  # fmt: skip


def significant(x: Any, depth: int = 5) -> int:
    """How many low bits of a word can be other than 0, as its form tells, seen to a depth."""
    n = x.size()
    if depth == 0 or number(x) is not None:
        return n if number(x) is None else number(x).bit_length()
    parts = [significant(c, depth - 1) for c in x.children() if z3.is_bv(c)]
    if z3.is_app_of(x, z3.Z3_OP_ZERO_EXT):
        n = parts[0]
    elif z3.is_app_of(x, z3.Z3_OP_CONCAT) and number(x.arg(0)) == 0:
        n = n - x.arg(0).size()
    elif z3.is_app_of(x, z3.Z3_OP_BLSHR) and number(x.arg(1)) is not None:
        n = max(0, parts[0] - number(x.arg(1)))
    elif z3.is_app_of(x, z3.Z3_OP_BMUL):
        n = min(n, sum(parts))
    elif z3.is_app_of(x, z3.Z3_OP_BAND):
        n = min(parts)
    return n


def unless(plain: Callable[[int, int], int], leaves: Callable) -> Callable:
    """The same test, left out where the widths alone answer it."""

    def test(a: Any, b: Any) -> z3.BoolRef:
        fits = plain(significant(a), significant(b)) <= a.size()
        return FALSE if fits else leaves(a, b)

    return test


LEAVES = {  # by opcode: the word is poison under nuw, under nsw
    "add": (unless(lambda a, b: max(a, b) + 1, wide(ADD, z3.ZeroExt)), wide(ADD, z3.SignExt)),
    "sub": (z3.ULT, wide(SUB, z3.SignExt)),
    "mul": (unless(lambda a, b: a + b, wide(MUL, z3.ZeroExt)), wide(MUL, z3.SignExt)),
    "shl": (lambda a, b: z3.LShR(a << b, b) != a, lambda a, b: (a << b) >> b != a),
}


def leading_zeros(x: Any) -> Any:
    """How many bits are 0 before the first that is 1."""
    n, result = x.size(), z3.BitVecVal(x.size(), x.size())
    for i in range(n):
        result = z3.If(z3.Extract(i, i, x) == 1, z3.BitVecVal(n - 1 - i, n), result)
    return result


def trailing_zeros(x: Any) -> Any:
    """How many bits are 0 after the last that is 1."""
    n, result = x.size(), z3.BitVecVal(x.size(), x.size())
    for i in reversed(range(n)):
        result = z3.If(z3.Extract(i, i, x) == 1, z3.BitVecVal(i, n), result)
    return result


def funnel_left(a: Any, b: Any, by: Any) -> Any:
    """Upper half of a:b shifted left, by modulo the width."""
    n = a.size()
    both = z3.Concat(a, b) << z3.ZeroExt(n, z3.URem(by, z3.BitVecVal(n, n)))
    return z3.Extract(2 * n - 1, n, both)


def funnel_right(a: Any, b: Any, by: Any) -> Any:
    """Lower half of a:b shifted right, by modulo the width."""
    n = a.size()
    both = z3.LShR(z3.Concat(a, b), z3.ZeroExt(n, z3.URem(by, z3.BitVecVal(n, n))))
    return z3.Extract(n - 1, 0, both)


def swapped(x: Any) -> Any:
    """The bytes the other way round."""
    return z3.Concat(*(z3.Extract(8 * i + 7, 8 * i, x) for i in range(x.size() // 8)))


def ones(x: Any) -> Any:
    """How many bits are 1."""
    n = x.size()
    return sum((z3.ZeroExt(n - 1, z3.Extract(i, i, x)) for i in range(n)), z3.BitVecVal(0, n))


def saturated(operation: Callable, leaves: Callable, limit: int) -> Callable:
    """Unsigned arithmetic that stops at a limit: 0 or -1."""
    return lambda a, b: z3.If(leaves(a, b), z3.BitVecVal(limit, a.size()), operation(a, b))


INTRINSICS: dict[str, Callable] = {
    "umin": lambda a, b: z3.If(z3.ULT(a, b), a, b), "umax": lambda a, b: z3.If(z3.ULT(a, b), b, a),
    "smin": lambda a, b: z3.If(a < b, a, b), "smax": lambda a, b: z3.If(a < b, b, a),
    "fabs": lambda a: a & (1 << (a.size() - 1)) - 1,
    "fshl": funnel_left, "fshr": funnel_right, "bswap": swapped, "ctpop": ones,
    "uadd.sat": saturated(ADD, LEAVES["add"][0], -1),
    "usub.sat": saturated(SUB, LEAVES["sub"][0], 0),
}  # fmt: skip
MARKED: dict[str, tuple[Callable, Callable]] = {  # the second operand says what is poison
    "ctlz": (leading_zeros, lambda x: x == 0),
    "cttz": (trailing_zeros, lambda x: x == 0),
    "abs": (lambda x: z3.If(x < 0, -x, x), lambda x: x == 1 << (x.size() - 1)),
}
OVERFLOW = {"add": ADD, "sub": SUB, "mul": MUL}
NOTHING = ("llvm.lifetime", "llvm.dbg", "llvm.experimental.noalias", "llvm.assume")


# ---------------------------------------------------------------- types


@dataclass(frozen=True)
class Layout:
    """Sizes of a module's types, in bytes, by their text."""

    structs: dict[str, list[str]]
    pointer: int

    @functools.cache  # noqa: B019 - a layout lives as long as the process
    def size_and_alignment(self, text: str) -> tuple[int, int]:
        """Of one element of an array."""
        if text in ("ptr", "float", "double"):
            size = {"ptr": self.pointer, "float": 4, "double": 8}[text]
            return size, size
        if text[0] == "i":
            size = 1 << max(0, (int(text[1:]) + 7) // 8 - 1).bit_length()
            return size, size
        if text[0] == "[":
            count, inner = re.fullmatch(r"\[(\d+) x (.*)\]", text).groups()
            size, alignment = self.size_and_alignment(inner)
            return int(count) * size, alignment
        offsets = self.offsets(text)
        return offsets[-1], max(self.size_and_alignment(t)[1] for t in self.fields(text))

    def fields(self, text: str) -> list[str]:
        """The types in a struct."""
        return self.structs[text] if text in self.structs else split_types(text.strip("{} "))

    def offsets(self, text: str) -> list[int]:
        """Where the fields of a struct begin, and its size."""
        at, found, most = 0, [], 1
        for kind in self.fields(text):
            size, alignment = self.size_and_alignment(kind)
            at = -(-at // alignment) * alignment
            found.append(at)
            at, most = at + size, max(most, alignment)
        return [*found, -(-at // most) * most]


def split_types(text: str) -> list[str]:
    """A list of types or of typed constants at its commas, those in brackets left alone."""
    parts, depth = [""], 0
    for c in text:
        depth += (c in "[{(") - (c in "]})")
        if c == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += c
    return [p.strip() for p in parts if p.strip()]


def bits_of(text: str) -> int:
    """Width of a value of a type, by its text."""
    known = {"float": 32, "double": 64, "ptr": WORD}
    if text in known:
        return known[text]
    if not re.fullmatch(r"i\d+", text):
        raise Unsupported(f"a value of type {text}")
    return int(text[1:])


# ---------------------------------------------------------------- code


@dataclass
class Outcome:
    """What a call gives: its value, all memory after it, and what must not happen."""

    value: Any
    fault: z3.BoolRef
    beyond: z3.BoolRef
    memory: dict[str, Any]
    arguments: list[Any] = field(default_factory=list)


@dataclass
class State:
    """One place in the code: under which condition it is reached, and with which values."""

    condition: z3.BoolRef
    values: dict[Any, Any]
    memory: dict[str, Any]


def merged(a: State, b: State) -> State:
    """Two ways to the same place."""
    values = dict(b.values)
    for key, value in a.values.items():
        values[key] = choose(a.condition, value, b.values[key]) if key in b.values else value
    memory = dict(b.memory)
    for key, array in a.memory.items():
        other = memory.get(key, array)
        memory[key] = array if array.eq(other) else z3.If(a.condition, array, other)
    return State(any_of(a.condition, b.condition), values, memory)


class Module:
    """The code of one or more files, by LLVM's own reader."""

    def __init__(self, code: str, unroll: int = 80) -> None:
        self.llvm = llvm.parse_assembly(code, context=llvm.create_context())
        self.unroll = unroll
        structs = dict(re.findall(r"^(%[\w.\"]+) = type \{(.*)\}$", code, re.M))
        pointer = 4 if re.search(r"e-m:e-p:32:32|e-p:32:32", code) else 8
        self.layout = Layout(Frozen({k: split_types(v) for k, v in structs.items()}), pointer)
        self.functions = {f.name: f for f in self.llvm.functions if not f.is_declaration}
        self.tables = {g.name: str(g) for g in self.llvm.global_variables}

    def __getitem__(self, name: str) -> Function:
        return Function(self, self.functions[name])


class Frozen(dict):
    """A dict that can be part of a cached call; nobody changes it."""

    __hash__ = object.__hash__  # type: ignore[assignment]


@dataclass(frozen=True)
class Function:
    """A compiled function; call it with terms, numbers, or names of objects for pointers."""

    module: Module
    code: Any

    def parameters(self) -> list[tuple[str, str]]:
        """Name and type of each argument."""
        return [(a.name or f"arg{i}", str(a.type)) for i, a in enumerate(self.code.arguments)]

    def symbols(self) -> list[Any]:
        """An argument of each type: a free term, or the name of an object."""
        return [
            f"at_{name}" if kind == "ptr" else z3.BitVec(name, bits_of(kind))
            for name, kind in self.parameters()
        ]

    def __call__(self, *arguments: Any, memory: dict[str, Any] | None = None) -> Outcome:
        given = list(arguments) or self.symbols()
        kinds = [kind for _, kind in self.parameters()]
        if len(given) != len(kinds):
            raise TypeError(f"{self.code.name} takes {len(kinds)} arguments, not {len(given)}")
        values = [as_value(a, k) for a, k in zip(given, kinds, strict=True)]
        objects = {v.object: bytes_named(v.object) for v in values if v.object}
        run = Run(self.module)
        value, state = run.call(self.code, values, State(TRUE, {}, {**objects, **(memory or {})}))
        term = value.term if isinstance(value, Value) else value
        poison = value.poison if isinstance(value, Value) else FALSE
        return Outcome(term, any_of(run.fault, poison), run.beyond, state.memory, given)


def bytes_named(name: str) -> Any:
    """Memory of an object of unknown contents."""
    return z3.Array(name, z3.BitVecSort(WORD), z3.BitVecSort(8))


def word(name: str, place: int = 0, bits: int = 64) -> Any:
    """What an object holds at a place before the call."""
    return loaded(bytes_named(name), z3.BitVecVal(place, WORD), bits, bits)


def as_value(argument: Any, kind: str) -> Value:
    """An argument as the code takes it."""
    if kind == "ptr":
        return Value(z3.BitVecVal(0, WORD), FALSE, argument)
    if isinstance(argument, int):
        return Value(z3.BitVecVal(argument, bits_of(kind)))
    return Value(argument)


class Run:
    """One execution over all paths."""

    def __init__(self, module: Module) -> None:
        self.module = module
        self.fault, self.beyond = FALSE, FALSE
        self.fresh = 0

    # paths

    def call(self, function: Any, arguments: list[Value], state: State) -> tuple[Any, State]:
        """Run a function; the blocks that wait run in the order that meets joins late."""
        blocks = order_of(function)
        values = dict(zip(function.arguments, arguments, strict=True))
        waiting = {0: State(state.condition, values, state.memory)}
        turns = dict.fromkeys(range(len(blocks)), 0)
        places = {b: i for i, b in enumerate(blocks)}
        result: tuple[Any, State] | None = None
        while waiting:
            place = min(waiting)
            here = waiting.pop(place)
            turns[place] += 1
            if turns[place] > self.module.unroll:
                self.beyond = any_of(self.beyond, here.condition)
                continue
            for target, next_state in self.block(blocks[place], here):
                if target is None:
                    value = next_state.values["return"]
                    result = (
                        (value, next_state)
                        if result is None
                        else (
                            choose(next_state.condition, value, result[0]),
                            merged(next_state, result[1]),
                        )
                    )
                    continue
                at = places[target]
                waiting[at] = merged(next_state, waiting[at]) if at in waiting else next_state
        if result is None:
            raise Unsupported(f"{function.name} never returns")
        return result

    def block(self, block: Any, state: State) -> list[tuple[Any, State]]:
        """Run one block; where it goes on, and how."""
        for i in block.instructions:
            kind = i.opcode
            if kind == "phi":
                continue
            if kind == "br":
                return self.branch(block, i, state)
            if kind == "switch":
                return self.switch(block, i, state)
            if kind == "unreachable":
                self.fault = any_of(self.fault, state.condition)
                return []
            if kind == "ret":
                operands = list(i.operands)
                value = self.value(operands[0], state) if operands else Value(z3.BitVecVal(0, 1))
                values = {**state.values, "return": value}
                return [(None, State(state.condition, values, state.memory))]
            state.values[i] = self.instruction(i, kind, state)
        raise Unsupported("a block without an end")

    def branch(self, block: Any, i: Any, state: State) -> list[tuple[Any, State]]:
        """One or two ways on."""
        operands = list(i.operands)
        targets = successors(block)
        if len(targets) == 1:
            return [(targets[0], self.edge(block, targets[0], state, TRUE))]
        condition = is_set(self.used(operands[0], state).term)
        yes, no = targets_of(i, targets)
        return self.ways(block, state, [(yes, condition), (no, tidy(z3.Not(condition)))])

    def switch(self, block: Any, i: Any, state: State) -> list[tuple[Any, State]]:
        """A way for each case, and one for the rest."""
        operands = list(i.operands)
        x = self.used(operands[0], state).term
        cases = [
            (block_of(operands[k + 1]), tidy(x == operands[k].get_constant_value()))
            for k in range(2, len(operands), 2)
        ]
        rest = tidy(z3.Not(z3.Or(*(c for _, c in cases))))
        return self.ways(block, state, [*cases, (block_of(operands[1]), rest)])

    def ways(self, block: Any, state: State, ways: list) -> list[tuple[Any, State]]:
        """Those of several ways that are not plainly impossible."""
        return [
            (target, self.edge(block, target, state, condition))
            for target, condition in ways
            if not z3.is_false(condition)
        ]

    def edge(self, source: Any, target: Any, state: State, condition: z3.BoolRef) -> State:
        """The state at the begin of the next block, its joins resolved."""
        values = dict(state.values)
        for i in target.instructions:
            if i.opcode != "phi":
                break
            sources = list(i.incoming_blocks)
            operand = list(i.operands)[sources.index(source)]
            values[i] = shortened(self.value(operand, state))
        return State(all_of(state.condition, condition), values, dict(state.memory))

    # values

    def value(self, operand: Any, state: State) -> Any:
        """What an operand is."""
        if operand in state.values:
            return state.values[operand]
        text, kind = str(operand).strip(), str(operand.type)
        if operand.value_kind == llvm.ValueKind.global_variable:
            return Value(z3.BitVecVal(0, WORD), FALSE, self.table(operand.name, state))
        if text.endswith((" poison", " undef")):
            return self.unknown(kind)
        if match := re.search(r"getelementptr .*\((.*)\)$", text):
            return self.constant_address(match[1], state)
        return self.constant(operand, text, kind)

    def constant(self, operand: Any, text: str, kind: str) -> Value:
        """A number, or the pointer to nothing."""
        if operand.value_kind == llvm.ValueKind.constant_int:
            return Value(z3.BitVecVal(operand.get_constant_value(), bits_of(kind)))
        if operand.value_kind == llvm.ValueKind.constant_fp:
            constant = z3.FPVal(operand.get_constant_value(), float_sort(kind))
            return Value(z3.simplify(z3.fpToIEEEBV(constant)))
        if text.endswith(" null"):
            return Value(z3.BitVecVal(0, WORD), FALSE, "null")
        raise Unsupported(f"operand {text}")

    def constant_address(self, text: str, state: State) -> Value:
        """A place in a table, as LLVM writes it: i8, ptr @table, i64 8."""
        kind, base, *indices = split_types(text)
        offset = self.offset_of(kind, [z3.BitVecVal(int(t.split()[1]), WORD) for t in indices])
        return Value(tidy(offset), FALSE, self.table(base.split("@")[1], state))

    def unknown(self, kind: str) -> Any:
        """Poison of a type."""
        if kind.startswith("{"):
            return Group(tuple(self.unknown(t) for t in split_types(kind.strip("{} "))))
        self.fresh += 1
        return Value(z3.BitVec(f"unknown!{self.fresh}", bits_of(kind)), TRUE)

    def used(self, operand: Any, state: State) -> Value:
        """An operand where poison is undefined behaviour."""
        value = self.value(operand, state)
        self.fault = any_of(self.fault, all_of(state.condition, value.poison))
        return value

    def table(self, name: str, state: State) -> str:
        """A constant table as an object."""
        if name not in state.memory:
            state.memory[name] = table_of(self.module.tables[name], self.module.layout)
        return name

    # instructions

    def instruction(self, i: Any, kind: str, state: State) -> Any:
        """The value of an instruction."""
        special = getattr(self, f"do_{kind}", None)
        if special:
            return special(i, list(i.operands), state)
        if kind in BINARY:
            return self.binary(i, kind, state)
        raise Unsupported(str(i).strip())

    def binary(self, i: Any, kind: str, state: State) -> Value:
        """Arithmetic; poison by the words that LLVM puts on it."""
        x, y = (self.value(o, state) for o in i.operands)
        a, b = x.term, y.term
        words = str(i).split(f" {kind} ", 1)[1].split()[:3]
        poison = [x.poison, y.poison]
        if kind in LEAVES:
            poison += [LEAVES[kind][k](a, b) for k, w in enumerate(("nuw", "nsw")) if w in words]
        if kind in ("shl", "lshr", "ashr"):
            poison.append(z3.UGE(b, a.size()))
        if "exact" in words:
            back = MUL if kind.endswith("div") else BINARY["shl"]
            poison.append(back(BINARY[kind](a, b), b) != a)
        if "disjoint" in words:
            poison.append(a & b != 0)
        if kind in ("udiv", "urem", "sdiv", "srem"):
            self.fault = any_of(self.fault, all_of(state.condition, any_of(y.poison, b == 0)))
        if kind in ("sdiv", "srem"):
            low = z3.And(a == 1 << (a.size() - 1), b == -1)
            self.fault = any_of(self.fault, all_of(state.condition, low))
        return Value(folded(BINARY[kind](a, b)), any_of(*map(tidy, poison)))

    def do_icmp(self, i: Any, operands: list, state: State) -> Value:
        x, y = (self.value(o, state) for o in operands)
        test = re.search(r"icmp (?:samesign )?(\w+)", str(i))[1]
        if x.object != y.object:
            if "null" in (x.object, y.object) and test in ("eq", "ne"):
                return Value(z3.BitVecVal(int(test == "ne"), 1))
            raise Unsupported("two objects compared")
        return Value(as_bit(COMPARE[test](x.term, y.term)), any_of(x.poison, y.poison))

    def do_select(self, i: Any, operands: list, state: State) -> Any:
        which, yes, no = (self.value(o, state) for o in operands)
        chosen = choose(is_set(which.term), yes, no)
        if isinstance(chosen, Group):
            return chosen
        return Value(chosen.term, any_of(which.poison, chosen.poison), chosen.object)

    def resize(self, i: Any, operands: list, state: State, to: Callable) -> Value:
        """Between widths."""
        x = self.value(operands[0], state)
        n, words = bits_of(str(i.type)), str(i).split("=", 1)[1].split()[1:3]
        term, poison = to(x.term, n - x.term.size(), n), [x.poison]
        if i.opcode == "zext" and "nneg" in words:
            poison.append(x.term < 0)
        if i.opcode == "trunc" and "nuw" in words:
            poison.append(z3.ZeroExt(x.term.size() - n, term) != x.term)
        if i.opcode == "trunc" and "nsw" in words:
            poison.append(z3.SignExt(x.term.size() - n, term) != x.term)
        return Value(folded(term), any_of(*map(tidy, poison)))

    def do_zext(self, i: Any, operands: list, state: State) -> Value:
        return self.resize(i, operands, state, lambda x, more, n: z3.ZeroExt(more, x))

    def do_sext(self, i: Any, operands: list, state: State) -> Value:
        return self.resize(i, operands, state, lambda x, more, n: z3.SignExt(more, x))

    def do_trunc(self, i: Any, operands: list, state: State) -> Value:
        return self.resize(i, operands, state, lambda x, more, n: z3.Extract(n - 1, 0, x))

    def do_bitcast(self, i: Any, operands: list, state: State) -> Value:
        value = self.value(operands[0], state)
        if bits_of(str(i.type)) != value.term.size():
            raise Unsupported(str(i).strip())
        return value

    def do_fneg(self, i: Any, operands: list, state: State) -> Value:
        value = self.value(operands[0], state)
        return Value(value.term ^ 1 << (value.term.size() - 1), value.poison)

    def do_freeze(self, i: Any, operands: list, state: State) -> Value:
        value = self.value(operands[0], state)
        if z3.is_false(value.poison):
            return value
        other = self.unknown(str(i.type))
        return Value(z3.If(value.poison, other.term, value.term), FALSE, value.object)

    def do_extractvalue(self, i: Any, operands: list, state: State) -> Any:
        return self.value(operands[0], state).parts[last_index(i)]

    def do_insertvalue(self, i: Any, operands: list, state: State) -> Group:
        parts = list(self.value(operands[0], state).parts)
        parts[last_index(i)] = self.value(operands[1], state)
        return Group(tuple(parts))

    # memory

    def do_alloca(self, i: Any, operands: list, state: State) -> Value:
        self.fresh += 1
        name = f"local!{self.fresh}"
        state.memory[name] = bytes_named(name)
        return Value(z3.BitVecVal(0, WORD), FALSE, name)

    def do_getelementptr(self, i: Any, operands: list, state: State) -> Value:
        base, *indices = (self.value(o, state) for o in operands)
        text = re.search(r"getelementptr (?:inbounds |nuw |nusw )*(.*)", str(i))[1]
        kind = split_types(text)[0]
        offset = self.offset_of(kind, [to_word(x.term) for x in indices])
        poison = any_of(base.poison, *(x.poison for x in indices))
        return Value(tidy(base.term + offset), poison, base.object)

    def offset_of(self, kind: str, indices: Sequence[Any]) -> Any:
        """How far the indices go, the first over whole values of the type."""
        layout = self.module.layout
        offset = indices[0] * layout.size_and_alignment(kind)[0]
        for index in indices[1:]:
            if kind[0] == "[":
                kind = re.fullmatch(r"\[\d+ x (.*)\]", kind)[1]
                offset = offset + index * layout.size_and_alignment(kind)[0]
            else:
                at = number(index)
                offset = offset + layout.offsets(kind)[at]
                kind = layout.fields(kind)[at]
        return offset

    def do_load(self, i: Any, operands: list, state: State) -> Value:
        place = self.used(operands[0], state)
        kind = str(i.type)
        if kind == "ptr" or place.object not in state.memory:
            raise Unsupported(str(i).strip())
        n = bits_of(kind)
        return Value(loaded(state.memory[place.object], place.term, max(n, 8), n))

    def do_store(self, i: Any, operands: list, state: State) -> None:
        value, place = self.value(operands[0], state), self.used(operands[1], state)
        if value.object or place.object not in state.memory:
            raise Unsupported(str(i).strip())
        self.fault = any_of(self.fault, all_of(state.condition, value.poison))
        array = state.memory[place.object]
        state.memory[place.object] = stored(array, place.term, value.term)

    # calls

    def do_call(self, i: Any, operands: list, state: State) -> Any:
        *given, callee = operands
        name = callee.name
        if re.search(r"call [^@]* asm ", str(i)):
            return self.barrier(i, given, state)
        if name in self.module.functions:
            arguments = [self.value(o, state) for o in given]
            inner = State(state.condition, {}, state.memory)
            value, after = self.call(self.module.functions[name], arguments, inner)
            state.memory = after.memory
            return value
        return self.intrinsic(i, name, given, state)

    def barrier(self, i: Any, given: list, state: State) -> Any:
        """An empty statement of assembly gives what it takes (DAHL_KEEP)."""
        if not re.search(r'asm (?:sideeffect )?"", "=r,0[,~"]', str(i)):
            raise Unsupported(str(i).strip())
        return self.value(given[0], state)

    def intrinsic(self, i: Any, name: str, given: list, state: State) -> Any:
        if name.startswith(NOTHING):
            return None
        if name in ("llvm.ubsantrap", "llvm.trap"):
            self.fault = any_of(self.fault, state.condition)
            return None
        if name.startswith(("llvm.memcpy", "llvm.memmove", "llvm.memset")):
            return self.copy(name, given, state)
        short = re.sub(r"^llvm\.|\.[if]\d+$", "", name)
        if short in INTRINSICS:
            values = [self.value(o, state) for o in given]
            poison = any_of(*(v.poison for v in values))
            return Value(folded(INTRINSICS[short](*(v.term for v in values))), poison)
        if short in MARKED:
            x, flag = self.value(given[0], state), given[1].get_constant_value()
            compute, bad = MARKED[short]
            poison = any_of(x.poison, bad(x.term)) if flag else x.poison
            return Value(compute(x.term), tidy(poison))
        if match := re.fullmatch(r"([us])(add|sub|mul)\.with\.overflow", short):
            return self.with_overflow(match[1], match[2], given, state)
        raise Unsupported(str(i).strip())

    def with_overflow(self, sign: str, kind: str, given: list, state: State) -> Group:
        x, y = (self.value(o, state) for o in given)
        poison = any_of(x.poison, y.poison)
        over = as_bit(LEAVES[kind][sign == "s"](x.term, y.term))
        return Group((Value(OVERFLOW[kind](x.term, y.term), poison), Value(over, poison)))

    def copy(self, name: str, given: list, state: State) -> None:
        """Bytes moved or set, as many as a constant says."""
        to, source = self.used(given[0], state), self.used(given[1], state)
        count = number(self.used(given[2], state).term)
        if count is None:
            raise Unsupported(f"{name} of a length that is not constant")
        array = state.memory[to.object]
        for k in range(count):
            byte = (
                source.term
                if "memset" in name
                else loaded(state.memory[source.object], source.term + k, 8, 8)
            )
            array = stored(array, to.term + k, byte)
        state.memory[to.object] = array


def order_of(function: Any) -> list[Any]:
    """The blocks, each after those that lead to it but by a loop."""
    done, after = set(), []
    stack = [(next(iter(function.blocks)), None)]
    while stack:
        block, rest = stack.pop()
        if rest is None:
            if block in done:
                continue
            done.add(block)
            rest = iter(successors(block))
        for target in rest:
            if target not in done:
                stack += [(block, rest), (target, None)]
                break
        else:
            after.append(block)
    return after[::-1]


def successors(block: Any) -> list[Any]:
    """The blocks to which a block leads."""
    last = list(block.instructions)[-1]
    return [block_of(o) for o in last.operands if str(o.type) == "label"]


def block_of(operand: Any) -> Any:
    """The block that a label names."""
    return llvm.ValueRef(operand._ptr, "block", operand._parents)


def targets_of(i: Any, targets: list[Any]) -> tuple[Any, Any]:
    """The blocks of a branch, yes and no: by the text, since readers list them in either order."""
    label = re.search(r"label %([\w.\"-]+), label %([\w.\"-]+)", str(i)).groups()[0]
    first = targets[0]
    named = first.name or re.match(r"\s*(\d+):", str(first))[1]
    return (first, targets[1]) if named == label.strip('"') else (targets[1], first)


def float_sort(kind: str) -> Any:
    return z3.Float32() if kind == "float" else z3.Float64()


def last_index(i: Any) -> int:
    """The index of extractvalue or insertvalue."""
    return int(re.search(r", (\d+)(?:, !.*)?$", str(i).strip())[1])


def shortened(value: Any) -> Any:
    """A value on the way round a loop, simplified so that its end is seen."""
    if not isinstance(value, Value):
        return value
    return Value(tidy(value.term), tidy(value.poison), value.object)


def to_word(term: Any) -> Any:
    """An index in the width of an offset."""
    return term if term.size() == WORD else z3.SignExt(WORD - term.size(), term)


def loaded(array: Any, place: Any, width: int, n: int) -> Any:
    """n bits of memory, the lowest byte first."""
    parts = [z3.Select(array, tidy(place + k)) for k in range(width // 8)]
    return z3.Extract(n - 1, 0, z3.Concat(*parts[::-1]) if len(parts) > 1 else parts[0])


def stored(array: Any, place: Any, term: Any) -> Any:
    """Memory with a value put into it."""
    term = z3.ZeroExt(-term.size() % 8, term)
    for k in range(term.size() // 8):
        array = z3.Store(array, tidy(place + k), z3.Extract(8 * k + 7, 8 * k, term))
    return array


def table_of(text: str, layout: Layout) -> Any:
    """Memory with a constant table, as LLVM writes it."""
    kind, rest = re.search(r" constant (\[.*?\]|i\d+) (.*?)(?:, align.*)?$", text).groups()
    inner = re.fullmatch(r"\[\d+ x (i\d+)\]", kind)
    if rest != "zeroinitializer" and not (inner and rest[0] == "["):
        raise Unsupported(text.strip())
    array = z3.K(z3.BitVecSort(WORD), z3.BitVecVal(0, 8))
    if inner and rest[0] == "[":
        size = layout.size_and_alignment(inner[1])[0]
        for k, item in enumerate(split_types(rest[1:-1])):
            value = z3.BitVecVal(int(item.split()[1]), 8 * size)
            array = stored(array, z3.BitVecVal(k * size, WORD), value)
    return array


# ---------------------------------------------------------------- compiler


def compile_c(
    *sources: Path | str,
    flags: Sequence[str] = PLAIN,
    include: Sequence[Path] = (ROOT / "lib" / "include",),
    compiler: str = "clang-19",
    unroll: int = 80,
) -> Module:
    """The code of C files taken as one, so that calls between them are followed."""
    found = shutil.which(compiler)
    if found is None:
        raise FileNotFoundError(f"{compiler} is not installed; tools/setup.sh gets it")
    with tempfile.TemporaryDirectory() as folder:
        unit = Path(folder) / "unit.c"
        unit.write_text("".join(f'#include "{Path(s).resolve()}"\n' for s in sources))
        command = [found, *flags, *(f"-I{i}" for i in include), "-S", "-emit-llvm"]
        done = subprocess.run(
            [*command, str(unit), "-o", "-"], capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise RuntimeError(f"{compiler}: {done.stderr.strip()}")
    return Module(done.stdout, unroll)


# ---------------------------------------------------------------- solvers


@dataclass
class Verdict:
    """proven; or not, with values for which the claim fails; or neither in the time given."""

    proven: bool
    values: dict[str, int] | None
    seconds: float
    solver: str
    memory: dict[str, bytes] = field(default_factory=dict)

    @property
    def refuted(self) -> bool:
        return self.values is not None

    def __str__(self) -> str:
        said = "proven" if self.proven else "unknown"
        if self.values is not None:
            said = "fails for " + ", ".join(f"{k}={v:#x}" for k, v in self.values.items())
        return f"{said} ({self.solver}, {self.seconds:.1f} s)"


def prove(
    claim: Any, given: Sequence[Any] = (), seconds: float = 60, solver: str = "bitwuzla"
) -> Verdict:
    """Whether the claim holds wherever all of `given` does."""
    query = z3.Solver()
    query.add(*given, z3.Not(claim))
    begin = time.monotonic()
    answer, values, memory = SOLVERS[solver](query, seconds)
    return Verdict(answer == "unsat", values, time.monotonic() - begin, solver, memory)


READ = 512  # bytes of an object that a counterexample shows


def by_z3(query: z3.Solver, seconds: float) -> tuple[str, dict[str, int] | None, dict[str, bytes]]:
    query.set("timeout", int(1000 * seconds))
    answer = str(query.check())
    if answer != "sat":
        return answer, None, {}
    model, values, memory = query.model(), {}, {}
    for d in model.decls():
        if d.arity() == 0 and z3.is_bv_sort(d.range()):
            values[d.name()] = model[d].as_long()
        elif d.arity() == 0 and z3.is_array_sort(d.range()):
            read = (model.eval(z3.Select(d(), z3.BitVecVal(k, WORD)), True) for k in range(READ))
            memory[d.name()] = bytes(b.as_long() for b in read)
    return answer, values, memory


def by_bitwuzla(
    query: z3.Solver, seconds: float
) -> tuple[str, dict[str, int] | None, dict[str, bytes]]:
    manager, options = bitwuzla.TermManager(), bitwuzla.Options()
    options.set(bitwuzla.Option.PRODUCE_MODELS, True)
    options.set(bitwuzla.Option.TIME_LIMIT_PER, int(1000 * seconds))
    parser = bitwuzla.Parser(manager, options)
    text = re.sub(r"\b(bv[us](?:div|rem|mod))_i\b", r"\1", query.to_smt2())
    parser.parse(text.replace("(check-sat)", ""), True, False)
    answer = str(parser.bitwuzla().check_sat()).rsplit(".", 1)[-1].lower()
    if answer != "sat":
        return answer, None, {}
    values, memory = {}, {}
    for term in parser.get_declared_funs():
        name = term.symbol().strip("|")
        if term.sort().is_bv():
            values[name] = int(parser.bitwuzla().get_value(term).value(10))
        elif term.sort().is_array():
            memory[name] = bytes_of(parser.bitwuzla(), manager, term)
    return answer, values, memory


def bytes_of(solver: Any, manager: Any, array: Any) -> bytes:
    """The first bytes of an object in a counterexample."""
    sort = manager.mk_bv_sort(WORD)
    places = (manager.mk_bv_value(sort, k) for k in range(READ))
    terms = (manager.mk_term(bitwuzla.Kind.ARRAY_SELECT, [array, p]) for p in places)
    return bytes(int(solver.get_value(t).value(10)) for t in terms)


SOLVERS: dict[str, Callable] = {"bitwuzla": by_bitwuzla, "z3": by_z3}


def inner_first(terms: Sequence[Any]) -> list[Any]:
    """All parts of terms, each once and after its own parts."""
    done, found, waiting = set(), [], list(terms)
    while waiting:
        node = waiting[-1]
        open_parts = [c for c in node.children() if c.get_id() not in done]
        if open_parts:
            waiting += open_parts
            continue
        waiting.pop()
        if node.get_id() not in done:
            done.add(node.get_id())
            found.append(node)
    return found


def without_products(terms: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """The terms with products as a function of which nothing is known, and that it commutes.

    Quick for a solver; what holds for any function holds for products, not the other way round.
    """
    pairs: list[tuple[Any, Any]] = []
    facts: list[Any] = []
    for node in inner_first(terms):
        if z3.is_app_of(node, z3.Z3_OP_BMUL) and not any(map(z3.is_bv_value, node.children())):
            first, *others = (z3.substitute(c, *pairs) for c in node.children())
            product = z3.Function(f"product{node.size()}", *3 * [node.sort()])
            for other in others:
                facts.append(product(first, other) == product(other, first))
                first = product(first, other)
            pairs.append((node, first))
    return [z3.substitute(t, *pairs) for t in terms], facts


def differ(
    one: Function,
    other: Function,
    given: Callable[[Outcome], Sequence[Any]] = lambda _: (),
    seconds: float = 60,
    solver: str = "bitwuzla",
) -> Verdict:
    """Whether two functions do the same for all arguments and all contents of memory.

    Proven: wherever the first is defined, the other is too, with the same value and the same bytes
    in every object. `given` may say, of the first one's call, which arguments are meant: its
    `arguments`, and by `word("at_arg1")` what its second argument points to.
    """
    arguments = one.symbols()
    a, b = one(*arguments), other(*arguments)
    place = z3.BitVec("place", WORD)
    objects = [name for name in arguments if isinstance(name, str)]
    same = [z3.Select(a.memory[o], place) == z3.Select(b.memory[o], place) for o in objects]
    if z3.is_bv(a.value):
        same.append(a.value == b.value)
    claim = all_of(z3.Not(b.fault), z3.Not(b.beyond), *same)
    meant = [z3.Not(a.fault), z3.Not(a.beyond), *given(a)]
    (claim_for_any, *meant_for_any), facts = without_products([claim, *meant])
    if facts:
        quick = prove(claim_for_any, [*meant_for_any, *facts], min(seconds, 10), solver)
        if quick.proven:
            return quick
    return prove(claim, meant, seconds, solver)
