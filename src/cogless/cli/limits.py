"""Further runs, after those of a study, that find what limits the best run of each scenario."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cogless.cli.terminal import new_bar

if TYPE_CHECKING:
    from cogless.results import AnyResults, Results


def with_limits(results: Results, wanted: bool | None, jobs: int, folder: Path | None) -> Results:
    """The results, with what limits each scenario's best run added.

    `wanted`: the option --limits or --no-limits, None without either. `folder`: room for long traces.
    """
    from cogless import report

    if wanted is False or results.interrupted:
        return results
    with new_bar() as bar:
        task = bar.add_task("", total=None)

        def tell(scenario: str) -> None:
            bar.update(task, description=f"{scenario}: what limits it")

        return report.with_limits(results, wanted is True, jobs, folder, tell)


def sentences(results: AnyResults) -> dict[str, str]:
    """Sentences on what limits the best run, by scenario; none where no cause is known or stands out."""
    from cogless import report

    found = {scenario: report.limit(results, scenario) for scenario in results.scenarios}
    return {scenario: str(remark) for scenario, remark in found.items() if remark is not None}
