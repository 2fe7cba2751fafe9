"""Convert structs of the control library to bytes and back, in the memory layout of this machine."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from cogless.control_library import Field, Headers, control_headers

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
SAME_BITS = {"f": "I", "d": "Q", "Q": "Q", "?": "B", "B": "B", "H": "H", "I": "I", "i": "I"}
POINTER = struct.calcsize("P")


class MisfitError(ValueError):
    """A number does not fit into a member of a C struct; the message names the member."""

    def __init__(self, member: str, number: Any, c_type: str) -> None:
        self.expected = f"expected a value of {c_type}"
        super().__init__(f"{member}: {number!r}: {self.expected}")


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


@dataclass(frozen=True)
class Layout:
    """Memory layout of the structs in one build of the library.

    `real`: format of the library's real numbers, "f" for float, "d" for double. `pointer`: a pointer's bytes.
    """

    headers: Headers
    real: str
    pointer: int = POINTER
    # caches of results that depend on the headers alone; without them a short run would be slower
    _sizes: dict[str, int] = field(default_factory=dict, repr=False)
    _places: dict[str, list[tuple[Field, int]]] = field(default_factory=dict, repr=False)
    _by_name: dict[str, dict[str, Field]] = field(default_factory=dict, repr=False)
    _packers: dict[str, struct.Struct] = field(default_factory=dict, repr=False)
    _bits: dict[str, struct.Struct] = field(default_factory=dict, repr=False)

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

        A list may be shorter than its array: the rest is zero. ValueError names a member that is missing or
        unknown. MisfitError, a ValueError, names a member whose type can't hold the value.
        """
        numbers: list[Any] = []
        self._collect(name, values, numbers, name)
        if name not in self._packers:
            self._packers[name] = self._whole(name, {})
        try:
            return self._packers[name].pack(*numbers)
        except (struct.error, OverflowError, TypeError):
            raise self._misfit(name, numbers) from None

    def bits(self, name: str, data: bytes | bytearray) -> tuple[int, ...]:
        """The bit pattern of every number of a struct, in memory order, without pointers."""
        if name not in self._bits:
            self._bits[name] = self._whole(name, SAME_BITS)
        return self._bits[name].unpack(data)

    def leaves(self, name: str) -> list[Leaf]:
        """Every number of a struct, in memory order, without pointers."""
        return list(self._leaves(name, "", 0))

    def _leaves(self, name: str, prefix: str, start: int) -> Iterator[Leaf]:
        for member, offset in self._offsets(name):
            if member.pointer:
                continue
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

    def _collect(self, name: str, values: Any, numbers: list[Any], where: str) -> None:
        """Append all numbers of a struct, in memory order."""
        members = self._members(name)
        odd = members.keys() ^ values.keys()
        if odd:
            odd_one = min(odd)
            raise ValueError(f"{where}.{odd_one}: {'unknown' if odd_one in values else 'missing'}")
        for key, member in members.items():
            value, enum = values[key], self.headers.enums.get(member.type)
            if member.pointer:
                if value is not None:
                    raise ValueError(f"{where}.{key}: expected None, since it is a pointer")
                continue
            items = [value] if member.length is None else list(value)
            if len(items) > (member.length or 1):
                raise ValueError(f"{where}.{key}: {len(items)} entries: expected at most {member.length}")
            for item in items:
                if member.type in self.headers.structs:
                    self._collect(member.type, item, numbers, f"{where}.{key}")
                elif isinstance(item, bool) != (member.type == "bool") or (enum and item not in enum):
                    raise ValueError(f"{where}.{key}: {item!r}: expected a value of {member.type}")
                else:
                    numbers.append(enum[item] if enum else item)
            if missing := (member.length or 1) - len(items):
                numbers += [0] * (missing * self._count(member.type))

    def _whole(self, name: str, formats: Mapping[str, str]) -> struct.Struct:
        """One format for all numbers of a struct, with the padding. `formats`: replacements of formats."""
        parts, end = ["="], 0  # "=": overflow raises
        for leaf in self.leaves(name):
            parts.append(f"{leaf.offset - end}x{formats.get(leaf.format, leaf.format)}")
            end = leaf.offset + struct.calcsize(leaf.format)
        return struct.Struct("".join([*parts, f"{self.size(name) - end}x"]))

    def _misfit(self, name: str, numbers: Sequence[Any]) -> MisfitError:
        """The error that names the first number that does not fit into its member."""
        for leaf, number in zip(self.leaves(name), numbers, strict=True):
            try:
                struct.pack(f"={leaf.format}", number)
            except (struct.error, OverflowError, TypeError):
                return MisfitError(f"{name}.{leaf.path}", number, leaf.type)
        raise AssertionError(name)

    def _count(self, name: str) -> int:
        """How many numbers a type has."""
        return len(self.leaves(name)) if name in self.headers.structs else 1

    def _members(self, name: str) -> dict[str, Field]:
        if name not in self._by_name:
            self._by_name[name] = {member.name: member for member in self.headers.structs[name]}
        return self._by_name[name]

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
                end = _up(end, self.pointer if member.pointer else self._alignment(member.type))
                places.append((member, end))
                end += self._bytes(member)
            self._places[name] = places
        return self._places[name]

    def _bytes(self, member: Field) -> int:
        return (self.pointer if member.pointer else self.size(member.type)) * (member.length or 1)

    def _alignment(self, name: str) -> int:
        if name not in self.headers.structs:
            return self.size(name)
        fields = self.headers.structs[name]
        return max(self.pointer if f.pointer else self._alignment(f.type) for f in fields)

    def _format(self, name: str) -> str:
        if name == "cgl_real":
            return self.real
        return "I" if name in self.headers.enums else PLAIN[name]


@cache
def control_layout(precision: str, pointer: int = POINTER) -> Layout:
    """Layout of the control library's structs in "single" or "double" precision.

    `pointer`: size of a pointer in bytes.
    """
    return Layout(control_headers(), {"single": "f", "double": "d"}[precision], pointer)


def _up(offset: int, alignment: int) -> int:
    return -(-offset // alignment) * alignment
