# SPDX-License-Identifier: MIT
"""Models of the CAN controllers of examples/can_*, with the example that runs on each of them.

Offsets and bits are those of the manuals, written without the headers of the examples.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path

import can
from cffi import FFI
from programs import shared_object

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
TWAI_MOCK, ZEPHYR_MOCK = (Path(__file__).with_name(name) for name in ("twai_mock", "zephyr_mock"))
MOCKS = [f"-I{TWAI_MOCK}", f"-I{ZEPHYR_MOCK}"]
UNTOUCHED = 1 << 31  # a reserved bit that shows if the program has written a register
MAX_INTERRUPTS = 10  # in a row

Rule = tuple[int, int, bool | None, bool | None]  # id, mask, extended, remote (None: both pass)


def standard(identifier: int, length: int, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=identifier, dlc=length, data=data[:length], is_extended_id=False
    )


def to_words(message: can.Message) -> list[int]:
    """Return the data of a frame as two registers: the first byte in the lowest bits."""
    data = bytes(message.data).ljust(8, b"\0")
    return [int.from_bytes(data[k : k + 4], "little") for k in (0, 4)]


def to_bytes(words: list[int]) -> bytes:
    return b"".join(word.to_bytes(4, "little") for word in words)


def declarations(header: Path) -> str:
    """Return the declarations of a header for cffi: no preprocessor lines, no inline functions."""
    text = re.sub(r"^#(.*\\\n)*.*$", "", header.read_text(), flags=re.MULTILINE)
    return re.sub(r"^static inline .*?^}", "", text, flags=re.MULTILINE | re.DOTALL)


class Controller:
    """Common to all models: frames on the bus, and a clock.

    A model has `settle`, which reacts to what the program has written; `rule`, its filter; `store`
    and `interrupt`, which deliver a frame; `go_off`, if the transmit error counter passes 255;
    `recover`, after 128 times 11 recessive bits; `quanta`, of its bit timing.
    """

    folder: str
    sources: tuple[str, ...] = ("can_node.c",)
    capacity = 3  # answers that wait for a stuck bus
    has_clock = True  # false: the controller does not answer
    headers: tuple[Path, ...] = ()  # of the mock
    flags: tuple[str, ...] = ()  # of the compiler
    pointers = seams = ""  # C between the example and this model; its function pointers

    def __init__(self, folder: Path, library: Path) -> None:
        self.now_us = 0
        self.is_off = self.is_masked = self.in_main = False
        self.room = math.inf  # frames that the bus still carries
        self.fifo: list[can.Message] = []  # received, not read
        self.pending: list[tuple[int, can.Message]] = []  # transmit buffers in order of request
        self.sent: list[can.Message] = []
        self.faults: list[str] = []
        self._kept: list[object] = []  # functions that C calls
        self.ffi = FFI()
        headers = (*self.headers, EXAMPLES / self.folder / "can_node.h")
        self.ffi.cdef(self.pointers + "".join(map(declarations, headers)))
        self.lib = self.ffi.dlopen(str(self.compiled(folder, library)))
        self.reset()

    def reset(self) -> None:
        """Set the registers after reset, and the function pointers."""

    def compiled(self, folder: Path, library: Path) -> Path:
        (seams := folder / "seams.c").write_text("#include <stdint.h>\n" + self.seams)
        example = EXAMPLES / self.folder
        flags = ["-DHOST_REGISTERS", *self.flags, f"-I{example}", *MOCKS, f"-I{ROOT}/lib/include"]
        files = [seams, *(example / name for name in self.sources), library]
        shared_object(folder, *flags, *files, f"-Wl,-rpath,{library.parent}")
        return folder / "made.so"

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
        return self.now_us % 2**32

    def mask(self, is_masked: bool = True) -> None:
        self.is_masked = is_masked

    def unmask(self) -> None:
        self.mask(False)

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

    def request(self, buffer: int, message: can.Message) -> None:
        self.check_mask("a transmit buffer is filled")
        if any(buffer == other for other, _ in self.pending):
            self.faults.append(f"transmit buffer {buffer} is filled while it waits")
        self.pending.append((buffer, message))

    def next_pending(self) -> int:
        """Return the place of the frame that is sent first: of the oldest."""
        return 0

    def transmit(self) -> None:
        while self.pending and not self.is_off and self.room > 0:
            self.room -= 1
            self.sent.append(self.pending.pop(self.next_pending())[1])

    def let_go(self, room: float = math.inf) -> None:
        """Let the bus carry this number of frames more."""
        self.room = room
        self.settle()

    def take_sent(self) -> list[can.Message]:
        sent, self.sent = self.sent, []
        return sent

    def accepts(self, message: can.Message) -> bool:
        """Return whether the filter passes a frame. Identifiers are compared by 29 bits."""
        identifier, mask, *kinds = self.rule()
        aligned = message.arbitration_id << (0 if message.is_extended_id else 18)
        is_kind = (message.is_extended_id, message.is_remote_frame)
        pairs = zip(kinds, is_kind, strict=True)
        return not (aligned ^ identifier) & mask and all(one in (None, is_) for one, is_ in pairs)

    def receive(self, message: can.Message) -> None:
        self.store(message)
        self.interrupt()

    def store(self, message: can.Message) -> None:
        self.fifo.append(message)
        self.settle()

    def bit_timing(self) -> tuple[float, float]:
        """Bit/s and the sample point."""
        quanta_hz, before, after = self.quanta()
        return quanta_hz / (before + after), before / (before + after)

    @property
    def dropped(self) -> int:
        return self.lib.can_dropped


# --- registers in memory --------------------------------------------------------------------------


def registers(*offsets: int, memory: str = "memory") -> list[property]:
    def register(place: int) -> property:
        return property(
            lambda one: getattr(one, memory)[place],
            lambda one, value: getattr(one, memory).__setitem__(place, value),
        )

    return [register(offset // 4) for offset in offsets]


def connected(**functions: str) -> tuple[str, str]:
    """Return C of functions that call pointers, and the declarations of the pointers."""
    kinds = {f"{kind} (*call_{name})(void);\n": name for name, kind in functions.items()}
    bodies = (
        f"{kind} {name}(void) {{ {'' if kind == 'void' else 'return '}call_{name}(); }}\n"
        for name, kind in functions.items()
    )
    return "".join([*kinds, *bodies]), "".join(f"extern {kind}" for kind in kinds)


COMMON = {"nvic_iser0": "uint32_t *", "clock_us": "uint32_t"}
COMMON |= dict.fromkeys(("mask_interrupts", "unmask_interrupts"), "void")


class InMemory(Controller):
    """A controller of an STM32. Each access of the program first lets the model settle."""

    lines: dict[int, str]  # handlers by the number of their interrupt

    def reset(self) -> None:
        self.memory, self.nvic = self.ffi.new("uint32_t[256]"), self.ffi.new("uint32_t[3]")
        self.ram = self.ffi.new("uint32_t[]", 0x350 // 4)
        self.connect(call_clock_us=self.clock, call_nvic_iser0=lambda: self.nvic)
        self.connect(call_mask_interrupts=self.mask, call_unmask_interrupts=self.unmask)

    def access(self) -> object:
        self.settle()
        return self.memory

    def settle(self) -> None:
        self.obey()
        self.transmit()
        self.show()

    def interrupt(self) -> None:
        """Run the handlers of the enabled interrupts until nothing requests one."""
        for _ in range(MAX_INTERRUPTS):
            calls = {n: name for n, name in self.lines.items() if self.is_due(n)}
            if not any(self.nvic[number // 32] >> number % 32 & 1 for number in calls):
                return
            for name in calls.values():
                getattr(self.lib, name)()
                self.settle()
        self.faults.append("the interrupt repeats for ever")


class BxCan(InMemory):
    """RM0090, bxCAN: three mailboxes, FIFO 0 with three frames, one filter bank."""

    folder, lines = "can_stm32_bxcan", {20: "CAN1_RX0_IRQHandler", 22: "CAN1_SCE_IRQHandler"}
    clock_hz, bank = 42e6, 0
    seams, pointers = connected(can1="void *", can2="void *", **COMMON)
    MCR, MSR, TSR, RF0R = registers(0x00, 0x04, 0x08, 0x0C)
    IER, ESR, BTR = registers(0x14, 0x18, 0x1C)
    FILTERS = FMR, FM1R, FS1R, FFA1R, FA1R = registers(
        *(0x200, 0x204, 0x20C, 0x214, 0x21C), memory="filters"
    )
    BANKS = 0x240 // 4  # of two words
    TX, RX = 0x180 // 4, 0x1B0 // 4  # mailboxes of four words

    def reset(self) -> None:
        super().reset()
        self.filters = self.memory  # those of CAN1
        self.connect(call_can1=self.access, call_can2=self.access_second)
        self.MCR, self.FMR, self.is_error = 0x00010002, 0x2A1C0E01, False
        self.locked = self.filter_words()
        self.show()

    def access_second(self) -> object:
        self.faults.append("CAN2 is used")
        return self.memory

    def filter_words(self) -> list[int]:
        """Return FM1R, FS1R, FFA1R and the banks, which are locked at times."""
        return [self.FM1R, self.FS1R, self.FFA1R, *self.filters[self.BANKS : self.BANKS + 56]]

    def lock_filters(self) -> None:
        """Note a write without FINIT, or to an active bank: it may be ignored."""
        for place, (before, now) in enumerate(zip(self.locked, self.filter_words(), strict=True)):
            is_active = place >= 3 and self.FA1R >> (place - 3) // 2 & 1
            if before != now and (is_active or not self.FMR & 1):
                self.faults.append(f"filter word {place} is written while it is locked")
        self.locked = self.filter_words()

    def obey(self) -> None:
        self.lock_filters()
        if not self.RF0R & UNTOUCHED and self.RF0R & 1 << 5:
            self.fifo = self.fifo[1:]
        if not self.MSR & UNTOUCHED and self.MSR & 1 << 2:
            self.is_error = False
        waiting = {buffer for buffer, _ in self.pending}
        for buffer in range(3):
            identifier, length, *data = self.memory[self.TX + 4 * buffer : self.TX + 4 * buffer + 4]
            if self.TSR & 1 << (7 + 8 * buffer):
                self.pending = [one for one in self.pending if one[0] != buffer]
            elif identifier & 1 and buffer not in waiting:
                if identifier & 0x1FFFFF != 1:
                    self.faults.append(f"TIR {identifier:#x} is no standard data frame")
                self.request(buffer, standard(identifier >> 21, length & 15, to_bytes(data)))

    def next_pending(self) -> int:
        """Return the oldest with TXFP; otherwise the lowest identifier, then the lowest number."""
        ranks = [(message.arbitration_id, buffer) for buffer, message in self.pending]
        return 0 if self.MCR & 1 << 2 else ranks.index(min(ranks))

    def show(self) -> None:
        """Write the registers that the controller owns."""
        self.MSR = UNTOUCHED | (self.MCR & 1 and self.has_clock) | self.is_error << 2
        free = sorted({0, 1, 2} - {buffer for buffer, _ in self.pending})
        for buffer in free:
            self.memory[self.TX + 4 * buffer] &= ~1
        self.TSR = sum(1 << (26 + buffer) for buffer in free) | (free or [0])[0] << 24
        self.RF0R = UNTOUCHED | len(self.fifo)
        self.ESR = self.is_off << 2
        for first in self.fifo[:1]:
            identifier = first.arbitration_id << 21 | first.is_remote_frame << 1
            length = 0xABCD0000 | first.dlc  # the upper half is a time
            self.memory[self.RX : self.RX + 4] = [identifier, length, *to_words(first)]

    def rule(self) -> Rule:
        is_on = self.FA1R >> self.bank & 1 and not self.FMR & 1 and not self.MCR & 3
        assert is_on and self.FS1R >> self.bank & 1
        assert not (self.FM1R | self.FFA1R) >> self.bank & 1
        first, second = self.filters[self.BANKS + 2 * self.bank : self.BANKS + 2 * self.bank + 2]
        kinds = [bool(first & bit) if second & bit else None for bit in (4, 2)]
        return first >> 3, second >> 3, *kinds

    def is_due(self, interrupt: int) -> bool:
        if interrupt == min(self.lines):
            return bool(self.fifo and self.IER & 1 << 1)
        return self.is_error and self.IER & 0x8400 == 0x8400

    def go_off(self) -> None:
        self.is_off = self.is_error = True
        self.show()
        self.interrupt()

    def recover(self) -> None:
        self.is_off = not self.MCR & 1 << 6  # by itself with ABOM only
        self.settle()

    def quanta(self) -> tuple[float, int, int]:
        quantum_hz = self.clock_hz / (1 + (self.BTR & 1023))
        return quantum_hz, 2 + (self.BTR >> 16 & 15), 1 + (self.BTR >> 20 & 7)


class BxCan2(BxCan):
    """CAN2 of an STM32F1 after a warm start: CAN1 has the filters, and works with banks 0 and 5."""

    flags = ("-DCAN_NODE_UNIT=2", "-DAPB1_MHZ=36")
    clock_hz, bank = 36e6, 14
    lines = {64: "CAN2_RX0_IRQHandler", 66: "CAN2_SCE_IRQHandler"}

    def reset(self) -> None:
        super().reset()
        self.filters = self.ffi.new("uint32_t[256]")
        self.connect(call_can1=self.access_filters, call_can2=self.access)
        self.FMR, self.FA1R = 0x2A1C0E00, 1 << 0 | 1 << 5 | 1 << 14
        self.FM1R, self.FS1R, self.FFA1R = 0x4001, 0x21, 0x4020
        for place in range(56):
            self.filters[self.BANKS + place] = 0x1000 + place
        self.locked = self.filter_words()
        self.of_others = self.others()

    def access_filters(self) -> object:
        self.settle()
        return self.filters

    def others(self) -> list[int]:
        """Return all that belongs to other banks, and the place of the first bank of CAN2."""
        masks = [self.FM1R, self.FS1R, self.FFA1R, self.FA1R]
        banks = list(self.filters[self.BANKS : self.BANKS + 56])
        del banks[28:30]
        return [self.FMR, *(one & ~(1 << 14) for one in masks), *banks]

    def rule(self) -> Rule:
        assert self.others() == self.of_others
        return super().rule()


class FdCan(InMemory):
    """RM0440, FDCAN: message RAM with fixed places, both FIFOs with three frames."""

    folder, lines = "can_stm32_fdcan", {21: "FDCAN1_IT0_IRQHandler"}
    seams, pointers = connected(fdcan1="void *", fdcan1_ram="void *", **COMMON)
    CCCR, NBTP, PSR, IR, IE, ILS = registers(0x18, 0x1C, 0x44, 0x50, 0x54, 0x58)
    ILE, RXGFC, RXF0S, RXF0A, TXFQS, TXBAR = registers(0x5C, 0x80, 0x90, 0x94, 0xC4, 0xCC)
    RX, TX, ELEMENT = 0xB0 // 4, 0x278 // 4, 72 // 4  # words of the RAM

    def reset(self) -> None:
        super().reset()
        self.connect(call_fdcan1=self.access, call_fdcan1_ram=lambda: self.ram)
        self.get = self.put = self.flags = 0
        self.configuration, self.was_changing = (0, 0), False
        self.CCCR = 1
        self.show()

    def obey(self) -> None:
        self.CCCR = self.CCCR if self.has_clock else 0
        if not self.IR & UNTOUCHED:
            self.flags &= ~self.IR
        if not self.RXF0A & UNTOUCHED:
            if self.RXF0A != self.get or not self.fifo:
                self.faults.append(f"frame {self.RXF0A} is acknowledged, {self.get} is the oldest")
            self.get, self.fifo = (self.get + 1) % 3, self.fifo[1:]
        self.configure()
        for buffer in range(3):
            if self.TXBAR & 1 << buffer:
                self.put = (self.put + 1) % 3
                self.request(buffer, self.element(self.TX + self.ELEMENT * buffer))

    def configure(self) -> None:
        """CCE needs INIT and clears the FIFOs. Only with both may NBTP and RXGFC change."""
        is_changing = self.CCCR & 3 == 3
        if is_changing and not self.was_changing:
            self.pending, self.fifo, self.get, self.put = [], [], 0, 0
        if (self.NBTP, self.RXGFC) != self.configuration and not is_changing:
            self.faults.append("NBTP or RXGFC is written without CCE")
        self.configuration, self.was_changing = (self.NBTP, self.RXGFC), is_changing

    def element(self, place: int) -> can.Message:
        identifier, length, *data = self.ram[place : place + 4]
        if identifier & ~(0x7FF << 18) or length & ~(15 << 16):
            self.faults.append(f"T0 {identifier:#x}, T1 {length:#x} is no classic data frame")
        return standard(identifier >> 18, length >> 16, to_bytes(data))

    def transmit(self) -> None:
        if not self.CCCR & 1:
            super().transmit()

    def show(self) -> None:
        self.IR, self.RXF0A, self.TXBAR = UNTOUCHED | self.flags, UNTOUCHED, 0
        self.RXF0S = len(self.fifo) | self.get << 8 | (self.get + len(self.fifo)) % 3 << 16
        free = 3 - len(self.pending)
        self.TXFQS = (free == 0) << 21 | self.put << 16 | free
        self.PSR = self.is_off << 7 | 0x707

    def rule(self) -> Rule:
        rejects_others = self.RXGFC >> 4 & 3 == self.RXGFC >> 2 & 3 == 2
        assert rejects_others and self.RXGFC >> 16 == 1 and self.CCCR == 0
        rule = self.ram[0]
        assert rule >> 27 == 0b10001  # identifier and mask, into FIFO 0
        return (rule >> 16 & 0x7FF) << 18, (rule & 0x7FF) << 18, False, not self.RXGFC & 2 and None

    def store(self, message: can.Message) -> None:
        place = self.RX + self.ELEMENT * ((self.get + len(self.fifo)) % 3)
        length = 0x00001234 | message.dlc << 16  # the lower half is a time
        self.ram[place : place + 4] = [message.arbitration_id << 18, length, *to_words(message)]
        self.flags |= 1
        super().store(message)

    def is_due(self, _interrupt: int) -> bool:
        return bool(self.flags & self.IE and self.ILE & 1 and not self.ILS)

    def go_off(self) -> None:
        self.is_off, self.flags = True, self.flags | 1 << 19
        self.CCCR |= 1
        self.show()
        self.interrupt()

    def recover(self) -> None:
        if not self.CCCR & 1:  # the program has left INIT
            self.is_off, self.flags = False, self.flags | 1 << 19
            self.show()
            self.interrupt()
        self.settle()

    def quanta(self) -> tuple[float, int, int]:
        quanta_hz = 170e6 / (1 + (self.NBTP >> 16 & 511))
        return quanta_hz, 2 + (self.NBTP >> 8 & 255), 1 + (self.NBTP & 127)


# --- MCP2515 --------------------------------------------------------------------------------------


class Mcp2515(Controller):
    """DS20001801: registers behind SPI commands, two receive and three transmit buffers."""

    folder, capacity = "can_mcp2515", 1
    sources = ("can_node.c", "mcp2515.c")
    CANSTAT, CANCTRL, CNF3, CANINTE, CANINTF, EFLG = 0x0E, 0x0F, 0x28, 0x2B, 0x2C, 0x2D

    def reset(self) -> None:
        functions = {"transfer": self.transfer, "clock_us": self.clock, "wait_us": lambda _us: None}
        functions |= {"mask": self.mask, "unmask": self.unmask}
        kinds = dict(self.ffi.typeof("can_board_t").fields)
        calls = {name: self.callback(kinds[name].type, call) for name, call in functions.items()}
        self.board = self.ffi.new("can_board_t *", calls)
        self.memory = bytearray(128)

    def init(self) -> int:
        return self.lib.can_node_init(self.board)

    def transfer(self, data: object, length: int) -> None:
        self.check_mask("SPI is used")
        command = bytes(data[0:length])
        data[0:length] = self.run(command) if self.has_clock else b"\xff" * length

    def run(self, command: bytes) -> bytes:
        """Run one SPI command; return the received bytes."""
        for mask, value, action in (
            (0xFF, 0xC0, self.reset_registers),
            (0xFF, 0x02, self.write_bytes),
            (0xFF, 0x03, self.read_bytes),
            (0xFF, 0x05, self.modify_bits),
            (0xFF, 0xA0, self.read_status),
            (0xF9, 0x40, self.load_transmit),
            (0xF9, 0x90, self.read_received),
            (0xF8, 0x80, self.request_to_send),
        ):
            if command[0] & mask == value:
                return (action(command) or b"").ljust(len(command), b"\0")
        self.faults.append(f"{command[0]:#04x} is no command")
        return bytes(len(command))

    def reset_registers(self, _command: bytes) -> None:
        self.memory = bytearray(b"\x55" * 0x28 + bytes(0x58))  # filters are undefined
        self.memory[self.CANSTAT], self.memory[self.CANCTRL] = 0x80, 0x87

    def write_bytes(self, command: bytes) -> None:
        for place, value in enumerate(command[2:], command[1]):
            is_setup = place < 0x0C or 0x10 <= place < 0x1C or 0x20 <= place < 0x2B
            if is_setup and self.memory[self.CANSTAT] >> 5 != 4:
                self.faults.append(f"register {place:#04x} is written outside configuration")
            self.memory[place] = value
        self.memory[self.CANSTAT] = self.memory[self.CANCTRL] & 0xE0
        self.pending = [one for one in self.pending if self.memory[0x30 + 0x10 * one[0]] & 8]

    def read_bytes(self, command: bytes) -> bytes:
        return b"\0\0" + self.memory[command[1] : command[1] + len(command) - 2]

    def modify_bits(self, command: bytes) -> None:
        _, address, mask, value = command
        changed = self.memory[address] & ~mask | value & mask
        self.write_bytes(bytes([0, address, changed]))

    def read_status(self, _command: bytes) -> bytes:
        requests = sum(1 << (2 + 2 * buffer) for buffer, _ in self.pending)
        return bytes([0, self.memory[self.CANINTF] & 3 | requests])

    def load_transmit(self, command: bytes) -> None:
        start = 0x31 + 0x10 * (command[0] >> 1 & 3)
        self.memory[start : start + len(command) - 1] = command[1:]

    def read_received(self, command: bytes) -> bytes:
        number = command[0] >> 2 & 1
        self.memory[self.CANINTF] &= ~(1 << number)
        return b"\0" + self.memory[0x61 + 0x10 * number :][: len(command) - 1]

    def request_to_send(self, command: bytes) -> None:
        for buffer in (n for n in range(3) if command[0] >> n & 1):
            start = 0x30 + 0x10 * buffer
            high, low, _, _, length, *data = self.memory[start + 1 : start + 14]
            if low & 0x1F or length > 8:
                self.faults.append(f"SIDL {low:#x}, DLC {length:#x} is no standard frame")
            self.memory[start] |= 8
            self.request(buffer, standard(high << 3 | low >> 5, length, bytes(data)))
        self.settle()

    def next_pending(self) -> int:
        """Return the highest buffer, which is first among equal priorities."""
        buffers = [buffer for buffer, _ in self.pending]
        return buffers.index(max(buffers))

    def settle(self) -> None:
        self.transmit()
        for buffer in {0, 1, 2} - {buffer for buffer, _ in self.pending}:
            self.memory[0x30 + 0x10 * buffer] &= ~8

    def rule(self) -> Rule:
        """All filters and both masks are equal, and compare no data bytes."""
        assert self.memory[self.CANSTAT] == 0 and self.memory[self.CANINTE] == 0x23
        assert self.memory[0x60] == 4 and self.memory[0x70] == 0
        places = ((0x20, 0x24), (0, 4, 8, 0x10, 0x14, 0x18))
        (mask,), (value,) = ({bytes(self.memory[k : k + 4]) for k in some} for some in places)
        assert not any((*mask[2:], *value[2:]))
        identifier, bits = (one[0] << 21 | one[1] >> 5 << 18 for one in (value, mask))
        return identifier, bits, bool(value[1] & 8), None

    def store(self, message: can.Message) -> None:
        """Into buffer 0, or 1 if that is full."""
        number = self.memory[self.CANINTF] & 1
        high, low = divmod(message.arbitration_id << 5 | message.is_remote_frame << 4, 256)
        stored = bytes([high, low, 0xEE, 0xEE, message.dlc, *message.data])
        start = 0x61 + 0x10 * number
        self.memory[start : start + len(stored)] = stored
        self.memory[self.CANINTF] |= 1 << number

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

    def quanta(self) -> tuple[float, int, int]:
        third, second, first = self.memory[self.CNF3 : self.CNF3 + 3]
        assert second & 0x80  # PHSEG2 is that of CNF3
        before = 1 + 1 + (second & 7) + 1 + (second >> 3 & 7)
        return 16e6 / (2 * (1 + (first & 63))), before, 1 + (third & 7)


# --- drivers with queues --------------------------------------------------------------------------


class Driver(Controller):
    """Queues of a driver: one task receives, ticks and sends."""

    off_code: int  # of a frame that is sent while the bus is off
    full_code: int  # of a full transmit queue, and of an empty receive queue

    def interrupt(self) -> None:
        self.lib.can_node_serve()

    def tick(self) -> None:
        self.lib.can_node_serve()

    def settle(self) -> None:
        self.transmit()

    def send(self, identifier: int, length: int, data: object, is_wrong: bool) -> int:
        """Queue a frame. `is_wrong`: the task waits, or the flags are of no standard data frame."""
        if is_wrong:
            self.faults.append("the task waits, or the frame is no standard data frame")
        if self.is_off:
            return self.off_code
        if len(self.pending) == self.capacity:
            return self.full_code
        self.pending.append((0, standard(identifier, length, bytes(data))))
        self.settle()
        return 0


def defining(*headers: str) -> str:
    """Return C that defines the function pointers that the headers of a mock declare."""
    of_c = "".join(f"#include <{name}.h>\n" for name in ("errno", "stdbool", "stddef"))
    of_mock = "".join(f"#include <{name}>\n" for name in headers)
    return f"{of_c}#define extern\n{of_mock}#undef extern\n"


class Twai(Driver):
    """The driver of ESP-IDF 5.0 to 5.4: states, queues and alerts."""

    folder, capacity = "can_esp32_twai/main", 5
    sources = ("can_node.c", "bus_5_0.c", "bus_5_5.c")
    off_code, full_code = 0x103, 0x107  # ESP_ERR_INVALID_STATE, ESP_ERR_TIMEOUT
    headers = (TWAI_MOCK / "driver/twai.h", TWAI_MOCK / "esp_timer.h")
    seams = defining("driver/twai.h", "esp_timer.h")

    def reset(self) -> None:
        self.state, self.alerts = "", 0
        self.connect(esp_timer_get_time=lambda: self.now_us, twai_driver_install=self.install)
        self.connect(twai_start=lambda: self.change("stopped", "running"))
        self.connect(twai_initiate_recovery=lambda: self.change("off", "recovering"))
        self.connect(twai_receive=self.give, twai_read_alerts=self.read_alerts)
        self.connect(twai_transmit=self.send_message)

    def install(self, general, timing, rule) -> int:
        self.wanted, self.rate = general.alerts_enabled, timing.bit_per_s
        assert rule.single_filter
        self.filter = rule.acceptance_code, ~rule.acceptance_mask
        self.state = "stopped" if self.has_clock else ""
        return 0 if self.has_clock else 0x101  # ESP_ERR_NO_MEM

    def change(self, before: str, after: str) -> int:
        """Change the state, and drop the frames that wait. Only a running driver sends."""
        if self.state != before:
            return self.off_code
        self.state, self.pending, self.is_off = after, [], after != "running"
        return 0

    def give(self, out, _ticks: int) -> int:
        if not self.fifo:
            return self.full_code
        first = self.fifo.pop(0)
        out.extd, out.rtr, out.data = first.is_extended_id, first.is_remote_frame, list(first.data)
        out.identifier, out.data_length_code = first.arbitration_id, first.dlc
        return 0

    def send_message(self, message, ticks: int) -> int:
        is_wrong = bool(ticks or message.extd or message.rtr or message.reserved)
        return self.send(message.identifier, message.data_length_code, message.data, is_wrong)

    def read_alerts(self, out, _ticks: int) -> int:
        out[0], self.alerts = self.alerts & self.wanted, 0
        return 0 if out[0] else self.full_code

    def rule(self) -> Rule:
        assert self.state == "running"
        code, mask = self.filter
        return code >> 3, mask >> 3, None, bool(code >> 20 & 1) if mask >> 20 & 1 else None

    def go_off(self) -> None:
        self.is_off, self.state, self.alerts = True, "off", self.alerts | 0x2000
        self.lib.can_node_serve()

    def recover(self) -> None:
        if self.state == "recovering":
            self.state, self.alerts = "stopped", self.alerts | 0x40
            self.lib.can_node_serve()

    def quanta(self) -> tuple[float, int, int]:
        return self.rate * 20, 16, 4  # sampled where TWAI_TIMING_CONFIG_500KBITS samples


class Twai60(Driver):
    """The driver of ESP-IDF 5.5 to 6.1: events in interrupts; frames by pointers until sent.

    `pending` are the frames of the controller (one) and of the queue of the driver, which survives
    a bus-off.
    """

    folder, capacity = "can_esp32_twai/main", 6  # a queue of five, and the controller
    sources, flags = Twai.sources, ("-DMOCK_IDF_6_0",)
    names = ("esp_twai.h", "freertos/FreeRTOS.h", "esp_timer.h")
    headers, seams = tuple(TWAI_MOCK / name for name in names), defining(*names)
    off_code, full_code = 0x103, 0x107  # ESP_ERR_INVALID_STATE, ESP_ERR_TIMEOUT

    def reset(self) -> None:
        self.queue: list[bytes] = []
        self.size = self.notified = 0
        self.state, self.is_received = "", False
        self.connect(esp_timer_get_time=lambda: self.now_us, xQueueCreate=self.create_queue)
        self.connect(xTaskGetCurrentTaskHandle=lambda: self.ffi.cast("void *", 2))
        self.connect(xQueueSendFromISR=self.put, xQueueReceive=self.get)
        self.connect(vTaskNotifyGiveFromISR=self.notify, ulTaskNotifyTake=self.take_notification)
        self.connect(twai_new_node_onchip=self.install, twai_node_enable=self.enable)
        self.connect(twai_node_register_event_callbacks=self.set_events)
        self.connect(twai_node_config_mask_filter=self.set_filter)
        self.connect(twai_node_transmit=self.send_pointer, twai_node_recover=self.start_recovery)
        self.connect(twai_node_receive_from_isr=self.give)

    def create_queue(self, places: int, size: int) -> object:
        self.places, self.size = places, size
        return self.ffi.cast("void *", 1)

    def put(self, _queue, item, _woken) -> int:
        if len(self.queue) == self.places:
            return 0
        self.queue.append(bytes(self.ffi.buffer(item, self.size)))
        return 1

    def get(self, _queue, out, wait: int) -> int:
        if wait or not self.queue:
            return 0
        self.ffi.memmove(out, self.queue.pop(0), self.size)
        return 1

    def notify(self, _task, _woken) -> None:
        self.notified += 1

    def take_notification(self, is_clearing: int, _ticks: int) -> int:
        before = self.notified
        self.notified = 0 if is_clearing else max(0, before - 1)
        return before

    def install(self, config, node) -> int:
        pins = config.io_cfg
        assert pins.quanta_clk_out == pins.bus_off_indicator == -1 and config.fail_retry_cnt == -1
        timing, self.depth = config.bit_timing, config.tx_queue_depth
        self.timing = timing.bitrate, timing.sp_permill
        self.state = "stopped" if self.has_clock else ""
        return 0 if self.has_clock else 0x101  # ESP_ERR_NO_MEM

    def set_events(self, _node, callbacks, _data) -> int:
        self.events = self.ffi.new("twai_event_callbacks_t *", callbacks[0])
        return 0 if self.state == "stopped" else self.off_code

    def set_filter(self, _node, number: int, rule) -> int:
        assert number == 0 and rule.no_fd and not rule.no_classic | rule.dual_filter
        self.filter = rule.id << 18, rule.mask << 18, bool(rule.is_ext), None
        return 0 if self.state == "stopped" else self.off_code

    def enable(self, _node) -> int:
        self.state = "running"
        return 0

    def send_pointer(self, _node, frame, wait: int) -> int:
        if self.is_off:
            return self.off_code
        if len(self.pending) > self.depth:
            return self.full_code
        if wait:
            self.faults.append("the task waits")
        self.pending.append((0, frame))
        return 0

    def give(self, _node, out) -> int:
        if not self.is_received:
            return self.off_code
        first = self.fifo.pop(0)
        out.header.id, out.header.dlc = first.arbitration_id, first.dlc
        out.header.ide, out.header.rtr = first.is_extended_id, first.is_remote_frame
        self.ffi.memmove(out.buffer, bytes(first.data), min(len(first.data), out.buffer_len))
        return 0

    def interrupt(self) -> None:
        while self.fifo:
            self.is_received = True
            self.events.on_rx_done(self.ffi.NULL, self.ffi.NULL, self.ffi.NULL)
            self.is_received = False
        self.run()

    def settle(self) -> None:
        """Nothing: the driver acts between the turns of the task."""

    def let_go(self, room: float = math.inf) -> None:
        self.room = room
        self.run()

    def tick(self) -> None:
        self.lib.can_node_serve()
        self.run()

    def run(self) -> None:
        """Let the bus carry frames, and the task run as often as it is woken."""
        self.transmit()
        while self.notified:
            self.lib.can_node_serve()
            self.transmit()

    def transmit(self) -> None:
        """Read the frame of the controller now, not when it was given to the driver."""
        if self.pending and not self.is_off and self.room > 0:
            self.room -= 1
            _, frame = self.pending.pop(0)
            header, data = frame.header, bytes(self.ffi.buffer(frame.buffer, frame.buffer_len))
            if header.ide or header.rtr or header.fdf or header.dlc != len(data):
                self.faults.append("the frame is no standard data frame")
            self.sent.append(standard(header.id, header.dlc, data))
            event = self.ffi.new("twai_tx_done_event_data_t *", {"is_tx_success": True})
            self.events.on_tx_done(self.ffi.NULL, event, self.ffi.NULL)

    def rule(self) -> Rule:
        assert self.state == "running"
        return self.filter

    def report(self, old: str, new: str) -> None:
        states = [getattr(self.lib, f"TWAI_ERROR_{state}") for state in (old, new)]
        event = self.ffi.new("twai_state_change_event_data_t *", states)
        self.events.on_state_change(self.ffi.NULL, event, self.ffi.NULL)

    def go_off(self) -> None:
        """The controller drops its frame; the driver keeps its queue."""
        self.is_off, self.pending = True, self.pending[1:]
        self.report("PASSIVE", "BUS_OFF")
        self.lib.can_node_serve()

    def start_recovery(self, _node) -> int:
        self.state = "recovering"
        return 0

    def recover(self) -> None:
        if self.state == "recovering":
            self.is_off, self.state = False, "running"
            self.report("BUS_OFF", "ACTIVE")
            self.run()

    def quanta(self) -> tuple[float, int, int]:
        rate, sample_point = self.timing
        return rate * 20, sample_point // 50, 20 - sample_point // 50


class Zephyr(Driver):
    """The CAN API of Zephyr 3.7: a driver that aborts pending frames on bus-off, and recovers."""

    folder = "zephyr_node/src"
    off_code, full_code = -101, -11  # -ENETUNREACH, -EAGAIN
    headers = tuple(ZEPHYR_MOCK / f"zephyr/{name}.h" for name in ("kernel", "can_state_3_7"))
    seams = defining("zephyr/kernel.h")

    def reset(self) -> None:
        self.filter: Rule | None = None
        self.is_started = False
        self.watch_state()
        self.connect(device_is_ready=lambda _device: self.has_clock)
        self.connect(k_uptime_ticks=lambda: self.now_us, k_ticks_to_us_floor64=lambda ticks: ticks)
        self.connect(k_msgq_get=self.give)
        self.connect(can_add_rx_filter_msgq=self.add_filter, can_start=self.start)
        self.connect(can_send=self.send_frame)

    def init(self) -> int:
        return -self.lib.can_node_init(self.ffi.NULL)

    def watch_state(self) -> None:
        self.connect(can_set_state_change_callback=self.set_callback)

    def set_callback(self, _device, callback, _data) -> None:
        self.on_state = callback

    def add_filter(self, _device, _queue, rule) -> int:
        self.filter = rule.id << 18, rule.mask << 18, bool(rule.flags & 1), None
        return 0

    def start(self, _device) -> int:
        self.is_started = True
        return 0

    def give(self, _queue, out, _wait: int) -> int:
        if not self.fifo:
            return self.full_code
        first = self.fifo.pop(0)
        frame = self.ffi.cast("struct can_frame *", out)
        frame.id, frame.dlc, frame.data = first.arbitration_id, first.dlc, list(first.data)
        frame.flags = first.is_remote_frame << 1
        return 0

    def send_frame(self, _device, frame, wait: int, callback, _data) -> int:
        """Without a callback, Zephyr waits without limit until the frame is on the bus."""
        is_wrong = bool(wait or not callback or frame.flags)
        return self.send(frame.id, frame.dlc, frame.data, is_wrong)

    def rule(self) -> Rule:
        assert self.is_started
        return self.filter

    def go_off(self) -> None:
        self.is_off, self.pending = True, []
        self.report(3)  # CAN_STATE_BUS_OFF

    def recover(self) -> None:
        self.is_off = False
        self.report(0)

    def report(self, state: int) -> None:
        errors = {"tx_err_cnt": 255 if state else 0}
        self.on_state(self.ffi.NULL, state, errors, self.ffi.NULL)


class Zephyr45(Zephyr):
    """Zephyr 4.5, which keeps a list of callbacks of the program."""

    flags = ("-DMOCK_ZEPHYR_4_5",)
    headers = tuple(ZEPHYR_MOCK / f"zephyr/{name}.h" for name in ("kernel", "can_state_4_5"))

    def watch_state(self) -> None:
        self.callbacks: list[object] = []
        self.connect(can_init_state_change_callback=self.init_callback)
        self.connect(can_add_state_change_callback=self.add_callback)

    def init_callback(self, callback, handler) -> None:
        callback.handler = handler

    def add_callback(self, _device, callback) -> int:
        self.callbacks.append(callback)
        return 0

    def report(self, state: int) -> None:
        errors = {"tx_err_cnt": 255 if state else 0}
        for one in self.callbacks:
            one.handler(self.ffi.NULL, one, state, errors)


MODELS = (BxCan, BxCan2, FdCan, Mcp2515, Twai, Twai60, Zephyr, Zephyr45)
CONTROLLERS = {one.__name__: one for one in MODELS}
