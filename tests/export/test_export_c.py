"""An exported controller compiles as it is and repeats the simulation bit for bit; mistakes are one line."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import ceil, nan, sqrt, tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trial_studies
from commands import cogless
from kept import kept, version
from laws import OF_SPEED

import studies
from cogless import c_literals as literals
from cogless import load
from cogless.c_literals import real
from cogless.control_library import Field
from cogless.errors import StudyError
from cogless.export import sources
from cogless.export.c import export_c as room
from cogless.export.c.export_c import export_c, subject_of
from cogless.export.c.self_test import ANGLE_COUNTS, STRETCH_PERIODS_MOST, _plan, awkward, memory_sum
from cogless.export.c.subject import Subject, identifier, study_hash
from cogless.export.prepared import prepare

STRICT = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror"]
FLAGS = ["-std=c99", "-O1", "-ffp-contract=off"]  # more takes longer, and rounds alike
LIBRARY = Path(__file__).parents[2] / "control" / "src" / "cogless"
CELLS = {"controller.pi-ilc.cells": 300}
ASKS = "Compiled with -ffp-contract=off, and without -ffast-math[?]\n"
# study, controller, changes: every law, and the memory by delay, and double precision
CONTROLLERS: list[tuple[str, str, dict[str, Any]]] = [
    ("liu2018", "pi", {}),
    ("liu2018", "adrc", studies.ADRC),
    ("liu2018", "pi-ilc", CELLS),
    ("liu2018-varying", "time", {}),
    ("liu2018", "robust-ilc", {"drive.precision": "double"}),
    ("uomodri", "table", {"scenario.1-rev-s.duration": "1.2 s", "metric": []}),
    ("uomodri", "pi-afc", studies.AFC),
    ("uomodri", "harmonic", studies.HARMONIC),
    (
        "uomodri",
        "pi",
        {
            "drive.dead_time_compensation.band": "35 mA",
            "drive.encoder_table.orders": [1],
            "drive.encoder_table.omega_min": "10 rev/s",
        },
    ),
    (
        "liu2018",
        "pi-ilc",
        {
            **CELLS,
            "drive.dead_time_compensation.band": "35 mA",
            "drive.belief.L_q": "60 mH",
            "drive.current_reference.field_weakening": True,
        },
    ),
    ("verrelli2016", "filtered", {"drive.precision": "single"}),
    ("verrelli2016", "printed", {}),
    ("verrelli2016-speed", "learning", {"drive.precision": "single"}),
    ("mandra2019", "ilc", {}),
]
# Laws of which no controller above has the name; each other one is exported as tests/laws.py has it.
NAMED_OTHERWISE = {"anti-cogging", "space-position", "space-speed"}
CONTROLLERS += [
    ("uomodri", law, {f"controller.{law}": row.keys})
    for law, row in OF_SPEED.items()
    if law not in NAMED_OTHERWISE | {controller for _, controller, _ in CONTROLLERS}
]
MORE = """
[controller]
none = { law = "python", object = "none.py:None" }
[controller.own]
law = "library"
library = "own.so"
"""


def object_of(source: Path, *flags: str) -> Path:
    """The object of a source, of what stands beside it and below."""
    command = ["cc", *FLAGS, *STRICT, *flags, "-c"]
    return kept(
        f"{source.stem}.o",
        [version("cc"), *command],
        [source, *sorted(source.parent.rglob("*.h"))],
        lambda made: subprocess.run([*command, source, "-o", made], check=True),
    )


library_object = cache(object_of)


def library_part(source: Path, *flags: str) -> Path:
    """What to link for a source of an export: the library's object, or the source where a test changed it."""
    own = LIBRARY / source.name
    return library_object(own, *flags) if source.read_bytes() == own.read_bytes() else source


def macros(exported: Path) -> list[str]:
    """The macros with which an export's README compiles every file."""
    return re.findall(r"`(-D\w+)`", (exported / "README.md").read_text().split("never with")[0])


def compiled(exported: Path, *main: Path) -> Path:
    """The program of an export and of `main`, else its self-test."""
    defined = macros(exported)
    library = [library_part(source, *defined) for source in sorted((exported / "cogless").glob("*.c"))]
    own = [*exported.glob("*_controller.c"), *(main or [object_of(exported / "self_test.c", *defined)])]
    command = ["cc", *FLAGS, *STRICT, *defined, "-I", exported]
    return kept(
        f"{own[-1].stem}.program",
        [version("cc"), *command[:-1]],
        [*own, *library, *sorted(exported.rglob("*.h"))],
        lambda made: subprocess.run([*command, "-o", made, *own, *library], check=True),
    )


def self_tested(exported: Path) -> tuple[int, str]:
    """Exit code and words of an export's self-test."""
    run = subprocess.run([compiled(exported)], capture_output=True, text=True, check=False)
    return run.returncode, run.stdout


Export = Callable[[str, str, dict[str, Any]], tuple[Subject, Path]]


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Writes the export of each controller of a study once; who changes it takes a copy."""
    made: dict[str, tuple[Subject, Path]] = {}

    def exported(study: str, controller: str, changes: dict[str, Any]) -> tuple[Subject, Path]:
        which = repr((study, controller, changes))
        if which not in made:
            out = tmp_path_factory.mktemp("export") / "out"
            made[which] = export_c(load(study, changes), controller, out), out
        return made[which]

    return exported


@pytest.fixture(scope="module", params=CONTROLLERS, ids=lambda found: "-".join(found[:2]))
def once(request: pytest.FixtureRequest, export: Export) -> tuple[Subject, Path]:
    """A controller and its export."""
    return export(*request.param)


def test_the_self_test_repeats_the_simulation(once: tuple[Subject, Path], tmp_path: Path) -> None:
    subject, exported = once
    name, periods = subject.name, min(2000, max(400, 80 * subject.divider))
    strict = ["cc", *FLAGS, *STRICT, *macros(exported)]
    code, out = self_tested(exported)
    assert code == 0
    assert re.fullmatch(rf"{name}: {periods} periods and \d+ stretches, all bits equal\n", out)
    example = ["-c", exported / "example_interrupt.c", "-o", tmp_path / "example.o"]
    subprocess.run([*strict, *example], check=True)


def test_the_self_test_finds_another_constant_and_another_memory(export: Export, tmp_path: Path) -> None:
    exported = shutil.copytree(export("liu2018", "pi-ilc", CELLS)[1], tmp_path / "out")
    source = exported / "pi_ilc_controller.c"
    text = source.read_text()
    gain = re.search(r"\.gain = (\S+)f,", text)
    assert gain
    source.write_text(text.replace(gain.group(1), str(1.001 * float(gain.group(1)))))
    code, out = self_tested(exported)
    assert code == 1
    assert re.fullmatch(r"pi_ilc: period \d+ differs\n" + ASKS, out)
    source.write_text(text)
    data = exported / "self_test_data.h"
    data.write_text(re.sub(r"memory_at_end = \d+U", "memory_at_end = 1U", data.read_text()))
    code, out = self_tested(exported)
    assert code == 1 and re.fullmatch("pi_ilc: init or the learned memory differs\n" + ASKS, out)


STUCK = "stuck_angle", "stuck_time"
# constants of limits and faults, of which an eventless recording knows nothing
GUARDS: list[tuple[str, str, dict[str, Any], tuple[str, ...]]] = [
    ("liu2018", "pi-ilc", CELLS,
        ("omega_max", "current_max", "current_sum", "current_limit", "speed_window", *STUCK)),
    ("verrelli2016-speed", "learning", {"drive.precision": "single"}, STUCK),
    ("mandra2019", "ilc", {}, STUCK),
]  # fmt: skip


def differs(name: str) -> str:
    """What the self-test says where a value is another; init refuses a law with a limit above the drive's."""
    stretch = r"stretch \d+ differs, see self_test_data.h"
    return rf"({stretch}|init or the learned memory differs)" if name == "current_limit" else stretch


@pytest.mark.parametrize(("study", "controller", "changes", "more"), GUARDS)
def test_the_self_test_finds_every_limit_and_fault(
    export: Export,
    study: str,
    controller: str,
    changes: dict[str, Any],
    more: tuple[str, ...],
    tmp_path: Path,
) -> None:
    exported = shutil.copytree(export(study, controller, changes)[1], tmp_path / "out")
    source = next(exported.glob("*_controller.c"))
    text = source.read_text()
    for name in ("limit", "hold", "bridge", "outlier", *more):
        for factor in (0.8, 1.25):
            if name in ("current_limit", "limit") and factor > 1:
                continue  # the other of the two is lower then
            found = re.search(rf"\.{name} = ([-\d.e+]+)f[,}}]", text)
            assert found, name
            value = f"{factor * float(found[1]) or 4.0!r}f"
            source.write_text(f"{text[: found.start(1)]}{value}{text[found.end(1) + 1 :]}")
            code, out = self_tested(exported)
            assert code == 1, (name, value)
            assert re.fullmatch(rf"\w+: {differs(name)}\n" + ASKS, out), name


def test_what_the_self_test_meets() -> None:
    """Saturation, every fault, and recovery from it."""
    prepared = prepare(load("liu2018"), "900-rpm", "pi-ilc")
    met: list[int] = []

    class Watched:
        def start(self) -> Any:
            return prepared.drive.start()

        def step_controller(self, state: Any, now: bytes, reference: bytes) -> bytes:
            out: bytes = prepared.drive.step_controller(state, now, reference)
            met.append(int.from_bytes(out[-4:], "little"))
            return out

    awkward(subject_of(prepared), replace(prepared, drive=Watched()), None)
    for bit in (1, 2, 4, 16, 32, 64, 128, 256, 1024):
        assert any(status & bit for status in met), bit
    assert met[0] == 0 and met[-31] & ~5 == 0  # all is well again; the currents that are fed still saturate


def test_the_stretches_of_a_self_test_by_hand(tmp_path: Path) -> None:
    """A law at 1 kHz in a drive at 15 kHz, whose bounds are round numbers."""
    bounds = {"omega_max": "300 rad/s", "stuck_angle": "1 rad", "current_max": "2 A", "current_sum": "1 A"}
    times = {"hold": "10 ms", "bridge": "5 ms", "speed_window": "2 ms", "stuck_time": "20 ms"}
    changes = {f"drive.monitor.{key}": value for key, value in {**bounds, **times}.items()}
    prepared = prepare(studies.study(tmp_path, changes), "low", "pi")
    subject = subject_of(prepared)
    layout, met = subject.layout, list[tuple[bytes, bytes]]()

    class Watched:
        def start(self) -> None: ...

        def step_controller(self, state: Any, now: bytes, reference: bytes) -> bytes:
            met.append((now, reference))
            return bytes(layout.size("cgl_drive_output"))

    def inputs(period: int) -> dict[str, Any]:
        now, reference = met[period]
        return layout.decode("cgl_measurement", now) | layout.decode("cgl_reference", reference)

    stretches = awkward(subject, replace(prepared, drive=Watched()), None)
    step = round(0.01 / tau * ANGLE_COUNTS)  # half of the largest speed, in a period
    speed = step * tau / ANGLE_COUNTS * 15e3
    turn = ceil(15e3 * tau / speed) + 30  # periods of a revolution, and of two steps of the law
    back = 150 + 75 + 30 + 30 + 4  # hold, bridge, the speed's window, and two steps of the law

    def vector(length: float) -> dict[str, Any]:
        return {"i_abc": pytest.approx([0.0, length * sqrt(3) / 2, -length * sqrt(3) / 2])}

    plain = {**dict.fromkeys(inputs(0), 0.0), **vector(0.3 * 2), "omega_m": speed, "omega_ref": 1.01 * speed}
    plain |= {"u_dc": 310.0, "learn": True, "torque": False}
    wanted: list[tuple[int, dict[str, Any]]] = [
        (turn // 2, {}),
        (turn - turn // 2, {"omega_ref": 0.99 * speed}),
        (30, {"omega_ref": 1e6, "omega_m": -speed}),
        (30, {"omega_ref": -1e6}),
        (2, vector(0.97 * 2)),
        (2, {"i_abc": pytest.approx([0.97, 0.0, 0.0])}),
        (2, {"omega_m": 0.97 * 300}),
        (2, vector(1.03 * 2)),
        (2, {"i_abc": pytest.approx([1.03, 0.0, 0.0])}),
        (2, {"omega_m": 1.03 * 300}),
        (1, {"i_abc": pytest.approx([nan, 0.0, 0.0], nan_ok=True)}),
        (1, {"u_dc": nan}),
        (back, {}),
        (60, {"omega_m": 0.9 * speed}),
        (60, {}),
        (75, {"theta_m": nan}),
        (3, {"theta_m": nan}),
        (back, {}),
        (330, {**vector(0.97 * 2), "omega_m": -0.97 * 300, "omega_ref": 15e3 / 10.5}),
        (back, {}),
        (330, {**vector(0.97 * 2), "omega_m": 0.97 * 300, "omega_ref": -15e3 / 10.5}),
        (back, {}),
        (613, {**vector(0.97 * 2), "omega_m": -0.97 * 300, "omega_ref": 15e3 / 610.5}),
        (back, {}),
        (613, {**vector(0.97 * 2), "omega_m": 0.97 * 300, "omega_ref": -15e3 / 610.5}),
        (back, {}),
        (30, {"learn": False}),
        (30, {"torque": True, "i_q_ref": 0.2 * 3}),
        (30, {}),
    ]
    assert [each.periods for each in stretches] == [periods for periods, _ in wanted]
    first = 0
    for each, (periods, changed) in zip(stretches, wanted, strict=True):
        moves = {"theta_m": each.counts * tau / ANGLE_COUNTS, **changed}
        found = inputs(first)
        for key, value in {**plain, **moves}.items():
            assert found[key] == (value if key == "i_abc" else pytest.approx(value, nan_ok=True)), (
                each.title,
                key,
            )
        first += periods
    assert first == len(met) and inputs(1)["theta_m"] == pytest.approx(step * tau / ANGLE_COUNTS)
    assert [each.step for each in stretches] == [step] * 18 + [0, step] * 4 + [step] * 3
    jumps = [(b.counts - a.counts - a.periods * a.step) % ANGLE_COUNTS for a, b in pairwise(stretches)]
    assert jumps == [0] * 12 + [ANGLE_COUNTS // 2] * 2 + [0] * 14  # else the angle goes on turning


@pytest.mark.parametrize(
    ("omega_max", "turn"), [("0 rad/s", 0.01), ("1200 rad/s", 0.04), ("1e6 rad/s", 0.05)]
)
def test_a_self_test_without_bounds_and_of_times_without_end(
    tmp_path: Path, omega_max: str, turn: float
) -> None:
    bounds = {"omega_max": omega_max, "stuck_angle": "0 rad", "current_max": "0 A", "current_sum": "0 A"}
    changes = {f"drive.monitor.{key}": value for key, value in bounds.items()}
    changes |= {
        "drive.monitor.hold": "1000 s",
        "drive.monitor.bridge": "1000 s",
        "drive.quality.span": "1e6 rad",
    }
    subject = subject_of(prepare(studies.study(tmp_path, changes), "low", "pi"))
    plan = _plan(subject)
    assert {step for *_, step, _ in plan} == {round(turn / tau * ANGLE_COUNTS)}
    assert [about for about, *_ in plan if "bound" in about] == [
        "the speed just within its bound",
        "the speed beyond its bound",
    ][: 2 * (omega_max != "0 rad/s")]
    periods = {about: periods for about, periods, *_ in plan}
    assert periods["a small error"] + periods["and one the other way"] == STRETCH_PERIODS_MOST + 30
    assert periods["all is well again"] == STRETCH_PERIODS_MOST + 34
    assert periods["the angle is missing, for as long as the controller bridges it"] == STRETCH_PERIODS_MOST
    assert plan[0][4].i_abc == pytest.approx((0.0, 0.9 * sqrt(3) / 2, -0.9 * sqrt(3) / 2))  # 0.3 of the limit
    monitor = {**subject.drive_config["monitor"], "phases": 2}
    of_two = _plan(replace(subject, drive_config={**subject.drive_config, "monitor": monitor}))
    assert of_two[0][4].i_abc == pytest.approx((0.0, 0.9, 0.0))  # of two phases, b is the beta axis


def test_a_self_test_of_extreme_bounds(tmp_path: Path) -> None:
    """What is beyond them is no longer a float; hold and bridge are longer than any test."""
    extreme = {"omega_max": "3.3e38 rad/s", "stuck_angle": "3e38 rad", "current_max": "3.3e38 A"}
    times = {"hold": "1000 s", "bridge": "1000 s", "speed_window": "1000 s"}
    none = {"omega_max": "1e-9 rad/s", "stuck_angle": "0 rad", "current_max": "0 A"}
    for bounds in (extreme, times, none):
        changes = {f"drive.monitor.{key}": value for key, value in bounds.items()}
        export_c(load("liu2018", changes), "pi", tmp_path / "out")
        assert self_tested(tmp_path / "out")[0] == 0


def test_the_self_test_finds_fused_arithmetic(export: Export, tmp_path: Path) -> None:
    """A motion begins at rest: the test must last into it. Rounding once stands for an fma."""
    exported = shutil.copytree(export("mandra2019", "ilc", {})[1], tmp_path / "out")
    source = exported / "cogless" / "trial.c"
    text = source.read_text()
    product = "config->k_1[0] * law->theta + config->k_1[1] * in->omega_m"
    assert product in text
    exact = re.sub(r"(\w+->)", r"(double)\1", product)
    source.write_text(text.replace(product, f"(float)({exact})"))
    assert self_tested(exported)[0] == 1


def test_only_what_the_law_needs_and_unchanged(export: Export) -> None:
    _, exported = export("liu2018", "pi", {})
    taken = {path.name for path in (exported / "cogless").iterdir()}
    assert {"LICENSE", "drive.c", "foc.c", "monitor.c", "speed_pi.c"} < taken
    assert not {"memory.c", "trial.c", "map.h"} & taken
    _, exported = export("liu2018", "pi-ilc", CELLS)
    taken = {path.name for path in (exported / "cogless").iterdir()}
    assert {"map.c", "map_store.c", "crc32.c", "memory.c", "pi_ilc.c", "trial.h", "robust_ilc.h"} < taken
    assert not {"trial.c", "robust_ilc.c", "space_speed.c", "anti_cogging.c"} & taken
    for name in taken - {"LICENSE"}:
        assert (exported / "cogless" / name).read_bytes() == (LIBRARY / name).read_bytes()


def test_what_a_header_says_of_its_step_and_its_memory(once: tuple[Subject, Path]) -> None:
    subject, exported = once
    name, divider, entries = subject.name, subject.divider, subject.memory_length
    header = next(exported.glob("*_controller.h")).read_text()
    readme = (exported / "README.md").read_text()
    law_rate = f"{subject.rate / divider:g}"
    assert (
        f"_step is called {subject.rate} times a second, the law runs {law_rate} times a second\n" in header
    )
    period = re.search(rf"#define {name.upper()}_PERIOD (\S+?)f? /\* between two steps \[s\] \*/\n", header)
    assert period and float(period[1]) == pytest.approx(1 / subject.rate)
    assert f"#define {name.upper()}_DIVIDER {divider}U /*" in header
    after = ": forgets what was learned, too" if entries else ""
    after = ", but the table stays" if name == "table" else after
    assert f"/* As after init{after}. */\nvoid {name}_reset(" in header
    assert (f"[{name.upper()}_MEMORY_LENGTH]; /* what is learned */" in header) == (entries > 0)
    memory = f"{entries} numbers, within `{name}_controller`" if entries else "none"
    learning = (
        "frozen while `reference.learn` is false, and while a check of the controller stops it"
        if entries
        else "none"
    )
    assert f"| memory | {memory} |\n| learning | {learning} |\n" in readme
    double = subject.precision == "d"
    precision = "double: define COGLESS_DOUBLE for every file" if double else "single"
    assert f" * precision        {precision}\n" in header
    assert f"#{'ifndef' if double else 'ifdef'} COGLESS_DOUBLE\n#error" in header


FLASH = """
#include <stdio.h>
#include <string.h>
static uint8_t flash[2][65536];
static cgl_flash_result erase(void *context, uint32_t slot)
{
    (void)context;
    memset(flash[slot], 0xff, sizeof flash[slot]);
    return CGL_FLASH_DONE;
}
static cgl_flash_result write(void *context, uint32_t slot, uint32_t offset, const uint8_t *bytes,
                              uint32_t count)
{
    (void)context;
    memcpy(&flash[slot][offset], bytes, count);
    return CGL_FLASH_DONE;
}
static cgl_flash_result read(void *context, uint32_t slot, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    (void)context;
    memcpy(bytes, &flash[slot][offset], count);
    return CGL_FLASH_DONE;
}
const cgl_map_store_config store_config = {
    .erase = erase, .write = write, .read = read, .slot_size = sizeof flash[0], .write_size = 8, .motor = 7};
int main(void)
{
    bool before, after;
    if (NAME_init(&controller) != CGL_OK) {
        return 1;
    }
    before = load_map();
    const cgl_real rest = controller.memory[2]; /* of an order; a cell is less by the mean */
    controller.memory[1] = CGL_R(0.03125);
    if (save_map() != CGL_MAP_OK || NAME_init(&controller) != CGL_OK) {
        return 2;
    }
    after = load_map();
    printf("%d %d %g\\n", before, after, (double)(controller.memory[1] - controller.memory[2] + rest));
    return 0;
}
"""


def test_the_readme_saves_and_loads_what_was_learned(once: tuple[Subject, Path], tmp_path: Path) -> None:
    """With nothing but what is in the folder, and the text as it stands in the README."""
    subject, exported = once
    code = re.search("```c\n(.*?)```", (exported / "README.md").read_text(), re.DOTALL)
    if subject.name in {"pi", "adrc", "time", "printed"}:
        assert code is None and not (exported / "cogless" / "map.h").exists()
        return
    assert code is not None
    name = subject.name
    text = f'#include "{name}_controller.h"\nstatic {name}_controller controller;\n{code[1]}'
    (tmp_path / "maps.c").write_text(text + FLASH.replace("NAME", name))
    program = compiled(exported, tmp_path / "maps.c")
    run = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "0 1 0.03125\n")


def test_it_says_where_it_comes_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = studies.write(tmp_path)
    options = ("--controller", "fair", "--to", "c", "-o", tmp_path / "out", "--set", "seed=7")
    code, out, err = cogless(capsys, "export", study, *options)
    assert (code, err) == (0, "")
    assert out == f"Export: {tmp_path / 'out' / 'README.md'}\n"
    header = (tmp_path / "out" / "fair_controller.h").read_text()
    assert study_hash(load(study, {"seed": 7})) in header
    assert study_hash(load(study)) not in header
    source = (tmp_path / "out" / "fair_controller.c").read_text()
    assert "rule = phase-margin" in source and "margins.phase_margin_rad = 1.0" in source
    assert "proportional gain [output/error], >= 0 */" in source
    readme = (tmp_path / "out" / "README.md").read_text()
    out = tmp_path / "out"
    assert f"    cogless export {study} --controller fair --to c -o {out} --set seed=7\n" in readme
    about = json.loads((tmp_path / "out" / "export.json").read_text())
    assert (about["law"], about["scenario"]) == ("pi", "low")


def test_it_warns_of_what_design_says_diverges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = ("law=pi-ilc", "gain=0.3", "lead=7 ms", "cells=30")  # it looks so far ahead that it pushes
    study = (
        studies.write(tmp_path),
        *(word for pair in far for word in ("--set", f"controller.fair.{pair}")),
    )
    options = ("--controller", "fair", "--to", "c", "-o", tmp_path / "out")
    code, out, err = cogless(capsys, "export", *study, *options)
    assert (code, out) == (0, f"Export: {tmp_path / 'out' / 'README.md'}\n")
    verdict, size = err.splitlines()
    _, table, _ = cogless(capsys, "design", *study)
    said = re.fullmatch(
        r"Warning: controller\.fair: ((?:may )?grows? by .* per period at .* Hz.*)\.", verdict
    )
    assert said and " ".join(said[1].split()[:4]) in table
    assert size.startswith(
        "Warning: controller.fair: with cells = 30 a wave of order 24 (mechanical) has only 1.25 cells"
    )
    readme = (tmp_path / "out" / "README.md").read_text()
    (listed,) = re.findall(r"\n`cogless design` says about the learning:\n\n- ((?:.+\n)+)\n##", readme)
    assert listed.replace("\n- ", "; ").replace("\n  ", " ").startswith(said[1])
    footer = (tmp_path / "out" / "fair_controller.c").read_text().split("What `cogless design` finds")[1]
    assert f"learning.verdict = {said[1]}" in footer and " unstable" not in footer


def test_an_export_of_what_settles_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--controller", "pi-ilc", "--to", "c", "-o", tmp_path / "out")
    assert cogless(capsys, "export", "uomodri", *options)[2] == ""
    listed = "\n\n`cogless design` says about the learning:\n\n- settles\n- learns up to 25000 rpm\n\n## What"
    assert listed in (tmp_path / "out" / "README.md").read_text()


def test_the_readme_lists_what_holds_at_each_speed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With `harmonic` the verdict has a statement on each speed. No line has two of them."""
    options = ("--controller", "harmonic", "--to", "c", "-o", tmp_path / "out")
    assert cogless(capsys, "export", "uomodri", *options)[0] == 0
    readme = (tmp_path / "out" / "README.md").read_text()
    listed = readme.split("`cogless design` says about the learning:\n\n")[1].replace("\n  ", " ").split("\n")
    starts = ["- learns orders 6, ", "- at 15 rpm ", "- at 240 rpm ", "- learns up to ", "- learns an ecc"]
    assert [line.startswith(start) for line, start in zip(listed, starts, strict=False)] == [True] * 5
    assert listed[5] == ""


def test_the_command_that_made_it_makes_it_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "with blanks"
    options = ("--controller", "fair", "--to", "c", "--scenario", "step", "-o", out)
    cogless(capsys, "export", studies.write(tmp_path), *options)
    readme = (out / "README.md").read_text()
    (command,) = [line for line in readme.splitlines() if line.startswith("    cogless export ")]
    assert cogless(capsys, *shlex.split(command)[1:])[0] == 0
    assert (out / "README.md").read_text() == readme


def test_numbers_come_back_to_the_same_bits() -> None:
    bits = np.random.default_rng(1).integers(0, 2**32, 20000, dtype=np.uint64).astype(np.uint32)
    numbers = bits.view(np.float32)
    for number in numbers[np.isfinite(numbers)]:
        text = real(float(number), "f")
        assert np.float32(text.removesuffix("f")).tobytes() == number.tobytes()
        assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?f", text) and ("." in text or "e" in text)
    assert [real(x, "d") for x in (0.1, 1e-5, 3.0)] == ["0.1", "1e-05", "3.0"]


@pytest.mark.parametrize("room", [95, 60])
def test_comments_stand_behind_the_code_or_above_it(room: int) -> None:
    """Behind it if the line ends within 120 columns, or if the code is short; each line within them."""
    text = "word " * 40
    behind = literals._commented("    .kp = 1.0f,", text.strip())
    assert behind[0].startswith("    .kp = 1.0f, /* word") and behind[-1].endswith(" */")
    assert all(line.startswith(" " * 19 + "word") for line in behind[1:]) and len(behind) > 1
    code = f"    .{'x' * room} = 1.0f,"
    above = literals._commented(code, text.strip())
    assert above[-1] == code and above[0].startswith("    /* word") and len(above) > 2
    assert above[1].startswith("       word") and above[-2].endswith("word */")
    assert max(map(len, behind + above[:-1])) <= 120
    assert literals._commented("    .a = 1,", "ohm") == ["    .a = 1, /* ohm */"]
    assert literals._commented("    .a = 1,", "") == ["    .a = 1,"]


def test_arrays_are_written_as_far_as_they_are_used() -> None:
    field = Field("x", "cgl_real", 5, False, "", 0)
    assert literals._value([1.0, 0.0, 2.0, 0.0, 0.0], field, "f") == "{1.0f, 0.0f, 2.0f}"
    assert literals._value([0.0, 0.0], field, "d") == "{0.0}"
    assert literals._value([True, False], field, "d") == "{true}"
    assert literals._value("motion", replace(field, pointer=True), "d") == "motion"
    nine = literals.array(np.arange(9.0), "d").splitlines()
    assert nine == ["    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0,", "    8.0,"]


def test_figures_are_flat_and_leave_out_what_is_empty() -> None:
    table = {
        "a": {"value": 0.12345678, "unit": "A", "note": "2 samples"},
        "b": {"value": 3, "unit": ""},
        "c": {"d": {"e": [True, 1.5, "x"]}, "f": None, "g": [], "h": ""},
        "i": "ends here */ and  goes on",
        "j": 0.0,
    }
    assert list(room._flat(table)) == [
        ("a", "0.123457 A (2 samples)"), ("b", "3"), ("c.d.e", "yes, 1.5, x"),
        ("i", "ends here * / and goes on"), ("j", "0"),
    ]  # fmt: skip


def test_the_memory_sum_is_fnv_1a_by_words() -> None:
    assert memory_sum(np.zeros(0, np.float32)) == 2166136261
    assert memory_sum(np.zeros(1, np.float32)) == 2166136261 * 16777619 % 2**32
    assert memory_sum(np.array([0.0, 1.0], np.float32)) != memory_sum(np.array([1.0, 0.0], np.float32))


@pytest.mark.parametrize(
    ("controller", "name"),
    [("pi-ilc", "pi_ilc"), ("2nd try", "my_2nd_try"), ("cgl_pi", "my_cgl_pi"), ("Ü", "my"), ("A.b", "A_b")],
)
def test_names(controller: str, name: str) -> None:
    assert identifier(controller) == name


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--controller", "p"], 'STUDY: controller: "p": expected one of pi, fair, none, own'),
        (["--controller", "none"],
            'STUDY: controller.none.law: "python": has no C form: expected a law of the control library'),
        (["--controller", "own"], 'STUDY: controller.own.law: "library": is C of your own already: '
            "expected a law of the control library"),
        (["--controller", "none", "--scenario", "step"],
            'STUDY: scenario: "step": expected a scenario with controller none: low'),
        (["--controller", "pi", "--to", "d"], '--to: "d": expected c'),
    ],
)  # fmt: skip
def test_mistakes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    study = studies.write(tmp_path, studies.BASE + MORE)
    to = [] if "--to" in arguments else ["--to", "c"]
    code, out, err = cogless(capsys, "export", study, *arguments, *to, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err.startswith(line.replace("STUDY", str(study))) and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_linear_plant_has_no_drive(tmp_path: Path) -> None:
    study = load(trial_studies.write(tmp_path, trial_studies.LINEAR))
    with pytest.raises(
        StudyError, match="plant: a linear plant has no drive: expected a study with a drive;"
    ):
        export_c(study, next(iter(study.controller)), tmp_path / "out")


@pytest.mark.parametrize(
    ("study", "controller", "changes", "says"),
    [
        ("liu2018", "pi-ilc", CELLS, ("theta_e = 4 theta_m",
            "2500 lines, 10000 counts, by the code that was simulated: `cogless/speed_count.h` says",
            "in the order a, b, c", "gates off", "psi_f / L_d = 2.27 A",
            "the law every 15 calls, the current loop", "for 10 ms after")),
        ("mandra2019", "ilc", {},
            ("a resolver of 16384 counts, by the code that was simulated: `cogless/speed_count.h` says",
            "the law every 20 calls. The study's current loop is ideal", "the current references are zero",
            ".motion")),
        ("verrelli2016", "filtered", {"drive.precision": "single"}, ("theta_e = 50 theta_m",
            "from a towards b", "measured as in the study, by an ideal sensor",
            "measurements, the law, the current loop", "CGL_MAP_STORED_LENGTH(3, 1024")),
        ("uomodri", "pi", {},
            ("20000 counts, by the code that was simulated: `cogless/speed_timed.h` says",)),
    ],
)  # fmt: skip
def test_the_readme_says_what_a_board_needs(
    export: Export, study: str, controller: str, changes: dict[str, Any], says: tuple[str, ...]
) -> None:
    _, exported = export(study, controller, changes)
    readme = " ".join((exported / "README.md").read_text().split())
    example = (exported / "example_interrupt.c").read_text()
    assert "wrapped to [0, 2 pi)" in readme and "`CGL_STATUS_OFF` (1024)" in readme
    for text in says:
        assert text in readme, text
    assert ("board_set_gates(" in example) == (study != "mandra2019") == ("`u_dc`" in readme)
    assert "ref" in example.split("static cgl_reference")[0].rsplit("/*", 1)[1]


# the folder


def test_an_earlier_export_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    sources.write(target, {"a.c": b"1", "cogless/b.c": b"2"}, {})
    sources.write(target, {"a.c": b"3"}, {})
    assert sorted(path.name for path in target.rglob("*")) == ["a.c", "export.json"]
    (target / "mine.c").write_bytes(b"4")
    with pytest.raises(StudyError, match=r"out: not empty: mine\.c: expected a new or empty folder"):
        sources.write(target, {"a.c": b"5"}, {})
    (target / "mine.c").unlink()
    (target / "a.c").write_bytes(b"6")
    with pytest.raises(StudyError, match=r"out: a\.c: changed since its export: expected a new"):
        sources.write(target, {"a.c": b"7"}, {})
    assert (target / "a.c").read_bytes() == b"6"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_what_a_compiler_made_of_the_sources_goes_with_them(tmp_path: Path) -> None:
    target = tmp_path / "out"
    sources.write(target, {"a.c": b"1", "cogless/b.c": b"2", "self_test.c": b"3"}, {})
    for name in ("a.o", "b.o", "self_test", "cogless/b.obj"):
        (target / name).write_bytes(b"made")
    sources.write(target, {"a.c": b"4"}, {})
    assert sorted(path.name for path in target.rglob("*")) == ["a.c", "export.json"]
    (target / "mine.o").write_bytes(b"5")  # of no source of the export
    with pytest.raises(StudyError, match=r"out: not empty: mine\.o"):
        sources.write(target, {"a.c": b"6"}, {})


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "main.c").write_text("")
    with pytest.raises(StudyError, match=r"out: not empty: main\.c"):
        sources.check(tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="file: is a file: expected a new or empty folder"):
        sources.check(tmp_path / "file")


def test_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    sources.write(target, {"a.c": b"1"}, {})
    rename = os.rename

    def fail(source: Path, goal: Path) -> None:
        if Path(goal) == target and Path(source).name == "new":
            raise OSError(28, "No space left on device")
        rename(source, goal)

    monkeypatch.setattr(os, "rename", fail)
    with pytest.raises(StudyError, match="out: no space left on device: expected a folder that can be"):
        sources.write(target, {"a.c": b"2"}, {})
    assert (target / "a.c").read_bytes() == b"1"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
