"""`calibrate`: a study's parameters from its target values."""

from __future__ import annotations

from cogless.cli.options import CORES, JobsOption, NoCodeOption, SetOption, StudyArgument
from cogless.cli.study import to_run
from cogless.cli.terminal import new_console
from cogless.errors import StudyError


def calibrate(
    study: StudyArgument,
    changes: SetOption = None,
    jobs: JobsOption = CORES,
    no_code: NoCodeOption = False,
) -> None:
    """Fit parameters of a study to target values of its metrics, as its calibration table says.

    Prints the fitted values as lines for the study, and each target beside what came out. Changes no file.

    Ctrl-C prints the best fit so far.
    """
    from cogless.run.calibrate import calibrate as fit_study
    from cogless.run.calibrate import residual_rows
    from cogless.run.own_law import no_exit

    loaded = to_run(study, changes, no_code)
    with new_console(stderr=True).status("Fitting") as status, no_exit():
        fit = fit_study(
            loaded, lambda n, d: status.update(f"Fitting: {n} evaluations, {100 * d:.2f} % off"), jobs
        )
    from rich.table import Table

    table = Table(
        "run", "metric", "wanted", "got", "deviation", box=None, header_style="bold", pad_edge=False
    )
    for row in residual_rows(fit):
        table.add_row(*row)
    console = new_console()
    console.print(table)
    outcome = "interrupted, the best fit so far is off by" if fit.interrupted else "fitted to"
    print(f"\n# {outcome} {100 * fit.deviation:.2f} % (rms of the deviations)")
    for parameter in fit.parameters:
        print(f"{parameter.toml}  # was {parameter.before}")
    if fit.interrupted:
        raise KeyboardInterrupt
    if not fit.settled:
        raise StudyError(
            f"{loaded.source.path}: calibration: not settled: expected parameters that move the targets"
        )
