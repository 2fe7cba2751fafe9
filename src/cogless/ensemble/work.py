"""The work of one task of an ensemble, in whatever process or machine it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cogless.ensemble.columns import columns
from cogless.ensemble.parcel import Parcel, unpacked
from cogless.errors import StudyError
from cogless.results import AnyResults
from cogless.run.simulate import Pair, RunError, rollout
from cogless.study import AnyStudy, changed
from cogless.study.controller import LibraryLaw, PythonLaw

Row = list[Any]  # a number for each column, and the error's text, or None


class Ended(Exception):  # noqa: N818, it isn't an error
    """Ctrl-C reached a worker."""


def rows(parcel: Parcel, changes: Sequence[Mapping[str, Any]], pairs: Sequence[Pair]) -> list[list[Row]]:
    """Run these variants: for each, in order, one row per pair of scenario and controller."""
    study = unpacked(parcel)
    wanted = columns(study)
    made = [_made(study, of_variant) for of_variant in changes]
    errors: Sequence[Mapping[Pair, StudyError]] = []
    valid = [variant for variant in made if not isinstance(variant, str)]
    try:
        results: Sequence[AnyResults] = rollout(
            valid, ["/".join(pair) for pair in pairs], jobs=1, keep_traces=False
        )
        if any(found.interrupted for found in results):
            raise Ended
    except RunError as error:
        results, errors = error.all_results, error.all_errors
    finished = zip(results, errors or [{}] * len(valid), strict=True)
    found = []
    for variant in made:
        if isinstance(variant, str):
            found.append([_failed_row(len(wanted), variant) for _ in pairs])
            continue
        of_variant, failed = next(finished)
        runs = {(run.scenario, run.controller): run.metrics for run in of_variant.runs}
        found.append(
            [
                _failed_row(len(wanted), _told(variant, failed[pair]))
                if pair in failed
                else [*(column.of(runs[pair]) for column in wanted), None]
                for pair in pairs
            ]
        )
    return found


def needed(study: AnyStudy) -> str:
    """What a task needs to end: memory, and own laws that don't crash, which is the likelier cause."""
    own = [
        f"controller.{name} not to end the process ({study.source.folder / law.code})"
        for name, law in study.controller.items()
        if isinstance(law, PythonLaw | LibraryLaw)
    ]
    return f"{', '.join(own)}, or enough memory" if own else "enough memory for it"


def _failed_row(columns: int, why: str) -> Row:
    return [*[None] * columns, why]


def _made(study: AnyStudy, changes: Mapping[str, Any]) -> AnyStudy | str:
    """The variant, or why the study doesn't allow it."""
    try:
        return changed(study, changes)
    except StudyError as error:
        return _told(study, error)


def _told(study: AnyStudy, error: StudyError) -> str:
    """The error without the folder of the study, which differs between machines."""
    return str(error).replace(str(study.source.path), study.source.path.name)
