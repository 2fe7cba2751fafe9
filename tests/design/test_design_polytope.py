"""Uncertain plants: Mandra 2019's six vertices, degenerate sets, and sets that bend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from design_plants import MANDRA_RANGES, mandra, motor
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from cogless.design.trials.model import (
    DesignError,
    Model,
    Real,
    relative_degree,
    sampled,
    uncontrollable_mode,
)
from cogless.design.trials.polytope import (
    UncertainPlant,
    _polygon,
    enclose,
    from_parameters,
    from_vertices,
    minimal,
)


def inside(vertices: Real, point: Real, slack: float = 1e-7) -> bool:
    """Whether a point is a mixture of vertices, but for a distance of `slack`."""
    shares_of = np.vstack([vertices.T, np.ones(len(vertices))])
    return bool(nnls(shares_of, np.append(point, 1.0))[1] <= slack)


def test_mandra() -> None:
    plant = mandra()
    assert len(plant.vertices) == 6
    assert plant.relative_degree == 2
    assert plant.exact_hull
    assert plant.note == ""
    assert np.round(plant.nominal.A, 4).tolist() == [[1, 0.0025], [0, 0.9958]]
    assert np.round(plant.nominal.B, 4).tolist() == [[0], [1.1212]]


def test_random_plants_are_drawn_for_both_models_and_the_held_plant_is_the_exact_one() -> None:
    plant = mandra()
    discrete, exact = plant.random
    assert exact is not None and (len(discrete), len(exact)) == (120, 60)
    held = plant.as_held
    assert (held.discretisation, held.relative_degree, held.nominal) == ("exact", 1, plant.exact_nominal)
    assert held.vertices == plant.exact_vertices and held.labels == plant.labels
    same, again = held.sample(np.random.default_rng(1), 3)
    assert again is not None and [a is b for a, b in zip(same, again, strict=True)] == [True] * 3
    bent = replace(plant, labels=plant.labels[:-1]).as_held
    assert bent.labels == tuple(f"corner {k}" for k in range(1, 7))
    given = from_vertices([([[0.5]], [1.0])], [1.0], 1e-3)
    assert given.as_held is given and given.random[1] is None


def test_a_polytope_shrinks_about_its_nominal_plant() -> None:
    plant = mandra()
    half, none = plant.shrunk(0.5), plant.shrunk(0.0)
    for vertex, full in zip(half.vertices, plant.vertices, strict=True):
        assert vertex.entries == pytest.approx((full.entries + plant.nominal.entries) / 2)
    assert all(vertex.entries == pytest.approx(plant.nominal.entries) for vertex in none.vertices)
    assert half.exact_vertices is None and half.exact_nominal is None


def test_mandra_vertices_are_minimal_and_hold_all_corners() -> None:
    corners = np.array(
        [[B / J, k / J] for J in (5.9e-4, 10.6e-4) for B in (1.3e-3, 1.5e-3) for k in (0.35, 0.39)]
    )
    kept = minimal(corners)
    assert len(kept) == 6
    hull = corners[list(kept)] / corners.max(axis=0)
    assert all(inside(hull, c / corners.max(axis=0)) for c in corners)


@pytest.mark.parametrize(
    ("ranges", "count"),
    [
        ({"inertia": (6e-4, 6e-4), "friction": (1e-3, 1e-3), "torque_constant": (0.3, 0.3)}, 1),
        ({"inertia": (6e-4, 6e-4), "friction": (1e-3, 1e-3), "torque_constant": (0.3, 0.4)}, 2),
        # along a line: both entries are proportional to 1 / J
        ({"inertia": (6e-4, 9e-4), "friction": (1e-3, 1e-3), "torque_constant": (0.3, 0.3)}, 2),
        ({"inertia": (6e-4, 6e-4), "friction": (1e-3, 2e-3), "torque_constant": (0.3, 0.4)}, 4),
    ],
)
def test_degenerate_ranges(ranges: dict[str, tuple[float, float]], count: int) -> None:
    plant = from_parameters(motor, ranges, [1, 0], 1e-3)
    assert len(plant.vertices) == count
    assert plant.exact_hull


def test_duplicate_and_inner_vertices_are_dropped() -> None:
    A = [[0.9]]
    models = [(A, [[b]]) for b in (1.0, 2.0, 1.0, 1.5, 2.0)]
    plant = from_vertices(models, [1], 1e-3)
    assert [float(m.B[0, 0]) for m in plant.vertices] == [1.0, 2.0]
    assert plant.labels == ("vertex 1", "vertex 2")
    assert plant.exact_hull  # a mixture of vertices is what the plant may be


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 3), st.integers(1, 12), st.integers(0, 2**32 - 1), st.booleans())
def test_minimal_in_a_random_affine_subspace(dimension: int, count: int, seed: int, repeat: bool) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, dimension)) @ rng.normal(size=(dimension, 6)) + rng.normal(size=6)
    points = points * 10.0 ** rng.integers(-4, 4, 6)  # units
    if repeat:
        points = np.vstack([points, points, points.mean(axis=0)])
    kept = list(minimal(points))
    size = np.abs(points).max(axis=0)
    hull = points[kept] / size
    assert all(inside(hull, p / size) for p in points)
    for k in range(len(kept)):
        if len(kept) > 1:
            assert not inside(np.delete(hull, k, axis=0), hull[k])


def test_more_dimensions_than_qhull_likes() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(40, 9))
    assert len(minimal(np.vstack([points, points]))) == 40
    mixtures = rng.dirichlet(np.ones(40), 50) @ points
    assert enclose(points, mixtures).exact
    found = enclose(points, 1.05 * points)
    assert not found.exact
    assert all(inside(found.vertices, 1.05 * p) for p in points)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_bent_sets_are_enclosed(dimension: int) -> None:
    rng = np.random.default_rng(dimension)
    ends = np.array(np.meshgrid(*[[0.0, 1.0]] * dimension)).reshape(dimension, -1).T

    def bent(p: Real) -> Real:
        return np.hstack([p, 0.1 * p**2, np.exp(p[:, :1])])

    found = enclose(bent(ends), bent(rng.random((200, dimension))))
    assert not found.exact
    assert found.outside > 0.01
    assert all(inside(found.vertices, p) for p in bent(rng.random((300, dimension))))


def test_exact_sampling_bends_the_polytope() -> None:
    plant = mandra("exact")
    assert plant.relative_degree == 1
    assert not plant.exact_hull
    assert "bounding polytope of 12 vertices" in plant.note
    assert plant.labels == tuple(f"vertex {k} of the bounding polytope" for k in range(1, 13))
    rows = np.array([m.entries for m in plant.vertices])
    size = np.abs(rows).max(axis=0)
    size[size == 0] = 1
    models, exact = plant.sample(np.random.default_rng(7), 100)
    assert exact is models
    assert all(inside(rows / size, m.entries / size) for m in models)


def test_parameters_that_enter_nonlinearly() -> None:
    plant = from_parameters(lambda p: ([[-p["a"]]], [[p["a"] ** 2]]), {"a": (1.0, 2.0)}, [1], 1e-2)
    assert not plant.exact_hull
    rows = np.array([m.entries for m in plant.vertices])
    assert all(inside(rows, m.entries, 1e-9) for m in plant.sample(np.random.default_rng(3), 200)[0])


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 4), st.integers(0, 2**32 - 1), st.floats(-3, 2))
def test_exact_sampling_is_the_exponential(n: int, seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, n)) * 10**size, rng.normal(size=(n, 1))
    found = sampled(Model(A, B), 0.1, "exact")
    expected = scipy.linalg.expm(0.1 * np.block([[A, B], [np.zeros((1, n + 1))]]))
    np.testing.assert_allclose(found.A, expected[:n, :n], rtol=1e-9, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(found.B, expected[:n, n:], rtol=1e-9, atol=1e-11 * np.abs(expected).max())


def test_continuous_vertices() -> None:
    corners = [motor({"inertia": J, "friction": 1e-3, "torque_constant": 0.3}) for J in (6e-4, 8e-4)]
    euler = from_vertices(corners, [1, 0], 1e-3, continuous=True)
    exact = from_vertices(corners, [1, 0], 1e-3, continuous=True, discretisation="exact")
    assert (euler.relative_degree, exact.relative_degree) == (2, 1)
    assert euler.exact_vertices is not None
    np.testing.assert_allclose(
        euler.exact_vertices[0].A, sampled(Model.from_arrays(*corners[0]), 1e-3, "exact").A
    )
    assert not exact.exact_hull


def test_relative_degree_ignores_rounding_and_units() -> None:
    A = np.array([[1.0, 1e-6], [0.3 - 0.1 * 3, 0.9]])
    assert relative_degree(Model(A, np.array([[0.0], [1e-9]])), np.array([1.0, 0.0])) == 2
    assert relative_degree(Model(A, np.array([[0.0], [1e-9]])), np.array([0.0, 1e5])) == 1
    assert relative_degree(Model(np.diag([0.5, 0.4]), np.array([[1.0], [0.0]])), np.array([0.0, 1.0])) == 0


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_uncontrollable_modes(size: float) -> None:
    A = np.diag([0.5, 0.5])
    assert uncontrollable_mode(A, size * np.array([[1.0], [1.0]])) == pytest.approx(0.5)
    A = np.array([[0.5, 1e-4 * size], [0, 0.5]])
    assert uncontrollable_mode(A, np.array([[0.0], [1.0]])) is None
    assert uncontrollable_mode(A, np.array([[1.0], [0.0]])) == pytest.approx(0.5)


def of(**changes: object) -> Callable[[], UncertainPlant]:
    arguments = {"model": motor, "ranges": MANDRA_RANGES, "C": [1, 0], "period": 1e-3, **changes}
    return lambda: from_parameters(**arguments)


@pytest.mark.parametrize(
    ("make", "key", "message"),
    [
        (of(ranges={**MANDRA_RANGES, "inertia": (2e-3, 1e-3)}), "range.inertia",
            "range.inertia: [0.002, 0.001]: expected the smaller end first"),
        (of(ranges={**MANDRA_RANGES, "inertia": (1e-3, float("nan"))}), "range.inertia",
            "range.inertia: [0.001, nan]: expected finite numbers"),
        (of(ranges={**MANDRA_RANGES, "inertia": (0.0, 1e-3)}), "range",
            "range: expected finite numbers at inertia = 0, friction = 0.0013, torque_constant = 0.35"),
        (of(period=0.0), "period", "period: 0: expected a time above zero"),
        (of(C=[1, 0, 0]), "output", "output: expected 2 numbers, one per state, not 3"),
        (of(C=[0, 0]), "output", "output: expected finite numbers that aren't all zero"),
        (of(ranges={**MANDRA_RANGES, "torque_constant": (-0.35, 0.39)}), "vertex",
            "vertex: expected the input to act in one direction at all vertices; at inertia = 0.00059, "
            "friction = 0.0013, torque_constant = -0.35 it acts in the other"),
        (of(nominal={"inertia": 7e-4}), "nominal",
            "nominal: expected the parameters that have ranges: friction is missing"),
        (lambda: from_vertices([], [1], 1.0), "vertex", "vertex: expected at least one"),
        (lambda: from_vertices([([["x"]], [1])], [1], 1.0), "vertex 1",
            "vertex 1: expected matrices of numbers"),
        (lambda: from_vertices([([[0.5]], [1]), ([[float("nan")]], [1])], [1], 1.0), "vertex 2",
            "vertex 2: expected finite numbers in A and B"),
        (lambda: from_vertices([([[0.5, 1]], [1])], [1], 1.0), "vertex 1",
            "vertex 1: A is 1 x 2, expected as many rows as columns"),
        (lambda: from_vertices([([[0.5]], [[1, 2]])], [1], 1.0), "vertex 1",
            "vertex 1: B is 1 x 2, expected 1 x 1"),
        (lambda: from_vertices([([[0, 1], [0, 0]], [[b], [1]]) for b in (0, 1)], [1, 0], 1.0), "vertex",
            "vertex: expected the same relative degree at all vertices; 1 at the nominal plant, 2 at "
            "vertex 1"),
        (lambda: from_vertices([([[0.5, 0], [0, 0.5]], [[0], [1]])], [1, 0], 1.0), "vertex",
            "vertex: expected an output that depends on the input; at the nominal plant it does not"),
    ],
)  # fmt: skip
def test_errors(make: Callable[[], UncertainPlant], key: str, message: str) -> None:
    with pytest.raises(DesignError) as error:
        make()
    assert str(error.value) == message
    assert error.value.key == key


def test_a_bounding_polytope_may_hold_what_acts_the_other_way() -> None:
    # B is at least 0.001 at all plants, and bends away from the corners' 1.001: the widened box crosses zero
    plant = from_parameters(
        lambda p: ([[p["a"]]], [0.001 + 4 * (p["a"] - 0.5) ** 2]), {"a": (0.0, 1.0)}, [1.0], 1.0, None
    )
    assert not plant.exact_hull
    assert plant.relative_degree == 1
    assert min(m.B[0, 0] for m in plant.vertices) < 0
    with pytest.raises(DesignError, match="act in one direction at all vertices; at a plant within"):
        from_parameters(
            lambda p: ([[p["a"]]], [4 * (p["a"] - 0.5) ** 2 - 0.1]), {"a": (0.0, 1.0)}, [1.0], 1.0, None,
            {"a": 0.1},
        )  # fmt: skip


@given(st.integers(3, 40), st.integers(0, 2**32 - 1))
def test_the_hull_in_the_plane_is_that_of_qhull(count: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 2)).round(1)
    points = np.unique(np.vstack([points, [[9.0, 9.0], [-9.0, 9.0], [0.0, 9.0], [0.3, -9.0]]]), axis=0)
    mine, theirs = _polygon(points), ConvexHull(points)
    assert set(mine.vertices) == set(theirs.vertices)
    facets = np.unique(np.column_stack([mine.normals, mine.offsets]).round(9) + 0.0, axis=0)
    assert np.allclose(facets, np.unique(theirs.equations.round(9) + 0.0, axis=0), atol=1e-8)
