"""The header of a plan for SimpleFOC, compiled into a stand-in of Arduino and of the library with a motor."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from commands import cogless
from drives.clocked_drive import STUDY
from drives.drive_bench import Plant

COMPILER = shutil.which("c++") or shutil.which("g++") or ""
pytestmark = pytest.mark.skipif(not COMPILER, reason="needs a C++ compiler")
PLANT = Plant()
# 5 kHz steps of the motor, of which every fifth is a loop() of the sketch. The sensor counts backwards.
BENCH = """
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
static const char *typed;
static unsigned long steps;
static struct Port {
    bool available() { return *typed && steps % 5000 == 4999; }
    int read() { return *typed++; }
    void print(char c) { putchar(c); }
    void print(int n) { printf("%d", n); }
    void print(unsigned long n) { printf("%lu", n); }
    void print(float v, int digits) { printf("%.*f", digits, v); }
    void println(float v, int digits) { printf("%.*f\\r\\n", digits, v); }
    void println(const char *text) { printf("%s\\r\\n", text); }
} Serial;
struct Motor {
    struct { float q; } current;
    float shaft_velocity, shaft_angle;
};
#include "record_simplefoc.h"

int main(int argc, char **argv)
{
    const double K_t = KT, inertia = J, coulomb = TC, viscous = B, pi = 3.14159265358979323846;
    double phi = 0.7, omega = 0, i = 0, reference = 0, integral = 0, output = 0, before = 0;
    Motor motor = {};
    const unsigned long count = 5000UL * (unsigned long)atoi(argv[1]);
    typed = argc > 2 ? argv[2] : "y";
    for (steps = 0; steps < count; steps++) {
        if (steps % 5 == 4) {
            const double sensor = floor((phi + 2.2) / (2 * pi) * 16384) / 16384 * 2 * pi;
            motor.shaft_angle = (float)(-sensor - 0.3);
            const double speed = (motor.shaft_angle - before) / 1e-3;
            motor.shaft_velocity = steps < 10 ? 0.0f : (float)(0.75 * motor.shaft_velocity + 0.25 * speed);
            before = motor.shaft_angle;
            motor.current.q = (float)(-i + 4e-3 * (rand() / (double)RAND_MAX - 0.5));
            const float target = record_target(motor, (uint32_t)(200UL * steps + 4294000000UL));
            const double error = target - motor.shaft_velocity;
            integral += 0.9e-3 * error;
            output += fmax(-0.3, fmin(0.3, 0.06 * error + integral - output));
            reference = -fmax(-6, fmin(6, output));
        }
        for (int half = 0; half < 2; half++) {
            const double h = 1e-4;
            i = reference + (i - reference) * exp(-h * 2 * pi * 1000);
            const double middle = phi + 0.5 * h * omega;
            const double cogging = COGGING;
            omega += h * (K_t * i + cogging - coulomb * tanh(omega / 0.02) - viscous * omega) / inertia;
            phi = middle + 0.5 * h * omega;
        }
    }
    fprintf(stderr, "%.6f\\n", omega);
    return 0;
}
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    folder = tmp_path_factory.mktemp("sketch")
    (folder / "study.toml").write_text(STUDY)
    from cogless.drives.registry import script_files
    from cogless.study import load

    for name, text in script_files(load(folder / "study.toml"), "simplefoc", None).items():
        (folder / name).write_text(text)
    numbers = {"KT": PLANT.K_t, "J": PLANT.inertia, "TC": PLANT.coulomb, "B": PLANT.viscous}
    bench = BENCH
    for name, value in numbers.items():
        bench = re.sub(rf"\b{name}\b", repr(value), bench)
    waves = " + ".join(f"{size!r} * sin({n} * middle + {phase!r})" for n, size, phase in PLANT.cogging)
    (folder / "bench.cpp").write_text(bench.replace("COGGING", waves))
    options = ["-std=c++11", "-O2", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-static-libubsan"]
    subprocess.run(
        [COMPILER, *options, "-fno-sanitize-recover", "bench.cpp", "-o", "bench"], cwd=folder, check=True
    )
    return folder


def played(plan: Path, seconds: int, typed: str = "y") -> tuple[list[str], float]:
    """Lines that the sketch prints, and the speed in the end."""
    done = subprocess.run([plan / "bench", str(seconds), typed], capture_output=True, text=True, check=True)
    return done.stdout.splitlines(), float(done.stderr)


def test_what_the_sketch_prints_tells_the_motor(
    plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The processor's microseconds wrap on the way."""
    lines, speed = played(plan, 48)
    assert lines[-1] == "done" and abs(speed) < 0.5
    log = tmp_path / "log.txt"
    log.write_text("\n".join(lines) + "\n")
    config = plan / "monitor.toml"
    code, out, err = cogless(capsys, "identify", log, "--drive-config", config, "-o", tmp_path / "found")
    assert (code, err) == (0, "") and "1 lines that do not fit are left out" in out
    made = json.loads((tmp_path / "found" / "identified.json").read_text())
    assert made["logs"] == [f"log.txt#{part}" for part in range(4)]
    assert made["values"]["j"]["value"] == pytest.approx(PLANT.inertia / PLANT.K_t, rel=0.05)
    assert made["values"]["c"]["value"] == pytest.approx(PLANT.coulomb / PLANT.K_t, rel=0.08)
    sizes = {wave["order"]: wave["amplitude_N_m"] for wave in made["cogging"]}
    assert sizes[12] == pytest.approx(5e-3, rel=0.05) and sizes[84] == pytest.approx(4e-3, rel=0.1)


@pytest.mark.parametrize("typed", ["", "n"])
def test_nothing_moves_until_y_is_sent(typed: str, plan: Path) -> None:
    lines, speed = played(plan, 3, typed)
    assert not lines and abs(speed) < 0.05


def test_any_other_character_stops(plan: Path) -> None:
    lines, speed = played(plan, 5, "yyx")  # one a second: a second y begins anew
    assert lines and abs(speed) < 0.05
    whole, _ = played(plan, 5, "y")
    assert len(lines) < 0.6 * len(whole)


def test_too_high_a_speed_stops(plan: Path, tmp_path: Path) -> None:
    for name in ("bench.cpp", "record_simplefoc.h"):
        (tmp_path / name).write_text((plan / name).read_text())
    header = tmp_path / "record_simplefoc.h"
    header.write_text(re.sub(r"record_speed_limit = \S+f;", "record_speed_limit = 1.0f;", header.read_text()))
    subprocess.run([COMPILER, "-std=c++11", "bench.cpp", "-o", "bench"], cwd=tmp_path, check=True)
    lines, speed = played(tmp_path, 6)
    assert lines[-1] == "stopped: too fast" and abs(speed) < 0.05
