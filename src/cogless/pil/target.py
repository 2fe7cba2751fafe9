"""The exported controller, compiled for the Cortex-M4F and run on its emulation as a drive's controller."""

from __future__ import annotations

import tempfile
from collections import Counter
from contextlib import ExitStack
from functools import cached_property
from importlib.resources import as_file, files
from pathlib import Path
from string import Template

import numpy as np

from cogless.errors import StudyError
from cogless.export.c.export_c import contents, subject_of
from cogless.export.c.parts import parts
from cogless.export.c.subject import Subject, stem
from cogless.export.prepared import Prepared, Reals, Recording
from cogless.export.sources import defined_in
from cogless.pil.processor import Function, Image, Processor, Visits, read
from cogless.pil.toolchain import Toolchain

# C source: memory for inputs and outputs, and references to functions, so that the linker keeps them.
EXCHANGE = """#include "${stem}.h"

${name}_controller pil_controller;
__attribute__((section(".exchange"))) struct {
    cgl_measurement now;
    cgl_reference reference;
    cgl_drive_output out;
    cgl_real motion[${motion}];
    cgl_real over_bus[3]; /* to the law: angle and speed; from it: i_q_ref */
} pil_exchange = {.reference = {.learn = true}};
${parts}__attribute__((section(".functions"), used))
const void *const pil_functions[] = {&pil_controller, ${functions}};
"""

# C source in place of EXCHANGE for a law without a drive.
LAW_EXCHANGE = """#include "${stem}.h"

${name}_controller pil_controller;
__attribute__((section(".exchange"))) ${output} pil_exchange;
__attribute__((section(".functions"), used))
const void *const pil_functions[] = {&pil_controller, ${functions}};
"""

# C source: the parts of the exported step before the law, the law, and after the law, for a drive with a bus.
PARTS = """
bool pil_measure(${name}_controller *controller, const cgl_measurement *now, const cgl_reference *reference)
{
    cgl_drive *drive = &controller->drive;
    const bool due = cgl_drive_measure(drive, now, reference);
    pil_exchange.over_bus[0] = drive->monitor.theta_m;
    pil_exchange.over_bus[1] = drive->monitor.omega_m;
    return due;
}

void pil_law(${name}_controller *controller)
{
    cgl_drive *drive = &controller->drive;
    cgl_law_output command = drive->command;
    drive->in.theta_m = pil_exchange.over_bus[0];
    drive->in.omega_m = pil_exchange.over_bus[1];
    ${law_step}(&controller->law, &drive->in, &command);
    pil_exchange.over_bus[2] = command.i_q_ref;
    drive->command.status = command.status;
}

void pil_actuate(${name}_controller *controller, bool received, cgl_drive_output *out)
{
    cgl_drive *drive = &controller->drive;
    if (received) {
        drive->command.i_q_ref = pil_exchange.over_bus[2];
    }
    cgl_drive_actuate(drive, out);
${compensate}}
"""


COMPILER_PART = "compiler's library"


class Target:
    """The exported controller on the emulated processor, as an object that `Drive.advance` takes.

    `counts`: instructions of each step. `ends`: instructions of each end of a trial. `most_with_law`: most
    instructions of each source file in a tick in which the law runs. The law runs in the first tick of a
    trial, and a trial is a whole number of the law's periods long.
    """

    def __init__(self, subject: Subject, image: Image, memory: Reals) -> None:
        self._subject, self._image = subject, image
        self._processor = Processor(image)
        self._dtype = np.dtype(np.float64 if subject.precision == "d" else np.float32)
        self._controller = image.symbols["pil_controller"].address
        size = subject.layout.size
        self._in = image.symbols["pil_exchange"].address
        self._reference = self._in + size("cgl_measurement")
        self._out = self._reference + size("cgl_reference")
        self._out_size = size(subject.output)
        self._motion = self._out + self._out_size
        values = subject.law_config["samples"] if subject.law.name == "trial" else 1
        self._over_bus = self._motion + values * self._dtype.itemsize
        self.counts: list[int] = []
        self.ends: list[int] = []
        self._with_law: Visits = Counter()
        self._without_law: Visits = Counter()
        self.most_with_law: dict[str, int] = {}
        self._sources: dict[Function, str] = {}
        error = self._call("init", self._controller)
        if error != 0:
            raise StudyError(f"pil: {subject.name}_init returned {error}: expected CGL_OK, 0")
        if len(memory):
            self._processor.write(self._memory, memory.astype(self._dtype).tobytes())
        self._processor.take_instructions()

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        self._processor.write(self._in, measurement + reference)
        self._call("step", self._controller, self._in, self._reference, self._out)
        return self._output()

    def _output(self) -> bytes:
        """Count the instructions of the step that has just run, and return its output."""
        due = len(self.counts) % self._subject.divider == 0
        visits: Visits = Counter()
        self.counts.append(self._processor.take_instructions(visits))
        (self._with_law if due else self._without_law).update(visits)
        if due:
            for source, count in self._instructions_of(visits).items():
                self.most_with_law[source] = max(count, self.most_with_law.get(source, 0))
        return self._processor.read(self._out, self._out_size)

    def measure(self, measurement: bytes, reference: bytes) -> tuple[bool, float, float]:
        self._processor.write(self._in, measurement + reference)
        due = self._processor.call("pil_measure", self._controller, self._in, self._reference)
        theta_m, omega_m, _ = self._exchanged
        return bool(due & 1), float(theta_m), float(omega_m)

    def law(self, theta_m: float, omega_m: float) -> float:
        self._processor.write(self._over_bus, np.array([theta_m, omega_m], self._dtype).tobytes())
        self._processor.call("pil_law", self._controller)
        return float(self._exchanged[2])

    def actuate(self, i_q_ref: float | None) -> bytes:
        received = np.array([0.0, 0.0, 0.0 if i_q_ref is None else i_q_ref], self._dtype)
        self._processor.write(self._over_bus, received.tobytes())
        self._processor.call("pil_actuate", self._controller, int(i_q_ref is not None), self._out)
        return self._output()

    @property
    def _exchanged(self) -> Reals:
        return np.frombuffer(self._processor.read(self._over_bus, 3 * self._dtype.itemsize), self._dtype)

    def begin(self, trajectory: bytes) -> None:
        self._processor.write(self._motion, trajectory)
        self._call("begin_trial", self._controller, self._motion)
        self._processor.take_instructions()

    def end(self) -> None:
        self._call("end_trial", self._controller)
        self.ends.append(self._processor.take_instructions())

    def by_source(self) -> tuple[dict[str, float], dict[str, float]]:
        """{source file: mean instructions per tick}, over ticks with the law, and over ticks without it."""
        due = -(-len(self.counts) // self._subject.divider)
        return self._by_source(self._with_law, due), self._by_source(
            self._without_law, len(self.counts) - due
        )

    def _by_source(self, tally: Visits, ticks: int) -> dict[str, float]:
        per_tick = {source: count / ticks for source, count in self._instructions_of(tally).items()}
        return dict(sorted(per_tick.items(), key=lambda entry: -entry[1]))

    def _instructions_of(self, tally: Visits) -> dict[str, int]:
        """Instructions in a tally, summed for each source file."""
        totals: dict[str, int] = {}
        for function, count in self._processor.by_function(tally).items():
            source = self._source(function)
            totals[source] = totals.get(source, 0) + count
        return totals

    @cached_property
    def _homes(self) -> dict[str, str]:
        return defined_in()

    def _source(self, function: Function) -> str:
        """The source file of a function, without suffix."""
        if function not in self._sources:
            own = function.name.startswith((f"{self._subject.name}_", "pil_"))
            home = stem(self._subject.name) if own else self._homes.get(function.name, COMPILER_PART)
            self._sources[function] = function.file or home
        return self._sources[function]

    @property
    def memory(self) -> Reals:
        """Contents of the law's memory in the processor's RAM."""
        length = self._subject.memory_length
        if not length:
            return np.zeros(0, self._dtype)
        data = self._processor.read(self._memory, length * self._dtype.itemsize)
        return np.frombuffer(data, self._dtype)

    @property
    def stack(self) -> int:
        """Largest use of the stack so far, bytes."""
        return self._processor.stack

    @property
    def _memory(self) -> int:
        """Address of the law's memory, which is the last member of the controller's struct."""
        symbol = self._image.symbols["pil_controller"]
        return symbol.address + symbol.size - self._subject.memory_length * self._dtype.itemsize

    def _call(self, function: str, *arguments: int) -> int:
        return self._processor.call(f"{self._subject.name}_{function}", *arguments)


class CoilTarget(Target):
    """The exported law `microstepping`, without a drive: references in, the coils' currents out."""

    def __init__(self, subject: Subject, image: Image, memory: Reals) -> None:
        super().__init__(subject, image, memory)
        self._out = self._in

    def step(self, measurement: bytes, reference: bytes) -> bytes:
        motion = reference[: 2 * self._dtype.itemsize]  # theta_ref and omega_ref, the first members
        name = f"{self._subject.name}_step"
        self._processor.call(name, self._controller, self._out, reals=motion)
        return self._output()


def build(prepared: Prepared, toolchain: Toolchain) -> tuple[Subject, Image]:
    """Compile the unchanged files of an export for the Cortex-M4F; StudyError if the compiler fails."""
    subject = subject_of(prepared)
    with ExitStack() as stack:
        assets = stack.enter_context(as_file(files("cogless.pil").joinpath("assets")))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for name, data in contents(subject, prepared, Recording()).items():
            path = folder / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
        (folder / "exchange.c").write_text(_exchange(subject, prepared.has_bus), encoding="utf-8")
        own = [folder / "exchange.c", folder / f"{stem(subject.name)}.c", assets / "runtime.c"]
        toolchain.build(
            [*own, *sorted((folder / "cogless").glob("*.c"))],
            assets / "image.ld",
            folder / "image.elf",
            subject.defines,
        )
        return subject, read(folder / "image.elf")


def _exchange(subject: Subject, has_bus: bool) -> str:
    trials = subject.law.name == "trial"
    functions = ["init", "reset", "step", *(["begin_trial", "end_trial"] if trials else [])]
    functions += ["calibrate"] if subject.law.name == "anti-cogging" else []
    names = [f"{subject.name}_{function}" for function in functions]
    names += ["pil_measure", "pil_law", "pil_actuate"] if has_bus else []
    words = {"stem": stem(subject.name), "name": subject.name, "law_step": subject.law.step}
    words["motion"] = str(subject.law_config["samples"] if trials else 1)
    words["functions"] = ", ".join(f"(const void *){name}" for name in names)
    words["parts"] = Template(PARTS).substitute(words | parts(subject)) if has_bus else ""
    words["output"] = subject.output
    return Template(EXCHANGE if subject.has_drive else LAW_EXCHANGE).substitute(words)
