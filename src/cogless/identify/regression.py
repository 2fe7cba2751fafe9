"""Joint least squares over all logs, without the bias of an angle in steps, and errors by jackknife."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cogless.errors import StudyError
from cogless.identify.files import Array
from cogless.identify.weak_form import Name, Rows, all_names

BLOCKS = 24  # of all logs together, at least
OF_A_LOG = 4  # at least
LARGEST_INFLATION = 100.0  # of a variance by the other columns


@dataclass(frozen=True, eq=False)
class Block:
    """Normal equations of a part of a log: matrix @ coefficients = vector."""

    log: str
    matrix: Array
    vector: Array
    steps: Array  # what the steps of the angle added to the diagonal, taken off it
    squares: float  # of its currents, A^2
    rows: int

    def per(self, noise: float) -> Block:
        """The block with the weight of this noise, A."""
        return replace(self, matrix=self.matrix / noise**2, vector=self.vector / noise**2)


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients by name, their standard errors, and how much others inflate each variance."""

    names: tuple[Name, ...]
    values: Array
    errors: Array
    inflation: Array
    blocks: tuple[Block, ...]
    noise: dict[str, float]  # of each log: residual, A rms
    without: dict[str, Array]  # values without each log; NaN: the others can't tell them
    parts: Array  # values without each block

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: Name) -> float:
        return float(self.values[self.names.index(name)])

    def get(self, key: str) -> float:
        """The coefficient of a single column, 0 if it isn't there."""
        found = dict(zip(self.names, self.values.tolist(), strict=True))
        return float(found.get((key,), 0.0))

    def error(self, name: Name) -> float:
        return float(self.errors[self.names.index(name)])

    def beside(self, name: Name, simulated: Fit) -> float:
        """Standard error of a value less that of a fit of simulated logs, by a jackknife over blocks of both.

        What a closed loop does to a block it does to the simulated one, too, so it is in no error.
        """
        own, other = self.parts[:, self.names.index(name)], np.zeros(0)
        if name in simulated:
            other = simulated.parts[:, simulated.names.index(name)]
        if len(own) != len(other):  # cut in other places
            return float(np.sqrt(2)) * self.error(name)
        return float(jackknife(own - other))

    def between_logs(self, name: Name, simulated: Fit | None = None) -> float:
        """Standard error by a jackknife over logs, where three or more can be left out; else 0.

        It is widened by Student's t for so few: twice it is an error at 95 %. `simulated`: a fit of simulated
        logs, whose own differences between logs are taken off.
        """
        parts = []
        for log, values in self.without.items():
            part = values[self.names.index(name)]
            if simulated is not None and name in simulated and log in simulated.without:
                part = part - simulated.without[log][simulated.names.index(name)]
            parts.append(part)
        told = np.array([part for part in parts if np.isfinite(part)])
        count = len(told)
        if count < 3:
            return 0.0
        return float(student.ppf(0.975, count - 1)) / 2 * float(jackknife(told))

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
    """Solve; each log weighs by the variance of its residual, found by solving three times.

    StudyError: no rows, such as of logs shorter than the kernel.
    """
    if not rows:
        raise StudyError("in no log the motor turns in one direction for long enough: expected longer logs")
    names = all_names(rows)
    logs = {each.log.name for each in rows}
    of_a_log = max(OF_A_LOG, -(-BLOCKS // len(logs)))
    plain = [block for each in rows for block in _blocks(each, names, of_a_log)]
    noise = dict.fromkeys(logs, 1.0)
    for _ in range(3):
        blocks = [block.per(noise[block.log]) for block in plain]
        values = solved(blocks, len(names))
        noise = {log: _noise([block for block in plain if block.log == log], values) for log in logs}
    parts = np.array([solved([b for b in blocks if b is not out], len(names)) for out in blocks])
    without = _without(blocks, len(names))
    return Fit(names, values, jackknife(parts), inflation(blocks), tuple(blocks), noise, without, parts)


def jackknife(parts: Array) -> Array:
    """Standard errors of values of which each row leaves a part of the data out."""
    count = len(parts)
    return np.asarray(np.sqrt((count - 1) / count * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0)))


def _without(blocks: Sequence[Block], size: int) -> dict[str, Array]:
    """Values without each log."""
    found = {}
    logs = dict.fromkeys(block.log for block in blocks)
    for log in logs if len(logs) > 1 else ():
        others = [block for block in blocks if block.log != log]
        values = solved(others, size)
        found[log] = np.where(inflation(others) < LARGEST_INFLATION, values, np.nan)
    return found


def _blocks(rows: Rows, names: Sequence[Name], count: int) -> list[Block]:
    place = [names.index(name) for name in rows.names]
    found = []
    for part in np.array_split(np.arange(len(rows.y)), min(count, max(1, len(rows.y) // 10))):
        columns, y = rows.columns[part], rows.y[part]
        matrix, vector = np.zeros((len(names), len(names))), np.zeros(len(names))
        steps = np.zeros(len(names))
        steps[place] = rows.noise[part].sum(axis=0)
        matrix[np.ix_(place, place)] = columns.T @ columns
        matrix -= np.diag(steps)
        vector[place] = columns.T @ y
        found.append(Block(rows.log.name, matrix, vector, steps, float(y @ y), len(y)))
    return found


def _noise(blocks: Sequence[Block], values: Array) -> float:
    """Residual of a log, A rms: at least a millionth of its current."""
    total, rows = sum(block.squares for block in blocks), sum(block.rows for block in blocks)
    left = sum(
        b.squares - 2 * values @ b.vector + values @ b.matrix @ values + b.steps @ values**2 for b in blocks
    )
    return float(np.sqrt(max(left, 1e-12 * total, 1e-24) / max(rows, 1)))


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
