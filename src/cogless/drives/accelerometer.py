"""An accelerometer on a simulated carriage: its samples by its own clock, and its logs as Klipper's."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import numpy as np

from cogless.drives.klipper import log_name, log_text
from cogless.printer.records import Numbers
from cogless.results import AnyResults, Run
from cogless.study import AnyStudy
from cogless.study.mechanics import Belt

STANDARD_GRAVITY = 9.80665  # m/s^2, along z
SENSOR_AXES = ("x", "y", "z")


def samples(belt: Belt, run: Run, seed: int, number: int) -> tuple[Numbers, Numbers]:
    """Times, s, and acceleration, m/s^2, a column an axis, in a log of a run. `number`: the log's, from 1.

    The random numbers follow from the seed, the names of scenario and controller, and the number.
    """
    assert belt.accelerometer is not None
    sensor, trace = belt.accelerometer, run.trace
    rng = np.random.default_rng([seed, crc32(f"{run.scenario}/{run.controller}".encode()), number])
    rate = sensor.rate * (1 + sensor.rate_error * rng.uniform(-1, 1))
    time = trace.time
    times = np.arange(time[0] + sensor.late * rng.uniform() + rng.uniform() / rate, time[-1], 1 / rate)
    along = belt.radius * np.diff(trace["omega_load"]) / np.diff(time)
    acceleration = np.zeros((len(times), len(SENSOR_AXES)))
    acceleration[:, SENSOR_AXES.index(sensor.axis)] = np.interp(times, 0.5 * (time[1:] + time[:-1]), along)
    acceleration[:, -1] = STANDARD_GRAVITY
    acceleration += rng.normal(0, sensor.noise, acceleration.shape)
    if sensor.resolution:
        acceleration = sensor.resolution * np.round(acceleration / sensor.resolution)
    return times, acceleration


def accelerometer_logs(study: AnyStudy, scenario: str, controller: str) -> list[str]:
    """The files with the accelerometer's logs of a run; none without an accelerometer."""
    belt = study.belt(scenario)
    sensor = None if belt is None else belt.accelerometer
    if sensor is None:
        return []
    numbers = range(1, sensor.logs + 1)
    return [f"{log_name(sensor.axis, scenario, controller, number)}.csv" for number in numbers]


def write_accelerometer_logs(results: AnyResults, folder: Path) -> None:
    """Write the logs of all runs that have an accelerometer."""
    study = results.study
    for run in results.runs:
        belt = study.belt(run.scenario)
        for number, name in enumerate(accelerometer_logs(study, run.scenario, run.controller), 1):
            assert belt is not None
            folder.mkdir(exist_ok=True)
            (folder / name).write_text(log_text(*samples(belt, run, study.seed, number)), "utf-8")
