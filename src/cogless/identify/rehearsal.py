"""The errors to expect from a plan: its logs are simulated, and identified as real ones would be."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from cogless.identify import config
from cogless.identify.command import lines, standing_out
from cogless.identify.estimate import Progress, estimate
from cogless.identify.log import load_logs
from cogless.results.trace import write_netcdf
from cogless.run.simulate import rollout
from cogless.study import load


def expected(folder: Path, progress: Progress) -> list[str]:
    """Values with their errors, a line each, and what would be left out, from a folder with a plan."""
    progress("simulating the logs", 0.0)
    (results,) = rollout([load(folder / "study.toml")])
    with TemporaryDirectory() as place:
        logs = Path(place) / "traces.nc"
        write_netcdf(logs, results.runs)
        known = config.load(folder / "id.toml")
        made = standing_out(estimate(known, load_logs([logs], known), progress))
    return [*lines(made), *(f"! {line}" for line in made.left_out)]
