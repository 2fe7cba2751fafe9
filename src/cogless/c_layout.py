"""Convert structs of the control library to bytes and back, in the memory layout of this machine."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from cogless.c_headers import Field, Headers, control_headers

PLAIN = {
    "bool": "?",
    "uint8_t": "B",
    "uint16_t": "H",
    "uint32_t": "I",
    "uint64_t": "Q",
    "int32_t": "i",
    "unsigned": "I",
    "int": "i",
}
SAME_BITS = {"f": "I", "d": "Q", "Q": "Q", "?": "?", "B": "B", "H": "H", "I": "I", "i": "I"}
POINTER = struct.calcsize("P")


@dataclass(frozen=True)
class Leaf:
    """A single number within a struct.

    `path`: its name, such as "pi.kp" or "i_abc[1]". `offset`: bytes from the struct's start. `format`: its
    format code for Python's struct module.
    """

    path: str
    type: str
    offset: int
    format: str

    def value(self, data: bytes) -> float:
        """The number, read from the struct's bytes."""
        return float(struct.unpack_from(self.format, data, self.offset)[0])

    def bits(self, data: bytes) -> int:
        """The number's bit pattern, read from the struct's bytes; for a bool 0 or 1."""
        return int(struct.unpack_from(SAME_BITS[self.format], data, self.offset)[0])


@dataclass(frozen=True)
class Layout:
    """Memory layout of the structs in one build of the library.

    `real`: format of the library's real numbers, "f" for float, "d" for double.
    """

    headers: Headers
    real: str
    # what follows from the headers, kept since a run of a millisecond would feel it
    _sizes: dict[str, int] = field(default_factory=dict, repr=False)
    _places: dict[str, list[tuple[Field, int]]] = field(default_factory=dict, repr=False)

    def size(self, name: str) -> int:
        """Size of a type in bytes, padding included."""
        if name not in self._sizes:
            self._sizes[name] = self._size(name)
        return self._sizes[name]

    def decode(self, name: str, data: bytes) -> dict[str, Any]:
        """Decode a struct's bytes to its members by name.

        A member is a number, the name of an enum constant, a dict (struct) or a list (array). A pointer is
        None, since the bytes don't contain what it points to. ValueError: `data` has the wrong size.
        """
        if len(data) != self.size(name):
            raise ValueError(f"{name}: {len(data)} bytes: expected {self.size(name)}")
        return self._struct(name, data, 0)

    def pack(self, name: str, values: Mapping[str, Any]) -> bytes:
        """Encode a struct's members, in the form that `decode` returns, as bytes. All must be given.

        A list may be shorter than its array: the rest is zero. ValueError names the member that is missing,
        unknown or of the wrong type.
        """
        data = bytearray(self.size(name))
        self._put(name, values, data, 0, name)
        return bytes(data)

    def leaves(self, name: str) -> list[Leaf]:
        """Every number of a struct, in memory order; the struct must have no pointers."""
        return list(self._leaves(name, "", 0))

    def _leaves(self, name: str, prefix: str, start: int) -> Iterator[Leaf]:
        for member, offset in self._offsets(name):
            size = self.size(member.type)
            for n in range(member.length or 1):
                path = prefix + member.name + (f"[{n}]" if member.length is not None else "")
                at = start + offset + n * size
                if member.type in self.headers.structs:
                    yield from self._leaves(member.type, f"{path}.", at)
                else:
                    yield Leaf(path, member.type, at, self._format(member.type))

    def _struct(self, name: str, data: bytes, start: int) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for member, offset in self._offsets(name):
            at = start + offset
            if member.pointer:
                values[member.name] = None
            elif member.length is not None:
                places = range(at, at + self._bytes(member), self.size(member.type))
                values[member.name] = [self._value(member.type, data, place) for place in places]
            else:
                values[member.name] = self._value(member.type, data, at)
        return values

    def _value(self, name: str, data: bytes, at: int) -> Any:
        if name in self.headers.structs:
            return self._struct(name, data, at)
        (value,) = struct.unpack_from(self._format(name), data, at)
        if name not in self.headers.enums:
            return value
        for constant, number in self.headers.enums[name].items():
            if number == value:
                return constant
        raise ValueError(f"{name}: {value}: no such constant")

    def _put(self, name: str, value: Any, data: bytearray, at: int, where: str) -> None:
        if name in self.headers.structs:
            self._put_members(name, value, data, at, where)
            return
        try:
            number = self.headers.enums[name][value] if name in self.headers.enums else value
            if isinstance(value, bool) != (name == "bool"):
                raise TypeError
            struct.pack_into(f"={self._format(name)}", data, at, number)  # "=": overflow raises
        except (struct.error, OverflowError, TypeError, KeyError):
            raise ValueError(f"{where}: {value!r}: expected a value of {name}") from None

    def _put_members(self, name: str, values: Any, data: bytearray, at: int, where: str) -> None:
        fields = self.headers.structs[name]
        odd = {member.name for member in fields} ^ values.keys()
        if odd:
            odd_one = min(odd)
            raise ValueError(f"{where}.{odd_one}: {'unknown' if odd_one in values else 'missing'}")
        for member, offset in self._offsets(name):
            value, place = values[member.name], f"{where}.{member.name}"
            if member.pointer:
                if value is not None:
                    raise ValueError(f"{place}: expected None, since it is a pointer")
                continue
            items = [value] if member.length is None else list(value)
            if len(items) > (member.length or 1):
                raise ValueError(f"{place}: {len(items)} entries: expected at most {member.length}")
            size = self.size(member.type)
            for n, item in enumerate(items):
                self._put(member.type, item, data, at + offset + n * size, place)

    def _size(self, name: str) -> int:
        if name not in self.headers.structs:
            return struct.calcsize(self._format(name))
        end = 0
        for member, offset in self._offsets(name):
            end = offset + self._bytes(member)
        return _up(end, self._alignment(name))

    def _offsets(self, name: str) -> list[tuple[Field, int]]:
        if name not in self._places:
            places, end = [], 0
            for member in self.headers.structs[name]:
                end = _up(end, POINTER if member.pointer else self._alignment(member.type))
                places.append((member, end))
                end += self._bytes(member)
            self._places[name] = places
        return self._places[name]

    def _bytes(self, member: Field) -> int:
        return (POINTER if member.pointer else self.size(member.type)) * (member.length or 1)

    def _alignment(self, name: str) -> int:
        if name not in self.headers.structs:
            return self.size(name)
        fields = self.headers.structs[name]
        return max(POINTER if f.pointer else self._alignment(f.type) for f in fields)

    def _format(self, name: str) -> str:
        if name == "cgl_real":
            return self.real
        return "I" if name in self.headers.enums else PLAIN[name]


@cache
def control_layout(precision: str) -> Layout:
    """Layout of the control library's structs in "single" or "double" precision."""
    return Layout(control_headers(), {"single": "f", "double": "d"}[precision])


def _up(offset: int, alignment: int) -> int:
    return -(-offset // alignment) * alignment
