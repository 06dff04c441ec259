"""Drawings of the trimming of Kim et al. 2010: biarcs, the distance to an arc, pixels, and regions about an arc.

Nothing is measured here. Points and arcs are chosen so that each panel shows what its title names; their distances and
feet are computed.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, ORANGE, VERMILLION, letter
from matplotlib.axes import Axes

import jhd

# The segment of (a), and a curve across the pixels of (c).
_SEGMENT = np.array([(0.0, 0.0), (0.5, 1.2), (2.2, 1.3), (3.0, 0.5)])
_CROSSING = np.array([(0.0, 1.0), (1.0, -0.4), (1.8, 2.2), (3.0, 1.3)])
# Ends of the arc about the origin that most panels show, and the radius of the region around that arc.
_FROM, _TO, _REACH = np.radians(145.0), np.radians(35.0), 0.35
# Half the width, as an angle on the unit circle, of an arc of A that leaves the region although its control points are
# inside.
_HALF = np.radians(26.0)
# Radii of the arcs of B and A, half the length and LB of (h); there the lowest point is 1.445 off.
_RADII, _LENGTH, _LB, _OFF = (100.0, 200.0), 10.0, 1.2, -1.195
_PIXEL = 0.25
_LIGHT = ("#9ecae9", "#fbe3a1", "#8fd3b6")
_DOT: dict[str, Any] = {"marker": "o", "markersize": 3.2, "linestyle": "none", "color": BLACK}
_THIN: dict[str, Any] = {"color": GRAY, "linewidth": 0.6}
_B: dict[str, Any] = {"color": BLACK, "linewidth": 1.4}
_A: dict[str, Any] = {"color": BLUE, "linewidth": 1.4}
_BAD: dict[str, Any] = {"color": VERMILLION, "linewidth": 2.4, "solid_capstyle": "butt"}
_POLYGON: dict[str, Any] = {"color": BLUE, "linewidth": 0.7, "marker": "s", "markersize": 3, "linestyle": (0, (3, 1.5))}


def draw_all(axes: np.ndarray) -> None:
    """Draw the eight panels."""
    panels = (
        (_biarc, "biarc with its joint"),
        (_feet, "feet on an arc"),
        (_pixels, "pixels that $A$ passes"),
        (_nearest, "nearest arcs of $B$"),
        (_regions, "region about an arc"),
        (_outside, "arc leaves region 2"),
        (_angle, r"turn $2\theta$, height $e$"),
        (_unsafe, "accepted by eq. (5)"),
    )
    for ax, name, (draw, title) in zip(axes.flat, "abcdefgh", panels, strict=True):
        ax.set_axis_off()
        ax.set_aspect("equal", anchor="N")
        draw(ax)
        letter(ax, name, title)


def _round(start: float, stop: float, radius: float = 1.0) -> np.ndarray:
    angle = np.linspace(start, stop, 121)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _write(ax: Axes, point: Any, text: str, move: tuple[float, float], **style: Any) -> None:
    ax.annotate(text, point, move, textcoords="offset points", ha="center", va="center", **style)


def _biarc(ax: Axes) -> None:
    """Draw a segment, its two arcs, the tangents at its ends, and the joint (figures 1 to 3)."""
    curve = jhd.BezierSegments(_SEGMENT[None])
    arcs = jhd.biarcs(curve, 1.0).segments()
    ax.plot(*np.asarray(curve(np.linspace(0, 1, 121))).T, **{**_THIN, "color": BLACK, "linestyle": (0, (3, 1.5))})
    for k, color in enumerate((BLUE, ORANGE)):
        ax.plot(*np.asarray(arcs(np.linspace(k, k + 1, 61))).T, color=color, linewidth=1.6)
    for end, other in ((0, 1), (3, 2)):
        way = _SEGMENT[other] - _SEGMENT[end]
        tip = _SEGMENT[end] + 0.8 * way / np.linalg.norm(way) * (1 if end == 0 else -1)
        ax.update_datalim([tip])
        ax.annotate("", tip, _SEGMENT[end], arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0})
    ax.plot(*_SEGMENT[[0, 3]].T, **_DOT)
    joint = np.asarray(arcs(np.array([1.0])))[0]
    ax.plot(*joint, **{**_DOT, "markerfacecolor": "white"})
    _write(ax, joint, "joint", (14, -6))
    ax.autoscale_view()


def _arc(ax: Axes) -> tuple[np.ndarray, np.ndarray]:
    """Draw the arc of B about the origin with rays through its ends, and return the ends."""
    first, last = _round(_FROM, _TO)[[0, -1]]
    ax.plot(*_round(_FROM, _TO).T, **_B)
    for end in (first, last):
        ax.plot(*np.stack([0 * end, 1.65 * end]).T, **_THIN)
    ax.plot(0, 0, **_DOT)
    _write(ax, (0, 0), "$O$", (0, -7))
    return first, last


def _feet(ax: Axes) -> None:
    """Draw the feet of three points: on the arc if the point is between the rays, else an end (figure 6)."""
    ax.fill(*np.concatenate([[[0, 0]], _round(_FROM, _TO, 1.65)]).T, color=_LIGHT[0], linewidth=0)
    first, last = _arc(ax)
    inside = np.array([0.12, 1.3])
    pairs = ((inside, inside / np.linalg.norm(inside), "$X$"), ((-1.45, 0.2), first, "$Y$"), ((1.5, 0.3), last, "$Z$"))
    for point, foot, name in pairs:
        ax.plot(*np.stack([point, foot]).T, **{**_B, "color": VERMILLION, "linewidth": 1.0})
        ax.plot(*point, **_DOT)
        ax.plot(*foot, **{**_DOT, "marker": "s", "markerfacecolor": "white"})
        _write(ax, point, name, (0, 7) if name == "$X$" else (0, -7))


def _pixels(ax: Axes) -> None:
    """Draw the pixels that contain samples of the curve; the method reads their depths (figure 9)."""
    along = np.asarray(jhd.BezierSegments(_CROSSING[None])(np.linspace(0, 1, 121)))
    low, high = (np.floor(along.min(axis=0) / _PIXEL) - 1) * _PIXEL, (np.ceil(along.max(axis=0) / _PIXEL) + 1) * _PIXEL
    for i, j in {tuple(place) for place in np.floor(along / _PIXEL).astype(int)}:
        x, y = _PIXEL * i, _PIXEL * j
        ax.fill([x, x + _PIXEL, x + _PIXEL, x], [y, y, y + _PIXEL, y + _PIXEL], color=_LIGHT[1], linewidth=0)
    for x in np.arange(low[0], high[0] + _PIXEL / 2, _PIXEL):
        ax.plot([x, x], [low[1], high[1]], **{**_THIN, "linewidth": 0.3})
    for y in np.arange(low[1], high[1] + _PIXEL / 2, _PIXEL):
        ax.plot([low[0], high[0]], [y, y], **{**_THIN, "linewidth": 0.3})
    ax.plot(*along.T, **_A)
    ax.plot(*along[::8].T, **{**_DOT, "markersize": 2.2})


def _nearest(ax: Axes) -> None:
    """Draw three arcs of B, their cells, and an arc of A with its control points and their feet (figure 11)."""
    turns = np.linspace(_FROM, _TO, 4)
    for k, color in enumerate(_LIGHT):
        cell = np.concatenate([_round(turns[k], turns[k + 1], 1.65), _round(turns[k + 1], turns[k], 0.45)])
        ax.fill(*cell.T, color=color, linewidth=0)
        ax.plot(*_round(turns[k], turns[k + 1]).T, **_B)
    ax.plot(*_round(_FROM, _TO)[[0, 40, 80, 120]].T, **{**_DOT, "marker": "|", "markersize": 7})
    points = _control_points(np.array([0.1, 2.6]), 1.35, np.radians(-90), np.radians(28))
    _control_polygon(ax, points, ("$C_1$", "$C_2$", "$C_3$"))
    for point in points:
        ax.plot(*np.stack([point, point / np.linalg.norm(point)]).T, **_THIN)


def _control_points(center: np.ndarray, radius: float, middle: float, half: float) -> np.ndarray:
    """Return the three control points of an arc from its center, radius, middle direction and half its turn."""
    angles, reach = middle + half * np.array([-1, 0, 1]), radius * np.array([1, 1 / np.cos(half), 1])
    return center + np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1)


def _along(points: np.ndarray) -> np.ndarray:
    """Return points along the arc with these three control points."""
    first, last = points[1] - points[0], points[2] - points[1]
    cosine = first @ (points[2] - points[0]) / (np.linalg.norm(first) * np.linalg.norm(points[2] - points[0]))
    assert np.isclose(np.linalg.norm(first), np.linalg.norm(last))
    t = np.linspace(0, 1, 241)[:, None]
    weights = np.concatenate([(1 - t) ** 2, 2 * cosine * t * (1 - t), t**2], axis=1)
    return weights @ points / weights.sum(axis=1, keepdims=True)


def _control_polygon(ax: Axes, points: np.ndarray, names: tuple[str, ...] = ()) -> None:
    ax.plot(*points.T, **_POLYGON)
    ax.plot(*_along(points).T, **_A)
    for point, name, move in zip(points, names, ((-6, 6), (0, -8), (6, 6)), strict=False):
        _write(ax, point, name, move, color=BLUE)


def _regions(ax: Axes) -> None:
    """Draw the region of all points within LB of the arc: a part of a ring and two half discs (figures 12 and 13)."""
    ring = np.concatenate([_round(_FROM, _TO, 1 + _REACH), _round(_TO, _FROM, 1 - _REACH)])
    ends = ((_FROM, _FROM, _FROM + np.pi), (_TO, _TO - np.pi, _TO))
    discs = [_round(at, at)[0] + _round(start, stop, _REACH) for at, start, stop in ends]
    for part, color in zip((discs[0], ring, discs[1]), _LIGHT, strict=True):
        ax.fill(*part.T, facecolor=color, edgecolor=GRAY, linewidth=0.6)
    first, last = _arc(ax)
    for place, name in ((1.0 * first + (-0.13, -0.13), "1"), (np.array([0.0, 1.17]), "2"), (last + (0.13, -0.13), "3")):
        _write(ax, place, name, (0, 0))
    _write(ax, first, "$A$", (-4, 9))
    _write(ax, last, "$B$", (4, 9))
    at = _round(np.radians(115), np.radians(115))[0]
    ax.annotate(
        "", (1 + _REACH) * at, at, arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.6}
    )
    _write(ax, (1 + _REACH / 2) * at, "$LB$", (-10, 2))


def _outside(ax: Axes) -> None:
    """Draw an arc that leaves the second part although its control points are inside (figure 14)."""
    ring = np.concatenate([_round(_FROM, _TO, 1 + _REACH), _round(_TO, _FROM, 1 - _REACH)])
    ax.fill(*ring.T, facecolor=_LIGHT[1], edgecolor=GRAY, linewidth=0.6)
    _arc(ax)
    # The control points are equally far from O, a little farther than the inner radius of the region.
    radius, reach = 1.0, 1.01 * (1 - _REACH)
    width = radius * np.sin(_HALF)
    points = np.array([(-width, np.sqrt(reach**2 - width**2)), (0.0, reach), (width, np.sqrt(reach**2 - width**2))])
    along = _along(points)
    _control_polygon(ax, points)
    ax.plot(*np.where(np.linalg.norm(along, axis=1, keepdims=True) < 1 - _REACH, along, np.nan).T, **_BAD)


def _angle(ax: Axes) -> None:
    """Draw half the turn of an arc, and the height of its control polygon above the arc (figure 15)."""
    points = _control_points(np.zeros(2), 1.0, np.pi / 2, np.radians(45))
    _control_polygon(ax, points, ())
    for point in points:
        ax.plot(*np.stack([0 * point, point]).T, **_THIN)
    ax.plot(*_round(np.pi / 2, np.radians(45), 0.3).T, **_THIN)
    ax.plot(0, 0, **_DOT)
    _write(ax, (0, 0), "$O$", (0, -7))
    _write(ax, (0.16, 0.4), r"$\theta$", (0, 0))
    ax.plot([0, 0], [1, points[1, 1]], **_BAD)
    _write(ax, (0, 1.2), "$e$", (9, 0), color=VERMILLION)


def _unsafe(ax: Axes) -> None:
    """Plot the distance from an arc of B along an arc of A whose control points satisfy the condition (figure 16)."""
    near, radius = _RADII
    half = np.arcsin(_LENGTH / radius)
    points = _control_points(np.zeros(2), radius, np.pi / 2, half)
    points[:, 1] += near + _OFF - points[1, 1]
    along, off = _along(points), lambda x: np.linalg.norm(x, axis=1) - near
    ax.set_axis_on()
    ax.set_aspect("auto")
    ax.axhspan(-_LB, 0.15, color=_LIGHT[1], linewidth=0)
    ax.plot([-12, 12], [0, 0], **_B)
    ax.plot(along[:, 0], off(along), **_A)
    ax.plot(along[:, 0], np.where(off(along) < -_LB, off(along), np.nan), **_BAD)
    ax.plot(points[:, 0], off(points), **{**_POLYGON, "linestyle": "none"})
    ax.set_xlim(-12, 12)
    ax.set_ylim(-1.55, 0.15)
    ax.set_yticks([0, -_LB], ["0", "$-LB$"])
    ax.set_xlabel("along an arc of $B$")
    ax.set_ylabel("distance from it", labelpad=5)
