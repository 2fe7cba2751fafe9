"""An uncertain plant as a polytope of discrete models: (1) and (2) of Mandra 2019.

docs/theory/trial-design.md#the-plant-as-a-polytope derives it. The polytope is made from ranges of physical
parameters, or from vertices. The hull of the corners' models need not contain the models of all parameters,
so this is tested on samples. If some are outside, a larger polytope that contains them is used, and `note`
says so.
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
from cogless.design.hull import enclose, minimal
from cogless.design.model import (
    Discretisation,
    Model,
    Real,
    first_effect,
    markov,
    relative_degree,
    sampled,
)
from cogless.design.sensing import Sensor, sensed

Parameters = Mapping[str, float]
Range = tuple[float, float]
Physics = Callable[[Parameters], tuple[ArrayLike, ArrayLike]]
Models = tuple[list[Model], list[Model] | None]  # discrete models; the exactly sampled ones, if known
Draw = Callable[[Generator, int], Models]
CERTIFIED = 60  # number of random plants that a certificate covers, and of mixtures of vertices
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
    sensor: Sensor = field(default=Sensor(), kw_only=True)  # through which a law gets the exact ones
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
        drawn, exact = self.sample(rng, CERTIFIED)
        return [*drawn, *_mixtures(self.vertices, rng, CERTIFIED)], exact

    @property
    def as_held(self) -> UncertainPlant:
        """The same plants exactly sampled, with the corners as vertices, or itself if those aren't known."""
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
        raise DesignError(f"nominal: expected the same parameters as the ranges, not {missing[0]}")
    _check_period(period)

    def physical(parameters: Parameters) -> Model:
        try:
            return Model.of(*model(parameters))
        except ZeroDivisionError:
            raise DesignError(f"range: expected finite numbers at {_at(parameters)}") from None
        except DesignError as error:
            raise DesignError(f"{error} at {_at(parameters)}") from None

    def within(shares: Real) -> list[Model]:
        low, high = np.array(list(ranges.values()), dtype=float).reshape(-1, 2).T
        rows = (low + shares * (high - low)).tolist()
        return [physical(dict(zip(ranges, row, strict=True))) for row in rows]

    def draw(rng: Generator, count: int) -> Models:
        return _discrete(within(rng.random((count, len(ranges)))), period, discretisation)

    ends = (sorted({float(low), float(high)}) for low, high in ranges.values())
    corners = [dict(zip(ranges, corner, strict=True)) for corner in itertools.product(*ends)]
    return _plant(
        C,
        period,
        discretisation,
        draw,
        labels=[_at(corner) for corner in corners],
        corners=_discrete([physical(corner) for corner in corners], period, discretisation),
        nominal=_discrete([physical(nominal)], period, discretisation),
        images=_designed(within(_inside(len(ranges))), period, discretisation) if ranges else [],
        image="a plant within the ranges",
        set_="the ranges map to a set that",
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
    given = [Model.of(*pair, key=f"vertex {k + 1}") for k, pair in enumerate(models)]
    sizes = {m.order for m in given}
    if len(sizes) > 1:
        raise DesignError(f"vertex: expected all of one order, not {min(sizes)} and {max(sizes)}")
    kept = minimal(np.array([m.entries for m in given]))
    corners = [given[k] for k in kept]
    mean = np.mean([m.entries for m in corners], axis=0)
    how = discretisation if continuous else None

    def draw(rng: Generator, count: int) -> Models:
        return _discrete(_mixtures(corners, rng, count), period, how)

    return _plant(
        C,
        period,
        how,
        draw,
        labels=[f"vertex {k + 1}" for k in kept],
        corners=_discrete(corners, period, how),
        nominal=_discrete([Model.from_entries(mean, given[0].order)], period, how),
        # only for exact sampling: mixtures of discrete or Euler models are always in the corners' hull
        images=draw(np.random.default_rng(0), INSIDE_SAMPLES)[0] if how == "exact" else [],
        image="a mixture of the vertices",
        set_="exact sampling makes a set that",
    )


def _discrete(models: Sequence[Model], period: float, how: Discretisation | None) -> Models:
    """Discrete models of continuous ones, and exactly sampled ones; `how` None: they are discrete already."""
    designed = _designed(models, period, how)
    if how != "euler":
        return designed, None if how is None else designed
    return designed, _designed(models, period, "exact")


def _designed(models: Sequence[Model], period: float, how: Discretisation | None) -> list[Model]:
    """The first part of `_discrete` alone."""
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
            designs, labels = [designs[k] for k in hull.kept], [labels[k] for k in hull.kept]
            exacts = exacts and [exacts[k] for k in hull.kept]
        else:
            designs = [Model.from_entries(row, centre.order) for row in hull.vertices]
            labels = [f"vertex {k + 1} of the bounding polytope" for k in range(len(designs))]
            note = f"{set_} bends out of its corners' hull by {100 * hull.outside:.2g} % of its size: "
            note += f"a bounding polytope of {len(designs)} vertices is used"
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
        raise DesignError("vertex: expected an output that sees the input; at the nominal plant it doesn't")
    sign = math.copysign(1.0, markov(nominal.A, nominal.B, C, degree)[-1])
    for label, vertex in tested:
        effects = markov(vertex.A, vertex.B, C, vertex.order)
        found = first_effect(effects)
        if found != degree:
            raise DesignError(
                f"vertex: expected the same relative degree at all vertices; {degree} at the nominal plant, "
                f"{found or 'none'} at {label}"
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


def _at(parameters: Parameters) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in parameters.items()) or "the only plant"
