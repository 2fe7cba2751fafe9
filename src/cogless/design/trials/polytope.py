"""An uncertain plant as a polytope of discrete models: (1) and (2) of Mandra 2019.

docs/theory/trial-design.md#the-plant-as-a-polytope derives it. The polytope is made from ranges of physical
parameters, or from vertices. The hull of the corners' models need not contain the models of all parameters,
so this is tested on samples. If some are outside, a larger polytope that contains them is used, and `note`
says so.

Smallest sets of vertices whose convex hull contains given points, in the space that the points span.

Points are rows, scaled by their spread, so that units do not matter: docs/theory/trial-design.md. Qhull's
work grows steeply with the dimension: above `QHULL_DIMENSIONS` dimensions all distinct points are kept.

`enclose` makes a polytope around the image of a polytope under a nonlinear map. The hull of the corners'
images need not contain the images of inner points. If it doesn't, it is inflated about its centre. In the
directions that the corners don't span it is widened by a box, or by a cross-polytope if these directions are
more than two.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from cogless.design.trials.model import (
    DesignError,
    Discretisation,
    Model,
    Real,
    first_effect,
    markov,
    relative_degree,
    sampled,
)
from cogless.design.trials.sensing import Sensor, sensed

QHULL_DIMENSIONS = 6  # largest number of dimensions in which a hull is computed
FLAT_SHARE = 1e-8  # share of the largest singular value; below it the points do not span a direction
# share of the largest singular value; below it a direction gets a box instead of being inflated
THIN_SHARE = 0.1
CONSTANT_SPREAD = 1e-11  # spread / magnitude of an entry; below it the entry is constant
# share of an entry's spread; less than this is ignored in a direction that the corners lack
NEGLECTED_SHARE = 1e-4
STRAIGHT_AREA = 1e-14  # twice a triangle's area / the spread's square; below it the corner is dropped
# a point counts as inside if it is outside by less than this share of the hull's size
INSIDE_TOLERANCE = 1e-7
RESERVE_SHARE = 0.1  # share of the excess that is added as reserve, because samples do not reach the extremes


@dataclass(frozen=True)
class _Frame:
    """Affine coordinates c of points x = origin + scale * (basis^T c + rest)."""

    origin: Real
    scale: Real
    basis: Real  # (d, m), orthonormal rows

    def coordinates(self, points: Real) -> tuple[Real, Real]:
        """Coordinates c of points, and `rest`, their scaled offsets from the affine hull."""
        scaled = _scaled(points, self.origin, self.scale)
        inside = scaled @ self.basis.T
        return inside, scaled - inside @ self.basis

    def back(self, inside: Real, rest: Real) -> Real:
        """The points with given coordinates and offsets: the inverse of `coordinates`."""
        return np.asarray(self.origin + self.scale * (inside @ self.basis + rest))


@dataclass(frozen=True)
class _Hull:
    """A convex hull: indices of its vertices; outward normals n and offsets o of its facets, n x + o = 0."""

    vertices: NDArray[np.signedinteger]
    normals: Real
    offsets: Real


@dataclass(frozen=True)
class Enclosure:
    """A polytope of M vertices (M, m); `exact` if it is the corners' hull and that contains all samples."""

    vertices: Real
    corner_indices: tuple[int, ...]  # indices of the corners that are vertices; empty if not exact
    exact: bool
    outside: float  # how far samples lie outside the hull of the corners, as a share of its size


def minimal(points: Real) -> tuple[int, ...]:
    """Indices of the rows that are vertices of the points' convex hull, ascending, each vertex once."""
    frame = _frame(points, points)
    inside, _ = frame.coordinates(points)
    return _vertices(inside)


def enclose(corners: Real, samples: Real) -> Enclosure:
    """A polytope that contains corners and samples: the hull of the corners, if that is enough."""
    frame = _frame(corners, np.vstack([corners, samples]))
    base, _ = frame.coordinates(corners)
    inside, rest = frame.coordinates(samples)
    indices = _vertices(base)
    base = base[list(indices)]
    factor = float(_gauge(base, inside).max(initial=0.0))
    off = float(np.abs(rest).max(initial=0.0))
    if factor <= 1 + INSIDE_TOLERANCE and off <= INSIDE_TOLERANCE:
        return Enclosure(corners[list(indices)], indices, True, 0.0)
    # Directions in which the corners hardly differ get a box: their hull would have to be inflated too far.
    frame = _frame(corners, np.vstack([corners, samples]), THIN_SHARE)
    everything, rest = frame.coordinates(np.vstack([corners, samples]))
    base = everything[list(_vertices(everything[: len(corners)]))]
    factor = max(1.0, float(_gauge(base, everything).max(initial=0.0)))
    off = float(np.abs(rest).max(initial=0.0))
    centre = base.mean(axis=0)
    grown = centre + (1 + (factor - 1) * (1 + RESERVE_SHARE)) * (base - centre)
    moves = _directions(rest) if off > NEGLECTED_SHARE else np.zeros((1, corners.shape[1]))
    vertices = [frame.back(vertex, move) for vertex in grown for move in moves]
    return Enclosure(np.array(vertices), (), False, max(factor - 1, off))


def _frame(corners: Real, everything: Real, flat: float = FLAT_SHARE) -> _Frame:
    origin = corners.mean(axis=0)
    spread = np.ptp(everything, axis=0) / 2
    scale = np.where(spread > CONSTANT_SPREAD * np.abs(everything).max(axis=0), spread, 0.0)
    _, values, rows = np.linalg.svd(_scaled(corners, origin, scale), full_matrices=False)
    thick = values > max(flat * float(values.max(initial=0.0)), FLAT_SHARE)
    return _Frame(origin, scale, rows[: int(np.sum(thick))])


def _scaled(points: Real, origin: Real, scale: Real) -> Real:
    return np.where(scale > 0, (points - origin) / np.where(scale > 0, scale, 1.0), 0.0)


def _hull(points: Real) -> _Hull | None:
    """The convex hull of full-dimensional points; None if Qhull fails or the dimensions are too many."""
    if points.shape[1] == 2:
        return _polygon(points)
    if points.shape[1] > QHULL_DIMENSIONS:
        return None
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    return _Hull(hull.vertices, hull.equations[:, :-1], hull.equations[:, -1])


def _polygon(points: Real) -> _Hull:
    """The hull in the plane, by Andrew's monotone chain; importing scipy.spatial takes longer."""
    order = np.lexsort((points[:, 1], points[:, 0])).tolist()

    def chain(indices: list[int]) -> list[int]:
        corners: list[int] = []
        for index in indices:
            while len(corners) > 1:
                (a, b), (c, d) = (
                    points[corners[-1]] - points[corners[-2]],
                    points[index] - points[corners[-2]],
                )
                if a * d - b * c > STRAIGHT_AREA:
                    break
                corners.pop()
            corners.append(index)
        return corners[:-1]

    ring = np.array(chain(order) + chain(order[::-1]))
    edges = np.roll(points[ring], -1, axis=0) - points[ring]
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    return _Hull(ring, normals, -np.sum(normals * points[ring], axis=1))


def _vertices(points: Real) -> tuple[int, ...]:
    """Indices of the vertices of the convex hull of full-dimensional points (count, d)."""
    dimensions = points.shape[1]
    if dimensions == 0:
        return (0,)
    if dimensions == 1:
        return tuple(sorted({int(points[:, 0].argmin()), int(points[:, 0].argmax())}))
    _, first = np.unique(np.round(points / INSIDE_TOLERANCE), axis=0, return_index=True)
    distinct = np.sort(first)
    hull = _hull(points[distinct])
    return tuple((distinct if hull is None else np.sort(distinct[hull.vertices])).tolist())


def _gauge(vertices: Real, points: Real) -> Real:
    """For each point, the factor by which the vertices' hull has to grow about their mean to contain it."""
    dimensions = points.shape[1]
    if dimensions == 0 or not len(points):
        return np.zeros(len(points))
    centre = vertices.mean(axis=0)
    if dimensions == 1:
        up, down = vertices.max() - centre[0], centre[0] - vertices.min()
        from_centre = points[:, 0] - centre[0]
        return np.asarray(np.maximum(from_centre / up, -from_centre / down))
    hull = _hull(vertices)
    if hull is not None:
        reach = -hull.offsets - hull.normals @ centre
        return np.asarray(((points - centre) @ hull.normals.T / reach).max(axis=1))
    from scipy.optimize import nnls

    tie = 1e-5  # small penalty on the sum of the weights: it only selects between equally good solutions
    rows = np.vstack([(vertices - centre).T, tie * np.ones(len(vertices))])
    return np.array([nnls(rows, np.append(point - centre, 0.0))[0].sum() for point in points])


def _directions(rest: Real) -> Real:
    """A polytope around offsets from the affine hull: a box in up to two directions, else a cross-polytope.

    A cross-polytope with half-axes s_i contains r if sum |r_i| / s_i <= 1. For offsets with half-widths h_i
    it is smallest if s_i is proportional to sqrt(h_i).
    """
    _, _, axes = np.linalg.svd(rest, full_matrices=False)
    along = rest @ axes.T
    keep = np.abs(along).max(axis=0) > NEGLECTED_SHARE
    axes, along = axes[keep], along[:, keep]
    low, high = np.minimum(along.min(axis=0), 0.0), np.maximum(along.max(axis=0), 0.0)
    low, high = low - RESERVE_SHARE * (high - low) / 2, high + RESERVE_SHARE * (high - low) / 2
    if len(axes) <= 2:
        corners = itertools.product(*zip(low, high, strict=True))
        return np.array([np.array(corner) @ axes for corner in corners])
    middle, root = (low + high) / 2, np.sqrt((high - low) / 2)
    reach = float((np.abs(along - middle) / root).sum(axis=1).max()) * (1 + RESERVE_SHARE)
    ends = [middle + sign * reach * half for half in np.diag(root) for sign in (-1.0, 1.0)]
    return np.asarray(np.array(ends) @ axes)


Parameters = Mapping[str, float]
Range = tuple[float, float]
Physics = Callable[[Parameters], tuple[ArrayLike, ArrayLike]]
Models = tuple[list[Model], list[Model] | None]  # discrete models; the exactly sampled ones, if known
Draw = Callable[[Generator, int], Models]
CERTIFIED_PLANTS = 60  # number of random plants that a certificate covers, and of mixtures of vertices
INSIDE_SAMPLES = 200  # number of sampled parameter sets whose models must be in the polytope


@dataclass(frozen=True)
class UncertainPlant:
    """The discrete models for which a design has to hold; `period` is in s."""

    C: Real  # (n,)
    period: float
    discretisation: Discretisation | None  # None: the models were given as discrete ones
    vertices: tuple[Model, ...]  # minimal
    labels: tuple[str, ...]  # a name of each vertex, for messages
    nominal: Model
    exact_vertices: tuple[Model, ...] | None  # the corners, sampled exactly; None if not known
    exact_nominal: Model | None
    relative_degree: int  # r
    exact_hull: bool  # the polytope is the corners' hull, and that contains all samples
    note: str
    sensor: Sensor = field(default=Sensor(), kw_only=True)  # a law gets the exactly sampled models through it
    #: draws a number of random discrete models within the uncertainty, and the same plants sampled exactly
    sample: Draw = field(repr=False, compare=False)

    @property
    def order(self) -> int:
        """Number of states, n."""
        return len(self.C)

    @cached_property
    def random(self) -> Models:
        """Random models, the same for all certificates: discrete ones, then exactly sampled ones or None.

        The discrete ones include mixtures of vertices.
        """
        rng = np.random.default_rng(0)
        drawn, exact = self.sample(rng, CERTIFIED_PLANTS)
        return [*drawn, *_mixtures(self.vertices, rng, CERTIFIED_PLANTS)], exact

    @property
    def as_held(self) -> UncertainPlant:
        """This plant exactly sampled, with the corners as vertices; this plant itself if that isn't known."""
        if self.exact_vertices is None or self.exact_nominal is None:
            return self

        def sample(rng: Generator, count: int) -> Models:
            _, exact = self.sample(rng, count)
            return list(exact or ()), exact

        labels = self.labels
        if len(labels) != len(self.exact_vertices):
            labels = tuple(f"corner {k + 1}" for k in range(len(self.exact_vertices)))
        return replace(
            self,
            discretisation="exact",
            vertices=self.exact_vertices,
            labels=labels,
            nominal=self.exact_nominal,
            relative_degree=relative_degree(self.exact_nominal.plant, self.C),
            sample=sample,
        )

    def seen_by(self, sensor: Sensor) -> UncertainPlant:
        """The same plants, of which a law gets the exactly sampled ones by this sensor."""
        if self.exact_vertices is None or self.exact_nominal is None or sensor.at_once:
            return replace(self, sensor=sensor)

        def behind(model: Model) -> Model:
            return sensed(model.plant, self.C, self.period, sensor)

        def sample(rng: Generator, count: int) -> Models:
            designed, exact = self.sample(rng, count)
            return designed, [behind(model) for model in exact or ()]

        return replace(
            self,
            exact_vertices=tuple(map(behind, self.exact_vertices)),
            exact_nominal=behind(self.exact_nominal),
            sensor=sensor,
            sample=sample,
        )

    def shrunk(self, share: float) -> UncertainPlant:
        """The polytope shrunk about the nominal model; share 1 is the full size."""
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
    """The uncertain plant from ranges of physical parameters; `model` maps these to continuous (A_c, B_c).

    If `discretisation` is None, `model` maps them to a discrete (A, B), and there are no exactly sampled
    models. DesignError if a range or a model is invalid.
    """
    for name, (low, high) in ranges.items():
        if not (math.isfinite(low) and math.isfinite(high)):
            raise DesignError(f"range.{name}: [{low:g}, {high:g}]: expected finite numbers")
        if low > high:
            raise DesignError(f"range.{name}: [{low:g}, {high:g}]: expected the smaller end first")
    if nominal is None:
        nominal = {name: (low + high) / 2 for name, (low, high) in ranges.items()}
    missing = sorted(set(nominal) ^ set(ranges))
    if missing:
        lacks = "missing" if missing[0] in ranges else "without a range"
        raise DesignError(f"nominal: expected the parameters that have ranges: {missing[0]} is {lacks}")
    _check_period(period)

    def physical(parameters: Parameters) -> Model:
        try:
            return Model.from_arrays(*model(parameters))
        except ZeroDivisionError:
            raise DesignError(f"range: expected finite numbers at {_parameter_words(parameters)}") from None
        except DesignError as error:
            raise DesignError(f"{error} at {_parameter_words(parameters)}") from None

    def models_within(shares: Real) -> list[Model]:
        low, high = np.array(list(ranges.values()), dtype=float).reshape(-1, 2).T
        rows = (low + shares * (high - low)).tolist()
        return [physical(dict(zip(ranges, row, strict=True))) for row in rows]

    def draw(rng: Generator, count: int) -> Models:
        return _discrete(models_within(rng.random((count, len(ranges)))), period, discretisation)

    ends = (sorted({float(low), float(high)}) for low, high in ranges.values())
    corners = [dict(zip(ranges, corner, strict=True)) for corner in itertools.product(*ends)]
    return _plant(
        C,
        period,
        discretisation,
        draw,
        labels=[_parameter_words(corner) for corner in corners],
        corners=_discrete([physical(corner) for corner in corners], period, discretisation),
        nominal=_discrete([physical(nominal)], period, discretisation),
        images=_designed(models_within(_inside(len(ranges))), period, discretisation) if ranges else [],
        image="a plant within the ranges",
        set_="plants within the ranges",
    )


def from_vertices(
    models: Sequence[tuple[ArrayLike, ArrayLike]],
    C: ArrayLike,
    period: float,
    continuous: bool = False,
    discretisation: Discretisation = "euler",
) -> UncertainPlant:
    """The uncertain plant from vertices [A_j B_j], nominal at their mean; DesignError if one is invalid."""
    if not models:
        raise DesignError("vertex: expected at least one")
    _check_period(period)
    vertices = [Model.from_arrays(*pair, key=f"vertex {k + 1}") for k, pair in enumerate(models)]
    sizes = {m.order for m in vertices}
    if len(sizes) > 1:
        raise DesignError(f"vertex: expected vertices of the same order, not {min(sizes)} and {max(sizes)}")
    indices = minimal(np.array([m.entries for m in vertices]))
    corners = [vertices[k] for k in indices]
    mean = np.mean([m.entries for m in corners], axis=0)
    how = discretisation if continuous else None

    def draw(rng: Generator, count: int) -> Models:
        return _discrete(_mixtures(corners, rng, count), period, how)

    return _plant(
        C,
        period,
        how,
        draw,
        labels=[f"vertex {k + 1}" for k in indices],
        corners=_discrete(corners, period, how),
        nominal=_discrete([Model.from_entries(mean, vertices[0].order)], period, how),
        # only for exact sampling: mixtures of discrete or Euler models are always in the corners' hull
        images=draw(np.random.default_rng(0), INSIDE_SAMPLES)[0] if how == "exact" else [],
        image="a mixture of the vertices",
        set_="exactly sampled plants",
    )


def _discrete(models: Sequence[Model], period: float, how: Discretisation | None) -> Models:
    """Discrete models of continuous ones, and exactly sampled ones; `how` None: they are discrete already."""
    designed = _designed(models, period, how)
    if how != "euler":
        return designed, None if how is None else designed
    return designed, _designed(models, period, "exact")


def _designed(models: Sequence[Model], period: float, how: Discretisation | None) -> list[Model]:
    """The discrete models of `_discrete`, without the exactly sampled ones."""
    return list(models) if how is None else [sampled(m, period, how) for m in models]


def _mixtures(corners: Sequence[Model], rng: Generator, count: int) -> list[Model]:
    rows = np.array([m.entries for m in corners])
    mixed = (
        Model.from_entries(row, corners[0].order) for row in rng.dirichlet(np.ones(len(rows)), count) @ rows
    )
    return [replace(corners[0], A=model.A, B=model.B) for model in mixed]


def _plant(
    C: ArrayLike,
    period: float,
    how: Discretisation | None,
    draw: Draw,
    *,
    labels: list[str],
    corners: Models,
    nominal: Models,
    images: list[Model],
    image: str,
    set_: str,
) -> UncertainPlant:
    """The uncertain plant, whose polytope contains corners and images; the texts name these in messages."""
    (designs, exacts), ((centre,), exact_centre) = corners, nominal
    output = np.asarray(C, dtype=float).ravel()
    if output.shape != (centre.order,):
        raise DesignError(f"output: expected {centre.order} numbers, one per state, not {output.size}")
    if not np.all(np.isfinite(output)) or not np.any(output):
        raise DesignError("output: expected finite numbers that aren't all zero")
    tested = [*zip(labels, designs, strict=True), *((image, m) for m in images)]
    degree = _relative_degree(centre, output, tested)
    note, exact_hull = "", True
    if images:
        samples = np.array([m.entries for m in [*images, centre]])
        hull = enclose(np.array([m.entries for m in designs]), samples)
        exact_hull = hull.exact
        if hull.exact:
            designs = [designs[k] for k in hull.corner_indices]
            labels = [labels[k] for k in hull.corner_indices]
            exacts = exacts and [exacts[k] for k in hull.corner_indices]
        else:
            designs = [Model.from_entries(row, centre.order) for row in hull.vertices]
            labels = [f"vertex {k + 1} of the bounding polytope" for k in range(len(designs))]
            note = (
                f"some {set_} are outside the hull of the corners, by up to {100 * hull.outside:.2g} % of "
                f"the hull's size: the design uses a bounding polytope of {len(designs)} vertices"
            )
    return UncertainPlant(
        C=output,
        period=float(period),
        discretisation=how,
        vertices=tuple(designs),
        labels=tuple(labels),
        nominal=centre,
        exact_vertices=None if exacts is None else tuple(exacts),
        exact_nominal=None if exact_centre is None else exact_centre[0],
        relative_degree=degree,
        exact_hull=exact_hull,
        note=note,
        sample=draw,
    )


def _relative_degree(nominal: Model, C: Real, tested: Sequence[tuple[str, Model]]) -> int:
    """The relative degree. All tested plants must have the same one, and the same sign of the input's effect.

    A bounding polytope contains more than these plants. In the added ones the input may have the other sign.
    """
    degree = relative_degree(nominal, C)
    if not degree:
        raise DesignError(
            "vertex: expected an output that depends on the input; at the nominal plant it does not"
        )
    sign = math.copysign(1.0, markov(nominal.A, nominal.B, C, degree)[-1])
    for label, vertex in tested:
        effects = markov(vertex.A, vertex.B, C, vertex.order)
        tested_degree = first_effect(effects)
        if tested_degree != degree:
            raise DesignError(
                f"vertex: expected the same relative degree at all vertices; {degree} at the nominal plant, "
                f"{tested_degree or 'none'} at {label}"
            )
        if math.copysign(1.0, effects[degree - 1]) != sign:
            raise DesignError(
                f"vertex: expected the input to act in one direction at all vertices; at {label} it acts in "
                "the other"
            )
    return degree


def _inside(count: int) -> Real:
    """Points in `count` ranges as shares 0 to 1: random ones, and the grid of 0, 0.5 and 1."""
    shares = np.random.default_rng(0).random((INSIDE_SAMPLES, count))
    # half of the random points are on the box's surface, where the models are furthest outside the hull
    at = np.arange(INSIDE_SAMPLES // 2)
    shares[at, at % count] = np.round(shares[at, at % count])
    grid = itertools.product((0.0, 0.5, 1.0), repeat=min(count, 4))
    return np.array([*shares.tolist(), *([*row, *[0.5] * (count - len(row))] for row in grid)])


def _check_period(period: float) -> None:
    if not (math.isfinite(period) and period > 0):
        raise DesignError(f"period: {period:g}: expected a time above zero")


def _parameter_words(parameters: Parameters) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in parameters.items()) or "the only plant"
