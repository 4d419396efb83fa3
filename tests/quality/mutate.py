# SPDX-License-Identifier: MIT
"""Small changes of C sources, one at a time: each is a mutant that some test ought to notice.

tree-sitter finds what can be changed, by node type; a change is a byte range and its replacement.
The id of a mutant is made of what it changes, not of where it stands, so it outlives edits
elsewhere: `lib/gap.h dahl_q30 arithmetic: a + b -> a - b`, and ` #2` where the same stands twice.

Not changed: conditions of the preprocessor, text of inline assembly, macros whose body is neither
an expression nor a number (attributes, definitions of whole functions).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import tree_sitter
import tree_sitter_c

PARSER = tree_sitter.Parser(tree_sitter.Language(tree_sitter_c.language()))

# What the parser does not know, made blank (or a word of the same length) before it looks.
BLANK = re.compile(
    r"(?<!define )\b(?:DAHL_(?:OUT_OF_LINE|SMALL|ALWAYS_INLINE|APART|AS_VECTORS|UNROLL_8)"
    r"|__extension__)\b|^DAHL_VARIANTS\(.*\)$",
    re.MULTILINE,
)
INLINE = re.compile(r"(?<!define )\bDAHL_INLINE\b")

LONG_LIST = 8  # entries of a table beyond this are changed in one way only

BINARY: dict[str, dict[str, tuple[str, ...]]] = {
    "relational": {
        "<": ("<=", "!=", ">="),
        "<=": ("<", "==", ">"),
        ">": (">=", "!=", "<="),
        ">=": (">", "==", "<"),
        "==": ("!=", "<=", ">="),
        "!=": ("==", "<", ">"),
    },
    "arithmetic": {"+": ("-",), "-": ("+",), "*": ("+",), "/": ("*",), "%": ("/",)},
    "bitwise": {
        "&": ("|", "^"),
        "|": ("&", "^"),
        "^": ("&", "|"),
        "<<": (">>",),
        ">>": ("<<",),
    },
    "logical": {"&&": ("||",), "||": ("&&",)},
}
ASSIGNMENT = {
    "+=": ("-=", "="),
    "-=": ("+=", "="),
    "*=": ("+=", "="),
    "/=": ("*=", "="),
    "%=": ("/=", "="),
    "&=": ("|=", "="),
    "|=": ("&=", "="),
    "^=": ("|=", "="),
    "<<=": (">>=", "="),
    ">>=": ("<<=", "="),
}
# Left alone with all that is in them.
CLOSED = {"gnu_asm_expression", "gnu_asm_statement", "sizeof_expression", "comment"}
CLOSED |= {"preproc_include", "attribute_specifier", "linkage_specification_string"}


@dataclass(frozen=True)
class Mutant:
    """Bytes start..end of the file become `text`."""

    id: str
    file: str
    line: int
    start: int
    end: int
    text: str
    hinted: bool = False  # seen by compilers with hints only, or by those without

    def apply(self, source: bytes) -> bytes:
        return source[: self.start] + self.text.encode() + source[self.end :]


@dataclass(frozen=True)
class Place:
    """Where the walk is: the function, whether a long table is around, offset of a macro's body."""

    function: str
    in_table: bool = False
    hinted: bool = False
    shift: int = 0


@dataclass(frozen=True)
class Change:
    """A change before it has its id; `old` and `new` are what a reader is shown."""

    operator: str
    function: str
    start: int
    end: int
    text: str
    old: str
    new: str
    hinted: bool


Node = tree_sitter.Node


def text_of(node: Node | None) -> str:
    if node is None or node.text is None:
        return ""
    return node.text.decode()


def one_line(text: str) -> str:
    """As a part of an id: comments and line breaks away."""
    return " ".join(re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL).split())


def changed(node: Node, place: Place, operator: str, text: str, of: Node | None = None) -> Change:
    """`node` becomes `text`; the id shows that within `of`."""
    whole = of or node
    before, after = node.start_byte - whole.start_byte, node.end_byte - whole.start_byte
    raw = (whole.text or b"").decode("latin-1")  # bytes and characters the same
    new = (raw[:before] + text + raw[after:]).encode("latin-1").decode()
    start, end = node.start_byte + place.shift, node.end_byte + place.shift
    old = one_line(text_of(whole))
    return Change(operator, place.function, start, end, text, old, one_line(new), place.hinted)


def of_binary(node: Node, place: Place) -> Iterator[Change]:
    sign = node.child_by_field_name("operator")
    left, right = node.child_by_field_name("left"), node.child_by_field_name("right")
    if sign is None or left is None or right is None:
        return
    for kind, table in BINARY.items():
        for other in table.get(text_of(sign), ()):
            yield changed(sign, place, kind, other, of=node)
    if text_of(sign) in BINARY["logical"]:
        yield changed(node, place, "logical", text_of(left))
        yield changed(node, place, "logical", text_of(right))


def of_assignment(node: Node, place: Place) -> Iterator[Change]:
    sign = node.child_by_field_name("operator")
    if sign is not None:
        for other in ASSIGNMENT.get(text_of(sign), ()):
            yield changed(sign, place, "assignment", other, of=node)


def of_unary(node: Node, place: Place) -> Iterator[Change]:
    argument = node.child_by_field_name("argument")
    if argument is not None and text_of(node.child_by_field_name("operator")) in "-~!":
        yield changed(node, place, "unary", text_of(argument))


def of_update(node: Node, place: Place) -> Iterator[Change]:
    sign = node.child_by_field_name("operator")
    if sign is not None:
        yield changed(sign, place, "update", "--" if text_of(sign) == "++" else "++", of=node)


def of_cast(node: Node, place: Place) -> Iterator[Change]:
    value = node.child_by_field_name("value")
    if value is not None and text_of(node.child_by_field_name("type")) != "void":
        yield changed(node, place, "cast", text_of(value))


def of_call(node: Node, place: Place) -> Iterator[Change]:
    arguments = node.child_by_field_name("arguments")
    given = arguments.named_children if arguments is not None else []
    for one, two in zip(given, given[1:], strict=False):
        if arguments is not None and text_of(one) != text_of(two) and one.type != "comment":
            raw = (arguments.text or b"").decode("latin-1")
            base = arguments.start_byte
            middle = raw[one.end_byte - base : two.start_byte - base]
            swapped = (
                raw[: one.start_byte - base]
                + text_of(two)
                + middle
                + text_of(one)
                + raw[two.end_byte - base :]
            )
            yield changed(arguments, place, "arguments", swapped, of=node)


def of_condition(node: Node, place: Place) -> Iterator[Change]:
    """if, while, do, for and ?: negated; those that begin no loop also always and never taken."""
    condition = node.child_by_field_name("condition")
    if condition is None:
        return
    if condition.type == "parenthesized_expression":
        condition = condition.named_children[0]
    yield changed(condition, place, "negation", f"!({text_of(condition)})")
    if node.type in ("if_statement", "conditional_expression"):
        yield changed(condition, place, "condition", "1")
        yield changed(condition, place, "condition", "0")


def of_return(node: Node, place: Place) -> Iterator[Change]:
    for value in node.named_children[:1]:
        yield changed(value, place, "return", f"({text_of(value)}) + 1", of=node)
        if text_of(value) != "0":
            yield changed(value, place, "return", "0", of=node)


def of_statement(node: Node, place: Place) -> Iterator[Change]:
    yield changed(node, place, "statement", ";")


def of_jump(node: Node, place: Place) -> Iterator[Change]:
    yield changed(node, place, "jump", ";")
    other = "continue;" if node.type == "break_statement" else "break;"
    yield changed(node, place, "jump", other)


INTEGER = re.compile(r"(0[xX][0-9a-fA-F]+|-?\d+)([uUlL]*)$")


def of_integer(node: Node, place: Place, digits: str, suffix: str) -> Iterator[Change]:
    value = int(digits, 16 if digits[:2].lower() == "0x" else 10)
    values = [value ^ 1] if place.in_table else [value + 1, value - 1, 0, value ^ 1]
    for other in dict.fromkeys(v for v in values if v != value):
        spelled = f"{other:#x}" if digits[:2].lower() == "0x" else str(other)
        yield changed(node, place, "constant", spelled + suffix)


def of_number(node: Node, place: Place) -> Iterator[Change]:
    text = text_of(node)
    integer = INTEGER.match(text)
    if integer:
        yield from of_integer(node, place, *integer.groups())
        return
    if not re.fullmatch(r"0[.]0f?", text):
        yield changed(node, place, "constant", "0.0")
        yield changed(node, place, "constant", f"(-{text})")
    yield changed(node, place, "constant", f"({text} + 1.0)")


def of_character(node: Node, place: Place) -> Iterator[Change]:
    yield changed(node, place, "constant", f"({text_of(node)} + 1)")


def of_string(node: Node, place: Place) -> Iterator[Change]:
    """Not of a pragma: those of the library unroll loops, and change no value."""
    call = node.parent.parent if node.parent else None
    if text_of(node) != '""' and not (call and text_of(call).startswith("_Pragma(")):
        yield changed(node, place, "constant", '""')


def of_boolean(node: Node, place: Place) -> Iterator[Change]:
    yield changed(node, place, "constant", "false" if text_of(node) == "true" else "true")


OPERATORS: dict[str, Callable[[Node, Place], Iterator[Change]]] = {
    "binary_expression": of_binary,
    "assignment_expression": of_assignment,
    "unary_expression": of_unary,
    "update_expression": of_update,
    "cast_expression": of_cast,
    "call_expression": of_call,
    "if_statement": of_condition,
    "while_statement": of_condition,
    "do_statement": of_condition,
    "for_statement": of_condition,
    "conditional_expression": of_condition,
    "return_statement": of_return,
    "expression_statement": of_statement,
    "break_statement": of_jump,
    "continue_statement": of_jump,
    "number_literal": of_number,
    "char_literal": of_character,
    "string_literal": of_string,
    "true": of_boolean,
    "false": of_boolean,
}


def has_error(node: Node) -> bool:
    return node.has_error or node.is_missing


def of_macro(node: Node, place: Place) -> Iterator[Change]:
    """The body of a #define, where it is an expression."""
    body, name = node.child_by_field_name("value"), text_of(node.child_by_field_name("name"))
    if body is None:
        return
    before = b"int x_ = "
    tree = PARSER.parse(before + (body.text or b"") + b";")
    if has_error(tree.root_node):
        return
    inner = Place(name, hinted=place.hinted, shift=body.start_byte - len(before))
    yield from walk(tree.root_node, inner)


def function_name(node: Node) -> str:
    declarator = node.child_by_field_name("declarator")
    while declarator is not None and declarator.type != "identifier":
        declarator = declarator.child_by_field_name("declarator")
    return text_of(declarator)


def place_within(node: Node, place: Place) -> Place:
    if node.type == "function_definition":
        return replace(place, function=function_name(node))
    if node.type == "initializer_list" and len(node.named_children) > LONG_LIST:
        return replace(place, in_table=True)
    if node.type == "preproc_if" and "__" in text_of(node.child_by_field_name("condition")):
        return replace(place, hinted=True)
    return place


def walk(node: Node, place: Place) -> Iterator[Change]:
    if node.type in CLOSED:
        return
    if node.type in ("preproc_def", "preproc_function_def"):
        yield from of_macro(node, place)
        return
    if node.type in OPERATORS:
        yield from OPERATORS[node.type](node, place)
    inner = place_within(node, place)
    condition = node.child_by_field_name("condition") if node.type == "preproc_if" else None
    for child in node.children:
        if child != condition:
            yield from walk(child, inner)


def blanked(source: str) -> str:
    source = BLANK.sub(lambda found: " " * len(found[0]), source)
    return INLINE.sub("static     ", source)


def mutants_of(file: str, source: bytes) -> list[Mutant]:
    """All mutants of a file, in the order of its text."""
    tree = PARSER.parse(blanked(source.decode("latin-1")).encode("latin-1"))
    found: list[Mutant] = []
    seen: Counter[str] = Counter()
    for change in walk(tree.root_node, Place("-")):
        name = f"{file} {change.function} {change.operator}: {change.old} -> {change.new}"
        seen[name] += 1
        if seen[name] > 1:
            name += f" #{seen[name]}"
        line = source.count(b"\n", 0, change.start) + 1
        found.append(Mutant(name, file, line, change.start, change.end, change.text, change.hinted))
    return found
