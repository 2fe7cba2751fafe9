"""Find the errors to expect from a plan: its logs are simulated and identified like real logs."""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cogless.identify import config
from cogless.identify.command import standing_out, value_lines
from cogless.identify.config import Identification
from cogless.identify.estimate import Progress, estimate_motor
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate
from cogless.results.trace import write_netcdf
from cogless.run.simulate import rollout
from cogless.study import Study
from cogless.study.base import Source
from cogless.study.reading import checked, read, speed_study


def expected(folder: Path, progress: Progress, own_law: Mapping[str, Any] | None = None) -> list[str]:
    """Lines of values with their errors, and lines of what would be left out, for the plan in a folder.

    `own_law`: the drive's own law, as the table of controllers of a study; None or empty: the plan's law.
    """
    progress("simulating the logs", 0.0)
    study, identification = _under(own_law or {}, folder)
    (results,) = rollout([study])
    with TemporaryDirectory() as place:
        logs = Path(place) / "traces.nc"
        write_netcdf(logs, results.runs)
        estimate = estimate_motor(identification, load_logs([logs], identification), progress)
    sure = standing_out(estimate)
    return [*value_lines(sure), *(f"! {line}" for line in (*missed(study, estimate), *sure.left_out))]


def _under(own_law: Mapping[str, Any], folder: Path) -> tuple[Study, Identification]:
    """The plan's study and its file of columns, both with this law, if any, in place of the plan's."""
    paths = folder / "study.toml", folder / "id.toml"
    played, log_file = read(paths[0]), read(paths[1])
    if own_law:
        (name,) = own_law
        played["controller"] = log_file["controller"] = dict(own_law)
        for rule in log_file["log"]:
            rule["controller"] = name
    study = speed_study(checked(Source(paths[0], played)))
    return study, config.from_tables(paths[1], log_file, list(own_law))


def missed(study: Study, estimate: Estimate) -> list[str]:
    """Sentences on the study's cogging that the identification from its simulated logs misses.

    One sentence is on orders with an error as large as the cogging itself, one on orders that were not found.
    """
    identified = {
        wave.order: estimate.K_t * cmath.rect(wave.size.value, wave.phase.value) for wave in estimate.cogging
    }
    waves = study.motor.star().cogging
    true = {one.order: cmath.rect(one.torque, one.phase) for one in waves if one.torque}
    wrong = [
        order
        for order in identified.keys() & true
        if abs(identified[order] - true[order]) >= abs(true[order])
    ]
    without = [order for order in true if order not in identified]

    def named(orders: Iterable[int]) -> str:
        return ", ".join(f"{n} ({1e3 * abs(true[n]):.3g} mN*m)" for n in sorted(orders))

    sentences = []
    if wrong:
        sentences.append(
            f"The plan's logs would mislead: cogging of order {named(wrong)}, identified from them, would be "
            "worse than no value, since the law does not hold the rotor at the plan's speeds."
        )
    if without:
        sentences.append(f"The plan's logs would not show the study's cogging of order {named(without)}.")
    return sentences
