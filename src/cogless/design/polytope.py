"""An uncertain plant as a polytope of discrete models, (1) and (2) of Mandra 2019, and the set it stands for.

    x(p+1) = A(lambda) x(p) + B(lambda) (u(p) - d(p)),  y = C x,  [A B](lambda) = sum lambda_j [A_j B_j]

Made from ranges of physical parameters, or from vertices. The corners of a box of ranges map to vertices;
their hull is minimal. Whether it holds the images of all parameters is tested on samples, because it need
not: exact sampling and parameters that enter nonlinearly bend the set. Where it doesn't, the polytope is one
that does, and `note` says so.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from cogless.design.error import DesignError
from cogless.design.hull import Enclosure, enclose, minimal
from cogless.design.model import Discretisation, Model, Real, markov, relative_degree, sampled

Parameters = Mapping[str, float]
Range = tuple[float, float]
Physics = Callable[[Parameters], tuple[ArrayLike, ArrayLike]]
CERTIFIED = 60  # random plants that a certificate speaks of, and as many mixtures
INSIDE_SAMPLES = 200  # parameters whose images have to lie in the polytope


@dataclass(frozen=True)
class UncertainPlant:
    """Discrete models that a design has to hold for. Lengths in samples, `period` in s."""

    C: Real  # (n,)
    period: float
    discretisation: Discretisation | None  # None: the models were given as discrete ones
    vertices: tuple[Model, ...]  # minimal
    labels: tuple[str, ...]  # what each vertex is, for messages
    nominal: Model
    exact_vertices: (
        tuple[Model, ...] | None
    )  # the plant at its corners under a held input; None where it isn't known
    exact_nominal: Model | None
    relative_degree: int  # r
    exact_hull: bool  # the vertices are the hull of the corners and hold all samples
    note: str
    draw: Callable[[Generator, int], tuple[list[Model], list[Model] | None]] = field(
        repr=False, compare=False
    )

    @property
    def order(self) -> int:
        """n."""
        return self.nominal.order

    def sample(self, rng: Generator, count: int) -> tuple[list[Model], list[Model] | None]:
        """Discrete models from within the uncertainty, and the exactly sampled ones of the same plants."""
        return self.draw(rng, count)

    @cached_property
    def random(self) -> tuple[list[Model], list[Model] | None]:
        """Random models, the same for all certificates; the discrete ones include mixtures of vertices."""
        rng = np.random.default_rng(0)
        drawn, exact = self.draw(rng, CERTIFIED)
        rows = np.array([m.entries for m in self.vertices])
        mixtures = rng.dirichlet(np.ones(len(rows)), CERTIFIED) @ rows
        return [*drawn, *(Model.from_entries(row, self.order) for row in mixtures)], exact

    def shrunk(self, share: float) -> UncertainPlant:
        """The polytope drawn together about the nominal model; share 1 is all of it."""
        nominal = self.nominal.entries
        models = [
            Model.from_entries(nominal + share * (vertex.entries - nominal), self.order)
            for vertex in self.vertices
        ]
        return replace(self, vertices=tuple(models), exact_vertices=None, exact_nominal=None)


def from_parameters(
    model: Physics,
    ranges: Mapping[str, Range],
    C: ArrayLike,
    period: float,
    discretisation: Discretisation | None = "euler",
    nominal: Parameters | None = None,
) -> UncertainPlant:
    """The plant over ranges of physical parameters; `model` maps them to continuous (A_c, B_c). DesignError.

    `discretisation` None: model maps them to a discrete (A, B), of which no exactly sampled one is known.
    """
    for name, (low, high) in ranges.items():
        _check_range(name, low, high)
    middle = {name: (low + high) / 2 for name, (low, high) in ranges.items()}
    if nominal is not None:
        missing = sorted(set(nominal) ^ set(ranges))
        if missing:
            raise DesignError(
                f"nominal: expected the same parameters as the ranges, not {missing[0]}", "nominal"
            )
        middle = dict(nominal)
    period = _check_period(period)

    def continuous(parameters: Parameters) -> Model:
        try:
            return Model.of(*model(parameters))
        except ZeroDivisionError:
            raise DesignError(f"range: expected finite numbers at {_at(parameters)}", "range") from None
        except DesignError as error:
            raise DesignError(f"{error} at {_at(parameters)}", error.key) from None

    def both(points: Sequence[Parameters]) -> tuple[list[Model], list[Model]]:
        physical = [continuous(point) for point in points]
        if discretisation is None:
            return physical, physical
        exact = [sampled(m, period, "exact") for m in physical]
        if discretisation == "exact":
            return exact, exact
        return [sampled(m, period, "euler") for m in physical], exact

    names = list(ranges)
    corners = [
        dict(zip(names, corner, strict=True))
        for corner in itertools.product(*(_ends(ranges[n]) for n in names))
    ]
    designs, exacts = both(corners)
    (centre,), (exact_centre,) = both([middle])
    output = _check_output(C, centre.order)

    def draw(rng: Generator, count: int) -> tuple[list[Model], list[Model] | None]:
        shares = rng.random((count, len(names)))
        low = np.array([ranges[n][0] for n in names])
        high = np.array([ranges[n][1] for n in names])
        points = [dict(zip(names, map(float, row), strict=True)) for row in low + shares * (high - low)]
        models, of_exact = both(points)
        return models, None if discretisation is None else of_exact

    images = both(_inside(names, ranges) if names else [])[0]
    samples = np.array([m.entries for m in [*images, centre]])
    hull = enclose(np.array([m.entries for m in designs]), samples)
    kept, labels, note = _kept(
        hull, designs, [_at(corner) for corner in corners], "the ranges map to a set that"
    )
    known = discretisation is not None
    exact = [exacts[k] for k in hull.kept] if hull.exact else exacts
    return _finish(
        UncertainPlant(
            C=output,
            period=period,
            discretisation=discretisation,
            vertices=tuple(kept),
            labels=tuple(labels),
            nominal=centre,
            exact_vertices=tuple(exact) if known else None,
            exact_nominal=exact_centre if known else None,
            relative_degree=0,
            exact_hull=hull.exact,
            note=note,
            draw=draw,
        ),
        [*zip(map(_at, corners), designs, strict=True), *(("a plant within the ranges", m) for m in images)],
    )


def from_vertices(
    models: Sequence[tuple[ArrayLike, ArrayLike]],
    C: ArrayLike,
    period: float,
    continuous: bool = False,
    discretisation: Discretisation = "euler",
    nominal: tuple[ArrayLike, ArrayLike] | None = None,
) -> UncertainPlant:
    """The plant over a polytope of vertices [A_j B_j]; nominal: their mean by default. DesignError."""
    if not models:
        raise DesignError("vertex: expected at least one", "vertex")
    period = _check_period(period)
    given = [Model.of(*pair, key=f"vertex {k + 1}") for k, pair in enumerate(models)]
    sizes = {m.order for m in given}
    if len(sizes) > 1:
        raise DesignError(f"vertex: expected all of one order, not {min(sizes)} and {max(sizes)}", "vertex")
    n = given[0].order
    output = _check_output(C, n)
    rows = np.array([m.entries for m in given])
    kept = list(minimal(rows))
    rows = rows[kept]
    given_nominal = Model.of(*nominal, key="nominal") if nominal else Model.from_entries(rows.mean(axis=0), n)
    if given_nominal.order != n:
        raise DesignError(f"nominal: expected order {n}, not {given_nominal.order}", "nominal")
    labels = [f"vertex {k + 1}" for k in kept]

    def mixed(rng: Generator, count: int) -> list[Model]:
        shares = rng.dirichlet(np.ones(len(rows)), count)
        return [Model.from_entries(row, n) for row in shares @ rows]

    if not continuous:
        vertices = [given[k] for k in kept]
        return _finish(
            UncertainPlant(
                C=output,
                period=period,
                discretisation=None,
                vertices=tuple(vertices),
                labels=tuple(labels),
                nominal=given_nominal,
                exact_vertices=None,
                exact_nominal=None,
                relative_degree=0,
                exact_hull=True,
                note="",
                draw=lambda rng, count: (mixed(rng, count), None),
            ),
            list(zip(labels, vertices, strict=True)),
        )

    def draw(rng: Generator, count: int) -> tuple[list[Model], list[Model] | None]:
        physical = mixed(rng, count)
        exact = [sampled(m, period, "exact") for m in physical]
        return exact if discretisation == "exact" else [sampled(m, period, "euler") for m in physical], exact

    designs = [sampled(given[k], period, discretisation) for k in kept]
    exacts = [sampled(given[k], period, "exact") for k in kept]
    centre, exact_centre = (sampled(given_nominal, period, how) for how in (discretisation, "exact"))
    tested = list(zip(labels, designs, strict=True))
    note, exact_hull = "", True
    if discretisation == "exact":
        images = draw(np.random.default_rng(0), INSIDE_SAMPLES)[0]
        hull = enclose(
            np.array([m.entries for m in designs]), np.array([m.entries for m in [*images, centre]])
        )
        exact_hull = hull.exact
        exacts = [exacts[k] for k in hull.kept] if hull.exact else exacts
        designs, labels, note = _kept(hull, designs, labels, "exact sampling makes a set that")
        tested += [("a mixture of the vertices", m) for m in images]
    return _finish(
        UncertainPlant(
            C=output,
            period=period,
            discretisation=discretisation,
            vertices=tuple(designs),
            labels=tuple(labels),
            nominal=centre,
            exact_vertices=tuple(exacts),
            exact_nominal=exact_centre,
            relative_degree=0,
            exact_hull=exact_hull,
            note=note,
            draw=draw,
        ),
        tested,
    )


def _kept(
    hull: Enclosure, corners: list[Model], labels: list[str], what: str
) -> tuple[list[Model], list[str], str]:
    """The vertices, their labels, and a note where they aren't corners."""
    if hull.exact:
        return [corners[k] for k in hull.kept], [labels[k] for k in hull.kept], ""
    vertices = [Model.from_entries(row, corners[0].order) for row in hull.vertices]
    names = [f"vertex {k + 1} of the bounding polytope" for k in range(len(vertices))]
    note = f"{what} bends out of its corners' hull by {100 * hull.outside:.2g} % of its size: a bounding "
    return vertices, names, f"{note}polytope of {len(vertices)} vertices is used"


def _finish(plant: UncertainPlant, tested: Sequence[tuple[str, Model]]) -> UncertainPlant:
    """The plant with the input's sign and its relative degree, which all plants it is made for must share.

    A bounding polytope holds more than those plants: what it adds may act in the other direction.
    """
    nominal, C = plant.nominal, plant.C
    degree = relative_degree(nominal, C)
    if not degree:
        raise DesignError(
            "vertex: expected an output that sees the input; at the nominal plant it doesn't", "vertex"
        )
    sign = math.copysign(1.0, markov(nominal.A, nominal.B, C, degree)[-1])
    for label, vertex in tested:
        first = markov(vertex.A, vertex.B, C, vertex.order)
        found = np.flatnonzero(first)
        if not len(found) or int(found[0]) + 1 != degree:
            r = int(found[0]) + 1 if len(found) else "none"
            raise DesignError(
                f"vertex: expected the same relative degree at all vertices; {degree} at the nominal "
                f"plant, {r} at "
                f"{label}",
                "vertex",
            )
        if math.copysign(1.0, first[found[0]]) != sign:
            raise DesignError(
                f"vertex: expected the input to act in one direction at all vertices; at {label} it "
                "acts in the other",
                "vertex",
            )
    return replace(plant, relative_degree=degree)


def _inside(names: Sequence[str], ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """Parameters inside their ranges: the middles of pairs of corners' edges and faces, and random ones."""
    rng = np.random.default_rng(0)
    shares = rng.random((INSIDE_SAMPLES, len(names)))
    # half of them on the box's surface, where images bend out the furthest
    at = np.arange(INSIDE_SAMPLES // 2)
    shares[at, at % len(names)] = np.round(shares[at, at % len(names)])
    grid = itertools.product((0.0, 0.5, 1.0), repeat=min(len(names), 4))
    fixed = [list(row) + [0.5] * (len(names) - len(row)) for row in grid]
    return [
        {n: ranges[n][0] + share * (ranges[n][1] - ranges[n][0]) for n, share in zip(names, row, strict=True)}
        for row in [*shares.tolist(), *fixed]
    ]


def _ends(values: Range) -> tuple[float, ...]:
    return tuple(sorted({float(values[0]), float(values[1])}))


def _check_range(name: str, low: float, high: float) -> None:
    key = f"range.{name}"
    if not (math.isfinite(low) and math.isfinite(high)):
        raise DesignError(f"{key}: [{low:g}, {high:g}]: expected finite numbers", key)
    if low > high:
        raise DesignError(f"{key}: [{low:g}, {high:g}]: expected the smaller end first", key)


def _check_period(period: float) -> float:
    if not (math.isfinite(period) and period > 0):
        raise DesignError(f"period: {period:g}: expected a time above zero", "period")
    return float(period)


def _check_output(C: ArrayLike, order: int) -> Real:
    output = np.asarray(C, dtype=float).ravel()
    if output.shape != (order,):
        raise DesignError(f"output: expected {order} numbers, one per state, not {output.size}", "output")
    if not np.all(np.isfinite(output)) or not np.any(output):
        raise DesignError("output: expected finite numbers that aren't all zero", "output")
    return output


def _at(parameters: Parameters) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in parameters.items()) or "the only plant"
