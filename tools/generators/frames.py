#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the CAN frames of lib/node/dahl.dbc in C, in Python and as a table of the docs.

Usage: frames.py     (in build/venv; a test compares its output with the committed files)

    lib/node/frames.c           packing and unpacking, between two marks
    tools/dahl/can/frames.py    the whole file
    docs/loop.md                the table of frames, between two marks

lib/include/dahl_frames.h is written by hand, for its comments. Each declaration that differs from
the DBC is printed, and the same test fails. Ids, bits, ranges, units, numbers and comments come
from the DBC; the tables below hold only the names that C and Python use.
"""

from __future__ import annotations

import math
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

from cantools.database.can import Database as CanDatabase
from cantools.database.can import Message, Signal

ROOT = Path(__file__).resolve().parents[2]
BEGIN, END = "from dahl.dbc by tools/generators/frames.py: begin", "from dahl.dbc: end"

FIELDS = {"EchoCounter": "echo", "TorqueRatio": "torque_q30"}  # else the name in snake case
NUMBERS = {"ThetaPerCount": "THETA", "MaxStep": "STEP", "StatusPeriod": "STATUS"}
NUMBERS |= {"Sequence": "WRONG_SEQUENCE"}
OWN_ERRORS = ("FORMAT", "INVALID", "JUMP")  # the other error bits are 1 << dahl_frames_state_t
OFF_AT_0 = ("STEP", "STATUS")  # 0: a move of any length; no Status but after an event
ENUMS = {  # signal: class in Python, its docstring, prefix in C, type in C
    "State": ("State", "State of the receiver.", "", "dahl_frames_state_t"),
    "Param": (
        "Param",
        "Parameters by number. UNITS has the unit.",
        "PARAM_",
        "dahl_frames_param_t",
    ),
    "Write": ("Write", "Purpose of a ParamWrite.", "PARAM_", ""),
    "Result": ("Result", "Result of a ParamWrite.", "PARAM_", ""),
    "What": ("What", "Extent of a Reset.", "RESET_", ""),
}
GROUPED = {  # fields that stand for several signals
    "errors": "Sticky bits: 1 << State, FORMAT, INVALID, JUMP.",
    "value": "Raw value of the parameter, in steps of its unit.",
}


@dataclass(frozen=True)
class Names:
    """Names of a frame in C and Python, and fields with their defaults in the order of Python."""

    call: str
    structure: str
    fields: dict[str, str]
    base: str = "Frame"
    c_order: tuple[str, ...] = ()  # else as in Python


FRAMES = {
    "EncoderState": Names(
        "encoder", "dahl_encoder_state_t", {"count": "", "counter": "0", "valid": "True"}
    ),
    "FrictionTorque": Names(
        "torque",
        "dahl_friction_torque_t",
        {"torque_q30": "", "counter": "0", "state": "State.OK", "echo": "0"},
        "TorqueFrame",
    ),
    "Status": Names(
        "status",
        "dahl_node_status_t",
        dict.fromkeys(("counter", "state", "errors", "lost", "corrupt", "out_of_step"), "")
        | dict.fromkeys(("version_major", "version_minor", "timeout"), ""),
        "StatusFrame",
    ),
    "ParamWrite": Names(
        "param_write",
        "dahl_param_write_t",
        {"param": "", "value": "0", "write": "Write.READ", "counter": "0"},
        "ParamWriteFrame",
        ("value", "counter", "param", "write"),
    ),
    "ParamReply": Names(
        "param_reply",
        "dahl_param_reply_t",
        {"param": "", "value": "", "result": "Result.DONE", "counter": "0"},
        "ParamFrame",
        ("value", "counter", "param", "result"),
    ),
    "Reset": Names(
        "reset", "dahl_node_reset_t", {"what": "", "counter": "0"}, c_order=("counter", "what")
    ),
}


@dataclass(frozen=True)
class Field:
    name: str
    signal: str
    start: int
    length: int
    is_signed: bool
    limits: tuple[int, int]
    comment: str
    unit: str  # of one step, if it is not 1

    @property
    def c_type(self) -> str:
        if self.length == 32:
            return "int32_t" if self.is_signed else "uint32_t"
        return "bool" if self.length == 1 else "uint8_t"


def fields_of(message: Message) -> list[Field]:
    """The fields of a frame in the order of their bits; several signals may share one."""
    found: dict[str, Field] = {}
    for signal in sorted(message.signals, key=lambda one: one.start):
        if signal.name != "Crc":
            name, start, length = _place(signal)
            comment, unit = GROUPED.get(name, str(signal.comment)), ""
            if signal.scale != 1 and name not in GROUPED:
                unit = f"In {step_text(signal)}. "
            limits = _limits(signal, length)
            field = Field(name, signal.name, start, length, signal.is_signed, limits, comment, unit)
            found.setdefault(name, field)
    return list(found.values())


def _place(signal: Signal) -> tuple[str, int, int]:
    if signal.multiplexer_ids:
        return "value", 32, 32
    if signal.name.startswith("Error"):
        return "errors", signal.start // 8 * 8, 8
    return FIELDS.get(signal.name, snake(signal.name)), signal.start, signal.length


def _limits(signal: Signal, length: int) -> tuple[int, int]:
    if signal.is_signed:
        return raw_range(signal)
    return 0, 2**length - 1


def raw_range(signal: Signal) -> tuple[int, int]:
    """Least and most, in raw steps."""
    assert signal.minimum is not None and signal.maximum is not None, signal.name
    return round(signal.minimum / signal.scale), round(signal.maximum / signal.scale)


def snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def number_name(name: object) -> str:
    return NUMBERS.get(str(name), snake(str(name)).upper())


def first_sentence(comment: object) -> str:
    return re.split(r"(?<=\.)\s", str(comment))[0]


def data_id(message: Message) -> int:
    """High half of the data ids, which the comment of the frame has."""
    found = re.search(r"Data id: 0x([0-9A-F])0 \+ Counter", str(message.comment))
    assert found, f"{message.name}: no data id in its comment"
    return int(found[1], 16)


class Database:
    """dahl.dbc, and its numbers by name."""

    def __init__(self) -> None:
        loaded = CanDatabase()
        loaded.add_dbc_file(ROOT / "lib" / "node" / "dahl.dbc")
        self.messages = {name: loaded.get_message_by_name(name) for name in FRAMES}
        self.fields = {name: fields_of(message) for name, message in self.messages.items()}
        signals = [one for message in self.messages.values() for one in message.signals]
        self.numbers: dict[str, dict[str, int]] = {name: {} for name in ENUMS}
        for signal in signals:
            if signal.name in ENUMS:
                each = {number_name(text): int(n) for n, text in (signal.choices or {}).items()}
                self.numbers[signal.name] |= each
        status = self.messages["Status"].signals
        errors = [one for one in status if one.name.startswith("Error")]
        first = min(one.start for one in errors)
        self.errors = {number_name(one.name[5:]): one.start - first for one in errors}
        write = self.messages["ParamWrite"]
        self.parameters = {
            number_name(one.name): one for one in write.signals if one.multiplexer_ids
        }
        (self.timeout,) = (one for one in status if one.name == "Timeout")


# --- C --------------------------------------------------------------------------------------------


def declarations(dbc: Database) -> list[str]:
    """The declarations of dahl_frames.h that follow from the DBC."""
    calls = {name: names.call.upper() for name, names in FRAMES.items()}
    messages = dbc.messages.items()
    own_errors = {f"ERROR_{name}": f"1u << {dbc.errors[name]}" for name in OWN_ERRORS}
    return [
        *(f"#define DAHL_FRAMES_ID_{calls[n]} 0x{m.frame_id:X}u" for n, m in messages),
        f"#define DAHL_FRAMES_TIMEOUT_US {round(dbc.timeout.scale * 1000)}u",
        c_enum({f"KIND_{calls[n]}": f"0x{data_id(m):X}" for n, m in messages}),
        *(_c_enum_of(dbc, signal) for signal in ENUMS),
        c_enum(own_errors),
        *(c_structure(name, dbc.fields[name]) for name in FRAMES),
    ]


def missing_in_header() -> list[str]:
    """The declarations that dahl_frames.h lacks, comments and spaces aside."""
    text = (ROOT / "lib" / "include" / "dahl_frames.h").read_text(encoding="utf-8")
    code = _condensed(re.sub(r"/\*.*?\*/", "", text, flags=re.S))
    return [one for one in declarations(Database()) if _condensed(one) not in code]


def _condensed(code: str) -> str:
    return " ".join(code.split())


def _c_enum_of(dbc: Database, signal: str) -> str:
    _, _, prefix, type_name = ENUMS[signal]
    numbers = {f"{prefix}{name}": str(number) for name, number in dbc.numbers[signal].items()}
    return c_enum(numbers, type_name)


def step_text(signal: Signal) -> str:
    """One raw step with its unit: 2^-10 N m/rad, 10 ms, ms."""
    scale = float(signal.scale)
    exponent = round(math.log2(scale))
    step = f"2^{exponent}" if exponent < 0 and math.isclose(scale, 2.0**exponent) else f"{scale:g}"
    return f"{'' if scale == 1 else step} {str(signal.unit or '').replace('.', ' ')}".strip()


def c_enum(numbers: dict[str, str], type_name: str = "") -> str:
    lines = ",\n".join(f"    DAHL_FRAMES_{name} = {number}" for name, number in numbers.items())
    begin, end = ("typedef enum {", f"}} {type_name};") if type_name else ("enum {", "};")
    return f"{begin}\n{lines}\n{end}"


def c_structure(name: str, fields: list[Field]) -> str:
    names = FRAMES[name]
    by_name = {one.name: one for one in fields}
    ordered = (by_name[field] for field in names.c_order or names.fields)
    lines = "\n".join(f"    {one.c_type} {one.name};" for one in ordered)
    return f"typedef struct {{\n{lines}\n}} {names.structure};"


def packing(dbc: Database) -> str:
    return "\n\n".join(_pack(dbc, name) + "\n\n" + _unpack(dbc, name) for name in FRAMES)


def _pack(dbc: Database, name: str) -> str:
    call, structure = FRAMES[name].call, FRAMES[name].structure
    kind, arguments = call.upper(), f"uint8_t node, const {structure} *in"
    return "\n".join(
        [
            f"void dahl_frames_pack_{call}(dahl_can_frame_t *frame, {arguments})",
            "{",
            f"    begin(frame, DAHL_FRAMES_ID_{kind}, node);",
            *_packed_bytes(dbc.fields[name]),
            f"    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_{kind});",
            "}",
        ]
    )


def _packed_bytes(fields: list[Field]) -> list[str]:
    lines = []
    for byte in sorted({one.start // 8 for one in fields}):
        inside = [one for one in fields if one.start // 8 == byte]
        first = inside[0]
        if first.length == 32:
            value = f"in->{first.name}" if first.is_signed else f"(int32_t)in->{first.name}"
            lines.append(f"    put_i32(&frame->data[{byte}], {value});")
        elif first.length == 8:
            lines.append(f"    frame->data[{byte}] = in->{first.name};")
        else:
            low, high = ([_nibble(one) for one in inside if one.start % 8 == at] for at in (0, 4))
            pair = ", ".join((low or ["0"]) + (high or ["0"]))
            lines.append(f"    frame->data[{byte}] = nibbles({pair});")
    return lines


def _nibble(field: Field) -> str:
    value = f"in->{field.name}"
    return {1: f"{value} ? 1u : 0u", 2: f"{value} & 3u", 4: value}[field.length]


def _unpack(dbc: Database, name: str) -> str:
    call, structure = FRAMES[name].call, FRAMES[name].structure
    kind = f"DAHL_FRAMES_KIND_{call.upper()}"
    reads = (f"        out->{one.name} = {_unpacked(one)};" for one in dbc.fields[name])
    return "\n".join(
        [
            f"dahl_frames_check_t dahl_frames_unpack_{call}"
            f"(const dahl_can_frame_t *frame, {structure} *out)",
            "{",
            f"    dahl_frames_check_t result = check_frame(frame, {kind});",
            "    if (result == DAHL_FRAMES_GOOD) {",
            *reads,
            "    }",
            "    return result;",
            "}",
        ]
    )


def _unpacked(field: Field) -> str:
    byte = f"frame->data[{field.start // 8}]"
    if field.length == 32:
        return f"{'' if field.is_signed else '(uint32_t)'}get_i32(&{byte})"
    if field.length == 1:
        return f"({byte} & 0x{1 << field.start % 8:02X}) != 0"
    if field.length == 8:
        return byte
    if field.start % 8 == 0:
        return f"{byte} & 0x0F"
    return f"{byte} >> 4" if field.length == 4 else f"({byte} >> 4) & 3"


# --- Python ---------------------------------------------------------------------------------------

MODULE = '''# SPDX-License-Identifier: MIT
# Written from lib/node/dahl.dbc by tools/generators/frames.py.
"""The frames of a friction node: numbers, units, and a class for each frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, ClassVar

from dahl.can.frame import Frame, ParamFrame, ParamWriteFrame, StatusFrame, TorqueFrame


'''


def module(dbc: Database) -> str:
    numbered = dbc.numbers
    blocks = [
        *(
            _python_enum(ENUMS[name][0], "IntEnum", ENUMS[name][1], numbered[name])
            for name in ENUMS
        ),
        _python_enum(
            "Errors",
            "IntFlag",
            "Sticky bits of Status, kept until a Reset.",
            {name: 1 << bit for name, bit in dbc.errors.items()},
        ),
        f"OFF_AT_0 = ({', '.join(f'Param.{name}' for name in OFF_AT_0)})"
        "  # 0: a move of any length; no Status but after an event\n"
        + "UNITS: dict[int, float] = {  # of one raw step\n"
        + "\n".join(
            f"    Param.{k}: {_unit(one)}"
            for k, one in dbc.parameters.items()
            if k in numbered["Param"]
        )
        + "\n    Param.NONE: 1.0,\n}",
        *(_python_class(dbc, name) for name in FRAMES),
        "KINDS: dict[int, type[Frame]] = {\n    kind.base: kind\n    for kind in ("
        + ", ".join(FRAMES)
        + ")\n}",
    ]
    return MODULE + "\n\n\n".join(blocks) + "\n"


def _unit(signal: Signal) -> str:
    is_ms = signal.unit == "ms"
    value, unit = float(signal.scale) * (1e-3 if is_ms else 1), "s" if is_ms else signal.unit
    comment = f"  # {unit.replace('.', ' ')}" if unit else ""
    return f"{value!r},{comment}"


def _python_enum(name: str, base: str, doc: str, numbers: dict[str, int]) -> str:
    lines = (f"    {key} = {number}" for key, number in numbers.items())
    return "\n".join([f"class {name}({base}):", f'    """{doc}"""', "", *lines])


def _python_class(dbc: Database, name: str) -> str:
    names, message = FRAMES[name], dbc.messages[name]
    by_name = {one.name: one for one in dbc.fields[name]}
    fields = [by_name[field] for field in names.fields]
    defaults = (f" = {default}" if default else "" for default in names.fields.values())
    typed = (
        f"    {one.name}: {_python_type(one)}{default}"
        for one, default in zip(fields, defaults, strict=True)
    )
    opening = f'    """{first_sentence(message.comment)}'
    return "\n".join(
        [
            "@dataclass(frozen=True)",
            f"class {name}({names.base}):",
            *textwrap.wrap(opening, 100, subsequent_indent="    "),
            "",
            *_documented(fields),
            '    """',
            "",
            *typed,
            "",
            *_constants(dbc, name, fields),
        ]
    )


def _documented(fields: list[Field]) -> list[str]:
    width = max(len(one.name) for one in fields) + 2
    indent = " " * (width + 4)
    return [
        line
        for one in fields
        for line in textwrap.wrap(
            f"    {one.name:{width}}{one.unit}{first_sentence(one.comment)}",
            100,
            subsequent_indent=indent,
        )
    ]


def _constants(dbc: Database, name: str, fields: list[Field]) -> list[str]:
    names, message = FRAMES[name], dbc.messages[name]
    lines = [
        f"    base = 0x{message.frame_id:X}",
        f'    _calls, _structure = "{names.call}", "{names.structure}"',
        f"    _kind = 0x{data_id(message):X}",
        "    _limits: ClassVar[dict[str, Any]] = {",
        *(f'        "{one.name}": {_python_limit(one)},' for one in fields),
        "    }",
    ]
    if "param" in names.fields:
        lines.append("    _units, _off_at_0 = UNITS, OFF_AT_0")
    if name == "Status":
        lines.append(f"    _timeout_unit = {dbc.timeout.scale / 1000!r}  # s")
    return lines


def _python_type(field: Field) -> str:
    if field.name == "param":  # any number may be asked for
        return "int"
    return _named(field) or ("bool" if field.length == 1 else "int")


def _named(field: Field) -> str:
    return "Errors" if field.name == "errors" else ENUMS.get(field.signal, ("",))[0]


def _python_limit(field: Field) -> str:
    return _named(field) or ("bool" if field.length == 1 else repr(field.limits))


# --- docs -----------------------------------------------------------------------------------------


def table(dbc: Database) -> str:
    lines = ["| frame | id | sent | purpose | fields |", "|---|---|---|---|---|"]
    for name, message in dbc.messages.items():
        sent = f"every {message.cycle_time} ms" if message.send_type == "Cyclic" else ""
        sent = (
            sent
            or {"OnReception": "on reception", "OnRequest": "on request"}[str(message.send_type)]
        )
        signals = ", ".join(dict.fromkeys(one.name for one in dbc.fields[name]))
        purpose = first_sentence(message.comment)
        lines.append(f"| {name} | 0x{message.frame_id:X} + node | {sent} | {purpose} | {signals} |")
    return "\n".join(lines)


# --- files ----------------------------------------------------------------------------------------


def between_marks(path: Path, text: str) -> str:
    """The file with this text between its marks."""
    whole = path.read_text(encoding="utf-8")
    opened, _, rest = whole.partition(BEGIN)
    old, _, closed = rest.partition(END)
    mark_end, mark_begin = old.partition("\n")[0], old.rpartition("\n")[2]
    return f"{opened}{BEGIN}{mark_end}\n{text}\n{mark_begin}{END}{closed}"


def generated() -> dict[Path, str]:
    """Text of each file that derives from the DBC."""
    dbc = Database()
    parts = {
        ROOT / "lib" / "node" / "frames.c": packing(dbc),
        ROOT / "docs" / "loop.md": table(dbc),
    }
    whole = {path: between_marks(path, text) for path, text in parts.items()}
    return whole | {ROOT / "tools" / "dahl" / "can" / "frames.py": module(dbc)}


if __name__ == "__main__":
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
    for declaration in missing_in_header():
        print(f"dahl_frames.h lacks:\n{declaration}\n")
