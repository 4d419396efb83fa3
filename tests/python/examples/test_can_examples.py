# SPDX-License-Identifier: MIT
"""examples/can_* and zephyr_node on models of their controllers, compared with dahl.Node."""

import math
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import dahl
import pytest
import yaml
from can_controllers import CONTROLLERS, EXAMPLES, MOCKS, Controller, standard
from conftest import need
from dahl import codec
from dahl.codec import EncoderState, FrictionTorque, ParamWrite, Reset
from programs import STRICT, run

MS = 1000  # us
PARAMS = (100.0, 0.5, 6.2831853 / 16384)  # sigma0, Fc, theta_per_count of the examples
PERIODS = 12  # longer than any transmit queue
MASK = 0x70F  # ids of node 0 are 0x100, 0x110 .. 0x170


@pytest.fixture(params=CONTROLLERS)
def off(request: pytest.FixtureRequest, tmp_path: Path, library: Path) -> Controller:
    """A controller before its program starts."""
    return CONTROLLERS[request.param](tmp_path, library)


@pytest.fixture
def controller(off: Controller) -> Iterator[Controller]:
    assert off.init() == 0
    yield off
    assert off.faults == []


class Pair:
    """A controller with its example, and dahl.Node with the same frames at the same times."""

    def __init__(self, controller: Controller) -> None:
        self.controller, self.node = controller, dahl.Node(dahl.Plan(*PARAMS))
        self.counter, self.count = 0, 0
        self.due: list[can.Message] = []

    def expect(self, message: can.Message | None) -> None:
        self.due += [message] if message else []

    def tick(self) -> None:
        self.controller.tick()
        self.expect(self.node.tick(self.controller.now_us / 1e6))

    def receive(self, message: can.Message) -> None:
        if self.controller.accepts(message):
            self.controller.receive(message)
            self.expect(self.node.receive(message, self.controller.now_us / 1e6))

    def encoder(self, step: int = 1, dcounts: int = 3) -> can.Message:
        self.counter, self.count = (self.counter + step) % 16, self.count + dcounts
        return codec.pack(EncoderState(self.count, self.counter))

    def bus_off(self) -> None:
        """Off the bus, and back after 128 times 11 bits of 2 us."""
        self.controller.go_off()
        error = can.Message(is_error_frame=True, arbitration_id=0x40, dlc=8, is_extended_id=False)
        self.expect(self.node.receive(error, self.controller.now_us / 1e6))
        self.tick()
        self.controller.recover()
        self.tick()
        self.controller.now_us += 3 * MS

    def check(self) -> None:
        """The same frames were sent."""
        assert fields(self.controller.take_sent()) == fields(self.due)
        self.due = []


def fields(messages: list[can.Message]) -> list[tuple[int, int, bytes]]:
    return [(one.arbitration_id, one.dlc, bytes(one.data)) for one in messages]


def damaged(message: can.Message) -> can.Message:
    message.data[5] ^= 0x10
    return message


def extended(message: can.Message) -> can.Message:
    """Return the frame with an extended identifier that starts with the standard one."""
    message.arbitration_id, message.is_extended_id = message.arbitration_id << 18, True
    return message


def gain(value: int) -> can.Message:
    return codec.pack(
        ParamWrite(param=codec.Param.GAIN, value=value, counter=1, write=codec.Write.WRITE)
    )


EVENTS: dict[str, tuple[int, Callable[[Pair, random.Random], can.Message]]] = {  # with a weight
    "next": (20, lambda pair, chance: pair.encoder(1, chance.randint(-40, 40))),
    "same counter": (1, lambda pair, _: pair.encoder(0)),
    "lost frames": (2, lambda pair, chance: pair.encoder(chance.randint(2, 6))),
    "wrong CRC": (1, lambda pair, _: damaged(pair.encoder())),
    "short": (1, lambda pair, _: standard(0x100, 7, bytes(pair.encoder().data))),
    "empty": (1, lambda _, __: standard(0x100, 0, b"")),
    "other node": (2, lambda pair, chance: codec.pack(EncoderState(9, 9), chance.randint(1, 15))),
    "other id": (2, lambda _, chance: standard(chance.randrange(0x200, 0x800), 8, bytes(8))),
    "own answer": (1, lambda _, __: codec.pack(FrictionTorque(5))),
    "remote": (1, lambda _, __: can.Message(0, 0x100, False, True, dlc=8)),
    "extended": (1, lambda pair, _: extended(pair.encoder())),
    "gain": (1, lambda _, chance: gain(chance.randint(0, 65536))),
    "reset": (1, lambda _, chance: codec.pack(Reset(counter=2, what=chance.randint(1, 2)))),
}


def test_the_example_sends_the_frames_of_dahl_node(controller: Controller) -> None:
    """On good, bad and foreign frames, silences and bus-offs."""
    pair, chance, seen = Pair(controller), random.Random(3), set()
    weights = [weight for weight, _ in EVENTS.values()]
    for number in range(600):
        controller.now_us += chance.choice([MS] * 20 + [150 * MS])
        if number % 100 == 99:
            pair.bus_off()
        (name,) = chance.choices(list(EVENTS), weights)
        pair.receive(EVENTS[name][1](pair, chance))
        pair.tick()
        seen |= {one.arbitration_id for one in pair.due}
        pair.check()
    assert seen == {0x110, 0x120, 0x140}
    assert pair.node.counts.bus_off == 6 and pair.node.counts.ok > 200
    assert controller.dropped == 0


def test_the_filter_passes_the_ids_of_the_node(controller: Controller) -> None:
    accepted = {one for one in range(0x800) if controller.accepts(standard(one, 8, bytes(8)))}
    assert accepted == {one for one in range(0x800) if one & MASK == 0x100}


def test_a_stuck_bus_drops_frames_and_blocks_nothing(controller: Controller) -> None:
    pair = Pair(controller)
    pair.receive(pair.encoder())
    pair.tick()
    pair.check()
    controller.room = 0
    for _ in range(PERIODS):
        controller.now_us += MS
        pair.receive(pair.encoder())
        pair.tick()
    assert controller.take_sent() == []
    assert controller.dropped == PERIODS - controller.capacity
    pair.due = pair.due[: controller.capacity]  # the oldest
    controller.let_go(room=1)  # the next answer fills this place and is sent last
    pair.receive(pair.encoder())
    controller.let_go()
    pair.check()
    pair.receive(pair.encoder())
    assert len(pair.due) == 1
    pair.check()


def test_each_frame_of_the_node_is_sent_or_counted_as_dropped(controller: Controller) -> None:
    """Answers and Status frames, on a bus that is stuck for some periods of Status."""
    pair = Pair(controller)
    for room in (0, math.inf, 0, 3):
        controller.let_go(room)
        for _ in range(250):
            controller.now_us += MS
            pair.receive(pair.encoder())
            pair.tick()
    controller.let_go()
    assert [one.arbitration_id for one in pair.due].count(0x120) >= 9
    assert len(controller.take_sent()) + controller.dropped == len(pair.due)


def test_bus_off_drops_the_frames_that_wait(controller: Controller) -> None:
    """Answers, and a Status frame if it has room; old torques must not be sent later."""
    pair = Pair(controller)
    pair.receive(pair.encoder())
    pair.tick()
    pair.check()
    controller.room = 0
    controller.now_us += 100 * MS
    pair.tick()
    for _ in range(controller.capacity):
        pair.receive(pair.encoder())
    assert {one.arbitration_id for one in pair.due} == {0x110, 0x120}
    pair.due = []
    controller.room = math.inf
    pair.bus_off()
    assert [one.arbitration_id for one in pair.due] == [0x120]
    pair.check()


@pytest.mark.parametrize("off", ["FdCan", "Mcp2515"], indirect=True)
def test_one_interrupt_serves_all_frames(controller: Controller) -> None:
    """It has an edge or a flag that a second frame would not set again."""
    pair = Pair(controller)
    for _ in range(2):
        frame = pair.encoder()
        controller.store(frame)
        pair.expect(pair.node.receive(frame, 0.0))
    controller.interrupt()
    pair.check()


@pytest.mark.parametrize("off", [*CONTROLLERS][:-2], indirect=True)
def test_the_bit_rate_is_500_kbit_per_s(controller: Controller) -> None:
    rate, sample_point = controller.bit_timing()
    assert rate == 500e3 and 0.8 <= sample_point <= 0.9


def test_a_controller_that_does_not_answer_is_an_error(off: Controller) -> None:
    off.has_clock = False
    assert off.init() > 0
    if hasattr(off, "nvic"):
        assert not any(off.nvic)


CALLS = {"device_is_ready": (False, 19), "can_add_rx_filter_msgq": (-28, 28), "can_start": (-5, 5)}
CALLS_45 = CALLS | {"can_add_state_change_callback": (-17, 17)}


@pytest.mark.parametrize(
    ("off", "call"),
    [*(("Zephyr", call) for call in CALLS), *(("Zephyr45", call) for call in CALLS_45)],
    indirect=["off"],
)
def test_zephyr_returns_the_code_of_its_driver(off: Controller, call: str) -> None:
    result, code = CALLS_45[call]
    off.connect(**{call: lambda *_: result})
    assert off.init() == code


SAMPLE = """
    #include <stdarg.h>
    #include <stdio.h>
    #include <stdlib.h>
    #include "can_node.h"
    const struct device mock_zephyr_canbus = {"can0"};
    int printk(const char *format, ...)
    {
        va_list values;
        va_start(values, format);
        return vprintf(format, values);
    }
    int can_node_init(const struct device *can)
    { return can == &mock_zephyr_canbus ? atoi(getenv("CODE")) : 1; }
    void can_node_serve(void) { exit(7); }
    """


@pytest.mark.parametrize("code", [0, -5])
def test_the_zephyr_sample_prints_the_line_of_its_metadata_or_an_error(
    tmp_path: Path, code: int
) -> None:
    """Twister waits for the line. The program then serves frames until it is stopped."""
    (mock := tmp_path / "mock.c").write_text(SAMPLE)
    folder = EXAMPLES / "zephyr_node"
    words = ["gcc", "-std=c11", *MOCKS, f"-I{folder}/src", mock, folder / "src/main.c"]
    run(*words, "-o", tmp_path / "sample")
    metadata = yaml.safe_load((folder / "sample.yaml").read_text())
    (line,) = metadata["tests"]["sample.dahl.node"]["harness_config"]["regex"]
    ends = "./sample" if code else "./sample || [ $? = 7 ]"  # by its main, or by can_node_serve
    said = run("sh", "-c", ends, cwd=tmp_path, env={"CODE": str(code)})
    assert re.fullmatch("error: can0: code -5" if code else line, said.strip())


CORES = {
    "can_stm32_bxcan": "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfloat-abi=soft",
    "can_stm32_fdcan": "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfloat-abi=soft",
    "can_mcp2515": "avr-gcc -mmcu=atmega2560",
    "zephyr_node": "arm-none-eabi-gcc -mcpu=cortex-m0 -mthumb",
    "stm32_current_loop": "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16"
    " -mfloat-abi=hard -Wdouble-promotion",
    "can_esp32_twai": "riscv64-unknown-elf-gcc -march=rv32imc -mabi=ilp32 --specs=picolibc.specs",
}

OTHER = ("-DMOCK_IDF_5_5", "-DMOCK_ZEPHYR_4_5", "-DCAN_NODE_UNIT=2", "-DAPB1_MHZ=36")


@pytest.mark.checks
@pytest.mark.parametrize("flags", [(), OTHER, ("-DMOCK_IDF_6_0",)], ids=["", "other", "6.0"])
@pytest.mark.parametrize("name", CORES)
def test_the_example_compiles_for_its_core(
    name: str, flags: tuple[str, ...], root: Path, tmp_path: Path
) -> None:
    """TWAI and Zephyr with the mocks of their headers, the first for an ESP32-C3."""
    compiler, *target = CORES[name].split()
    need(compiler, f"examples/{name} compiles for its core")
    words = [compiler, *target, *STRICT, *flags, f"-I{root}/lib/include", *MOCKS]
    for source in EXAMPLES.glob(f"{name}/**/*.c"):
        run(*words, "-c", source, "-o", tmp_path / "made.o")
