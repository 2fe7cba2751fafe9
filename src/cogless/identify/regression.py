"""Joint least squares over all logs, without the bias of an angle in steps, and errors by jackknife."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogless.identify.files import Array
from cogless.identify.weak_form import Name, Rows, all_names

BLOCKS = 24  # of all logs together, at least
OF_A_LOG = 4  # at least


@dataclass(frozen=True, eq=False)
class Block:
    """Normal equations of a part of a log, per squared A of its noise: matrix @ coefficients = vector."""

    log: str
    matrix: Array
    vector: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients by name, their standard errors, and how much others inflate each variance."""

    names: tuple[Name, ...]
    values: Array
    errors: Array
    inflation: Array
    blocks: tuple[Block, ...]
    noise: dict[str, float]  # of each log: residual, A rms
    parts: Array  # solutions with each block left out

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: Name) -> float:
        return float(self.values[self.names.index(name)])

    def get(self, key: str) -> float:
        """The coefficient of a single column, 0 if it isn't there."""
        return dict(zip(self.names, self.values.tolist(), strict=True)).get((key,), 0.0)

    def error(self, name: Name) -> float:
        return float(self.errors[self.names.index(name)])

    def prediction(self, rows: Rows, without: str | None = None) -> Array:
        """i_q that the coefficients give for these rows, A. `without`: a log that they are not from."""
        values = (
            self.values
            if without is None
            else solved([block for block in self.blocks if block.log != without], len(self.names))
        )
        found = dict(zip(self.names, values, strict=True))
        return np.asarray(rows.columns @ np.array([found.get(name, 0.0) for name in rows.names]))


def fit(rows: Sequence[Rows]) -> Fit:
    """Solve; each log weighs by the variance of its residual, found by solving three times."""
    names = all_names(rows)
    noise = {each.log.name: 1.0 for each in rows}
    values = np.zeros(len(names))
    of_a_log = max(OF_A_LOG, -(-BLOCKS // len(noise)))
    for _ in range(3):
        blocks = [block for each in rows for block in _blocks(each, names, noise[each.log.name], of_a_log)]
        values = solved(blocks, len(names))
        noise = _noises(rows, names, values)
    parts = np.array([solved([b for b in blocks if b is not out], len(names)) for out in blocks])
    count = len(parts)
    errors = np.sqrt((count - 1) / count * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
    return Fit(names, values, errors, inflation(blocks), tuple(blocks), noise, parts)


def _blocks(rows: Rows, names: Sequence[Name], noise: float, count: int) -> list[Block]:
    place = [names.index(name) for name in rows.names]
    found = []
    for part in np.array_split(np.arange(len(rows.y)), min(count, max(1, len(rows.y) // 10))):
        columns = rows.columns[part]
        matrix, vector = np.zeros((len(names), len(names))), np.zeros(len(names))
        inner = columns.T @ columns - np.diag(rows.noise[part].sum(axis=0))
        matrix[np.ix_(place, place)] = inner / noise**2
        vector[place] = columns.T @ rows.y[part] / noise**2
        found.append(Block(rows.log.name, matrix, vector))
    return found


def solved(blocks: Sequence[Block], size: int) -> Array:
    """Coefficients of these blocks; 0 for those that none of them has."""
    matrix = sum((block.matrix for block in blocks), np.zeros((size, size)))
    vector = sum((block.vector for block in blocks), np.zeros(size))
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    used = scale > 0
    scaled = matrix[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    found = np.zeros(size)
    found[used] = np.linalg.lstsq(scaled, vector[used] / scale[used], rcond=1e-10)[0] / scale[used]
    return found


def _noises(rows: Sequence[Rows], names: Sequence[Name], values: Array) -> dict[str, float]:
    squares: dict[str, list[Array]] = {}
    known = dict(zip(names, values, strict=True))
    for each in rows:
        residual = each.y - each.columns @ np.array([known[name] for name in each.names])
        squares.setdefault(each.log.name, []).append(residual**2)
    smallest = 1e-9 * max(1e-12, float(np.max([np.max(np.abs(each.y), initial=0) for each in rows])))
    return {log: max(smallest, float(np.sqrt(np.mean(np.concatenate(s))))) for log, s in squares.items()}


def inflation(blocks: Sequence[Block]) -> Array:
    """Factor by which the other columns inflate the variance of each coefficient; inf: it can't be told."""
    size = len(blocks[0].vector)
    matrix = sum((block.matrix for block in blocks), np.zeros((size, size)))
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    found = np.full(size, np.inf)
    used = scale > 0
    scaled = matrix[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, 1e-12)
    found[used] = np.sum(vectors**2 / values, axis=1)
    return found
