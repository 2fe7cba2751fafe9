"""Compare the emulated processor with the simulation bit for bit, and count instructions and memory.

Write the result as lines of text.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cogless.c_layout import Layout
from cogless.export.c.subject import Subject
from cogless.export.prepared import Prepared, Recording, prepare, record, run
from cogless.pil.processor import Image
from cogless.pil.target import CoilTarget, Target, build
from cogless.pil.toolchain import Toolchain
from cogless.run.run_plan import RunProgress
from cogless.study import AnyStudy

TICKS_DEFAULT = 100_000
REPORT_TICKS = 1000  # ticks between two reports of progress


@dataclass(frozen=True)
class Difference:
    """The first value that differs. `tick`: from 0. `field`: member of the struct, or entry of the memory."""

    tick: int
    field: str
    simulation: float
    processor: float


@dataclass(frozen=True)
class Instructions:
    """Number of instructions per tick: fewest, mean, most."""

    least: int
    mean: float
    most: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Result for one controller: first difference from the simulation, instructions, memory.

    `all`, `with_law`, `without_law`: instructions per tick, over all ticks, over ticks in which the law runs,
    and over the other ticks. `by_source_...`: the means, by source file. `most_by_source_with_law`: the most
    in a tick in which the law runs. A function that the compiler inlined counts for its caller's file.

    Sizes are in bytes. `flash`: code and constants; `constants`: the part of the flash that holds the
    controller's configuration. `ram`: the controller's struct; `memory`: the part of the struct that the law
    learns into.
    """

    study: str
    scenario: str
    controller: str
    law: str
    ticks: int
    difference: Difference | None
    all: Instructions
    with_law: Instructions
    without_law: Instructions | None
    end_of_trial: int | None  # most instructions at the end of a trial; None without trials
    by_source_with_law: dict[str, float]
    by_source_without_law: dict[str, float]
    most_by_source_with_law: dict[str, int]
    stack: int
    flash: int
    constants: int
    ram: int
    memory: int
    compiler: str
    flags: str


def compare(
    study: AnyStudy,
    controller: str,
    scenario: str,
    ticks: int | None,
    toolchain: Toolchain,
    progress: RunProgress = lambda share: None,
) -> Comparison:
    """Run the simulation, then the processor in closed loop with the same plant, and compare them.

    A law without a drive has no feedback, so it runs without the plant, on the simulation's references.
    `ticks`: default 100,000; at most those of the scenario. StudyError: simulation or processor fails.
    """
    prepared = prepare(study, scenario, controller)
    ticks = min(ticks or TICKS_DEFAULT, prepared.ticks)
    subject, image = build(prepared, toolchain)
    recording = record(prepared, ticks)
    target = (Target if subject.has_drive else CoilTarget)(subject, image, prepared.memory)
    watched = _Watched(target, subject.layout, recording, ticks, progress, subject.output)
    if subject.has_drive:
        run(prepared, watched, ticks)
    else:  # it has no feedback
        for measurement, reference in zip(recording.measurements, recording.references, strict=True):
            watched.step(measurement, reference)
    difference = watched.difference or _memory_difference(target, recording, ticks)
    return _comparison(prepared, subject, image, target, difference, toolchain)


class _Watched:
    """A target whose outputs are compared with those of the simulation, tick by tick."""

    def __init__(
        self,
        target: Target,
        layout: Layout,
        expected: Recording,
        ticks: int,
        progress: RunProgress,
        output: str = "cgl_drive_output",
    ) -> None:
        self._output = output
        self._target, self._layout, self._wanted = target, layout, expected
        self._ticks, self._progress, self._tick = ticks, progress, 0
        self._measurement = b""
        self.difference: Difference | None = None

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        return self._watched(measurement, self._target.step(measurement, reference))

    def measure(self, measurement: bytes, reference: bytes) -> tuple[bool, float, float]:
        self._measurement = measurement
        return self._target.measure(measurement, reference)

    def law(self, theta_m: float, omega_m: float) -> float:
        return self._target.law(theta_m, omega_m)

    def actuate(self, i_q_ref: float | None) -> bytes:
        return self._watched(self._measurement, self._target.actuate(i_q_ref))

    def _watched(self, measurement: bytes, out: bytes) -> bytes:
        """Compare output and measurement with those of the simulation, and return the output."""
        tick, recording = self._tick, self._wanted
        self._tick += 1
        if out != recording.outputs[tick] or measurement != recording.measurements[tick]:
            self._compare(self._output, recording.outputs[tick], out)
            self._compare("cgl_measurement", recording.measurements[tick], measurement)
        if tick % REPORT_TICKS == 0:
            self._progress(tick / self._ticks)
        return out

    def begin(self, trajectory: bytes) -> None:
        self._target.begin(trajectory)

    def end(self) -> None:
        self._target.end()

    def _compare(self, struct: str, expected: bytes, got: bytes) -> None:
        """Compare two structs number by number, since their padding may differ."""
        bits = self._layout.bits
        if self.difference or bits(struct, expected) == bits(struct, got):
            return
        pairs = zip(self._layout.leaves(struct), bits(struct, expected), bits(struct, got), strict=True)
        leaf = next(leaf for leaf, a, b in pairs if a != b)
        self.difference = Difference(self._tick - 1, leaf.path, leaf.value(expected), leaf.value(got))


def _memory_difference(target: Target, recording: Recording, ticks: int) -> Difference | None:
    """The first difference between the law's memory on the processor and in the simulation, at the end.

    None if both are equal.
    """
    got = target.memory
    if got.tobytes() == recording.memory.tobytes():
        return None
    kind = np.uint64 if got.dtype == np.float64 else np.uint32
    n = int(np.argmax(got.view(kind) != recording.memory.view(kind)))
    return Difference(ticks, f"memory[{n}]", float(recording.memory[n]), float(got[n]))


def _comparison(
    prepared: Prepared,
    subject: Subject,
    image: Image,
    target: Target,
    difference: Difference | None,
    toolchain: Toolchain,
) -> Comparison:
    counts = np.asarray(target.counts)
    by_source = target.by_source()
    due = np.arange(len(counts)) % subject.divider == 0
    configs = (
        f"{subject.name}_drive_config",
        f"{subject.name}_law_config",
        f"{subject.name}_learning_matrix",
    )
    return Comparison(
        study=prepared.study.name,
        scenario=prepared.scenario,
        controller=prepared.controller,
        law=subject.law.name,
        ticks=len(counts),
        difference=difference,
        all=_instructions(counts),
        with_law=_instructions(counts[due]),
        without_law=_instructions(counts[~due]) if not due.all() else None,
        end_of_trial=max(target.ends, default=None),
        by_source_with_law=by_source[0],
        by_source_without_law=by_source[1],
        most_by_source_with_law=target.most_with_law,
        stack=target.stack,
        flash=image.flash,
        constants=sum(image.symbols[name].size for name in configs if name in image.symbols),
        ram=image.symbols["pil_controller"].size,
        memory=subject.memory_length * subject.layout.size("cgl_real"),
        compiler=toolchain.name,
        flags=" ".join(toolchain.flags),
    )


def _instructions(counts: Any) -> Instructions:
    return Instructions(int(counts.min()), float(counts.mean()), int(counts.max()))


NAME_COLUMNS = 18  # width of the name before each value in `comparison_lines`


def comparison_lines(comparison: Comparison) -> list[str]:
    """Lines that `cogless pil` prints."""
    rows = [
        ("result", "every output and all learned values: bit for bit equal"),
        (
            "compared",
            f"{comparison.ticks} periods of {comparison.study}, "
            f"{comparison.scenario}/{comparison.controller}",
        ),
        ("instructions", _instruction_counts(comparison.all)),
        ("  with the law", _instruction_counts(comparison.with_law)),
        ("  without", _instruction_counts(comparison.without_law)),
        ("  where, with", _sources(comparison.by_source_with_law)),
        ("  where, without", _sources(comparison.by_source_without_law)),
        ("  end of a trial", str(comparison.end_of_trial or "")),
        ("stack", f"{comparison.stack} bytes"),
        ("flash", f"{comparison.flash} bytes, {comparison.constants} of them the configured constants"),
        ("RAM", f"{comparison.ram} bytes, {comparison.memory} of them memory of the learned values"),
        ("compiler", f"{comparison.compiler} {comparison.flags}"),
    ]
    if comparison.difference is not None:
        rows[0] = ("result", _difference(comparison.difference, comparison.ticks))
    return [f"{name:<{NAME_COLUMNS}}{value}" for name, value in rows if value]


def _difference(d: Difference, ticks: int) -> str:
    where = "at the end" if d.tick == ticks else f"period {d.tick}"
    return f"NOT equal: {where}: {d.field}: simulation {d.simulation!r}, processor {d.processor!r}"


def _instruction_counts(comparison: Instructions | None) -> str:
    return f"{comparison.least} to {comparison.most}, mean {comparison.mean:.1f}" if comparison else ""


def _sources(by_source: dict[str, float]) -> str:
    return ", ".join(f"{name} {count:.0f}" for name, count in by_source.items() if count >= 0.5)
