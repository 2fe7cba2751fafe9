"""Smallest sets of vertices whose convex hull contains given points, in the space that the points span.

Points are rows, scaled by their spread, so that units do not matter: docs/theory/trial-design.md. Qhull's
work grows steeply with the dimension: above `QHULL_DIMENSIONS` dimensions all distinct points are kept.

`enclose` makes a polytope around the image of a polytope under a nonlinear map. The hull of the corners'
images need not contain the images of inner points. If it doesn't, it is inflated about its centre. In the
directions that the corners don't span it is widened by a box, or by a cross-polytope if these directions are
more than two.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogless.design.margins import Real

QHULL_DIMENSIONS = 6
FLAT = 1e-8  # share of the largest singular value; below it the points don't span a direction
THIN = 0.1  # such a share; below it a direction gets a box instead of being inflated
CONSTANT = 1e-11  # spread / magnitude of an entry; below it the entry is constant
NEGLECTED = 1e-4  # share of an entry's spread; less in a direction that the corners lack is ignored
STRAIGHT = 1e-14  # twice a triangle's area, as a share of the spread's square; below it a corner is none
INSIDE = 1e-7  # share of the hull's size; a point this little outside counts as inside
SPARE = 0.1  # share of the excess added as reserve, because samples don't reach the extremes


@dataclass(frozen=True)
class _Frame:
    """Affine coordinates c of points x = origin + scale * (basis^T c + rest)."""

    origin: Real
    scale: Real
    basis: Real  # (d, m), orthonormal rows

    def of(self, points: Real) -> tuple[Real, Real]:
        """Coordinates c of points, and `rest`, their scaled offsets from the affine hull."""
        scaled = _scaled(points, self.origin, self.scale)
        inside = scaled @ self.basis.T
        return inside, scaled - inside @ self.basis

    def back(self, inside: Real, rest: Real) -> Real:
        """The points with given coordinates and offsets: the inverse of `of`."""
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
    kept: tuple[int, ...]  # indices of the corners that are vertices; empty if not exact
    exact: bool
    outside: float  # how far samples lie outside the hull of the corners, as a share of its size


def minimal(points: Real) -> tuple[int, ...]:
    """Indices of the rows that are vertices of the points' convex hull, ascending, each vertex once."""
    frame = _frame(points, points)
    inside, _ = frame.of(points)
    return _vertices(inside)


def enclose(corners: Real, samples: Real) -> Enclosure:
    """A polytope that contains corners and samples: the hull of the corners, if that is enough."""
    frame = _frame(corners, np.vstack([corners, samples]))
    base, _ = frame.of(corners)
    inside, rest = frame.of(samples)
    kept = _vertices(base)
    base = base[list(kept)]
    factor = float(_gauge(base, inside).max(initial=0.0))
    off = float(np.abs(rest).max(initial=0.0))
    if factor <= 1 + INSIDE and off <= INSIDE:
        return Enclosure(corners[list(kept)], kept, True, 0.0)
    # Directions in which the corners hardly differ get a box: their hull would have to be inflated too far.
    frame = _frame(corners, np.vstack([corners, samples]), THIN)
    everything, rest = frame.of(np.vstack([corners, samples]))
    base = everything[list(_vertices(everything[: len(corners)]))]
    factor = max(1.0, float(_gauge(base, everything).max(initial=0.0)))
    off = float(np.abs(rest).max(initial=0.0))
    centre = base.mean(axis=0)
    grown = centre + (1 + (factor - 1) * (1 + SPARE)) * (base - centre)
    moves = _directions(rest) if off > NEGLECTED else np.zeros((1, corners.shape[1]))
    vertices = [frame.back(vertex, move) for vertex in grown for move in moves]
    return Enclosure(np.array(vertices), (), False, max(factor - 1, off))


def _frame(corners: Real, everything: Real, flat: float = FLAT) -> _Frame:
    origin = corners.mean(axis=0)
    spread = np.ptp(everything, axis=0) / 2
    scale = np.where(spread > CONSTANT * np.abs(everything).max(axis=0), spread, 0.0)
    _, values, rows = np.linalg.svd(_scaled(corners, origin, scale), full_matrices=False)
    thick = values > max(flat * float(values.max(initial=0.0)), FLAT)
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
        found: list[int] = []
        for index in indices:
            while len(found) > 1:
                (a, b), (c, d) = points[found[-1]] - points[found[-2]], points[index] - points[found[-2]]
                if a * d - b * c > STRAIGHT:
                    break
                found.pop()
            found.append(index)
        return found[:-1]

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
    _, first = np.unique(np.round(points / INSIDE), axis=0, return_index=True)
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
    keep = np.abs(along).max(axis=0) > NEGLECTED
    axes, along = axes[keep], along[:, keep]
    low, high = np.minimum(along.min(axis=0), 0.0), np.maximum(along.max(axis=0), 0.0)
    low, high = low - SPARE * (high - low) / 2, high + SPARE * (high - low) / 2
    if len(axes) <= 2:
        corners = itertools.product(*zip(low, high, strict=True))
        return np.array([np.array(corner) @ axes for corner in corners])
    middle, root = (low + high) / 2, np.sqrt((high - low) / 2)
    reach = float((np.abs(along - middle) / root).sum(axis=1).max()) * (1 + SPARE)
    ends = [middle + sign * reach * half for half in np.diag(root) for sign in (-1.0, 1.0)]
    return np.asarray(np.array(ends) @ axes)
