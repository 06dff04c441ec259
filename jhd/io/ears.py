"""Triangles of polygons: fans about the first corner where these are the polygon, else ears that are cut off.

A polygon is seen along the axis in which its normal is longest. The triangles of a fan do not overlap if all of them,
and all triangles of the first side and another corner, turn the same way. Of other polygons ears are cut off, one by
one: corners whose triangle turns as the polygon does and holds no further corner. A corner that does not turn gives a
triangle without area, so that sides keep the corners that other faces have there.

The triangles turn one way, are glued along their sides, and have the polygon as their border. A polygon that crosses
itself has no such triangles in general, and is refused. Ears are found in whole numbers, so nothing rounds.

Source: Meisters, Polygons have ears, American Mathematical Monthly 82 (1975).
"""

from collections.abc import Sequence

import numpy as np

from jhd.distance.certificate.verification.pieces import integers

# Of the rounding of a product of two differences, less another one, as a share of the sum of both: four units in the
# last place. And what is lost where they underflow.
_ROUNDING, _UNDERFLOW = 8 * 2.0**-53, 1e-300

_Place = tuple[int, int]
_Ear = tuple[int, int, int]


def are_fans(corners: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Of polygons whether their fans are proven to be them; what floats do not decide counts as no.

    Args:
        corners: the coordinates of the corners of all polygons, one after the other, (corners, 3).
        sizes: their numbers of corners, each at least 3.
    """
    first = np.cumsum(sizes) - sizes
    counts = sizes - 2
    start = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(sizes)), counts)
    k = first[polygon] + 1 + np.arange(counts.sum()) - start[polygon]
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        origin = corners[first][polygon]
        here, after, side = corners[k] - origin, corners[k + 1] - origin, corners[first + 1][polygon] - origin
        normal = np.add.reduceat(np.cross(here, after), start, axis=0)
        axis = np.argmax(np.abs(normal), axis=1)
        ahead = np.sign(np.take_along_axis(normal, axis[:, None], 1)[:, 0])[polygon]
        columns = np.stack([axis + 1, axis + 2], axis=1)[polygon] % 3
        here, after, side = (np.take_along_axis(x, columns, 1) for x in (here, after, side))
        good = _turns(here, after, ahead) & _turns(side, after, ahead)
    return np.logical_and.reduceat(good, start)


def _turns(p: np.ndarray, q: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    left, right = p[:, 0] * q[:, 1], p[:, 1] * q[:, 0]
    return ahead * (left - right) > _ROUNDING * (np.abs(left) + np.abs(right)) + _UNDERFLOW


def ears(corners: np.ndarray) -> list[_Ear] | None:
    """As many triangles as a fan has, of the corners (corners, 3) of one polygon; None where it crosses itself."""
    flat, _ = integers(corners.ravel().tolist())
    rows = [tuple(flat[k : k + 3]) for k in range(0, len(flat), 3)]
    fan = [(0, k, k + 1) for k in range(1, len(rows) - 1)]
    doubled = [[_area([rows[i][u] for i in f], [rows[i][v] for i in f]) for f in fan] for u, v in _SEEN]
    normal = [sum(areas) for areas in doubled]
    axis = max(range(3), key=lambda k: abs(normal[k]))
    if not normal[axis]:
        # Along a line, back and forth: its sides are the fan. Else it is as much one way around as the other.
        return None if any(map(any, doubled)) else fan
    u, v = _SEEN[axis] if normal[axis] > 0 else _SEEN[axis][::-1]
    return _cut([(row[u], row[v]) for row in rows])


# The axes of what is seen along each.
_SEEN = ((1, 2), (2, 0), (0, 1))


def _area(x: Sequence[int], y: Sequence[int]) -> int:
    """Twice the area of a triangle, positive where it turns from x towards y."""
    return (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])


def _turn(p: _Place, q: _Place, r: _Place) -> int:
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def _cut(places: Sequence[_Place]) -> list[_Ear] | None:
    """The ears of a polygon in the plane of positive area."""
    left, found, at, missed = list(range(len(places))), [], 0, 0
    straight = False
    while len(left) > 3:
        ear = (left[at - 1], left[at], left[(at + 1) % len(left)])
        if _is_ear(places, left, ear, straight):
            found.append(ear)
            del left[at]
            # The next corner but one: ears in turn make no thin triangles about one corner.
            at, missed, straight = (at + 1) % len(left), 0, False
            continue
        at, missed = (at + 1) % len(left), missed + 1
        if missed == len(left):
            if straight:
                return None
            missed, straight = 0, True
    last = (left[0], left[1], left[2])
    return None if _turn(*(places[k] for k in last)) < 0 else [*found, last]


def _is_ear(places: Sequence[_Place], left: Sequence[int], ear: _Ear, straight: bool) -> bool:
    """Whether a corner can be cut off; of those that do not turn, where these are meant."""
    p, q, r = (places[k] for k in ear)
    turn = _turn(p, q, r)
    if straight or turn <= 0:
        return straight and turn == 0
    low, high = min(p[0], q[0], r[0]), max(p[0], q[0], r[0])
    for k in left:
        s = places[k]
        if low <= s[0] <= high and s not in (p, q, r):
            if _turn(p, q, s) >= 0 and _turn(q, r, s) >= 0 and _turn(r, p, s) >= 0:
                return False
    return True
