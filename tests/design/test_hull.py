"""Polytopes around points: how far a hull has to grow, and what directions add to it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cogless.design.trials.polytope import _directions, _frame, _gauge, _hull, _vertices, enclose


def test_on_a_line_the_gauge_is_the_distance_in_halves() -> None:
    """From the vertices' mean, 3, to 1 and 7: the mean of three vertices is not the middle."""
    vertices = np.array([[1.0], [1.0], [7.0]])
    points = np.array([[3.0], [7.0], [1.0], [11.0], [-3.0], [2.0]])
    assert _gauge(vertices, points) == pytest.approx([0.0, 1.0, 1.0, 2.0, 3.0, 0.5])


@pytest.mark.parametrize("dimensions", [2, 3, 7])
def test_a_cube_grows_by_the_largest_coordinate(dimensions: int) -> None:
    """Above six dimensions without Qhull."""
    cube = np.array(list(itertools.product((-1.0, 1.0), repeat=dimensions))) + 0.25
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, dimensions))
    found = _gauge(cube, points + 0.25)
    assert found == pytest.approx(np.abs(points).max(axis=1), rel=1e-4)
    assert (_hull(cube) is None) == (dimensions == 7)


def test_no_dimension_needs_no_growth() -> None:
    assert _gauge(np.zeros((1, 0)), np.zeros((3, 0))).tolist() == [0.0] * 3
    assert _vertices(np.zeros((4, 0))) == (0,)
    assert _vertices(np.array([[2.0], [-1.0], [0.5], [2.0]])) == (0, 1)


def test_a_frame_leads_there_and_back() -> None:
    """Points in a plane of three dimensions, one entry constant: two directions, whatever the units."""
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(10, 2)) @ rng.normal(size=(2, 3)) * [1.0, 1e-6, 1e6]
    points = np.column_stack([flat, np.full(10, 5.0)])
    frame = _frame(points, points)
    assert frame.basis.shape == (2, 4) and frame.scale[3] == 0.0
    inside, rest = frame.coordinates(points)
    assert rest == pytest.approx(np.zeros((10, 4)), abs=1e-12)
    assert frame.back(inside, rest) / [1, 1e-6, 1e6, 1] == pytest.approx(points / [1, 1e-6, 1e6, 1])
    assert frame.basis @ frame.basis.T == pytest.approx(np.eye(2))


@pytest.mark.parametrize("count", [1, 2])
def test_a_box_around_offsets_has_a_tenth_to_spare(count: int) -> None:
    """From zero to the largest on each side, and a twentieth of that more at each end."""
    rest = np.zeros((4, 3))
    rest[0, 0], rest[1, 0] = 0.3, -0.1
    if count == 2:
        rest[2, 1] = 0.02
    found = _directions(rest)
    assert len(found) == 2**count
    assert sorted({round(float(x), 9) for x in found[:, 0]}) == pytest.approx([-0.12, 0.32])
    if count == 2:
        assert sorted({round(float(x), 9) for x in found[:, 1]}) == pytest.approx([-0.001, 0.021])
    assert found[:, 2].tolist() == [0.0] * len(found)


def test_offsets_in_many_directions_get_a_cross_polytope() -> None:
    rng = np.random.default_rng(0)
    rest = rng.normal(size=(50, 4)) * [1.0, 0.5, 0.1, 1e-6]  # the last is neglected
    found = _directions(rest)
    assert len(found) == 6
    middle = found.reshape(3, 2, 4).mean(axis=1)
    assert middle[0] == pytest.approx(middle[1]) and middle[0] == pytest.approx(middle[2])
    axes = (found.reshape(3, 2, 4)[:, 1] - middle[0]) / 1.0
    lengths = np.linalg.norm(axes, axis=1)
    shares = np.abs((rest - middle[0]) @ (axes / lengths[:, None] ** 2).T).sum(axis=1)
    assert shares.max() == pytest.approx(1 / 1.1, rel=1e-5)  # a tenth to spare


def test_a_hull_of_corners_that_is_enough_stays_as_it_is() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])
    found = enclose(square, np.array([[0.2, 0.9], [1.0, 0.5]]))
    assert (found.exact, found.corner_indices, found.outside) == (True, (0, 1, 2, 3), 0.0)
    out = enclose(square, np.array([[0.5, 1.2]]))
    assert not out.exact and out.corner_indices == ()
    # scaled by the spread of all, 1 and 1.2: 0.7 over 0.5 of the height; a tenth of the excess more
    assert out.outside == pytest.approx(0.4)
    assert out.vertices[:, 1].max() == pytest.approx(0.5 + 0.5 * (1 + 0.4 * 1.1))


def test_samples_beside_a_line_of_corners_get_a_box_with_a_tenth_to_spare() -> None:
    found = enclose(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.5, 0.1], [0.2, 0.0]]))
    assert not found.exact and found.corner_indices == ()
    expected = [[0.0, -0.005], [0.0, 0.105], [1.0, -0.005], [1.0, 0.105]]
    assert sorted(found.vertices.tolist()) == pytest.approx(np.array(expected))
    assert found.outside == pytest.approx(2.0)  # of half the samples' spread


def test_a_thin_hull_gets_a_box_instead_of_growing_along_its_length() -> None:
    """The corners span a twentieth of the samples' height: the hull would have to grow to twenty times it."""
    thin = np.array([[0.0, -0.05], [1.0, -0.05], [1.0, 0.05], [0.0, 0.05]])
    found = enclose(thin, np.array([[0.5, 1.0], [0.5, -1.0]]))
    assert len(found.vertices) == 4
    assert found.vertices[:, 0] == pytest.approx([0.0, 0.0, 1.0, 1.0])
    assert found.vertices[:, 1] == pytest.approx([-1.1, 1.1, -1.1, 1.1])
    thick = enclose(thin * [1.0, 3.0], np.array([[0.5, 1.0], [0.5, -1.0]]))  # grows to 1 / 0.15 of its size
    assert np.ptp(thick.vertices[:, 0]) == pytest.approx(1 + 1.1 * (1 / 0.15 - 1))


@pytest.mark.parametrize(("beside", "count"), [(5e-5, 4), (2e-4, 8)])
def test_what_is_hardly_beside_the_corners_is_told_but_adds_no_vertices(beside: float, count: int) -> None:
    plane = np.array([[x, y, x + y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    normal = np.array([1.0, 1.0, -2.0]) / 6**0.5  # entries scaled by their spreads, 1, 1 and 2
    found = enclose(plane, beside * normal[None, :] * [1.0, 1.0, 2.0])
    assert not found.exact and len(found.vertices) == count
    assert found.outside == pytest.approx(beside * (4 / 6) ** 0.5)
