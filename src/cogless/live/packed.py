"""The engine's description of a run as flat bytes, and the place of each number in them.

simulator/packed_value.hpp reads these bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from cogless.c_layout import Leaf, control_layout
from cogless.control_library import C_LAWS

NONE, BOOL, INTEGER, NATURAL, REAL, TEXT, NUMBERS, LIST, TABLE, MATRIX = range(10)
STRUCTS = {
    "drive.control": "cgl_drive_config",
    "drive.encoder_table": "cgl_encoder_table_config",
    "drive.dead_time": "cgl_dead_time_config",
}
POINTER = 4  # bytes, in WebAssembly


@dataclass(frozen=True)
class Number:
    """A number in the bytes. `format`: as Python's struct module names it."""

    path: str
    offset: int
    format: str

    def read(self, data: bytes) -> float:
        return float(struct.unpack_from(f"<{self.format}", data, self.offset)[0])

    def write(self, data: bytearray, value: float) -> None:
        """Write the value, rounded if the number's format is a whole one."""
        struct.pack_into(f"<{self.format}", data, self.offset, value if self.format in "df" else round(value))


@dataclass(frozen=True)
class Packed:
    """A description as bytes. `numbers`: all numbers in it. `shape`: all else that it holds."""

    data: bytes
    numbers: tuple[Number, ...]
    shape: tuple[str, ...]


def pack(description: Mapping[str, Any], precision: str) -> Packed:
    """Pack a description. TypeError: a value that no description has."""
    law = C_LAWS.get(description["controller"]["law"])
    structs = STRUCTS | ({"controller.config": law.config} if law else {})
    packer = _Packer(precision, structs)
    packer.value(description, "")
    return Packed(bytes(packer.data), tuple(packer.numbers), tuple(packer.shape))


@cache
def _leaves(precision: str, name: str) -> tuple[Leaf, ...]:
    return tuple(control_layout(precision, POINTER).leaves(name))


class _Packer:
    def __init__(self, precision: str, structs: Mapping[str, str]) -> None:
        self.precision, self.structs, self.data = precision, structs, bytearray()
        self.numbers: list[Number] = []
        self.shape: list[str] = []

    def value(self, of: Any, path: str) -> None:
        for kind, put in KINDS:
            if isinstance(of, kind):
                put(self, of, path)
                return
        raise TypeError(f"{path}: {type(of).__name__}: expected a plain value")

    def none(self, _: None, path: str) -> None:
        self._head(NONE, 0, path)

    def boolean(self, of: bool, path: str) -> None:
        self.numbers.append(Number(path, len(self.data) + 4, "I"))
        self.data += struct.pack("<II", BOOL, of)
        self.shape.append(f"{path} bool")

    def integer(self, of: int, path: str) -> None:
        signed = -(2**63) <= of < 2**63
        self._head(INTEGER if signed else NATURAL, 0, path)
        self._number(path, "q" if signed else "Q", of)

    def real(self, of: float, path: str) -> None:
        self._head(REAL, 0, path)
        self._number(path, "d", float(of))

    def text(self, of: str, path: str) -> None:
        self._head(TEXT, len(of.encode()), f"{path}={of}")
        self._padded(of.encode())

    def struct(self, of: bytes, path: str) -> None:
        name = self.structs[path]
        ours, theirs = control_layout(self.precision), control_layout(self.precision, POINTER)
        if ours.size(name) != theirs.size(name):
            of = theirs.pack(name, ours.decode(name, of))
        self._head(TEXT, len(of), path)
        here = len(self.data)
        for leaf in _leaves(self.precision, name):
            self.numbers.append(Number(f"{path}.{leaf.path}", here + leaf.offset, leaf.format))
        self._padded(of)

    def table(self, of: Mapping[str, Any], path: str) -> None:
        self._head(TABLE, len(of), path)
        for key, value in of.items():
            self.data += struct.pack("<Q", len(key.encode()))
            self._padded(key.encode())
            self.value(value, f"{path}.{key}" if path else key)

    def matrix(self, of: Any, path: str) -> None:
        if of.ndim == 1:
            self.items(of.tolist(), path)
            return
        rows, columns = of.shape
        self._head(MATRIX, rows, f"{path} {rows}x{columns}")
        self.data += struct.pack("<Q", columns)
        for n, x in enumerate(of.ravel().tolist()):
            self._number(f"{path}.{n}", "d", x)

    def items(self, of: Any, path: str) -> None:
        items = list(of)
        if items and all(type(item) is float for item in items):
            self._head(NUMBERS, len(items), path)
            for n, x in enumerate(items):
                self._number(f"{path}.{n}", "d", x)
            return
        self._head(LIST, len(items), path)
        for n, item in enumerate(items):
            self.value(item, f"{path}.{n}")

    def _head(self, kind: int, count: int, shape: str) -> None:
        self.data += struct.pack("<II", kind, count)
        self.shape.append(f"{shape} {kind} {count}")

    def _number(self, path: str, format: str, value: float) -> None:
        self.numbers.append(Number(path, len(self.data), format))
        self.data += struct.pack(f"<{format}", value)

    def _padded(self, of: bytes) -> None:
        self.data += of + bytes(-len(of) % 8)


KINDS: tuple[tuple[type | tuple[type, ...], Callable[[_Packer, Any, str], None]], ...] = (
    (type(None), _Packer.none),
    (bool, _Packer.boolean),
    ((int, np.integer), _Packer.integer),
    ((float, np.floating), _Packer.real),
    (str, _Packer.text),
    (bytes, _Packer.struct),
    (Mapping, _Packer.table),
    (np.ndarray, _Packer.matrix),
    ((list, tuple), _Packer.items),
)
