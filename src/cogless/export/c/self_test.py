"""The self-test of an export: recorded inputs and expected outputs as C code."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from cogless.c_layout import Leaf
from cogless.export.c.edge_cases import COUNTS, FNV_PRIME, FNV_START, Stretch, fnv
from cogless.export.c.literals import array
from cogless.export.c.subject import Subject
from cogless.export.prepared import Reals, Recording

START_MEMORY = """
/* Memory that had been learned before. */
static const cgl_real memory_at_start[{length}] = {{
{numbers}
}};
"""
MOTION = """
/* The motion of the trial: theta_ref at each sample [rad]. */
static const cgl_real motion[{length}] = {{
{numbers}
}};
"""
TAKE_MEMORY = """    for (uint32_t n = 0; n < {NAME}_MEMORY_LENGTH; ++n) {{
        controller->memory[n] = memory_at_start[n];
    }}
"""
SUM = """
/* FNV-1a of the learned memory, word by word. */
static uint32_t memory_sum(const {name}_controller *controller)
{{
    uint32_t sum = FNV_START;
    for (uint32_t n = 0; n < {NAME}_MEMORY_LENGTH; ++n) {{
        sum = add(sum, bits_of(controller->memory[n]));
    }}
    return sum;
}}
"""
END = """    if (memory_sum(controller) != memory_at_end) {
        return UINT32_MAX - 1;
    }
"""
BEGIN = "    {name}_begin_trial(controller, motion);\n"


def self_test_words(
    subject: Subject, recording: Recording, memory: Reals, stretches: Sequence[Stretch]
) -> dict[str, str]:
    """Texts that fill the placeholders in the templates self_test.c and self_test_data.h."""
    layout = subject.layout
    measured, asked = layout.leaves("cgl_measurement"), layout.leaves("cgl_reference")
    given = layout.leaves("cgl_drive_output")
    names = [f"now.{leaf.path}" for leaf in measured] + [f"reference.{leaf.path}" for leaf in asked]
    pairs = zip(recording.measurements, recording.references, strict=True)
    inputs = [layout.bits("cgl_measurement", m) + layout.bits("cgl_reference", r) for m, r in pairs]
    taken = _Columns("in", names, inputs)
    outputs = [layout.bits("cgl_drive_output", out) for out in recording.outputs]
    wanted = _Columns("wanted", [leaf.path for leaf in given], outputs)
    reads = [
        f"{name} = {_read(leaf, word)};"
        for name, leaf, word in zip(names, [*measured, *asked], taken.words, strict=True)
    ]
    equal = [_equal(leaf, word) for leaf, word in zip(given, wanted.words, strict=True)]
    every = [
        f"{name} = {_read(leaf, f's->in[{n}]')};"
        for n, (name, leaf) in enumerate(zip(names, [*measured, *asked], strict=True))
    ]
    double = subject.precision == "d"
    return {
        "bits": "uint64_t" if double else "uint32_t",
        "fnv_start": str(FNV_START),
        "fnv_prime": str(FNV_PRIME),
        "folded": "(uint32_t)(next ^ (next >> 32))" if double else "next",
        "counts": str(COUNTS),
        "stretch_count": str(len(stretches)),
        "stretch_inputs": str(len(names)),
        "stretch_names": textwrap.fill(", ".join(names), 116, subsequent_indent=" * "),
        "stretches": "\n".join(map(_stretch, stretches)),
        "read_stretch": "\n".join(f"        {line}" for line in every),
        "sum_outputs": "\n".join(f"        sum = add(sum, {_word(leaf)});" for leaf in given),
        "input_count": str(len(taken.varying)),
        "output_count": str(len(wanted.varying)),
        "input_names": taken.header(),
        "output_names": wanted.header(),
        "inputs": taken.table(),
        "outputs": wanted.table(),
        "read_inputs": "\n".join(f"    {line}" for line in reads),
        "compare_outputs": "\n           && ".join(equal),
        **_memory(subject, recording, memory),
    }


class _Columns:
    """A table of numbers as bit patterns, with named columns.

    Columns that don't change are left out of the table. `words`: a C expression for each column.
    """

    def __init__(self, array: str, names: list[str], rows: list[tuple[int, ...]]) -> None:
        self._names, self._rows = names, rows
        first = rows[0] if rows else [0] * len(names)
        changing = [n for n in range(len(names)) if any(row[n] != first[n] for row in rows)]
        self.varying = changing or [0]  # C has no empty arrays
        place = {n: k for k, n in enumerate(self.varying)}
        self.words = [f"{array}[{place[n]}]" if n in place else _hex(first[n]) for n in range(len(names))]

    def header(self) -> str:
        """Names of the table's columns, for a comment."""
        names = ", ".join(self._names[n] for n in self.varying)
        return textwrap.fill(names, 116, subsequent_indent=" * ")

    def table(self) -> str:
        """Rows of the table in C, a line for each period."""
        rows = ([row[n] for n in self.varying] for row in self._rows)
        return "\n".join("    {" + ", ".join(map(_hex, row)) + "}," for row in rows)


def _hex(word: int) -> str:
    return f"{word:#x}" if word > 9 else str(word)


def memory_sum(memory: Reals) -> int:
    """Checksum of float32 or float64 numbers, the same as the C function of the self-test computes."""
    bits = np.ascontiguousarray(memory).view(np.uint32 if memory.dtype == np.float32 else np.uint64)
    return fnv(bits.tolist())


def _memory(subject: Subject, recording: Recording, memory: Reals) -> dict[str, str]:
    names = {"name": subject.name, "NAME": subject.name.upper()}
    data = start = begin = function = end_data = ""
    end = ""
    if memory.any():
        length = f"{names['NAME']}_MEMORY_LENGTH"
        data += START_MEMORY.format(length=length, numbers=array(memory, subject.precision))
        start += TAKE_MEMORY.format(**names)
    if recording.begun:
        kind: type[np.floating] = np.float64 if subject.precision == "d" else np.float32
        motion: Reals = np.frombuffer(recording.begun[0][1], kind)
        data += MOTION.format(length=len(motion), numbers=array(motion, subject.precision))
        begin = BEGIN.format(**names)
    if subject.memory_length:
        function = SUM.format(**names)
        total = memory_sum(recording.memory)
        end_data = (
            "\n/* Of the learned memory afterwards, see self_test.c. */\n"
            f"static const uint32_t memory_at_end = {total}U;\n"
        )
        end = END
    return {
        "start_data": data,
        "start": start + begin,
        "begin": begin,
        "memory_function": function,
        "end_data": end_data,
        "end": end,
    }


def _stretch(s: Stretch) -> str:
    inputs = ", ".join(map(_hex, s.inputs))
    return f"    /* {s.about} */\n    {{{s.periods}U, {s.counts}U, {s.step}U, {{{inputs}}}, {s.sum}U}},"


def _word(leaf: Leaf) -> str:
    return f"bits_of(out.{leaf.path})" if leaf.type == "cgl_real" else f"out.{leaf.path}"


def _read(leaf: Leaf, word: str) -> str:
    if leaf.type == "cgl_real":
        return f"real_of({word})"
    if leaf.type == "bool":
        return {"0": "false", "1": "true"}.get(word, f"{word} != 0")
    return f"({leaf.type}){word}"


def _equal(leaf: Leaf, word: str) -> str:
    return f"bits_of(out.{leaf.path}) == {word}" if leaf.type == "cgl_real" else f"out.{leaf.path} == {word}"
