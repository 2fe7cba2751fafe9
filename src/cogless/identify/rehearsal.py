"""The errors to expect from a plan: its logs are simulated, and identified as real ones would be."""

from __future__ import annotations

import cmath
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

from cogless.identify import config
from cogless.identify.command import lines, standing_out
from cogless.identify.estimate import Progress, estimate
from cogless.identify.log import load_logs
from cogless.identify.result import Estimate
from cogless.results.trace import write_netcdf
from cogless.run.simulate import rollout
from cogless.study import Study, load


def expected(folder: Path, progress: Progress) -> list[str]:
    """Values with their errors, a line each, and what would be left out, from a folder with a plan."""
    progress("simulating the logs", 0.0)
    study = load(folder / "study.toml")
    assert isinstance(study, Study)  # which a plan is
    (results,) = rollout([study])
    with TemporaryDirectory() as place:
        logs = Path(place) / "traces.nc"
        write_netcdf(logs, results.runs)
        known = config.load(folder / "id.toml")
        made = estimate(known, load_logs([logs], known), progress)
    sure = standing_out(made)
    return [*lines(sure), *(f"! {line}" for line in (*missed(study, made), *sure.left_out))]


def missed(study: Study, made: Estimate) -> list[str]:
    """Sentences on the study's cogging that its own logs do not tell, or tell worse than not at all."""
    found = {wave.order: made.K_t * cmath.rect(wave.size.value, wave.phase.value) for wave in made.cogging}
    waves = study.motor.star().cogging
    true = {one.order: cmath.rect(one.torque, one.phase) for one in waves if one.torque}
    wrong = [order for order in found.keys() & true if abs(found[order] - true[order]) >= abs(true[order])]
    without = [order for order in true if order not in found]

    def named(orders: Iterable[int]) -> str:
        return ", ".join(f"{n} ({1e3 * abs(true[n]):.3g} mN*m)" for n in sorted(orders))

    said = []
    if wrong:
        said.append(
            f"The plan's logs would mislead: the study's cogging of order {named(wrong)} comes out worse "
            "than not at all, since the law does not hold the rotor at their speeds."
        )
    if without:
        said.append(f"The plan's logs would not tell the study's cogging of order {named(without)}.")
    return said
