"""Sketches of shapes for notebooks: lines as SVG text, without a plotting package.

Shapes in space are seen along (-1, -1, -1), with z upward. Lines are drawn without hiding.
"""

from collections.abc import Sequence

import numpy as np

from jhd._arithmetic import bernstein

# Pixels of the longer side, and of the margin about the lines.
_SIDE, _MARGIN = 280.0, 8.0
# Most lines of a sketch, and points along each curved one.
MOST_LINES, PLACES = 4_000, 25
_RIGHT = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
_UP = np.array([-1.0, -1.0, 2.0]) / np.sqrt(6.0)


def along(control_points: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    """Points (segments, places, dim) along Bezier segments (segments, points, dim)."""
    degree = control_points.shape[-2] - 1
    table = bernstein.basis(degree, np.linspace(0.0, 1.0, 2 if degree < 2 else PLACES))
    if weights is None:
        return table @ control_points
    return (table @ (control_points * weights[..., None])) / (table @ weights[..., None])


def across(control_points: np.ndarray, weights: np.ndarray | None, lines: int = 5) -> np.ndarray:
    """Lines of constant parameters (lines, places, 3) of Bezier patches (patches, rows, columns, 3)."""
    found = []
    for turned in (False, True):
        net = control_points.swapaxes(1, 2) if turned else control_points
        own = None if weights is None else (weights.swapaxes(1, 2) if turned else weights)
        table = bernstein.basis(net.shape[1] - 1, np.linspace(0.0, 1.0, lines))
        if own is None:
            rows, kept = np.einsum("li,pijd->pljd", table, net), None
        else:
            kept = np.einsum("li,pij->plj", table, own)
            rows = np.einsum("li,pijd->pljd", table, net * own[..., None]) / kept[..., None]
        shape = (-1, *rows.shape[2:])
        found.append(along(rows.reshape(shape), None if kept is None else kept.reshape(-1, rows.shape[2])))
    places = max(part.shape[1] for part in found)
    return np.concatenate([_resampled(part, places) for part in found])


def svg(lines: Sequence[np.ndarray] | np.ndarray, title: str, dots: bool = False) -> str | None:
    """The picture of lines of points (places, dim), or of dots; None if it is empty or a point is not finite.

    Of more than MOST_LINES lines, evenly chosen ones are drawn.
    """
    chosen = lines[:: 1 + (len(lines) - 1) // MOST_LINES]
    flat = [_seen(np.asarray(line, float)) for line in chosen]
    if not flat or not all(np.isfinite(line).all() for line in flat):
        return None
    whole = np.concatenate(flat)
    low, high = whole.min(axis=0), whole.max(axis=0)
    size = float(np.max(0.5 * high - 0.5 * low)) or 1.0
    width, height = (_SIDE * (0.5 * high - 0.5 * low) / size + 2 * _MARGIN).tolist()
    placed = [(0.5 * line - 0.5 * low) / size * _SIDE + _MARGIN for line in flat]
    if dots:
        parts = [f'<circle cx="{x:.1f}" cy="{height - y:.1f}" r="1.5"/>' for line in placed for x, y in line]
        drawn = f'<g fill="#0072b2">{"".join(parts)}</g>'
    else:
        path = "".join("M" + "L".join(f"{x:.1f} {height - y:.1f}" for x, y in line) for line in placed)
        drawn = f'<path d="{path}" fill="none" stroke="#0072b2" stroke-width="1.2" stroke-linejoin="round"/>'
    text = title.replace("&", "&amp;").replace("<", "&lt;")
    start = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}"'
    return f'{start} viewBox="0 0 {width:.1f} {height:.1f}"><title>{text}</title>{drawn}</svg>'


def _seen(line: np.ndarray) -> np.ndarray:
    if line.shape[-1] == 2:
        return line
    return np.stack([line @ _RIGHT, line @ _UP], axis=-1)


def _resampled(lines: np.ndarray, places: int) -> np.ndarray:
    """Straight lines of two points as lines of `places` points; lines that have `places` points are unchanged."""
    if lines.shape[1] == places:
        return lines
    share = np.linspace(0.0, 1.0, places)[:, None]
    return (1 - share) * lines[:, :1] + share * lines[:, -1:]
