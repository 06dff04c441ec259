"""Samples of parametric shapes: starts for the search of feet, and samples at the same point; nothing is proven."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import binomials
from jhd._distance.normalization.net_jets import Net
from jhd._triangles.closest_point import TriangleTree, in_unit_of, nearest_triangles, point_tree

# Pairs of queries and samples of which all are looked at, which takes no longer than to make a tree of some thousand
# samples; and how many of them at once, few enough for the cache of a processor.
_FEW, _AT_ONCE = 1 << 21, 1 << 16

# Samples of pieces that count as neighbors, and in how many units a length of one is divided to tell whether samples
# are at one place.
_MOST, _SAME = 3, 2.0**30
# Samples around a place onto which an edge is collapsed: those of sixteen pieces.
_MOST_AROUND = 96


def samples_beside(samples: np.ndarray) -> np.ndarray:
    """For each sample some of other pieces at the same place, (all samples, _MOST), -1 for none.

    Args:
        samples: of all pieces (pieces, samples, 3), with coordinates of at most one.
    """
    count = samples.shape[1]
    place = _places(samples.reshape(-1, 3))
    piece = np.arange(len(place)) // count
    # Of a piece one sample at each place.
    _, first = np.unique(place * len(samples) + piece, return_index=True)
    start, size = np.unique(place[first], return_index=True, return_counts=True)[1:]
    found = np.full((len(place), _MOST), -1)
    own = np.searchsorted(place[first] * len(samples) + piece[first], place * len(samples) + piece)
    for k in range(_MOST):
        turned = start[place] + (own - start[place] + k + 1) % size[place]
        found[:, k] = np.where(k + 1 < size[place], first[turned], -1)
    return found


def _places(points: np.ndarray) -> np.ndarray:
    """The number of the place of each point (points, 3); those of one place have the same."""
    return np.unique(np.rint(points * _SAME), axis=0, return_inverse=True)[1].ravel()


class StartsOfFeet(NamedTuple):
    """Starts of feet.

    Args:
        rows: the numbers of the samples that feet are looked for from.
        beside: for each of all samples others at its place, or -1.
        poles: (poles, most) the numbers of the samples of all pieces at each place onto which an edge is collapsed, -1
            after the last one.
    """

    rows: np.ndarray
    beside: np.ndarray
    poles: np.ndarray


def starts_among(samples: np.ndarray) -> StartsOfFeet:
    """The samples that serve, and those at the same places; of pieces that are collapsed onto others there are none.

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
    """Whether samples that are neighbors along an axis are at one place."""
    return np.all(np.abs(np.diff(samples, axis=axis)) * _SAME <= 1, axis=-1)


def _poles(samples: np.ndarray) -> np.ndarray:
    """The numbers of the samples at each place where neighboring samples of a piece coincide, -1 after the last one.

    Of more than _MOST_AROUND samples at a place some are left out, evenly.
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
    """The numbers of the pieces but for those that are collapsed onto others, as those of empty knot spans are.

    A foot would be moved along a collapsed piece alone, where its neighbors hold the same points.
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
    """Which of some points is about nearest to queries: by all of them, or by a tree of them where there are many.

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
        """The number of a point for each query (queries, 3); queries from afar only get some point."""
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
    """Points of all pieces at a grid of parameters, about; in double precision, so that equal points stay equal."""
    p, q = net.degrees

    def basis(degree: int, t: np.ndarray) -> np.ndarray:
        k = np.arange(degree + 1)
        return binomials(degree) * t[:, None] ** k * (1 - t[:, None]) ** (degree - k)

    u, v = basis(p, places), basis(q, places if net.parameters == 2 else places[:1])
    points = net.points.astype(np.float64)
    weights = np.ones((*points.shape[:-1], 1)) if net.weights is None else net.weights.astype(np.float64)[..., None]
    along = [np.einsum("ia,jb,kabd->kijd", u, v, x) for x in (points * weights, weights)]
    return along[0] / along[1]
