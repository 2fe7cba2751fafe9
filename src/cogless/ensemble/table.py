"""The table of a sweep: a row for each run, as Parquet."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.ensemble.columns import Column, columns
from cogless.ensemble.sample import Ensemble
from cogless.ensemble.work import Row
from cogless.errors import StudyError
from cogless.files import replacing, versions
from cogless.run.simulate import Pair
from cogless.study import AnyStudy

ROWS = 1 << 16  # of a row group


@dataclass(frozen=True, eq=False)
class Sweep:
    """A finished sweep.

    `values`: metrics [variant, pair, column], SI, NaN where there is none. `errors`: why a run failed, by
    variant and place of its pair.
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
    """Put the rows of each variant, in order, into arrays."""
    found = columns(study)
    values = np.full((ensemble.count, len(pairs), len(found)), np.nan)
    errors = {}
    for variant, of_pairs in enumerate(rows):
        for place, row in enumerate(of_pairs):
            values[variant, place] = row[:-1]  # None becomes NaN
            if row[-1] is not None:
                errors[variant, place] = row[-1]
    return Sweep(study, ensemble, pairs, found, values, errors)


def require(command: str) -> None:
    """StudyError unless what a sweep needs is installed. `command`: that needs it, by which its extra is
    named."""
    if find_spec("pyarrow") is None or find_spec("SALib") is None:
        raise StudyError(f"{command}: expected the extra: pip install 'cogless[{command}]'")


def write(sweep: Sweep, path: Path) -> None:
    """Write the table; the same sweep gives the same bytes. Keys and metrics are SI, null: no value."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    count, of_variant = sweep.ensemble.count, len(sweep.pairs)

    def each(values: Sequence[Any]) -> list[Any]:
        return [value for value in values for _ in range(of_variant)]

    named = {
        "variant": pa.array(np.repeat(np.arange(count, dtype=np.int64), of_variant)),
        "scenario": pa.array([scenario for scenario, _ in sweep.pairs] * count),
        "controller": pa.array([controller for _, controller in sweep.pairs] * count),
        **{key: _array(each(sweep.ensemble.si(key))) for key in sweep.ensemble.drawn},
        **{
            column.name: pa.array(sweep.values[:, :, place].ravel(), from_pandas=True)
            for place, column in enumerate(sweep.columns)
        },
        "error": pa.array(
            [sweep.errors.get((v, p)) for v in range(count) for p in range(of_variant)], pa.string()
        ),
    }
    about = {
        "study": sweep.study.name,
        "title": sweep.study.title,
        "seed": sweep.study.seed,
        "cogless": versions()["cogless"],
    }
    table = pa.table(named).replace_schema_metadata({"cogless": json.dumps(about, ensure_ascii=False)})
    with replacing(path) as temporary:
        pq.write_table(table, temporary, row_group_size=ROWS, compression="zstd")


def _array(values: list[Any]) -> Any:
    """A column of a key: numbers, or texts where a value is none."""
    import pyarrow as pa

    number = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if number and all(isinstance(value, int) for value in values):
        return pa.array(values, pa.uint64() if min(values, default=0) >= 0 else pa.int64())
    return pa.array(
        [float(v) for v in values] if number else [v if isinstance(v, str) else json.dumps(v) for v in values]
    )
