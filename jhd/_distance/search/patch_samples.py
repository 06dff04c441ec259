"""Samples of parametric shapes: starts for the search of feet, and groups of equal samples; nothing is proven."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import binomials
from jhd._distance.normalization.net_jets import Net
from jhd._triangles.closest_point import TriangleTree, in_unit_of, nearest_triangles, point_tree

# Largest number of pairs of queries and samples that are all compared, as fast as making a tree of some thousand
# samples; and pairs compared at once, few enough for the cache of a processor.
_FEW, _AT_ONCE = 1 << 21, 1 << 16

# Samples of other pieces that count as neighbors, and cells along a unit of length: samples in one cell are equal.
_MOST, _SAME = 3, 2.0**30
# Samples around a pole, onto which an edge is collapsed: the samples of sixteen pieces.
_MOST_AROUND = 96


def samples_beside(samples: np.ndarray) -> np.ndarray:
    """Return for each sample some equal samples of other pieces, (all samples, _MOST), -1 for none.

    Args:
        samples: of all pieces (pieces, samples, 3), with coordinates of at most one.
    """
    count = samples.shape[1]
    place = _places(samples.reshape(-1, 3))
    piece = np.arange(len(place)) // count
    # One sample of each piece at each location.
    _, first = np.unique(place * len(samples) + piece, return_index=True)
    start, size = np.unique(place[first], return_index=True, return_counts=True)[1:]
    found = np.full((len(place), _MOST), -1)
    own = np.searchsorted(place[first] * len(samples) + piece[first], place * len(samples) + piece)
    for k in range(_MOST):
        turned = start[place] + (own - start[place] + k + 1) % size[place]
        found[:, k] = np.where(k + 1 < size[place], first[turned], -1)
    return found


def _places(points: np.ndarray) -> np.ndarray:
    """Return a number for the location of each point (points, 3); equal points have equal numbers."""
    return np.unique(np.rint(points * _SAME), axis=0, return_inverse=True)[1].ravel()


class StartsOfFeet(NamedTuple):
    """Samples from which feet are searched."""

    rows: np.ndarray  # the numbers of the samples from which feet are searched
    beside: np.ndarray  # for each of all samples the numbers of equal samples, or -1
    poles: np.ndarray  # (poles, most) the numbers of the samples of all pieces at each pole, -1 after the last one


def starts_among(samples: np.ndarray) -> StartsOfFeet:
    """Return the samples to start from and equal samples, without pieces that are collapsed onto others.

    Args:
        samples: of all pieces (pieces, places, 3) or (pieces, places, places, 3), with coordinates of at most one.
    """
    kept, flat = _apart_from_others(samples), samples.reshape(len(samples), -1, 3)
    many = flat.shape[1]
    rows = (kept[:, None] * many + np.arange(many)).ravel()
    among = samples_beside(flat[kept])
    beside = np.full((len(samples) * many, among.shape[1]), -1)
    beside[rows] = np.where(among >= 0, rows[among], -1)
    poles = _poles(samples[kept])
    return StartsOfFeet(rows, beside, np.where(poles >= 0, rows[poles], -1))


def _coincide(samples: np.ndarray, axis: int) -> np.ndarray:
    """Return whether samples that are neighbors along an axis are equal."""
    return np.all(np.abs(np.diff(samples, axis=axis)) * _SAME <= 1, axis=-1)


def _poles(samples: np.ndarray) -> np.ndarray:
    """Return the numbers of the samples at each location of coinciding neighbors, -1 after the last one.

    At most _MOST_AROUND evenly chosen samples are kept at a location.
    """
    alike = np.zeros(samples.shape[:-1], bool)
    for axis in range(1, samples.ndim - 1):
        same = _coincide(samples, axis)
        for end in ((1, 0), (0, 1)):
            alike |= np.pad(same, [end if k == axis else (0, 0) for k in range(samples.ndim - 1)])
    rows = np.flatnonzero(alike)
    place = _places(samples.reshape(-1, 3)[rows])
    count = np.bincount(place)
    size = np.minimum(count, _MOST_AROUND)
    found = np.full((len(count), max(size, default=1)), -1)
    order = np.argsort(place, kind="stable")
    column = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    found[place[order], column * np.repeat(size, count) // np.repeat(count, count)] = rows[order]
    return found


def _apart_from_others(samples: np.ndarray) -> np.ndarray:
    """Return the numbers of the pieces, without pieces collapsed onto others, such as empty knot spans.

    A foot on a collapsed piece could only move along it, and its neighbors hold the same points.
    """
    count = len(samples)
    along = range(1, samples.ndim - 1)
    collapsed = np.any([_coincide(samples, k).reshape(count, -1).all(axis=1) for k in along], axis=0)
    if not np.any(collapsed) or np.all(collapsed):
        return np.arange(count)
    place = _places(samples.reshape(-1, 3)).reshape(count, -1)
    elsewhere = np.all(np.isin(place, place[~collapsed]), axis=1)
    return np.flatnonzero(~(collapsed & elsewhere))


class SampledStarts:
    """Approximate nearest points among given points: by comparing all, or by a tree if there are many.

    Args:
        points: (points, 3), with coordinates of at most one.
    """

    def __init__(self, points: np.ndarray):
        self.points = points

    @cached_property
    def _tree(self) -> TriangleTree:
        return point_tree(self.points)

    @cached_property
    def _columns(self) -> np.ndarray:
        return np.ascontiguousarray(self.points.T)

    def nearest(self, queries: np.ndarray) -> np.ndarray:
        """Return the number of a point for each query (queries, 3); far queries only get some point."""
        if len(queries) * len(self.points) > _FEW:
            tree, rows = in_unit_of(self._tree, queries)
            return tree.order[nearest_triangles(tree, rows).triangle]
        step = max(1, _AT_ONCE // len(self.points))
        return np.concatenate([self._among_all(queries[k : k + step]) for k in range(0, len(queries), step)])

    def _among_all(self, queries: np.ndarray) -> np.ndarray:
        square = np.zeros((len(queries), len(self.points)), self.points.dtype)
        with np.errstate(over="ignore"):
            for sample, query in zip(self._columns, queries.T, strict=True):
                step = sample - query[:, None]
                step *= step
                square += step
        return np.argmin(square, axis=1)


def samples_of(net: Net, places: np.ndarray) -> np.ndarray:
    """Return approximate points of all pieces at a grid of parameters, in double precision: equal points stay equal."""
    p, q = net.degrees

    def basis(degree: int, t: np.ndarray) -> np.ndarray:
        k = np.arange(degree + 1)
        return binomials(degree) * t[:, None] ** k * (1 - t[:, None]) ** (degree - k)

    u, v = basis(p, places), basis(q, places if net.parameters == 2 else places[:1])
    points = net.points.astype(np.float64)
    weights = np.ones((*points.shape[:-1], 1)) if net.weights is None else net.weights.astype(np.float64)[..., None]
    along = [np.einsum("ia,jb,kabd->kijd", u, v, x) for x in (points * weights, weights)]
    return along[0] / along[1]
