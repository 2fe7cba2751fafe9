"""The stored map of what a run's law has learned; the identities that cogless gives motors and motions."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from cogless.engine import engine_config
from cogless.results import AnyResults, Run
from cogless.stored_map import LAWS, StoredMap, write
from cogless.study import AnyStudy, Study, TrialStudy
from cogless.study.motor import StarMotor

CURRENT, ACCELERATION, OF_THE_TRIAL = 1, 4, 5
SPACE_UNITS = (1, 2, 3)  # of alpha, beta and h


def motor_identity(motor: StarMotor) -> int:
    """32 bits that tell motors of studies apart: a CRC-32 over all their numbers (control/SPEC.md)."""
    data = struct.pack("<II4d", motor.pole_pairs, motor.phases, motor.R_s, motor.L_d, motor.L_q, motor.psi_f)
    for flux in motor.flux_harmonics:
        data += struct.pack("<I4d", flux.order, flux.d, flux.q, flux.d_phase, flux.q_phase)
    for cogging in motor.cogging:
        data += struct.pack("<I2d", cogging.order, cogging.torque or 0.0, cogging.phase)
    return crc32(data)


def motion_identity(reference: ArrayLike) -> int:
    """32 bits that tell a trial's references apart: a CRC-32 over its samples as float32."""
    return crc32(np.asarray(reference, dtype="<f4").tobytes())


def study_identity(study: AnyStudy) -> int:
    """The identity of a study's motor as it stands there, without overrides; 0 without a motor."""
    return 0 if study.motor is None else motor_identity(study.motor.star())


def of_run(study: AnyStudy, run: Run) -> StoredMap | None:
    """What the run's law has learned; None where nothing is learned, or it is not tied to an angle."""
    if not run.memory:
        return None
    if isinstance(study, TrialStudy):
        return _of_trial(study, run)
    assert isinstance(study, Study)
    config = engine_config(study, run.scenario, run.controller)["controller"]
    limit = config.get("limit", study.drive.current_loop.current_limit)
    period = Fraction(1)
    if config["law"] in ("pi-ilc", "robust-ilc") and config["period"] == "electrical":
        period = Fraction(1, study.motor.pole_pairs)
    values, units, limits, ratio = [run.memory["current"]], [CURRENT], [limit], 1
    if config["law"] == "robust-ilc":  # it learns an acceleration, f = -b i
        real = np.float32 if study.drive.precision == "single" else np.float64
        values, units = [-float(real(config["b"])) * np.asarray(values[0])], [ACCELERATION]
        limits = [config["b"] * limit]
    elif config["law"].startswith("space-"):
        values += [run.memory[name] for name in ("beta", "h") if name in run.memory]
        units, limits = list(SPACE_UNITS[: len(values)]), list(config["limits"])
        ratio = config["ratio"] if config["law"] == "space-position" else 1
        period = Fraction(config["turns"], config["ratio"] * config["parts"])
    return _stored(
        values,
        units,
        limits,
        law=LAWS.index(config["law"]),
        turns=period.numerator,
        parts=period.denominator,
        ratio=ratio,
        motor=study_identity(study),
    )


def write_all(results: AnyResults, folder: Path) -> None:
    """Write folder/SCENARIO/CONTROLLER.bin for each run that has a map."""
    for run in results.runs:
        stored = of_run(results.study, run)
        if stored is not None:
            path = _file(folder, run.scenario, run.controller)
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, bytes(stored))


def remove_all(runs: Iterable[tuple[str, str]], folder: Path) -> None:
    """Remove what `write_all` wrote for runs, (scenario, controller), and folders that are empty then."""
    for scenario, controller in runs:
        path = _file(folder, scenario, controller)
        path.unlink(missing_ok=True)
        for place in (path.parent, folder):
            with suppress(OSError):  # not empty, or not there
                place.rmdir()


def _file(folder: Path, scenario: str, controller: str) -> Path:
    return folder / scenario / f"{controller}.bin"


def _of_trial(study: TrialStudy, run: Run) -> StoredMap:
    """With the identity of the last phase's reference, which is the one that it was learned for."""
    _, last = study.scenario[run.scenario].phases[-1]
    return _stored(
        [run.memory["learned"]],
        [OF_THE_TRIAL],
        [study.controller[run.controller].learned_limit],
        law=LAWS.index("trial"),
        turns=0,
        parts=0,
        motor=study_identity(study),
        motion=motion_identity(study.reference(run.scenario, last)),
    )


def _stored(values: list[Any], units: list[int], limits: list[float], **fields: int) -> StoredMap:
    """Within the limits, as the firmware stores it."""
    single = [np.float32(limit) for limit in limits]
    clamped = [
        np.clip(np.asarray(row, dtype=np.float32), -limit, limit)
        for row, limit in zip(values, single, strict=True)
    ]
    return StoredMap(np.stack(clamped), tuple(units), tuple(float(limit) for limit in single), **fields)
