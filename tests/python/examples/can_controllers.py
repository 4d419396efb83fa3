# SPDX-License-Identifier: MIT
"""Models of the CAN controllers of examples/can_*, with the example that runs on each of them.

Offsets and bits are those of the manuals, written without the headers of the examples.
"""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import can
from cffi import FFI

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
TWAI_MOCK, ZEPHYR_MOCK = (Path(__file__).with_name(name) for name in ("twai_mock", "zephyr_mock"))
MOCKS = [f"-I{TWAI_MOCK}", f"-I{ZEPHYR_MOCK}"]
STRICT = ["-std=c11", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O1"]
UINT32_MAX = 2**32 - 1
UNTOUCHED = 1 << 31  # a reserved bit that shows if the program has written a register
MAX_INTERRUPTS = 10  # in a row
STANDARD_HEADERS = ("errno.h", "stdbool.h", "stddef.h", "stdint.h")


def defining(*headers: str) -> str:
    """Return C that defines the function pointers that the headers of a mock declare."""
    before, after = (
        "".join(f"#include <{name}>\n" for name in names) for names in (STANDARD_HEADERS, headers)
    )
    return f"{before}#define extern\n{after}#undef extern\n"


def standard(identifier: int, length: int, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=identifier, dlc=length, data=data[:length], is_extended_id=False
    )


def to_words(message: can.Message) -> tuple[int, int]:
    """Return the data of a frame as two registers: the first byte in the lowest bits."""
    data = bytes(message.data).ljust(8, b"\0")
    return int.from_bytes(data[:4], "little"), int.from_bytes(data[4:], "little")


def to_bytes(*words: int) -> bytes:
    return b"".join(word.to_bytes(4, "little") for word in words)


def declarations(header: Path) -> str:
    """Return the declarations of a header for cffi: no preprocessor lines, no inline functions."""
    text = re.sub(r"^#(.*\\\n)*.*$", "", header.read_text(), flags=re.MULTILINE)
    return re.sub(r"^static inline .*?^}", "", text, flags=re.MULTILINE | re.DOTALL)


class Controller:
    """Common to all models: a bus that can be stuck or off, and a clock.

    A model has `settle`, which reacts to what the program has written; `accepts`, whether a frame
    passes the filter; `receive`, which delivers it; `go_off`, if the transmit error counter passes
    255; `recover`, after 128 times 11 recessive bits.
    """

    folder: str
    sources: tuple[str, ...] = ("can_node.c",)
    headers: tuple[Path, ...] = ()  # of the mock
    seams = '#include "can_node.h"\n'  # C between the example and this model
    hooks = ""  # function pointers of the seams
    capacity: int  # answers that wait for a stuck bus
    has_clock = True  # false: the controller does not answer

    def __init__(self, folder: Path, library: Path) -> None:
        self.now_us = 0
        self.is_off = self.is_masked = self.in_main = False
        self.room = math.inf  # frames that the bus still carries
        self.sent: list[can.Message] = []
        self.faults: list[str] = []
        self._kept: list[object] = []  # functions that C calls
        self.ffi = FFI()
        headers = (*self.headers, EXAMPLES / self.folder / "can_node.h")
        self.ffi.cdef(self.hooks + "".join(map(declarations, headers)))
        self.lib = self.ffi.dlopen(str(self.build(folder, library)))

    def build(self, folder: Path, library: Path) -> Path:
        (seams := folder / "seams.c").write_text(self.seams)
        example, made = EXAMPLES / self.folder, folder / "example.so"
        flags = ["-DHOST_REGISTERS", f"-I{example}", *MOCKS, f"-I{ROOT}/lib/include"]
        files = [seams, *(example / name for name in self.sources)]
        words = ["gcc", *STRICT, "-shared", "-fPIC", *flags, *files, library]
        words += [f"-Wl,-rpath,{library.parent}", "-o", made]
        subprocess.run([str(one) for one in words], check=True)
        return made

    def callback(self, kind: object, function: Callable[..., object]) -> object:
        self._kept.append(self.ffi.callback(kind, function))
        return self._kept[-1]

    def connect(self, **functions: Callable[..., object]) -> None:
        """Set function pointers of the seams or of the mock."""
        for name, function in functions.items():
            kind = self.ffi.typeof(getattr(self.lib, name))
            setattr(self.lib, name, self.callback(kind, function))

    def clock(self) -> int:
        self.check_mask("the clock is read")
        return self.now_us & UINT32_MAX

    def mask(self) -> None:
        self.is_masked = True

    def unmask(self) -> None:
        self.is_masked = False

    def check_mask(self, action: str) -> None:
        if self.in_main and not self.is_masked:
            self.faults.append(f"{action} in the main loop while the interrupt is not masked")

    def init(self) -> int:
        return self.lib.can_node_init()

    def tick(self) -> None:
        self.in_main = True
        self.lib.can_node_tick()
        self.in_main = False
        self.settle()

    def take_sent(self) -> list[can.Message]:
        sent, self.sent = self.sent, []
        return sent

    def let_go(self, room: float = math.inf) -> None:
        """Let the bus carry this number of frames more."""
        self.room = room
        self.settle()

    def carries(self) -> bool:
        """Return whether the bus carries one more frame, and count it."""
        is_carried = not self.is_off and self.room > 0
        self.room -= is_carried
        return is_carried

    @property
    def dropped(self) -> int:
        return self.lib.can_dropped


# --- registers in memory --------------------------------------------------------------------------


class InMemory(Controller):
    """A controller of an STM32. Each access of the program first lets the model settle."""

    hooks = """
        extern void *(*access_hook)(void), *(*ram_hook)(void);
        extern uint32_t *(*nvic_hook)(void), (*clock_hook)(void);
        extern void (*mask_hook)(void), (*unmask_hook)(void);
        """
    seams = f"""
        #include "registers.h"
        #include "can_node.h"
        #define extern
        {hooks}
        #undef extern
        uint32_t *nvic_iser0(void) {{ return nvic_hook(); }}
        uint32_t clock_us(void) {{ return clock_hook(); }}
        void mask_interrupts(void) {{ mask_hook(); }}
        void unmask_interrupts(void) {{ unmask_hook(); }}
        """

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.memory, self.nvic = self.ffi.new("uint32_t[256]"), self.ffi.new("uint32_t *")
        self.requests: list[int] = []  # mailboxes in the order of their requests
        self.connect(access_hook=self.access, nvic_hook=lambda: self.nvic, clock_hook=self.clock)
        self.connect(mask_hook=self.mask, unmask_hook=self.unmask)

    def access(self) -> object:
        self.settle()
        return self.memory

    def __getitem__(self, offset: int) -> int:
        return self.memory[offset // 4]

    def __setitem__(self, offset: int, value: int) -> None:
        self.memory[offset // 4] = value

    def written(self, offset: int) -> int | None:
        """Return a new value of a register that was shown with UNTOUCHED."""
        return None if self[offset] & UNTOUCHED else self[offset]

    def is_enabled(self, interrupt: int) -> bool:
        return bool(self.nvic[0] & 1 << interrupt)


class BxCan(InMemory):
    """RM0090, bxCAN: three mailboxes, FIFO 0 with three frames, filter bank 0."""

    folder, capacity = "can_stm32_bxcan", 3
    seams = InMemory.seams + "bxcan_t *can1(void) { return access_hook(); }\n"
    MCR, MSR, TSR, RF0R, IER, ESR, BTR = 0x00, 0x04, 0x08, 0x0C, 0x14, 0x18, 0x1C
    TX, RX, FMR, FM1R, FS1R, FFA1R, FA1R, F0R1, F0R2 = (
        *(0x180, 0x1B0, 0x200, 0x204),
        *(0x20C, 0x214, 0x21C, 0x240, 0x244),
    )
    BUS_HZ = 42e6

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.fifo: list[can.Message] = []
        self.is_error = False
        self[self.MCR], self[self.FMR] = 0x00010002, 0x2A1C0E01  # after reset
        self.show()

    def settle(self) -> None:
        if self.written(self.RF0R) is not None and self[self.RF0R] & 1 << 5 and self.fifo:
            self.fifo.pop(0)
        if self.written(self.MSR) is not None and self[self.MSR] & 1 << 2:
            self.is_error = False
        for number in range(3):
            if self[self.TSR] & 1 << (7 + 8 * number) and number in self.requests:
                self.requests.remove(number)
            elif self[self.TX + 16 * number] & 1 and number not in self.requests:
                self.check_mask("a mailbox is filled")
                self.requests.append(number)
        while self.requests and self.carries():
            number = self.next_request()
            self.requests.remove(number)
            self.sent.append(self.mailbox(number))
        self.show()

    def next_request(self) -> int:
        """The oldest with TXFP; otherwise the lowest identifier, and of equal ones the lowest."""
        by_priority = [(self[self.TX + 16 * number], number) for number in self.requests]
        return self.requests[0] if self[self.MCR] & 1 << 2 else min(by_priority)[1]

    def mailbox(self, number: int) -> can.Message:
        identifier, length, *data = (self[self.TX + 16 * number + 4 * k] for k in range(4))
        if identifier & 0x1FFFFF != 1:
            self.faults.append(f"TIR {identifier:#x} is no standard data frame")
        return standard(identifier >> 21, length & 15, to_bytes(*data))

    def show(self) -> None:
        """Write the registers that the controller owns."""
        is_initial = self[self.MCR] & 1 and self.has_clock
        self[self.MSR] = UNTOUCHED | is_initial | self.is_error << 2
        free = [number for number in range(3) if number not in self.requests]
        for number in free:
            self[self.TX + 16 * number] &= ~1
        self[self.TSR] = sum(1 << (26 + number) for number in free) | (free or [0])[0] << 24
        self[self.RF0R] = UNTOUCHED | len(self.fifo)
        self[self.ESR] = self.is_off << 2
        if self.fifo:
            first = self.fifo[0]
            self[self.RX] = first.arbitration_id << 21 | first.is_remote_frame << 1
            self[self.RX + 4] = 0xABCD0000 | first.dlc  # the upper half is a time
            self[self.RX + 8], self[self.RX + 12] = to_words(first)

    def accepts(self, message: can.Message) -> bool:
        is_on = self[self.FA1R] & 1 and not self[self.FMR] & 1 and not self[self.MCR] & 3
        assert is_on and self[self.FS1R] & 1 and not (self[self.FM1R] | self[self.FFA1R]) & 1
        identifier = message.arbitration_id << (3 if message.is_extended_id else 21)
        identifier |= message.is_extended_id << 2 | message.is_remote_frame << 1
        return (identifier ^ self[self.F0R1]) & self[self.F0R2] == 0

    def receive(self, message: can.Message) -> None:
        self.fifo = [*self.fifo, message][:3]
        self.show()
        for _ in range(MAX_INTERRUPTS):
            if self.fifo and self[self.IER] & 1 << 1 and self.is_enabled(20):
                self.lib.CAN1_RX0_IRQHandler()
                self.settle()

    def go_off(self) -> None:
        self.is_off = self.is_error = True
        self.show()
        if self[self.IER] & 0x8400 == 0x8400 and self.is_enabled(22):
            self.lib.CAN1_SCE_IRQHandler()
        self.settle()
        if self.is_error:
            self.faults.append("the interrupt of the error repeats for ever")

    def recover(self) -> None:
        self.is_off = not self[self.MCR] & 1 << 6  # by itself with ABOM only
        self.settle()

    def bit_timing(self) -> tuple[float, float]:
        """Bit/s and the sample point."""
        value = self[self.BTR]
        before, after = 2 + (value >> 16 & 15), 1 + (value >> 20 & 7)
        rate = self.BUS_HZ / (1 + (value & 1023)) / (before + after)
        return rate, before / (before + after)


class FdCan(InMemory):
    """RM0440, FDCAN: message RAM with fixed places, both FIFOs with three frames."""

    folder, capacity = "can_stm32_fdcan", 3
    seams = InMemory.seams + "fdcan_t *fdcan1(void) { return access_hook(); }\n"
    seams += "fdcan_ram_t *fdcan1_ram(void) { return ram_hook(); }\n"
    CCCR, NBTP, PSR, IR, IE, ILS, ILE, RXGFC = 0x18, 0x1C, 0x44, 0x50, 0x54, 0x58, 0x5C, 0x80
    RXF0S, RXF0A, TXFQS, TXBAR = 0x90, 0x94, 0xC4, 0xCC
    RX, TX, ELEMENT = 0xB0, 0x278, 72  # bytes
    KERNEL_HZ = 170e6

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.ram = self.ffi.new("uint32_t[]", 0x350 // 4)
        self.connect(ram_hook=lambda: self.ram)
        self.get = self.fill = self.put = self.flags = 0
        self.configuration = (0, 0)
        self.was_changing = False
        self[self.CCCR] = 1
        self.show()

    def settle(self) -> None:
        if not self.has_clock:
            self[self.CCCR] = 0
        if (flags := self.written(self.IR)) is not None:
            self.flags &= ~flags
        if (index := self.written(self.RXF0A)) is not None:
            if index != self.get or not self.fill:
                self.faults.append(f"frame {index} is acknowledged, {self.get} is the oldest")
            self.get, self.fill = (self.get + 1) % 3, max(self.fill - 1, 0)
        self.configure()
        for number in range(3):
            if self[self.TXBAR] & 1 << number:
                self.check_mask("the FIFO is filled")
                self.requests.append(number)
                self.put = (self.put + 1) % 3
        while self.requests and not self[self.CCCR] & 1 and self.carries():
            self.sent.append(self.element(self.requests.pop(0)))
        self.show()

    def configure(self) -> None:
        """CCE needs INIT and clears the FIFOs. Only with both may NBTP and RXGFC change."""
        is_changing = self[self.CCCR] & 3 == 3
        if is_changing and not self.was_changing:
            self.requests, self.get, self.fill, self.put = [], 0, 0, 0
        configuration = (self[self.NBTP], self[self.RXGFC])
        if configuration != self.configuration and not is_changing:
            self.faults.append("NBTP or RXGFC is written without CCE")
        self.configuration, self.was_changing = configuration, is_changing

    def element(self, number: int) -> can.Message:
        place = (self.TX + self.ELEMENT * number) // 4
        identifier, length, *data = self.ram[place : place + 4]
        if identifier & ~(0x7FF << 18) or length & ~(15 << 16):
            self.faults.append(f"T0 {identifier:#x}, T1 {length:#x} is no classic data frame")
        return standard(identifier >> 18, length >> 16, to_bytes(*data))

    def show(self) -> None:
        self[self.IR] = UNTOUCHED | self.flags
        self[self.RXF0A] = UNTOUCHED
        self[self.TXBAR] = 0
        self[self.RXF0S] = self.fill | self.get << 8 | (self.get + self.fill) % 3 << 16
        is_full = len(self.requests) == 3
        self[self.TXFQS] = is_full << 21 | self.put << 16 | 3 - len(self.requests)
        self[self.PSR] = self.is_off << 7 | 0x707

    def accepts(self, message: can.Message) -> bool:
        filters = self[self.RXGFC]
        rejects_others = filters >> 4 & 3 == 2 and filters >> 2 & 3 == 2 and not filters >> 24 & 15
        assert filters >> 16 & 31 == 1 and rejects_others and self[self.CCCR] == 0
        rule = self.ram[0]
        assert rule >> 30 == 2 and rule >> 27 & 7 == 1  # identifier and mask, into FIFO 0
        if message.is_extended_id or (message.is_remote_frame and filters & 2):
            return False
        return (message.arbitration_id ^ rule >> 16) & rule & 0x7FF == 0

    def store(self, message: can.Message) -> None:
        place = (self.RX + self.ELEMENT * ((self.get + self.fill) % 3)) // 4
        self.ram[place] = message.arbitration_id << 18
        self.ram[place + 1] = 0x00001234 | message.dlc << 16  # the lower half is a time
        self.ram[place + 2], self.ram[place + 3] = to_words(message)
        self.fill, self.flags = self.fill + 1, self.flags | 1
        self.show()

    def receive(self, message: can.Message) -> None:
        self.store(message)
        self.interrupt()

    def interrupt(self) -> None:
        for _ in range(MAX_INTERRUPTS):
            is_line_0 = self[self.ILE] & 1 and not self[self.ILS] and self.is_enabled(21)
            if not self.flags & self[self.IE] or not is_line_0:
                return
            self.lib.FDCAN1_IT0_IRQHandler()
            self.settle()
        self.faults.append("the interrupt repeats for ever")

    def go_off(self) -> None:
        self.is_off, self.flags = True, self.flags | 1 << 19
        self[self.CCCR] |= 1
        self.show()
        self.interrupt()

    def recover(self) -> None:
        if not self[self.CCCR] & 1:  # the program has left INIT
            self.is_off, self.flags = False, self.flags | 1 << 19
            self.show()
            self.interrupt()
        self.settle()

    def bit_timing(self) -> tuple[float, float]:
        value = self[self.NBTP]
        before, after = 2 + (value >> 8 & 255), 1 + (value & 127)
        rate = self.KERNEL_HZ / (1 + (value >> 16 & 511)) / (before + after)
        return rate, before / (before + after)


# --- MCP2515 --------------------------------------------------------------------------------------


class Mcp2515(Controller):
    """DS20001801: registers behind SPI commands, two receive and three transmit buffers."""

    folder, capacity = "can_mcp2515", 1
    sources = ("can_node.c", "mcp2515.c")
    CANSTAT, CANCTRL, CNF3, CANINTE, CANINTF, EFLG = 0x0E, 0x0F, 0x28, 0x2B, 0x2C, 0x2D
    OSCILLATOR_HZ = 16e6

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.memory = bytearray(128)
        functions = {"transfer": self.transfer, "clock_us": self.clock, "wait_us": lambda _us: None}
        functions |= {"mask": self.mask, "unmask": self.unmask}
        kinds = dict(self.ffi.typeof("can_board_t").fields)
        calls = {name: self.callback(kinds[name].type, call) for name, call in functions.items()}
        self.board = self.ffi.new("can_board_t *", calls)

    def init(self) -> int:
        return self.lib.can_node_init(self.board)

    def transfer(self, data: object, length: int) -> None:
        self.check_mask("SPI is used")
        command = bytes(data[0:length])
        data[0:length] = self.run(command) if self.has_clock else b"\xff" * length

    def run(self, command: bytes) -> bytes:
        """Run one SPI command; return the received bytes."""
        for mask, value, action in (
            (0xFF, 0xC0, self.reset),
            (0xFF, 0x02, self.write_bytes),
            (0xFF, 0x03, self.read_bytes),
            (0xFF, 0x05, self.modify_bits),
            (0xFF, 0xA0, self.read_status),
            (0xF9, 0x40, self.load_transmit),
            (0xF9, 0x90, self.read_received),
            (0xF8, 0x80, self.request),
        ):
            if command[0] & mask == value:
                return (action(command) or b"").ljust(len(command), b"\0")
        self.faults.append(f"{command[0]:#04x} is no command")
        return bytes(len(command))

    def reset(self, _command: bytes) -> None:
        self.memory = bytearray(b"\x55" * 0x28 + bytes(0x58))  # filters are undefined
        self.memory[self.CANSTAT], self.memory[self.CANCTRL] = 0x80, 0x87

    def write_bytes(self, command: bytes) -> None:
        self.write(command[1], command[2:])

    def read_bytes(self, command: bytes) -> bytes:
        return b"\0\0" + self.memory[command[1] : command[1] + len(command) - 2]

    def modify_bits(self, command: bytes) -> None:
        address, mask, value = command[1:]
        self.write(address, bytes([self.memory[address] & ~mask | value & mask]))

    def read_status(self, _command: bytes) -> bytes:
        requests = sum((self.memory[0x30 + 0x10 * n] >> 3 & 1) << (2 + 2 * n) for n in range(3))
        return bytes([0, self.memory[self.CANINTF] & 3 | requests])

    def load_transmit(self, command: bytes) -> None:
        start = 0x31 + 0x10 * (command[0] >> 1 & 3)
        self.memory[start : start + len(command) - 1] = command[1:]

    def read_received(self, command: bytes) -> bytes:
        number = command[0] >> 2 & 1
        self.memory[self.CANINTF] &= ~(1 << number)
        start = 0x61 + 0x10 * number
        return b"\0" + self.memory[start : start + len(command) - 1]

    def request(self, command: bytes) -> None:
        for number in range(3):
            self.memory[0x30 + 0x10 * number] |= (command[0] >> number & 1) << 3
        self.settle()

    def write(self, address: int, values: bytes) -> None:
        for place, value in enumerate(values, address):
            is_setup = place < 0x0C or 0x10 <= place < 0x1C or 0x20 <= place < 0x2B
            if is_setup and self.memory[self.CANSTAT] >> 5 != 4:
                self.faults.append(f"register {place:#04x} is written outside configuration")
            self.memory[place] = value
        self.memory[self.CANSTAT] = self.memory[self.CANCTRL] & 0xE0

    def settle(self) -> None:
        for number in (2, 1, 0):  # of equal priority, the highest number first
            start = 0x30 + 0x10 * number
            if self.memory[start] & 8 and self.carries():
                high, low, _, _, length, *data = self.memory[start + 1 : start + 14]
                if low & 0x1F or length > 8:
                    self.faults.append(f"SIDL {low:#x}, DLC {length:#x} is no standard frame")
                self.sent.append(standard(high << 3 | low >> 5, length, bytes(data)))
                self.memory[start] &= ~8

    def accepts(self, message: can.Message) -> bool:
        assert self.memory[self.CANSTAT] == 0 and self.memory[self.CANINTE] == 0x23
        assert self.memory[0x60] == 4 and self.memory[0x70] == 0
        return any(self.passes(message, buffer) for buffer in (0, 1))

    def passes(self, message: can.Message, buffer: int) -> bool:
        masks = self.memory[0x20 + 4 * buffer :][:4]
        assert not masks[2] | masks[3]  # they would compare data bytes
        mask = masks[0] << 3 | masks[1] >> 5
        rules = [self.memory[k:][:4] for k in ((0, 4), (8, 0x10, 0x14, 0x18))[buffer]]
        return any(
            (message.arbitration_id ^ (rule[0] << 3 | rule[1] >> 5)) & mask == 0
            and bool(rule[1] & 8) == message.is_extended_id
            for rule in rules
        )

    def store(self, message: can.Message) -> None:
        """Into buffer 0, or 1 if that is full."""
        number = self.memory[self.CANINTF] & 1
        start = 0x61 + 0x10 * number
        identifier = message.arbitration_id
        head = [identifier >> 3, (identifier & 7) << 5 | message.is_remote_frame << 4, 0xEE, 0xEE]
        head += [message.dlc, *message.data]
        self.memory[start : start + len(head)] = bytes(head)
        self.memory[self.CANINTF] |= 1 << number

    def receive(self, message: can.Message) -> None:
        self.store(message)
        self.interrupt()

    def interrupt(self) -> None:
        """Pin INT falls once; it must be high at the end."""
        self.lib.can_node_interrupt()
        self.settle()
        if self.memory[self.CANINTF] & self.memory[self.CANINTE]:
            self.faults.append("pin INT stays low and never falls again")

    def go_off(self) -> None:
        self.is_off = True
        self.memory[self.EFLG] |= 0x20
        self.memory[self.CANINTF] |= 0x20
        self.interrupt()

    def recover(self) -> None:
        self.is_off = False
        self.memory[self.EFLG] &= ~0x20
        self.settle()

    def bit_timing(self) -> tuple[float, float]:
        third, second, first = self.memory[self.CNF3 : self.CNF3 + 3]
        assert second & 0x80  # PHSEG2 is that of CNF3
        before = 1 + 1 + (second & 7) + 1 + (second >> 3 & 7)
        after = 1 + (third & 7)
        rate = self.OSCILLATOR_HZ / (2 * (1 + (first & 63))) / (before + after)
        return rate, before / (before + after)


# --- drivers with queues --------------------------------------------------------------------------


class Driver(Controller):
    """Queues of a driver: one task receives, ticks and sends."""

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.queue: list[can.Message] = []  # received, not read
        self.pending: list[can.Message] = []  # sent, and not on the bus

    def tick(self) -> None:
        self.lib.can_node_serve()

    def settle(self) -> None:
        while self.pending and self.carries():
            self.sent.append(self.pending.pop(0))

    def receive(self, message: can.Message) -> None:
        self.queue.append(message)
        self.lib.can_node_serve()


# --- ESP32 ----------------------------------------------------------------------------------------


class Twai(Driver):
    """The driver of ESP-IDF v5: states, queues and alerts."""

    folder, capacity = "can_esp32_twai/main", 5
    OFF, RECOVERED = 0x2000, 0x40  # alerts
    TIMEOUT, INVALID_STATE, NO_MEMORY = 0x107, 0x103, 0x101
    headers = (TWAI_MOCK / "driver/twai.h", TWAI_MOCK / "esp_timer.h")
    seams = defining("driver/twai.h", "esp_timer.h")

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.state, self.alerts, self.wanted = "", 0, 0
        self.connect(esp_timer_get_time=lambda: self.now_us, twai_driver_install=self.install)
        self.connect(twai_start=self.start, twai_initiate_recovery=self.start_recovery)
        self.connect(twai_receive=self.give, twai_transmit=self.transmit)
        self.connect(twai_read_alerts=self.read_alerts)

    def install(self, general, timing, rule) -> int:
        self.wanted, self.rate = general.alerts_enabled, timing.bit_per_s
        self.rule = (rule.acceptance_code, rule.acceptance_mask, rule.single_filter)
        self.state = "stopped" if self.has_clock else ""
        return 0 if self.has_clock else self.NO_MEMORY

    def start(self) -> int:
        if self.state != "stopped":
            return self.INVALID_STATE
        self.state, self.pending, self.queue = "running", [], []
        return 0

    def start_recovery(self) -> int:
        if self.state != "off":
            return self.INVALID_STATE
        self.state, self.pending = "recovering", []
        return 0

    def give(self, out, _ticks: int) -> int:
        if not self.queue:
            return self.TIMEOUT
        first = self.queue.pop(0)
        out.extd, out.rtr, out.data = first.is_extended_id, first.is_remote_frame, list(first.data)
        out.identifier, out.data_length_code = first.arbitration_id, first.dlc
        return 0

    def transmit(self, message, ticks: int) -> int:
        if ticks:
            self.faults.append("the task waits for the transmit queue")
        if self.state != "running":
            return self.INVALID_STATE
        if len(self.pending) == self.capacity:
            return self.TIMEOUT
        if message.extd or message.rtr or message.reserved:
            self.faults.append("the flags are those of no standard data frame")
        length, data = message.data_length_code, bytes(message.data)
        self.pending.append(standard(message.identifier, length, data))
        self.settle()
        return 0

    def read_alerts(self, out, _ticks: int) -> int:
        out[0], self.alerts = self.alerts & self.wanted, 0
        return 0 if out[0] else self.TIMEOUT

    def accepts(self, message: can.Message) -> bool:
        code_, mask, is_single = self.rule
        assert is_single and self.state == "running"
        shift = 3 if message.is_extended_id else 21
        rtr = message.is_remote_frame << (2 if message.is_extended_id else 20)
        return (message.arbitration_id << shift | rtr) & ~mask == code_ & ~mask & UINT32_MAX

    def go_off(self) -> None:
        self.is_off, self.state = True, "off"
        self.alerts |= self.OFF
        self.lib.can_node_serve()

    def recover(self) -> None:
        if self.state == "recovering":
            self.is_off, self.state = False, "stopped"
            self.alerts |= self.RECOVERED
            self.lib.can_node_serve()

    def bit_timing(self) -> tuple[float, float]:
        return self.rate, 0.8  # that of TWAI_TIMING_CONFIG_500KBITS


# --- Zephyr ---------------------------------------------------------------------------------------


class Zephyr(Driver):
    """The CAN API of Zephyr 3.7: a driver that aborts pending frames on bus-off, and recovers."""

    folder, capacity = "zephyr_node/src", 3
    BUS_OFF, BUSY, UNREACHABLE = 3, -11, -101
    headers = (ZEPHYR_MOCK / "zephyr/kernel.h",)
    seams = defining("zephyr/kernel.h")

    def __init__(self, folder: Path, library: Path) -> None:
        super().__init__(folder, library)
        self.is_started = False
        self.rule: tuple[int, int, int] | None = None
        self.connect(device_is_ready=lambda _device: self.has_clock)
        self.connect(k_uptime_ticks=lambda: self.now_us, k_ticks_to_us_floor64=lambda ticks: ticks)
        self.connect(can_set_state_change_callback=self.set_callback, k_msgq_get=self.give)
        self.connect(can_add_rx_filter_msgq=self.add_filter, can_start=self.start)
        self.connect(can_send=self.send)

    def init(self) -> int:
        return -self.lib.can_node_init(self.ffi.NULL)

    def set_callback(self, _device, callback, _data) -> None:
        self.on_state = callback

    def add_filter(self, _device, _queue, rule) -> int:
        self.rule = (rule.id, rule.mask, rule.flags)
        return 0

    def start(self, _device) -> int:
        self.is_started = True
        return 0

    def give(self, _queue, out, _wait: int) -> int:
        if not self.queue:
            return self.BUSY
        first = self.queue.pop(0)
        frame = self.ffi.cast("struct can_frame *", out)
        frame.id, frame.dlc, frame.data = first.arbitration_id, first.dlc, list(first.data)
        frame.flags = first.is_remote_frame << 1
        return 0

    def send(self, _device, frame, wait: int, callback, _data) -> int:
        """Without a callback, Zephyr waits without limit until the frame is on the bus."""
        if wait or not callback or frame.flags:
            self.faults.append("the thread waits, or the frame is no standard data frame")
        if self.is_off:
            return self.UNREACHABLE
        if len(self.pending) == self.capacity:
            return self.BUSY
        self.pending.append(standard(frame.id, frame.dlc, bytes(frame.data)))
        self.settle()
        return 0

    def accepts(self, message: can.Message) -> bool:
        assert self.is_started
        identifier, mask, flags = self.rule
        is_of_kind = message.is_extended_id == bool(flags & 1)
        return is_of_kind and (message.arbitration_id ^ identifier) & mask == 0

    def go_off(self) -> None:
        self.is_off, self.pending = True, []
        self.report(self.BUS_OFF)

    def recover(self) -> None:
        self.is_off = False
        self.report(0)

    def report(self, state: int) -> None:
        self.on_state(self.ffi.NULL, state, {"tx_err_cnt": 255 if state else 0}, self.ffi.NULL)


CONTROLLERS = {one.__name__: one for one in (BxCan, FdCan, Mcp2515, Twai, Zephyr)}
