"""A linked program image: its bytes, its symbols, and the flash that it takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

FLASH = (".text", ".rodata", ".data")


@dataclass(frozen=True)
class Symbol:
    address: int
    size: int


@dataclass(frozen=True)
class Function:
    """A function of an image. `file`: source of a static function, without suffix; None for other
    functions."""

    address: int
    name: str
    file: str | None


@dataclass(frozen=True)
class Image:
    """A linked program image. `segments`: bytes to load, by address. `sections`: sizes by name."""

    segments: Mapping[int, bytes]
    symbols: Mapping[str, Symbol]
    functions: tuple[Function, ...]  # by address
    sections: Mapping[str, int]

    @property
    def flash(self) -> int:
        """Bytes of code, constants and initial values."""
        return sum(self.sections.get(name, 0) for name in FLASH)


def read(path: Path) -> Image:
    """Read an ELF file."""
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
