"""Solve the balance of all logs with instruments, and find errors by leaving out blocks.

In the normal equations, the acceleration's row is not multiplied by the acceleration but by its instrument,
the slow part of the acceleration. The instrument has neither the angle's fast noise nor the law's answer to
the noise. A log at one speed has no slow acceleration, and so shows nothing of inertia.

Errors are a jackknife's over blocks of the logs. They are widened where logs, quarters of logs, or states of
the motion differ by more: a current with waves faster than the rows is wrong by the same amount in each ramp,
and so in each block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import f as fisher
from scipy.stats import t as student

from cogless.errors import StudyError
from cogless.identify.balance import LADDER, LOG_BLOCKS, WIDE_INSTRUMENT, Name, Rows, all_names
from cogless.results.trace import Array

BLOCK_ROWS_LEAST = 6  # a block has no fewer
LOG_QUARTERS = 4  # parts of a log, and of its speeds, that are compared with each other
# states of a log's motion, each a quarter of the speeds and a sign of the acceleration
MOTION_STATES = 2 * LOG_QUARTERS
WEIGHING_ROUNDS = 4
SINGULAR_SHARE = 1e-11  # singular value of scaled equations, over the largest, below which it counts as 0
WELL_POSED = 1e9  # largest condition of scaled equations that are inverted
DELAY_SMOOTHING = 0.02  # s
ALONE = np.eye(len(LADDER))  # shares of the instruments, for each instrument by itself
LARGEST_INFLATION = 100.0  # largest factor by which the other columns may inflate a variance


@dataclass(frozen=True, eq=False)
class Block:
    """Normal equations of a part of a log, for all columns: products with columns, and with instruments.

    `matrix`, `vector`: products of the columns with the columns and with the current. `noise`: part of the
    matrix's diagonal by the angle's noise. `instruments`, `driven`: products of each of the acceleration's
    instruments with the columns and with the current. `late`: both products of the delay's instrument.
    """

    log: str
    part: int  # quarter of the log
    matrix: Array
    vector: Array
    noise: Array
    instruments: Array
    driven: Array
    squares: float  # A^2
    rows: int
    late: tuple[Array, float] | None = None


@dataclass(frozen=True, eq=False)
class Inertia:
    """An inertia by some instrument, and its change without each block.

    `product`: of instrument and acceleration.
    """

    value: float
    moved: Array
    product: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients by name, and their standard errors.

    `intervals`: errors at 95 %. `covariance`, `freedom`: covariance and degrees of freedom by the jackknife.
    `normal`: normal matrix without instruments. `noise`: residual of each log, A rms. `equations`: log,
    weighted matrix and weighted vector of each block.
    """

    names: tuple[Name, ...]
    values: Array
    errors: Array
    intervals: Array
    covariance: Array
    freedom: Array
    normal: Array
    noise: dict[str, float]
    equations: tuple[tuple[str, Array, Array], ...] = ()

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: Name) -> float:
        return float(self.values[self.names.index(name)])

    def get(self, key: str) -> float:
        """The coefficient of a single column, 0 if it isn't there."""
        return self[key,] if (key,) in self.names else 0.0

    def error(self, name: Name) -> float:
        """Standard error of a coefficient."""
        return float(self.errors[self.names.index(name)])

    def interval(self, name: Name) -> float:
        """Error of a coefficient at 95 %."""
        return float(self.intervals[self.names.index(name)])

    def clearness(self, kind: str, order: int) -> float:
        """Size of a wave over its error at 95 %."""
        place = [self.names.index((kind, order, part)) for part in "cs"]
        wave = self.values[place]
        return float(wave @ wave / max(float(np.linalg.norm(wave * self.intervals[place])), 1e-300))

    def chance(self, kind: str, order: int) -> float:
        """Chance that noise alone gives a wave as large as this, by Hotelling's test."""
        place = [self.names.index((kind, order, part)) for part in "cs"]
        covariance = self.covariance[np.ix_(place, place)]
        freedom = max(2.0, float(np.min(self.freedom[place])))
        wave = self.values[place]
        try:
            square = float(wave @ np.linalg.solve(covariance, wave)) / 2 * (freedom - 1) / freedom
        except np.linalg.LinAlgError:
            return 1.0
        return float(fisher.sf(square, 2, freedom - 1))

    @cached_property
    def inflation(self) -> Array:
        """Factor by which the other columns inflate the variance of each coefficient."""
        return inflation(self.normal)

    def prediction(self, rows: Rows, without: str | None = None) -> Array:
        """i_q that the coefficients give for these rows, A. `without`: log left out of the coefficients."""
        values = self.values
        if without is not None:
            others = [(matrix, vector) for log, matrix, vector in self.equations if log != without]
            if not others:
                return np.zeros(len(rows.y))
            matrices, vectors = zip(*others, strict=True)
            values, _ = solved(np.sum(matrices, axis=0), np.sum(vectors, axis=0))
        by_name = dict(zip(self.names, values, strict=True))
        return np.asarray(rows.columns @ np.array([by_name.get(name, 0.0) for name in rows.names]))


def solved(matrix: Array, vector: Array) -> tuple[Array, Array]:
    """The solution of the equations and the inverse matrix. What the equations leave open is 0."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    scales = np.outer(scale, scale)
    scaled = matrix / scales
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        inverse = np.full_like(scaled, np.inf)
    if not np.linalg.norm(inverse) * np.linalg.norm(scaled) < WELL_POSED:
        inverse = np.linalg.pinv(scaled, rcond=SINGULAR_SHARE)
    inverse = inverse / scales
    return inverse @ vector, inverse


def jackknife(parts: Array) -> Array:
    """Standard errors of values. Each row of `parts` has the values with one part of the data left out."""
    count = len(parts)
    return np.asarray(np.sqrt((count - 1) / count * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0)))


def inflation(matrix: Array) -> Array:
    """Factor by which the other columns inflate the variance of each coefficient; inf: the column is zero."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    factors = np.full(len(scale), np.inf)
    used = scale > 0
    values, vectors = np.linalg.eigh(matrix[np.ix_(used, used)] / np.outer(scale[used], scale[used]))
    factors[used] = np.sum(vectors**2 / np.maximum(values, 1e-12), axis=1)
    return factors


class Equations:
    """The normal equations of logs. They can be solved with any one of the acceleration's instruments.

    `removed`: kinds and orders of columns of the rows that the equations leave out. A stretch is copied
    without them only while it is used, so that a whole second set of rows is never in memory. StudyError:
    there are no rows, as with logs shorter than the kernel.
    """

    def __init__(self, rows: Sequence[Rows], removed: frozenset[Name] = frozenset()) -> None:
        if not rows:
            raise StudyError(
                "in no log the motor turns in one direction for long enough: expected longer logs"
            )
        self.rows, self._removed = tuple(rows), removed
        self.names = tuple(name for name in all_names(rows) if name[:2] not in removed)
        self.logs = tuple(dict.fromkeys(stretch.log.name for stretch in rows))

    def without(self, *columns: Name) -> Equations:
        """These equations without columns of these kinds and orders; `own` columns go with their cogging."""
        removed = {*columns, *(("own", *order) for kind, *order in columns if kind == "cogging")}
        return Equations(self.rows, self._removed | removed)

    def _used(self, rows: Rows) -> Rows:
        return rows.without(self._removed) if self._removed else rows

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        blocks: list[Block] = []
        for log in self.logs:
            own = [rows for rows in self.rows if rows.log.name == log]
            whole, done = sum(len(rows.y) for rows in own), 0
            for rows in own:
                stretch, late = self._used(rows), self._late.get(id(rows))
                count, place = len(stretch.y), [self.names.index(name) for name in stretch.names]
                part_count = max(1, min(round(LOG_BLOCKS * count / whole), count // BLOCK_ROWS_LEAST))
                for part in np.array_split(np.arange(count), part_count):
                    if len(part):
                        quarter = min(LOG_QUARTERS - 1, LOG_QUARTERS * (done + int(part[0])) // whole)
                        blocks.append(
                            self._block(stretch, late, place, slice(part[0], part[-1] + 1), quarter)
                        )
                done += count
        return tuple(blocks)

    @cached_property
    def _late(self) -> dict[int, Array]:
        """Instrument of the delay, by id of the rows: the current's derivative by angle and slow course.

        The instrument has no noise that goes round the control loop.
        """
        instruments = {}
        for rows in self.rows:
            if ("delay",) in self._removed or ("delay",) not in rows.names:
                continue
            stretch = self._used(rows)
            column = stretch.columns[:, stretch.names.index(("delay",))]
            angular = [
                k
                for k, name in enumerate(stretch.names)
                if name[0] in ("c", "b", "offset", "cogging", "ripple", "own")
            ]
            count = len(stretch.y)
            if count <= 4 * (2 * len(angular) + 1):
                instruments[id(rows)] = np.zeros(count)
                continue
            base = stretch.columns[:, angular]
            smooth = gaussian_filter1d(column, DELAY_SMOOTHING / stretch.spacing)
            base = np.column_stack([base, np.gradient(base, axis=0), smooth])
            instruments[id(rows)] = base @ solved(base.T @ base, base.T @ column)[0]
        return instruments

    def _block(
        self, rows: Rows, course: Array | None, place: Sequence[int], part: slice, quarter: int
    ) -> Block:
        """The block of a part of rows. `course`: the delay's instrument, if there is one.

        `place`: the index of each of the rows' columns among all columns.
        """
        size = len(self.names)
        columns, y = rows.columns[part], rows.y[part]
        z = rows.instruments[:, part] if ("j",) in rows.names else np.zeros((len(LADDER), len(y)))
        matrix, vector, noise = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        matrix[np.ix_(place, place)] = columns.T @ columns
        vector[place] = columns.T @ y
        for name, variances in rows.noise.items():
            noise[self.names.index(name)] = variances[part].sum()
        instruments = np.zeros((len(z), size))
        instruments[:, place] = z @ columns
        late = None
        if course is not None:
            products = np.zeros(size)
            products[place] = course[part] @ columns
            late = (products, float(course[part] @ y))
        return Block(
            log=rows.log.name,
            part=quarter,
            matrix=matrix,
            vector=vector,
            noise=noise,
            instruments=instruments,
            driven=z @ y,
            squares=float(y @ y),
            rows=len(y),
            late=late,
        )

    @cached_property
    def _stacked(self) -> tuple[Array, Array]:
        """Matrices of all blocks, less the angle's noise, and vectors.

        The delay's row has the products with the delay's instrument.
        """
        matrices = np.array([block.matrix - np.diag(block.noise) for block in self.blocks])
        vectors = np.array([block.vector for block in self.blocks])
        if ("delay",) in self.names:
            place = self.names.index(("delay",))
            for k, block in enumerate(self.blocks):
                late = block.late or (np.zeros(len(self.names)), 0.0)
                matrices[k, place], vectors[k, place] = late
        return matrices, vectors

    @cached_property
    def _plain(self) -> dict[str, tuple[Array, Array, float, int]]:
        """Matrix, vector, square of the current and rows of each log."""
        sums = {}
        for log in self.logs:
            own = [block for block in self.blocks if block.log == log]
            matrix, vector = np.sum([b.matrix for b in own], axis=0), np.sum([b.vector for b in own], axis=0)
            sums[log] = matrix, vector, sum(b.squares for b in own), sum(b.rows for b in own)
        return sums

    def noises(self, instrument: int = WIDE_INSTRUMENT) -> dict[str, float]:
        """Residual of each log, A rms."""
        weights = self._weights(instrument)
        return dict(zip(self.logs, (weights**-0.5).tolist(), strict=True))

    def cost(self, instrument: int = WIDE_INSTRUMENT) -> float:
        """Sum over all logs: count of rows times the logarithm of the residual's variance."""
        counts = dict.fromkeys(self.logs, 0)
        for rows in self.rows:
            counts[rows.log.name] += len(rows.y)
        return float(sum(2 * counts[log] * np.log(x) for log, x in self.noises(instrument).items()))

    def _with(self, shares: Array) -> tuple[Array, Array]:
        """Matrices and vectors of all blocks, with these shares of the instruments in the inertia's row."""
        matrices, vectors = self._stacked
        if ("j",) in self.names:
            place, matrices, vectors = self.names.index(("j",)), matrices.copy(), vectors.copy()
            matrices[:, place] = [shares @ block.instruments for block in self.blocks]
            vectors[:, place] = [shares @ block.driven for block in self.blocks]
        return matrices, vectors

    def _weights(self, instrument: int) -> Array:
        """Weight of each log: the inverse of its residual's variance."""
        return self._solved(*self._with(ALONE[instrument]))[4]

    def inertia(self, shares: Array, instrument: int) -> Inertia:
        """The inertia with these shares of the instruments.

        `instrument`: index of the instrument whose fit weighs the logs.
        """
        place, weights = self.names.index(("j",)), self._weights(instrument)[self._log_of]
        matrices, vectors = self._with(shares)
        matrices, vectors = weights[:, None, None] * matrices, weights[:, None] * vectors
        matrix = matrices.sum(axis=0)
        values, inverse = solved(matrix, vectors.sum(axis=0))
        moved = _without_each(matrices, vectors, values, inverse)
        return Inertia(float(values[place]), moved[:, place], float(matrix[place, place]))

    @cached_property
    def _log_of(self) -> NDArray[np.intp]:
        return np.array([self.logs.index(block.log) for block in self.blocks])

    def _solved(self, matrices: Array, vectors: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Matrix, vector, solution, inverse, and the weight of each log."""
        logs = range(len(self.logs))
        sums = np.array([matrices[self._log_of == k].sum(axis=0) for k in logs])
        sides = np.array([vectors[self._log_of == k].sum(axis=0) for k in logs])
        weights = np.ones(len(self.logs))
        for _ in range(WEIGHING_ROUNDS):
            matrix, vector = np.tensordot(weights, sums, 1), weights @ sides
            values, inverse = solved(matrix, vector)
            weights = np.array([1 / self._variance(log, values) for log in self.logs])
        return np.tensordot(weights, sums, 1), weights @ sides, values, inverse, weights

    def fit(self, instrument: int = WIDE_INSTRUMENT, exact: bool = False) -> Fit:
        """Solve with this one of the acceleration's instruments; each log weighs by its residual.

        `exact`: the jackknife solves anew without each block, and states of the motion widen the errors. Else
        blocks are left out to first order, and the states do not count: their part of the error is the same
        with all instruments, so the choice of an instrument does not need it.
        """
        matrices, vectors = self._with(ALONE[instrument])
        matrix, vector, values, inverse, weights = self._solved(matrices, vectors)
        log_of = self._log_of
        matrices = weights[log_of, None, None] * matrices
        vectors = weights[log_of, None] * vectors
        states = np.zeros((1, len(values)))
        if exact:
            sides = weights[:, None, None] * self._by_state(values, instrument)
            states = np.concatenate(sides) @ inverse.T * MOTION_STATES / (MOTION_STATES - 1)
            others = [solved(matrix - m, vector - v)[0] for m, v in zip(matrices, vectors, strict=True)]
            moved = values - np.array(others)
        else:
            moved = _without_each(matrices, vectors, values, inverse)
        variance, freedom = variance_of(moved)
        intervals = self._intervals(moved, states, variance, freedom)
        plain = sum(weight * self._plain[log][0] for log, weight in zip(self.logs, weights, strict=True))
        return Fit(
            names=self.names,
            values=values,
            errors=intervals / 2,
            intervals=intervals,
            covariance=moved.T @ moved,
            freedom=freedom,
            normal=np.asarray(plain),
            noise=dict(zip(self.logs, (weights**-0.5).tolist(), strict=True)),
            equations=tuple(
                (block.log, m, v) for block, m, v in zip(self.blocks, matrices, vectors, strict=True)
            ),
        )

    def _by_state(self, values: Array, instrument: int) -> Array:
        """Products of residual and columns or instruments, summed by log, state of motion and column.

        A state is a quarter of the log's speeds, with an acceleration of one sign.
        """
        sums = np.zeros((len(self.logs), MOTION_STATES, len(values)))
        for k, log in enumerate(self.logs):
            own = [rows for rows in self.rows if rows.log.name == log]
            shares = np.arange(1, LOG_QUARTERS) / LOG_QUARTERS
            edges = np.quantile(np.concatenate([rows.omega for rows in own]), shares)
            for whole in own:
                rows, late = self._used(whole), self._late.get(id(whole))
                place = [self.names.index(name) for name in rows.names]
                residual, course = rows.y - rows.columns @ values[place], rows.instruments[instrument]
                factors = np.array(rows.columns)
                for name, x in ((("j",), course), (("delay",), late)):
                    if name in rows.names and x is not None:
                        factors[:, rows.names.index(name)] = x
                states = np.searchsorted(edges, rows.omega) + LOG_QUARTERS * (course > 0)
                for state in np.unique(states):
                    members = states == state
                    sums[k, state, place] += residual[members] @ factors[members]
        return sums

    def _intervals(self, moved: Array, states: Array, variance: Array, freedom: Array) -> Array:
        """Errors at 95 % by blocks, or larger ones where logs, quarters of logs or states differ by more.

        The excess variance is a random effect with few degrees of freedom. The sum of both variances has
        degrees of freedom after Satterthwaite.
        """
        widest = student.ppf(0.975, freedom) * np.sqrt(variance)
        parts = [np.array([block.part for block in self.blocks]) + LOG_QUARTERS * self._log_of, self._log_of]
        by_part = [np.array([moved[part == one].sum(axis=0) for one in np.unique(part)]) for part in parts]
        for groups in (*by_part, states):
            between, fewer = variance_of(groups)
            excess = np.maximum(0.0, between - variance)
            total = np.maximum(variance + excess, 1e-300)
            spare = total**2 / np.maximum(excess**2 / fewer + variance**2 / freedom, 1e-300)
            widest = np.maximum(widest, student.ppf(0.975, np.maximum(spare, 1.0)) * np.sqrt(total))
        return widest

    def _variance(self, log: str, values: Array) -> float:
        """Variance of a log's residual, A^2: at least 1e-9 of the current's mean square."""
        matrix, vector, squares, count = self._plain[log]
        residual = squares - 2 * values @ vector + values @ matrix @ values
        return max(float(residual), 1e-9 * squares + 1e-18) / count

    def residuals(self, fit: Fit) -> list[tuple[Rows, Array]]:
        """The rows of each part, and their residual of i_q, A."""
        return [(rows, rows.y - fit.prediction(self._used(rows))) for rows in self.rows]


def _without_each(matrices: Array, vectors: Array, values: Array, inverse: Array) -> Array:
    """Change of the values when one block is left out, to first order; a row for each block."""
    count = len(matrices)
    return np.asarray((vectors - matrices @ values) @ inverse.T * count / max(1, count - 1))


def variance_of(moved: Array) -> tuple[Array, Array]:
    """Variance of a sum, and its degrees of freedom after Satterthwaite.

    Satterthwaite's formula needs the squared variances of the parts. For normal parts the mean of the fourth
    power is three times the squared variance.
    """
    squares = moved**2
    variance = squares.sum(axis=0)
    parts = variance**2 / np.maximum((squares**2).sum(axis=0), 1e-300)
    return variance, np.clip(3 * parts - 2, 1.0, max(1, len(moved) - 1))


def fit(rows: Sequence[Rows]) -> Fit:
    """Solve with a wide instrument. StudyError: no rows."""
    return Equations(rows).fit()
