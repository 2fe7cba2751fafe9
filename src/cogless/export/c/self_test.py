"""The self-test of an export: recorded inputs and expected outputs as C code.

The self-test also has unusual inputs, above all limits and faults, which an ordinary recording lacks.
"""

from __future__ import annotations

import math
import struct
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cogless.c_layout import Leaf
from cogless.c_literals import array
from cogless.export.c.subject import Subject
from cogless.export.prepared import Prepared, Reals, Recording

ANGLE_COUNTS = 1 << 20  # steps of the angle per revolution; a float represents each of them exactly
INSIDE_BOUND, OUTSIDE_BOUND = 0.97, 1.03  # factors on a bound
HUGE_SPEED = 1e6  # rad/s
LARGEST_INPUT = 3e38
STRETCH_PERIODS_MOST = 5_000  # periods of a stretch, or of a time within it
BETA_SHARE_OF_B = math.sqrt(3) / 2  # share of phase b in a vector on the beta axis
FNV_START, FNV_PRIME = 2166136261, 16777619


@dataclass(frozen=True)
class Stretch:
    """Successive periods in which only the angle changes, by `step` counts per period.

    `sum`: FNV-1a checksum of all outputs.
    """

    title: str
    periods: int
    counts: int  # angle in the first period
    step: int
    inputs: tuple[int, ...]  # bit patterns of measurement and reference; theta_m is an offset to the angle
    sum: int


@dataclass(frozen=True, kw_only=True)
class _Inputs:
    """Measurements and references of a step, in SI units. NaN: a measurement is missing."""

    i_abc: tuple[float, float, float]
    omega_m: float
    omega_ref: float
    u_dc: float
    theta_m: float = 0.0
    learn: bool = True
    torque: bool = False
    i_q_ref: float = 0.0


def awkward(subject: Subject, prepared: Prepared, motion: bytes | None) -> list[Stretch]:
    """Stretches of unusual inputs, with checksums of the controller's outputs.

    The engine's controller runs through all stretches, one after the other, from its initial state.
    `motion`: reference of a trial, as bytes.
    """
    state = prepared.drive.start()
    if motion is not None:
        prepared.drive.begin_trial(state, motion)
    layout, counts, stretches = subject.layout, 0, []
    measured, asked = layout.leaves("cgl_measurement"), layout.leaves("cgl_reference")
    real: type[np.floating[Any]] = np.float64 if subject.precision == "d" else np.float32
    for title, periods, jump, step, inputs in _plan(subject):
        counts += jump
        now, reference = bytearray(layout.size("cgl_measurement")), bytearray(layout.size("cgl_reference"))
        values = _values(inputs)
        for leaves, data in ((measured, now), (asked, reference)):
            for leaf in leaves:
                struct.pack_into(leaf.format, data, leaf.offset, values.get(leaf.path, 0.0))
        words = layout.bits("cgl_measurement", now) + layout.bits("cgl_reference", reference)
        place = next(leaf for leaf in measured if leaf.path == "theta_m")
        total = FNV_START
        turned = ((counts + step * np.arange(periods)) % ANGLE_COUNTS).astype(real)
        for angle in real(inputs.theta_m) + turned * (real(math.tau) / real(ANGLE_COUNTS)):
            struct.pack_into(place.format, now, place.offset, angle)
            out: bytes = prepared.drive.step_controller(state, bytes(now), bytes(reference))
            total = fnv(layout.bits("cgl_drive_output", out), total)
        stretches.append(
            Stretch(
                title=title, periods=periods, counts=counts % ANGLE_COUNTS, step=step, inputs=words, sum=total
            )
        )
        counts += periods * step
    return stretches


def fnv(words: Iterable[int], total: int = FNV_START) -> int:
    """FNV-1a checksum over words, as the self-test computes it; a word of 64 bits is folded into 32."""
    for word in words:
        total = ((total ^ word ^ (word >> 32)) & 0xFFFFFFFF) * FNV_PRIME & 0xFFFFFFFF
    return total


def _values(inputs: _Inputs) -> dict[str, Any]:
    """Values of the inputs, by their paths in the C structs."""
    values = {f"i_abc[{n}]": _limited_input(current) for n, current in enumerate(inputs.i_abc)}
    values |= {
        name: _limited_input(getattr(inputs, name))
        for name in ("theta_m", "omega_m", "u_dc", "omega_ref", "i_q_ref")
    }
    return {**values, "learn": inputs.learn, "torque": inputs.torque}


def _limited_input(value: float) -> float:
    """The value, limited to +-LARGEST_INPUT, which a float holds; NaN stays NaN."""
    return math.copysign(LARGEST_INPUT, value) if abs(value) > LARGEST_INPUT else value


def _plan(subject: Subject) -> list[tuple[str, int, int, int, _Inputs]]:
    """Plan of the stretches, each with description, number of periods, two angles and inputs.

    The angles, in counts, are the jump before the first period and the step per period.
    """
    config, monitor = subject.drive_config, subject.drive_config["monitor"]
    limit, law, ts = config["foc"]["current_limit"], subject.divider, 1 / subject.rate
    hold, bridge, window = (_periods(monitor[key], ts) for key in ("hold", "bridge", "speed_window"))
    back = min(hold + bridge + window, STRETCH_PERIODS_MOST) + 2 * law + 4
    turn = min(monitor["omega_max"] * ts / 2 or 0.01, 0.05)  # rad per period
    step = max(1, round(turn / math.tau * ANGLE_COUNTS))
    speed = step * math.tau / ANGLE_COUNTS / ts
    whole = (
        min(math.ceil(config["quality"]["span"] / (speed * ts)), STRETCH_PERIODS_MOST) + 2 * law
    )  # periods of a window in which the quality is judged

    def currents(length: float) -> tuple[float, float, float]:
        """Phase currents of a vector with this length on the beta axis."""
        return (
            (0.0, length, 0.0)
            if monitor["phases"] == 2
            else (0.0, BETA_SHARE_OF_B * length, -BETA_SHARE_OF_B * length)
        )

    length = 0.3 * min(limit, monitor["current_max"] or limit)
    plain = _Inputs(i_abc=currents(length), omega_m=speed, omega_ref=1.01 * speed, u_dc=_bus(subject))
    up = replace(plain, omega_ref=HUGE_SPEED, omega_m=-speed)
    plan = [
        ("a small error", whole // 2, 0, step, plain),
        ("and one the other way", whole - whole // 2, 0, step, replace(plain, omega_ref=0.99 * speed)),
        ("a large one: the output saturates", 2 * law, 0, step, up),
        ("the other way", 2 * law, 0, step, replace(up, omega_ref=-HUGE_SPEED, omega_m=speed)),
    ]
    for part, what in ((INSIDE_BOUND, "just within"), (OUTSIDE_BOUND, "beyond")):
        bounds = [
            ("the current", {"i_abc": currents(part * monitor["current_max"])}, monitor["current_max"]),
            ("their sum", {"i_abc": (part * monitor["current_sum"], 0.0, 0.0)}, monitor["current_sum"]),
            ("the speed", {"omega_m": part * monitor["omega_max"]}, monitor["omega_max"]),
        ]
        for name, change, bound in bounds:
            if bound:
                plan.append((f"{name} {what} its bound", 2, 0, step, replace(plain, **change)))
    slower = replace(plain, omega_m=0.9 * speed)
    plan += [
        ("a current that is no number", 1, 0, step, replace(plain, i_abc=(math.nan, 0.0, 0.0))),
        ("a bus voltage that is no number", 1, 0, step, replace(plain, u_dc=math.nan)),
        ("all is well again", back, 0, step, plain),
        ("the angle jumps, and the speed is not believed", 2 * law + window, ANGLE_COUNTS // 2, step, slower),
        ("the angle jumps back", 2 * law + window, ANGLE_COUNTS // 2, step, plain),
        (
            "the angle is missing, for as long as the controller bridges it",
            bridge,
            0,
            step,
            replace(plain, theta_m=math.nan),
        ),
        ("the angle is missing for longer", 3, 0, step, replace(plain, theta_m=math.nan)),
        ("all is well again", back, 0, step, plain),
    ]
    if monitor["stuck_angle"]:
        # Two cases: the reference has turned by stuck_angle before stuck_time has passed, or only after that.
        # Speed and currents are almost as far from their references as the monitor allows, so the output is
        # at its limit. A law that follows an angle pushes one way only, so the reference turns both ways.
        time = _periods(monitor["stuck_time"], ts)
        away, pushed = (
            INSIDE_BOUND * (monitor["omega_max"] or HUGE_SPEED),
            INSIDE_BOUND * (monitor["current_max"] or 2 * limit),
        )
        for until, periods in ((10.5, time + 15 + law), (2 * time + 10.5, 2 * time + 13)):
            for way in (1.0, -1.0):
                asked = way * monitor["stuck_angle"] / (until * ts)
                stuck = replace(plain, i_abc=currents(pushed), omega_m=-way * away, omega_ref=asked)
                plan += [
                    (
                        "the angle stands still under full current",
                        min(periods, STRETCH_PERIODS_MOST),
                        0,
                        0,
                        stuck,
                    ),
                    ("all is well again", back, 0, step, plain),
                ]
    plan += [
        ("learning is frozen", 2 * law, 0, step, replace(plain, learn=False)),
        ("torque mode", 2 * law, 0, step, replace(plain, torque=True, i_q_ref=0.2 * limit)),
        ("and back", 2 * law, 0, step, plain),
    ]
    return [entry for entry in plan if entry[1] > 0]


def _bus(subject: Subject) -> float:
    """The study's bus voltage, V; 0 without an inverter."""
    inverter = subject.study.drive.inverter if subject.study.drive is not None else None
    return inverter.bus_voltage if inverter is not None else 0.0


def _periods(time: float, ts: float) -> int:
    """A time (s) as a number of periods, as the monitor counts them; at most STRETCH_PERIODS_MOST."""
    return min(math.ceil(time / ts * 0.999), STRETCH_PERIODS_MOST)


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
MEMORY_CHECK = """    if (memory_sum(controller) != memory_at_end) {
        return UINT32_MAX - 1;
    }
"""
BEGIN_TRIAL = "    {name}_begin_trial(controller, motion);\n"


def self_test_words(
    subject: Subject, recording: Recording, memory: Reals, stretches: Sequence[Stretch]
) -> dict[str, str]:
    """Texts that fill the placeholders in the templates self_test.c and self_test_data.h."""
    layout = subject.layout
    measured, asked = layout.leaves("cgl_measurement"), layout.leaves("cgl_reference")
    leaves = layout.leaves("cgl_drive_output")
    names = [f"now.{leaf.path}" for leaf in measured] + [f"reference.{leaf.path}" for leaf in asked]
    pairs = zip(recording.measurements, recording.references, strict=True)
    inputs = [layout.bits("cgl_measurement", m) + layout.bits("cgl_reference", r) for m, r in pairs]
    taken = _Columns("in", names, inputs)
    outputs = [layout.bits("cgl_drive_output", out) for out in recording.outputs]
    expected = _Columns("wanted", [leaf.path for leaf in leaves], outputs)
    reads = [
        f"{name} = {_read(leaf, word)};"
        for name, leaf, word in zip(names, [*measured, *asked], taken.words, strict=True)
    ]
    equal = [_equal(leaf, word) for leaf, word in zip(leaves, expected.words, strict=True)]
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
        "counts": str(ANGLE_COUNTS),
        "stretch_count": str(len(stretches)),
        "stretch_inputs": str(len(names)),
        "stretch_names": textwrap.fill(", ".join(names), 116, subsequent_indent=" * "),
        "stretches": "\n".join(map(_stretch, stretches)),
        "read_stretch": "\n".join(f"        {line}" for line in every),
        "sum_outputs": "\n".join(f"        sum = add(sum, {_word(leaf)});" for leaf in leaves),
        "input_count": str(len(taken.varying)),
        "output_count": str(len(expected.varying)),
        "input_names": taken.header(),
        "output_names": expected.header(),
        "inputs": taken.table(),
        "outputs": expected.table(),
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
    """FNV-1a checksum of float32 or float64 numbers, as the C function `memory_sum` computes it."""
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
        begin = BEGIN_TRIAL.format(**names)
    if subject.memory_length:
        function = SUM.format(**names)
        total = memory_sum(recording.memory)
        end_data = (
            "\n/* Of the learned memory afterwards, see self_test.c. */\n"
            f"static const uint32_t memory_at_end = {total}U;\n"
        )
        end = MEMORY_CHECK
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
    return f"    /* {s.title} */\n    {{{s.periods}U, {s.counts}U, {s.step}U, {{{inputs}}}, {s.sum}U}},"


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
