"""The table of a sweep: a row for each run, as Parquet.

Each metric of a study becomes one or more columns of plain numbers: one column for each order or phase.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.ensemble.variants import Ensemble
from cogless.errors import StudyError
from cogless.files import replacing, versions
from cogless.results.metrics import Value, result_name
from cogless.run.simulate import Pair
from cogless.study import AnyStudy
from cogless.study.metric import Metric


@dataclass(frozen=True)
class Column:
    """A column of one metric. `part`: if the metric is a list, the order, the phase from 1, or LAST_TRIAL."""

    metric: Metric
    place: int | None = None  # index of the value if the metric is a list
    part: str = ""

    @property
    def name(self) -> str:
        """Name in the table: as in results.json, with the part after a dot."""
        return result_name(self.metric) + (f".{self.part}" if self.part else "")

    @property
    def spoken(self) -> str:
        """Name as in the study's file, with the part after a dot."""
        return self.metric.name + (f".{self.part}" if self.part else "")

    def number_in(self, metrics: Mapping[str, Value]) -> float | None:
        """The column's number in a run's metrics; None: never reached, not finite, or not taken there."""
        value = metrics.get(result_name(self.metric))
        if isinstance(value, list):
            place = -1 if self.place is None else self.place
            value = value[place] if place < len(value) else None
        return value if value is not None and math.isfinite(value) else None


def columns(study: AnyStudy) -> list[Column]:
    """The columns of a study's metrics, in the study's order."""
    by_name: dict[str, Column] = {}
    for metric in study.metric:
        for place, part in study.columns_of(metric):
            column = Column(metric, place, part)
            by_name.setdefault(column.name, column)
    return list(by_name.values())


GROUP_ROWS = 1 << 16  # largest number of rows in a row group of sweep.parquet


@dataclass(frozen=True, eq=False)
class Sweep:
    """A finished sweep.

    `values`: metrics [variant, pair, column], SI, NaN where a run has none. `errors`: why a run failed, by
    variant and index of the pair.
    """

    study: AnyStudy
    ensemble: Ensemble
    pairs: Sequence[Pair]
    columns: Sequence[Column]
    values: NDArray[np.float64]
    errors: dict[tuple[int, int], str]


def gathered(
    study: AnyStudy, ensemble: Ensemble, pairs: Sequence[Pair], rows: Iterable[Sequence[Row]]
) -> Sweep:
    """A sweep from rows: for each variant, in order, a row for each pair."""
    metrics = columns(study)
    values = np.full((ensemble.count, len(pairs), len(metrics)), np.nan)
    errors = {}
    for variant, of_pairs in enumerate(rows):
        for place, row in enumerate(of_pairs):
            values[variant, place] = row[:-1]  # None becomes NaN
            if row[-1] is not None:
                errors[variant, place] = row[-1]
    return Sweep(study=study, ensemble=ensemble, pairs=pairs, columns=metrics, values=values, errors=errors)


def require(command: str) -> None:
    """StudyError unless what a sweep needs is installed. `command`: name of the calling command, also of its
    extra."""
    if find_spec("pyarrow") is None or find_spec("SALib") is None:
        raise StudyError(f"{command}: expected more packages: pip install 'cogless[{command}]'")


def write(sweep: Sweep, path: Path) -> None:
    """Write the table; the same sweep gives the same bytes. Keys and metrics are SI; null means no value."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    count, of_variant = sweep.ensemble.count, len(sweep.pairs)

    def for_each_run(values: Sequence[Any]) -> list[Any]:
        return [value for value in values for _ in range(of_variant)]

    named = {
        "variant": pa.array(np.repeat(np.arange(count, dtype=np.int64), of_variant)),
        "scenario": pa.array([scenario for scenario, _ in sweep.pairs] * count),
        "controller": pa.array([controller for _, controller in sweep.pairs] * count),
        **{key: _array(for_each_run(sweep.ensemble.si[key])) for key in sweep.ensemble.drawn},
        **{
            column.name: pa.array(sweep.values[:, :, place].ravel(), from_pandas=True)
            for place, column in enumerate(sweep.columns)
        },
        "error": pa.array(
            [sweep.errors.get((v, p)) for v in range(count) for p in range(of_variant)], pa.string()
        ),
    }
    metadata = {
        "study": sweep.study.name,
        "title": sweep.study.title,
        "seed": sweep.study.seed,
        "cogless": versions()["cogless"],
    }
    table = pa.table(named).replace_schema_metadata({"cogless": json.dumps(metadata, ensure_ascii=False)})
    with replacing(path) as temporary:
        pq.write_table(table, temporary, row_group_size=GROUP_ROWS, compression="zstd")


def _array(values: list[Any]) -> Any:
    """The values of a key as an array: of numbers, or of texts if any value is no number."""
    import pyarrow as pa

    number = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if number and all(isinstance(value, int) for value in values):
        return pa.array(values, pa.uint64() if min(values, default=0) >= 0 else pa.int64())
    return pa.array(
        [float(v) for v in values] if number else [v if isinstance(v, str) else json.dumps(v) for v in values]
    )


Row = list[Any]  # a number for each column, and the error's text, or None
