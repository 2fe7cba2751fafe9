"""The exported controller on an emulated Cortex-M4F; `make pil` runs all laws for longer.

What needs the emulator or a cross compiler is skipped where there is none.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from commands import cogless
from kept import kept

import studies
from cogless import load
from cogless.errors import StudyError
from cogless.export.prepared import prepare
from cogless.pil import toolchain
from cogless.pil.compare import compare
from cogless.pil.processor import Processor
from cogless.pil.target import CoilTarget, Target, build

EMULATOR = all(importlib.util.find_spec(name) for name in ("unicorn", "elftools"))
COMPILERS = [
    name
    for name, there in (
        ("gcc", shutil.which(toolchain.GCC) is not None),
        ("zig", importlib.util.find_spec("ziglang") is not None),
    )
    if there
]
needs_both = pytest.mark.skipif(not (EMULATOR and COMPILERS), reason="no emulator or no cross compiler")
BUS = {"delay_measured": "0.3 ms", "delay_command": "1 ms", "jitter": "0.5 ms", "quantum": "1 mA"}
COMPENSATED = {"drive.dead_time_compensation": {"band": "35 mA"}}
# trials of 1,000 periods, of which a case sees the second begin
SHORT = {
    "scenario.table-1.duration": "0.125 s",
    "scenario.table-1.reference": [["0.01 s", "0 rev"], ["0.11 s", "0.05 rev"]],
    "scenario.table-1.changes": [{"trial": 2, "load_steps": [[5, "1.11 N*m"]]}],
}
CASES: list[tuple[str, str, str, dict[str, Any], int]] = [
    ("liu2018", "900-rpm", "robust-ilc", {}, 1500),
    ("uomodri", "1-rev-s", "pi-afc", studies.AFC, 1500),
    ("verrelli2016", "twelve-seconds", "printed", {}, 150),  # double precision
    ("mandra2019", "table-1", "ilc", SHORT, 1100),
    ("liu2018", "60-rpm", "pi-ilc", {"drive.bus": BUS}, 1500),
    ("liu2018", "900-rpm", "robust-ilc", {"drive.bus": BUS, **COMPENSATED}, 1500),
    ("mandra2019", "table-1", "ilc", SHORT | {"drive.bus": BUS}, 1100),
    ("printer", "50-mm-s-back", "table", {"drive.precision": "single"}, 1500),  # a law without a drive
    ("printer", "20-mm-s", "table", {}, 150),
]


@pytest.fixture(scope="module", autouse=True)
def images() -> Iterator[None]:
    """An image of the same files is built once, and kept."""
    build_image = toolchain.Toolchain.build

    def built(
        tools: toolchain.Toolchain, sources: list[Path], script: Path, image: Path, defines: list[str]
    ) -> None:
        def make(made: Path) -> None:
            build_image(tools, sources, script, made, defines)

        headers = {header for source in sources for header in source.parent.glob("*.h")}
        words = [tools.name, *tools.flags, *toolchain.LINK_FLAGS, *tools.libraries, *defines]
        shutil.copy(kept("image.elf", words, [*sources, *sorted(headers), script], make), image)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(toolchain.Toolchain, "build", built)
        yield


@needs_both
@pytest.mark.parametrize("compiler", COMPILERS)
def test_both_compilers_agree_with_the_simulation(compiler: str) -> None:
    found = compare(load("liu2018"), "pi-ilc", "60-rpm", 1500, toolchain.find(compiler))
    assert (found.difference, found.ticks) == (None, 1500)
    assert found.without_law is not None
    assert found.without_law.most < found.with_law.least <= found.with_law.mean <= found.with_law.most
    divider = 15
    mean = (found.with_law.mean + (divider - 1) * found.without_law.mean) / divider
    assert found.all.mean == pytest.approx(mean)
    assert sum(found.by_source_with_law.values()) == pytest.approx(found.with_law.mean)
    assert all(mean <= found.most_by_source_with_law[name] for name, mean in found.by_source_with_law.items())
    assert found.with_law.most <= sum(found.most_by_source_with_law.values())
    assert found.memory == 4 * 257
    assert found.memory < found.ram < found.memory + 1200  # states, with their configs and the guard's
    assert 100 < found.constants < found.flash < 24_576
    assert 50 < found.stack < 1000


@needs_both
@pytest.mark.parametrize(("study", "scenario", "controller", "changes", "ticks"), CASES)
def test_other_laws(study: str, scenario: str, controller: str, changes: dict[str, Any], ticks: int) -> None:
    found = compare(load(study, changes), controller, scenario, ticks, toolchain.find())
    assert (found.difference, found.ticks) == (None, ticks)


@needs_both
def test_over_a_bus_the_processor_is_asked_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[float | None] = []
    actuate = Target.actuate

    def noted(target: Target, i_q_ref: float | None) -> bytes:
        commands.append(i_q_ref)
        return actuate(target, i_q_ref)

    monkeypatch.setattr(Target, "actuate", noted)
    bus = {"delay_command": "0.5 ms", "quantum": "1 mA"}  # 7.5 periods of 15 kHz
    found = compare(load("liu2018", {"drive.bus": bus}), "pi", "60-rpm", 60, toolchain.find())
    assert found.difference is None
    arrived = [tick for tick, command in enumerate(commands) if command is not None]
    assert arrived == [8, 23, 38, 53]
    assert all(1e3 * command == pytest.approx(round(1e3 * command)) for command in commands if command)


@needs_both
def test_the_first_difference_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    step = Target.step

    def wrong(target: Target, measurement: bytes, reference: bytes) -> bytes:
        out = step(target, measurement, reference)
        return out[:-1] + b"\x80" if len(target.counts) == 43 else out

    monkeypatch.setattr(Target, "step", wrong)
    arguments = ("pil", "liu2018", "--controller", "pi", "--ticks", "100")
    code, out, _ = cogless(capsys, *arguments)
    assert code == 1
    assert "NOT equal: period 42: status: simulation 4.0, processor 2147483652.0" in out
    code, out, _ = cogless(capsys, *arguments, "--json")
    assert code == 1
    assert json.loads(out)["difference"]["tick"] == 42


@needs_both
def test_a_coil_s_current_that_differs_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    step = CoilTarget.step

    def wrong(target: CoilTarget, measurement: bytes, reference: bytes) -> bytes:
        out = step(target, measurement, reference)
        return out[:4] + bytes([out[4] ^ 1]) + out[5:] if len(target.counts) == 43 else out

    monkeypatch.setattr(CoilTarget, "step", wrong)
    study = load("printer", {"drive.precision": "single"})
    found = compare(study, "table", "20-mm-s", 100, toolchain.find())
    assert found.difference is not None
    assert (found.difference.tick, found.difference.field) == (42, "i_b")
    assert found.difference.simulation == pytest.approx(found.difference.processor, rel=1e-6)
    assert (found.law, found.memory, found.without_law) == ("microstepping", 0, None)
    assert found.constants == 204 < found.flash < 2500 and found.constants < found.ram


@needs_both
def test_a_difference_in_what_is_learned_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = Target.memory.fget

    def wrong(target: Target) -> Any:
        changed = memory(target).copy()
        changed[3] += 1
        return changed

    monkeypatch.setattr(Target, "memory", property(wrong))
    found = compare(load("liu2018"), "pi-ilc", "60-rpm", 50, toolchain.find())
    assert found.difference is not None
    assert (found.difference.tick, found.difference.field) == (50, "memory[3]")


@needs_both
def test_blocks_hold_what_was_run_and_what_a_condition_skipped() -> None:
    """Instruction by instruction the emulator says what it ran. The rest of each block stands under an IT."""
    import unicorn

    prepared = prepare(load("liu2018"), "60-rpm", "pi-ilc")
    subject, image = build(prepared, toolchain.find())
    processor = Processor(image)
    ran: list[list[int]] = []
    blocks: list[tuple[int, int]] = []

    def enter(uc: Any, address: int, size: int, data: Any) -> None:
        blocks.append((address, size))
        ran.append([])

    processor._uc.hook_add(unicorn.UC_HOOK_BLOCK, enter)
    processor._uc.hook_add(unicorn.UC_HOOK_CODE, lambda uc, address, size, data: ran[-1].append(address))
    controller, exchange = (image.symbols[name].address for name in ("pil_controller", "pil_exchange"))
    assert processor.call(f"{subject.name}_init", controller) == 0
    processor.take_instructions()
    skipped = counted = 0
    for tick in range(40):
        ran.clear()
        blocks.clear()
        processor.write(exchange, struct.pack("<6f", 1.0, -0.5, -0.5, 0.1 * tick, 1.0, 300.0))
        processor.call(f"{subject.name}_step", controller, exchange, exchange + 24, exchange + 44)
        count = processor.take_instructions()
        counted += count
        before = (0, 0)
        for (address, size), addresses in zip(blocks, ran, strict=True):
            every, conditional = listing(processor.read(address, size), address)
            if sum(before) == address:  # a page's end, which an IT may stand before
                both = listing(processor.read(before[0], before[1] + size), before[0])
                conditional = conditional | both[1]
            before = (address, size)
            assert set(addresses) <= set(every)
            assert set(every) - set(addresses) <= conditional
            skipped += len(every) - len(addresses)
        assert sum(len(listing(processor.read(a, n), a)[0]) for a, n in blocks) == count
    assert 0 < skipped < 0.1 * counted


def listing(code: bytes, start: int) -> tuple[list[int], set[int]]:
    """Addresses of the Thumb instructions in a block, and of those of them that an IT makes conditional."""
    addresses: list[int] = []
    conditional: set[int] = set()
    place = left = 0
    while place < len(code):
        half = int.from_bytes(code[place : place + 2], "little")
        addresses.append(start + place)
        if left:
            conditional.add(start + place)
            left -= 1
        elif half >> 8 == 0xBF and half & 0xF:  # IT: as many follow as its lowest bit set says
            left = 4 - ((half & -half).bit_length() - 1)
        place += 4 if half >> 11 in (0b11101, 0b11110, 0b11111) else 2
    return addresses, conditional


@needs_both
def test_a_call_that_faults_is_one_line() -> None:
    prepared = prepare(load("liu2018"), "60-rpm", "pi")
    subject, image = build(prepared, toolchain.find())
    processor = Target(subject, image, prepared.memory)._processor
    with pytest.raises(
        StudyError,
        match=r"pil: pi_step stopped at 0x[0-9a-f]+ \(.*\): expected a function "
        r"that returns",
    ):
        processor.call("pi_step", 0x60000000, 0x60000000, 0x60000000, 0x60000000)


@needs_both
def test_it_warns_of_what_design_says_diverges(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--controller", "pi-ilc", "--ticks", "100", "--set", "controller.pi-ilc.gain=3")
    code, _, err = cogless(capsys, "pil", "uomodri", *options)
    assert code == 0
    grows = (
        r"Warning: controller\.pi-ilc: grows by a factor of up to .* per period at .*; "
        r'learning settles with gain = ".* A\*s/rad"\.\n'
    )
    assert re.fullmatch(grows, err)


def test_a_missing_compiler_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    code, out, err = cogless(capsys, "pil", "liu2018", "--controller", "pi")
    assert (code, out) == (2, "")
    assert err == (
        "pil: no cross compiler: expected arm-none-eabi-gcc (Debian: apt-get install gcc-arm-none-eabi) or "
        "ziglang (pip install 'cogless[pil]')\n"
    )
    _, _, err = cogless(capsys, "pil", "liu2018", "--controller", "pi", "--compiler", "zig")
    assert err.startswith("pil: no cross compiler: expected ziglang (pip install 'cogless[pil]') or arm-")


def test_a_missing_emulator_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = toolchain.Toolchain(("cc",), "cc", (), ())
    monkeypatch.setattr(toolchain, "find", lambda wanted=None: found)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    code, out, err = cogless(capsys, "pil", "liu2018", "--controller", "pi")
    assert (code, out) == (2, "")
    assert err == "pil: no emulator: expected unicorn and pyelftools (pip install 'cogless[pil]')\n"


@pytest.mark.skipif(not EMULATOR, reason="no unicorn and pyelftools")
@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--compiler", "icc"], '--compiler: "icc": expected gcc or zig\n'),
        (
            ["--scenario", "x"],
            'liu2018.toml: scenario: "x": expected a scenario with controller pi: 900-rpm, ',
        ),
    ],
)
def test_mistakes(capsys: pytest.CaptureFixture[str], arguments: list[str], line: str) -> None:
    code, out, err = cogless(capsys, "pil", "liu2018", "--controller", "pi", *arguments)
    assert (code, out) == (2, "")
    assert line in err and err.count("\n") == 1


def test_the_assets_are_installed() -> None:
    import cogless.pil

    assets = Path(cogless.pil.__file__).parent / "assets"
    assert {path.name for path in assets.iterdir()} == {"image.ld", "runtime.c"}
