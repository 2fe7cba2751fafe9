"""What is told of a comparison with the processor, from blocks of instructions to lines, without either."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cogless.c_layout import control_layout
from cogless.export.prepared import Recording
from cogless.export.sources import defined_in
from cogless.pil.compare import (
    Comparison,
    Difference,
    Instructions,
    _comparison,
    _instructions,
    _memory_difference,
    _Watched,
    comparison_lines,
)
from cogless.pil.processor import (
    PAGE_BYTES,
    PAINT_BYTE,
    STACK_SIZE,
    STACK_TOP,
    Function,
    Image,
    Processor,
    Symbol,
    _pages,
)
from cogless.pil.target import COMPILER_PART, Target
from cogless.pil.toolchain import Toolchain

FOUND = Comparison(
    study="liu2018",
    scenario="60-rpm",
    controller="pi",
    law="pi",
    ticks=100,
    difference=None,
    all=Instructions(300, 412.25, 900),
    with_law=Instructions(800, 850.0, 900),
    without_law=Instructions(300, 375.96, 400),
    end_of_trial=1234,
    by_source_with_law={"foc": 600.4, "drive": 249.5, "crc32": 0.5, "memory": 0.4},
    by_source_without_law={},
    most_by_source_with_law={"foc": 640, "drive": 260, "crc32": 1, "memory": 40},
    stack=200,
    flash=9000,
    constants=500,
    ram=1500,
    memory=1028,
    compiler="gcc 12",
    flags="-O2",
)


def test_a_comparison_s_lines() -> None:
    """What does not exist has no line; a file below half an instruction a period is not named."""
    assert comparison_lines(FOUND) == [
        "result            every output and all learned values: bit for bit equal",
        "compared          100 periods of liu2018, 60-rpm/pi",
        "instructions      300 to 900, mean 412.2",
        "  with the law    800 to 900, mean 850.0",
        "  without         300 to 400, mean 376.0",
        "  where, with     foc 600, drive 250, crc32 0",
        "  end of a trial  1234",
        "stack             200 bytes",
        "flash             9000 bytes, 500 of them the configured constants",
        "RAM               1500 bytes, 1028 of them memory of the learned values",
        "compiler          gcc 12 -O2",
    ]
    without = {
        line[:18].strip() for line in comparison_lines(replace(FOUND, without_law=None, end_of_trial=None))
    }
    assert not without & {"without", "end of a trial"} and "with the law" in without


@pytest.mark.parametrize(("tick", "where"), [(99, "period 99"), (100, "at the end")])
def test_a_difference_s_line(tick: int, where: str) -> None:
    told = comparison_lines(replace(FOUND, difference=Difference(tick, "i_d", 0.5, -1.0)))[0]
    assert told == f"result            NOT equal: {where}: i_d: simulation 0.5, processor -1.0"


def test_instructions_are_the_fewest_their_mean_and_the_most() -> None:
    assert _instructions(np.array([3, 1, 8])) == Instructions(1, 4.0, 8)


# an image: two functions in flash, one of them static, and a controller across the end of a page of RAM
FUNCTIONS = (
    Function(0x2000, "cgl_foc_step", None),
    Function(0x2010, "pi_step", None),
    Function(0x2020, "clamp", "foc"),
    Function(0x2030, "__aeabi_dmul", None),
)
IMAGE = Image(
    {0x2000: bytes(0x40), 0x5000: bytes(1)},
    {"pil_controller": Symbol(0x20000FFC, 8), "end": Symbol(0x70000010, 0)},
    FUNCTIONS,
    {".text": 64, ".rodata": 8, ".data": 4, ".bss": 1000},
)


def test_an_image_takes_flash_for_all_but_zeros() -> None:
    assert IMAGE.flash == 64 + 8 + 4


def test_pages_hold_segments_and_symbols_and_join_where_they_meet() -> None:
    beside = replace(IMAGE, segments={0x2FFF: bytes(2), 0x5000: bytes(PAGE_BYTES)})
    ram = (0x20000000, 0x20002000)
    assert _pages(IMAGE) == [(0x2000, 0x3000), (0x5000, 0x6000), ram]
    assert _pages(beside) == [(0x2000, 0x4000), (0x5000, 0x6000), ram]


def processor(code: bytes) -> Any:
    """As much of a processor as counting needs, with the same code everywhere."""
    own = SimpleNamespace(_image=IMAGE, _lengths={}, _owners={}, _visits=[])
    own.read = lambda address, size: code[:size]
    own._count = lambda address, size: Processor._count(own, address, size)
    own._length = lambda visit: Processor._length(own, visit)
    own._owner = lambda address: Processor._owner(own, address)
    return own


def test_thumb_instructions_are_two_bytes_or_four() -> None:
    """Four where the upper five bits of the first half are 11101, 11110 or 11111."""
    short, wide = (
        bytes([0, 0b11100 << 3]),
        [bytes([0, five << 3, 0, 0]) for five in (0b11101, 0b11110, 0b11111)],
    )
    code = short + wide[0] + short + wide[1] + wide[2] + short
    assert Processor._count(processor(code), 0, len(code)) == 6
    assert Processor._count(processor(code), 0, 0) == 0


def test_blocks_count_as_often_as_they_are_run_and_for_the_function_that_they_are_in() -> None:
    own = processor(bytes(8))  # four instructions of two bytes
    own._visits += [(0x2000, 4), (0x2010, 8), (0x2000, 4)]
    tally: Counter[tuple[int, int]] = Counter({(0x2000, 4): 1})
    assert Processor.take_instructions(own, tally) == 2 + 4 + 2
    assert tally == {(0x2000, 4): 3, (0x2010, 8): 1} and not own._visits
    assert Processor.take_instructions(own) == 0
    found = Processor.by_function(
        own, Counter({(0x2000, 4): 3, (0x200E, 2): 1, (0x2010, 8): 2, (0x2044, 2): 1})
    )
    foc, step, _, last = FUNCTIONS
    assert found == {foc: 3 * 2 + 1, step: 2 * 4, last: 1}


def test_the_stack_is_used_down_to_where_its_paint_is_gone() -> None:
    def left(paint: int) -> Any:
        def read(address: int, size: int) -> bytes:
            assert (address, size) == (STACK_TOP - STACK_SIZE, STACK_SIZE)
            return bytes([PAINT_BYTE]) * paint + bytes([0, PAINT_BYTE]) + bytes(size - paint - 2)

        return SimpleNamespace(read=read)

    assert [Processor.stack.fget(left(paint)) for paint in (0, STACK_SIZE - 200)] == [STACK_SIZE, 200]


def test_instructions_by_source_are_means_of_the_periods_with_the_law_and_of_the_others() -> None:
    """The most first; the compiler's own functions are in none of the sources."""
    foc, step, clamp, double = FUNCTIONS
    own = SimpleNamespace(
        _subject=SimpleNamespace(name="pi", divider=3),
        _processor=SimpleNamespace(by_function=dict),
        counts=[0] * 7,  # the law runs in the first, the fourth and the last
        _with_law={foc: 30, step: 36, Function(0x2040, "pil_law", None): 9, clamp: 3, double: 6},
        _without_law={foc: 40},
    )
    own._sources, own._homes = {}, defined_in()
    own._source = lambda function: Target._source(own, function)
    own._instructions_of = lambda tally: Target._instructions_of(own, tally)
    own._by_source = lambda tally, ticks: Target._by_source(own, tally, ticks)
    with_law, without = Target.by_source(own)
    assert list(with_law.items()) == [("pi_controller", 15.0), ("foc", 11.0), (COMPILER_PART, 2.0)]
    assert without == {"foc": 10.0}


def test_the_most_of_a_source_is_that_of_one_period_with_the_law() -> None:
    foc, step, clamp, _ = FUNCTIONS
    # the law runs in the first and the last
    periods = [{foc: 9, step: 1}, {foc: 99}, {foc: 4, clamp: 8, step: 2}]
    own = SimpleNamespace(
        _subject=SimpleNamespace(name="pi", divider=2),
        _processor=SimpleNamespace(by_function=dict, read=lambda address, size: b""),
        _sources={}, _homes=defined_in(), _with_law=Counter(), _without_law=Counter(),
        _out=0, _out_size=0, counts=[], most_with_law={},
    )  # fmt: skip
    own._source = lambda function: Target._source(own, function)
    own._instructions_of = lambda tally: Target._instructions_of(own, tally)
    visited = iter(periods)

    def take_instructions(tally: Counter[Function]) -> int:
        tally.update(period := next(visited))
        return sum(period.values())

    own._processor.take_instructions = take_instructions
    for _ in periods:
        Target._output(own)
    assert own.most_with_law == {"foc": 12, "pi_controller": 2}
    assert (own.counts, own._without_law[foc]) == ([10, 99, 14], 99)


@pytest.mark.parametrize("divider", [3, 1])
def test_a_comparison_tells_periods_with_the_law_from_the_others(divider: int) -> None:
    named = {"pi_drive_config": 100, "pi_law_config": 20, "pil_controller": 300, "pi_controller": 7}
    image = replace(IMAGE, symbols={name: Symbol(0, size) for name, size in named.items()})
    ends = [5, 7, 6] if divider > 1 else []
    found = _comparison(
        cast(Any, SimpleNamespace(study=SimpleNamespace(name="s"), scenario="low", controller="my-pi")),
        cast(Any, SimpleNamespace(name="pi", divider=divider, law=SimpleNamespace(name="pi"), memory_length=7,
                                  layout=SimpleNamespace(size={"cgl_real": 4}.get))),
        image,
        cast(Any, SimpleNamespace(counts=[9, 1, 2, 8, 3, 4, 10], ends=ends, stack=120,
                                  most_with_law={"foc": 3}, by_source=lambda: ({"foc": 1.0}, {"pi": 2.0}))),
        None,
        Toolchain(("cc",), "gcc 12", ("-O2", "-g"), ()),
    )  # fmt: skip
    assert (found.study, found.scenario, found.controller, found.law) == ("s", "low", "my-pi", "pi")
    assert (found.ticks, found.all) == (7, Instructions(1, pytest.approx(37 / 7), 10))
    if divider == 3:
        assert (found.with_law, found.without_law) == (Instructions(8, 9.0, 10), Instructions(1, 2.5, 4))
        assert found.end_of_trial == 7
    else:
        assert (found.with_law, found.without_law, found.end_of_trial) == (found.all, None, None)
    assert (found.by_source_with_law, found.by_source_without_law) == ({"foc": 1.0}, {"pi": 2.0})
    assert found.most_by_source_with_law == {"foc": 3}
    assert (found.stack, found.flash, found.constants, found.ram, found.memory) == (120, 76, 120, 300, 28)
    assert (found.compiler, found.flags) == ("gcc 12", "-O2 -g")


def test_the_first_number_that_differs_is_told_and_padding_does_not_count() -> None:
    layout = control_layout("single")
    place = {leaf.path: leaf.offset for leaf in layout.leaves("cgl_drive_output")}
    now = bytes(layout.size("cgl_measurement"))
    same, outputs = bytes(layout.size("cgl_drive_output")), list[bytes]()

    def with_numbers(**numbers: float) -> bytes:
        made = bytearray(same)
        for name, number in numbers.items():
            struct.pack_into("f", made, place[name], number)
        return bytes(made)

    told: list[float] = []
    wanted = Recording([now] * 1003, outputs=[with_numbers(i_q=0.5)] * 1003)
    target = cast(Any, SimpleNamespace(step=lambda measurement, reference: outputs.pop()))
    watched = _Watched(target, layout, wanted, 2004, told.append)

    def step(out: bytes, measurement: bytes = now) -> Difference | None:
        outputs.append(out)
        assert watched.step(measurement, b"") == out
        return watched.difference

    for _ in range(1001):
        assert step(wanted.outputs[0]) is None
    assert told == [0.0, 1000 / 2004]
    first = Difference(1001, "i_q", 0.5, 0.25)
    other = struct.pack("f", 1.0) + now[4:]
    assert step(with_numbers(i_q=0.25, u_d=1.0), other) == first
    assert step(wanted.outputs[0]) == first  # still the first of all that differ
    alone = _Watched(target, layout, wanted, 2, told.append)
    outputs.append(with_numbers(i_q=0.25))
    alone.step(now, b"")
    assert alone.difference == Difference(0, "i_q", 0.5, 0.25)
    again = _Watched(target, layout, wanted, 2, told.append)
    outputs.append(wanted.outputs[0])
    again.step(other, b"")
    assert again.difference == Difference(0, layout.leaves("cgl_measurement")[0].path, 0.0, 1.0)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_memories_are_compared_by_their_bits(kind: Any) -> None:
    learned = np.array([1.0, 0.0, np.nan], kind)

    def told(*numbers: float) -> Difference | None:
        target = cast(Any, SimpleNamespace(memory=np.array(numbers, kind)))
        return _memory_difference(target, Recording(memory=learned), 9)

    assert told(1.0, 0.0, np.nan) is None
    found = told(1.0, -0.0, np.nan)
    assert found is not None and (found.tick, found.field) == (9, "memory[1]")
    assert (found.simulation, str(found.processor)) == (0.0, "-0.0")
