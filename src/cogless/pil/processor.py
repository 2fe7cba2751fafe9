"""An emulated Cortex-M4F (PyPI's unicorn) that calls functions of a program image and counts instructions.

A linked program image: its bytes, its symbols, and its size in flash.
"""

from __future__ import annotations

import importlib.util
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogless.errors import StudyError

FLASH = (".text", ".rodata", ".data")


@dataclass(frozen=True)
class Symbol:
    address: int
    size: int


@dataclass(frozen=True)
class Function:
    """A function of an image. `file`: source file of a static function, without suffix; otherwise None."""

    address: int
    name: str
    file: str | None


@dataclass(frozen=True)
class Image:
    """A linked program image. `segments`: bytes to load, by address. `sections`: sizes by name."""

    segments: Mapping[int, bytes]
    symbols: Mapping[str, Symbol]
    functions: tuple[Function, ...]  # sorted by address
    sections: Mapping[str, int]

    @property
    def flash(self) -> int:
        """Bytes of code, constants and initial values."""
        return sum(self.sections.get(name, 0) for name in FLASH)


def read(path: Path) -> Image:
    """Read a program image from an ELF file."""
    from elftools.elf.elffile import ELFFile

    with path.open("rb") as stream:
        elf = ELFFile(stream)
        segments = {s["p_vaddr"]: s.data() for s in elf.iter_segments() if s["p_type"] == "PT_LOAD"}
        sections = {s.name: s["sh_size"] for s in elf.iter_sections()}
        table = elf.get_section_by_name(".symtab")
        symbols: dict[str, Symbol] = {}
        functions: list[Function] = []
        file: str | None = None
        for entry in table.iter_symbols():
            kind, address = entry["st_info"]["type"], entry["st_value"] & ~1
            if kind == "STT_FILE":
                file = Path(entry.name).stem
            elif entry.name:
                symbols[entry.name] = Symbol(address, entry["st_size"])
            if kind == "STT_FUNC":
                local = entry["st_info"]["bind"] == "STB_LOCAL"
                functions.append(Function(address, entry.name, file if local else None))
    return Image(segments, symbols, tuple(sorted(functions, key=lambda f: f.address)), sections)


PAGE_BYTES = 0x1000
STACK_TOP, STACK_SIZE = 0x20200000, 0x10000
RETURN_ADDRESS = 0x00001000  # return address of a called function; no code is there
PAINT_BYTE = 0xA5

Visits = Counter[tuple[int, int]]  # address and size of a block -> how often it was run


def require() -> None:
    """Raise StudyError if the emulator isn't installed."""
    if not all(importlib.util.find_spec(name) for name in ("unicorn", "elftools")):
        raise StudyError("pil: no emulator: expected unicorn and pyelftools (pip install 'cogless[pil]')")


class Processor:
    """An emulated processor with an image in its flash and RAM; each call starts with an empty stack.

    The emulator starts with the FPU switched on; on a real processor, firmware must switch it on.
    """

    def __init__(self, image: Image) -> None:
        import unicorn
        from unicorn import arm_const as arm

        self._arm: Any = arm
        self._image = image
        self._error = unicorn.UcError
        self._uc: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        self._visits: list[tuple[int, int]] = []
        self._lengths: dict[tuple[int, int], int] = {}
        self._owners: dict[int, Function] = {}
        for start, end in _pages(image):
            self._uc.mem_map(start, end - start)
        for address, data in image.segments.items():
            self._uc.mem_write(address, data)
        self._uc.mem_map(STACK_TOP - STACK_SIZE, STACK_SIZE)
        self._uc.mem_write(STACK_TOP - STACK_SIZE, bytes([PAINT_BYTE]) * STACK_SIZE)
        visit = self._visits.append
        # the hook is called for each block (instructions without a jump between them) that is run
        self._uc.hook_add(unicorn.UC_HOOK_BLOCK, lambda uc, address, size, data: visit((address, size)))

    def call(self, function: str, *arguments: int, reals: bytes = b"") -> int:
        """Run a function to its end and return its result; StudyError if the processor faults.

        `arguments`: at most four, for R0 to R3. `reals`: words of the floating-point arguments, from S0 on.
        """
        registers = (
            self._arm.UC_ARM_REG_R0,
            self._arm.UC_ARM_REG_R1,
            self._arm.UC_ARM_REG_R2,
            self._arm.UC_ARM_REG_R3,
        )
        for register, value in zip(registers, arguments, strict=False):
            self._uc.reg_write(register, value)
        for n, (word,) in enumerate(struct.iter_unpack("<I", reals)):
            self._uc.reg_write(self._arm.UC_ARM_REG_S0 + n, word)
        self._uc.reg_write(self._arm.UC_ARM_REG_SP, STACK_TOP)
        self._uc.reg_write(self._arm.UC_ARM_REG_LR, RETURN_ADDRESS | 1)
        try:
            self._uc.emu_start(self._image.symbols[function].address | 1, RETURN_ADDRESS)
        except self._error as error:
            at = self._uc.reg_read(self._arm.UC_ARM_REG_PC)
            raise StudyError(
                f"pil: {function} stopped at {at:#x} ({error}): expected a function that returns"
            ) from error
        return int(self._uc.reg_read(self._arm.UC_ARM_REG_R0))

    def take_instructions(self, tally: Visits | None = None) -> int:
        """Number of instructions since the last call of this method. Adds the blocks that ran to `tally`.

        Instructions that an IT block skips are counted, too, since the processor fetches them.
        """
        total = sum(map(self._length, self._visits))
        if tally is not None:
            tally.update(self._visits)
        self._visits.clear()
        return total

    def by_function(self, tally: Visits) -> dict[Function, int]:
        """{function: number of its instructions in a tally}."""
        totals: dict[Function, int] = {}
        for visit, times in tally.items():
            function = self._owner(visit[0])
            totals[function] = totals.get(function, 0) + times * self._length(visit)
        return totals

    def read(self, address: int, size: int) -> bytes:
        return bytes(self._uc.mem_read(address, size))

    def write(self, address: int, data: bytes) -> None:
        self._uc.mem_write(address, data)

    @property
    def stack(self) -> int:
        """Largest use of the stack so far, bytes."""
        painted = self.read(STACK_TOP - STACK_SIZE, STACK_SIZE)
        return len(painted.lstrip(bytes([PAINT_BYTE])))

    def _owner(self, address: int) -> Function:
        """The function that contains an address."""
        if address not in self._owners:
            place = bisect_right(self._image.functions, address, key=lambda function: function.address)
            self._owners[address] = self._image.functions[place - 1]
        return self._owners[address]

    def _length(self, visit: tuple[int, int]) -> int:
        """Number of instructions of a block. Code doesn't change, so the number is computed only once."""
        if visit not in self._lengths:
            self._lengths[visit] = self._count(*visit)
        return self._lengths[visit]

    def _count(self, address: int, size: int) -> int:
        """Number of Thumb instructions in a block.

        An instruction has 4 bytes if its upper five bits are 11101, 11110 or 11111, else 2.
        """
        code, count, place = self.read(address, size), 0, 0
        while place < size:
            place += 4 if code[place + 1] >> 3 in (0b11101, 0b11110, 0b11111) else 2
            count += 1
        return count


def _pages(image: Image) -> list[tuple[int, int]]:
    """Address ranges of whole pages, without overlap, that contain all segments and symbols."""
    ends = [(address, address + len(data)) for address, data in image.segments.items()]
    ends += [(s.address, s.address + s.size) for s in image.symbols.values() if s.size]
    pages = sorted(
        {page for start, end in ends for page in range(start // PAGE_BYTES, -(-end // PAGE_BYTES))}
    )
    ranges: list[tuple[int, int]] = []
    for page in pages:
        if ranges and ranges[-1][1] == page * PAGE_BYTES:
            ranges[-1] = (ranges[-1][0], (page + 1) * PAGE_BYTES)
        else:
            ranges.append((page * PAGE_BYTES, (page + 1) * PAGE_BYTES))
    return ranges
