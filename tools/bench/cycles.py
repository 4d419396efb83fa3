# SPDX-License-Identifier: MIT
"""Cycles of instructions on Cortex-M0, M3 and M4F with zero wait states.

Sources: the tables "instruction set summary" of the Technical Reference Manuals (M0: DDI 0432C,
table 3-1; M3: DDI 0337, table 3-1; M4: 100166, tables 3-1 and 7-1). plugin.c adds the costs of the
executed instructions.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

CONDITION = "(?:eq|ne|cs|hs|cc|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)"


@dataclass(frozen=True)
class Cost:
    """Least and most cycles if the next instruction in memory follows, and if another one does."""

    least: int
    most: int
    jump_least: int
    jump_most: int


@dataclass(frozen=True)
class Rule:
    """The cost of instructions whose name, or name and operands, match a pattern. `registers`: the
    cycles of each register in their list.
    """

    pattern: str
    cost: Cost
    registers: int = 0


def exact(cycles: int) -> Cost:
    return Cost(cycles, cycles, cycles, cycles)


def between(least: int, most: int) -> Cost:
    return Cost(least, most, least, most)


def with_refill(least: int, most: int) -> Cost:
    """Return the cost of an instruction that can jump: P, the refill of the pipeline, is 1 to 3."""
    return Cost(least, most, most + 1, most + 3)


# The multiplier needs 1 cycle or 32, as its maker chose: least and most are these two processors.
M0 = (
    Rule(f"b{CONDITION}", Cost(1, 1, 3, 3)),
    Rule("b|bx|blx", exact(3)),
    Rule("bl|mrs|msr|dsb|dmb|isb", exact(4)),
    Rule("muls", between(1, 32)),
    Rule(r"pop .*\bpc\b.*", exact(4), registers=1),
    Rule("(pop|push|ldm|stm)(ia)?", exact(1), registers=1),
    Rule("(ldr|str)s?[bh]?", exact(2)),
    Rule("(mov|add) pc,.*", exact(3)),
)

# Adjacent loads and stores are pipelined to 1 cycle each. A folded IT is free.
THUMB2 = (
    Rule("b|bl|bx|blx|cbn?z|(mov|add) pc,.*", with_refill(1, 1)),
    Rule("tb[bh]", with_refill(2, 2)),
    Rule("it[te]*", between(0, 1)),
    Rule("(pop|ldm)(ia|db)?", with_refill(1, 1), registers=1),
    Rule("(push|stm)(ia|db)?", exact(1), registers=1),
    Rule("ldrd|strd", exact(3)),
    Rule("ldrs?[bh]?", Cost(1, 2, 2, 5)),
    Rule("strs?[bh]?", between(1, 2)),
    Rule("[us]div", between(2, 12)),
    Rule("dsb|dmb|isb", between(0, 4)),
)

M3 = (
    *THUMB2,
    Rule("[us]mull", between(3, 5)),
    Rule("[us]mlal", between(4, 7)),
    Rule("mla|mls", exact(2)),
)

# A result that the next instruction uses costs the FPU one cycle more. Integer instructions after
# a division run during it.
M4F = (
    *THUMB2,
    Rule("v(div|sqrt)", between(1, 15)),
    Rule("v(n?ml[as]|fn?m[as])", between(3, 4)),
    Rule(r"v(ldr|str)\w* d.*", between(1, 3)),
    Rule(r"v(ldr|str)\w*", between(1, 2)),
    Rule(r"v(push|pop|ldm|stm)\w* .*\{d.*", exact(1), registers=2),
    Rule(r"v(push|pop|ldm|stm)\w*", exact(1), registers=1),
    Rule(r"vmov\w* \w+, \w+, .*", exact(2)),
    Rule(r"v\w+", between(1, 2)),
)

TABLES = {"m0": M0, "m3": M3, "m4f": M4F}
ONE_CYCLE = exact(1)  # data processing

INSTRUCTION = re.compile(
    r"^ *([0-9a-f]+):\t((?:[0-9a-f]{4} ?)+)\s*\t(\S+)(?:[\t ]([^;@\n]*))?", re.MULTILINE
)
ALIASES = {"sl": 10, "fp": 11, "ip": 12, "sp": 13, "lr": 14, "pc": 15}


def number_of(register: str) -> int:
    return ALIASES.get(register) or int(register[1:])


def registers(operands: str) -> int:
    """Return the length of a list of registers such as {r0, r4-r7, lr}."""
    count = 0
    for part in operands.partition("{")[2].rstrip("} ^").split(","):
        first, _, last = part.strip().partition("-")
        count += number_of(last) - number_of(first) + 1 if last else 1
    return count


def find_cost(core: str, name: str, operands: str) -> Cost | None:
    for rule in TABLES[core]:
        if re.fullmatch(f"(?:{rule.pattern})(?: .*)?", f"{name} {operands}"):
            more = rule.registers and rule.registers * registers(operands)
            base = rule.cost
            least, most = base.least + more, base.most + more
            return Cost(least, most, base.jump_least + more, base.jump_most + more)
    return None


def cost(core: str, mnemonic: str, operands: str = "") -> Cost:
    """Return the cost of an instruction. A suffix such as .w or .f32 is no part of its name. An
    instruction whose condition is false costs 1 cycle.
    """
    name = mnemonic.partition(".")[0]
    found = find_cost(core, name, operands)
    if found is None and re.search(f"{CONDITION}$", name):
        found = find_cost(core, name[:-2], operands)
        found = found and replace(found, least=min(found.least, 1))
    return found or ONE_CYCLE


def cost_lines(core: str, listing: str) -> str:
    """Return a line for each instruction of a listing of objdump, for plugin.c: address, bytes,
    then the four numbers of its cost.
    """
    lines = []
    for address, code, mnemonic, operands in INSTRUCTION.findall(listing):
        if not mnemonic.startswith("."):
            each = cost(core, mnemonic, operands.strip())
            numbers = (each.least, each.most, each.jump_least, each.jump_most)
            lines.append(f"{address} {2 * len(code.split())} {' '.join(map(str, numbers))}\n")
    return "".join(lines)
