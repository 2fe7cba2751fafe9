"""Smallest sets of vertices around points, in as many dimensions as the points really have.

Points are rows, scaled by their spread, so that units do not matter: docs/theory/trial-design.md.
Qhull's work grows with the dimension's power: above `QHULL_DIMENSIONS` all distinct points stay.

`enclose` answers what a nonlinear map does to a polytope: the images of the corners need not contain the
images of the inside. Where they don't, the hull of the corners is inflated about its centre and widened by a
box (in more than two directions by a cross-polytope) in the directions that it lacks.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cogless.design.margins import Real

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

QHULL_DIMENSIONS = 6
FLAT = 1e-8  # singular value beside the largest below which a direction is none
THIN = 0.1  # the same, below which a direction is boxed instead of inflated
CONSTANT = 1e-11  # spread beside size below which an entry is constant
NEGLECTED = 1e-4  # of an entry's spread: a bend into a direction that the corners lack
INSIDE = 1e-7  # of the hull's size: as good as inside
SPARE = 0.1  # of what lies outside, added: samples don't reach the very extremes


@dataclass(frozen=True)
class _Frame:
    """Affine coordinates of points: x = origin + scale * (basis^T c + rest)."""

    origin: Real
    scale: Real
    basis: Real  # (d, m), orthonormal rows

    def of(self, points: Real) -> tuple[Real, Real]:
        """Coordinates and what lies off the affine hull, scaled."""
        scaled = _scaled(points, self.origin, self.scale)
        inside = scaled @ self.basis.T
        return inside, scaled - inside @ self.basis

    def back(self, inside: Real, rest: Real) -> Real:
        """The points at coordinates."""
        return np.asarray(self.origin + self.scale * (inside @ self.basis + rest))


@dataclass(frozen=True)
class Enclosure:
    """Vertices (M, m) of a polytope; `exact` where it is the hull of the corners, which holds all samples."""

    vertices: Real
    kept: tuple[int, ...]  # which corners they are; empty where exact is false
    exact: bool
    outside: float  # how far samples lie outside the hull of the corners, as a share of its size


def minimal(points: Real) -> tuple[int, ...]:
    """Rows that are the vertices of the points' convex hull, in their order, each once."""
    frame = _frame(points, points)
    inside, _ = frame.of(points)
    return _vertices(inside)


def enclose(corners: Real, samples: Real) -> Enclosure:
    """A polytope that holds corners and samples; the hull of the corners if that does."""
    frame = _frame(corners, np.vstack([corners, samples]))
    base, _ = frame.of(corners)
    inside, rest = frame.of(samples)
    kept = _vertices(base)
    base = base[list(kept)]
    factor = float(_gauge(base, inside).max(initial=0.0))
    off = float(np.abs(rest).max(initial=0.0))
    if factor <= 1 + INSIDE and off <= INSIDE:
        return Enclosure(corners[list(kept)], kept, True, 0.0)
    # Where the corners hardly differ, their hull would have to grow without measure: box it.
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


def _qhull(points: Real) -> ConvexHull | None:
    """The hull of full-dimensional points; None where Qhull can't make it."""
    if points.shape[1] > QHULL_DIMENSIONS:
        return None
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except QhullError:
        return None


def _vertices(points: Real) -> tuple[int, ...]:
    """Vertices of the hull of full-dimensional points (count, d)."""
    dimensions = points.shape[1]
    if dimensions == 0:
        return (0,)
    if dimensions == 1:
        return tuple(sorted({int(points[:, 0].argmin()), int(points[:, 0].argmax())}))
    _, first = np.unique(np.round(points / INSIDE), axis=0, return_index=True)
    distinct = np.sort(first)
    hull = _qhull(points[distinct])
    return tuple((distinct if hull is None else np.sort(distinct[hull.vertices])).tolist())


def _gauge(vertices: Real, points: Real) -> Real:
    """Factor by which the hull of the vertices has to grow about their mean to hold each point."""
    dimensions = points.shape[1]
    if dimensions == 0 or not len(points):
        return np.zeros(len(points))
    centre = vertices.mean(axis=0)
    if dimensions == 1:
        up, down = vertices.max() - centre[0], centre[0] - vertices.min()
        from_centre = points[:, 0] - centre[0]
        return np.asarray(np.maximum(from_centre / up, -from_centre / down))
    hull = _qhull(vertices)
    if hull is not None:
        normals, offsets = hull.equations[:, :-1], hull.equations[:, -1]
        return np.asarray(((points - centre) @ normals.T / (-offsets - normals @ centre)).max(axis=1))
    from scipy.optimize import nnls

    tie = 1e-5  # so small that the sum of the weights hardly matters, but it decides between representations
    rows = np.vstack([(vertices - centre).T, tie * np.ones(len(vertices))])
    return np.array([nnls(rows, np.append(point - centre, 0.0))[0].sum() for point in points])


def _directions(rest: Real) -> Real:
    """A polytope around rows off the affine hull: a box, in more directions a cross-polytope.

    With half-axes s_i that holds r where sum |r_i| / s_i <= 1; half-widths h_i and s_i ~ sqrt(h_i) make it
    smallest.
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
