"""A distance as one HTML page that needs no network: walk along plane curves, or rotate shapes in space.

A page of plane curves consists of SVG and a few lines of our own JavaScript; a page of shapes in space contains the
plotly script. Outlines and colors are drawn from samples; the bounds in the text are certified.
"""

import html
import json
from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np

from jhd._distance.deviation_solution import Deviation, DistanceSamples
from jhd._distance.profiles import distance_profile
from jhd._plot.axes import BLUE, GRAY, ORANGE, VERMILLION
from jhd._plot.colored import DrawnPieces, distances_at, pieces_of
from jhd._results.solution import HausdorffSolution, name_of
from jhd._runtime.decimals import lower_text, upper_text
from jhd._shapes.as_shape import ShapeLike, as_shape
from jhd._shapes.curve import AbstractCurve

PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 sans-serif; margin: 1.5em auto; max-width: 62em; padding: 0 1em; }}
h1 {{ font-size: 1.2em; }}
pre {{ white-space: pre-wrap; overflow-wrap: anywhere; }}
svg {{ display: block; max-width: 100%; height: auto; }}
svg path, svg line {{ vector-effect: non-scaling-stroke; }}
input[type=range] {{ width: 100%; max-width: 640px; margin: 0; }}
.profile {{ touch-action: none; cursor: crosshair; border-bottom: 1px solid #888; margin-top: 0.8em; }}
#space {{ height: 75vh; }}
</style>
</head>
<body>
{head}
{body}
</body>
</html>
"""

OUTLINE = (
    '<path id="{name}" d="{path}" fill="none" stroke="{color}" stroke-width="1.8" stroke-linecap="round" {style}/>'
)

PLANE = """\
<p>{key} · move along a profile or its slider; <button id="farthest">farthest point</button></p>
<svg id="shapes" viewBox="0 0 {width} {height}" width="{width}" height="{height}">
{paths}
<path id="spokes" fill="none" stroke="black" stroke-width="1.2"/>
<g id="feet" fill="white" stroke="black"></g>
<circle id="marker" r="5" fill="#D55E00" stroke="black"/>
</svg>
<p id="told"></p>
{profiles}
<script type="application/json" id="data">{data}</script>
<script>
{script}
</script>
"""

PROFILE = """\
<svg class="profile" id="profile-{k}" viewBox="0 0 {wide:.0f} {high:.0f}" width="{wide:.0f}" height="{high:.0f}">
<path d="{path}" fill="none" stroke="{color}" stroke-width="{width}" stroke-linecap="round"/>
<line class="here" y1="0" y2="{high:.0f}" stroke="#707070" stroke-dasharray="2 2"/>
<circle class="here" r="4" fill="#D55E00" stroke="black"/>
</svg>
<label>{text}<br><input type="range" id="slider-{k}" min="0" max="{last}" value="0"></label>
"""

# Positions in the data are in input units, positions in the pictures in pixels.
SCRIPT = """\
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const by = name => document.getElementById(name);
const placed = p => [(p[0] - data.left) * data.scale, (data.top - p[1]) * data.scale];
const at = p => "(" + p.map(x => x.toPrecision(6)).join(", ") + ")";
const set = (node, values) => { for (const name in values) node.setAttribute(name, values[name]); };
const span = walk => walk.t[walk.t.length - 1] - walk.t[0] || 1;

function show(k, i) {
  const walk = data.walks[k];
  const [x, y] = placed(walk.point[i]);
  const feet = walk.feet[i].map(placed);
  set(by("marker"), {cx: x, cy: y});
  set(by("spokes"), {d: feet.map(f => `M${x} ${y}L${f[0]} ${f[1]}`).join("")});
  by("feet").innerHTML = feet.map(f => `<rect x="${f[0] - 4}" y="${f[1] - 4}" width="8" height="8"/>`).join("");
  const most = data.above * Math.max(...walk.distance) || 1;
  const across = data.wide * (walk.t[i] - walk.t[0]) / span(walk);
  const chart = by(`profile-${k}`);
  set(chart.querySelector("line.here"), {x1: across, x2: across});
  set(chart.querySelector("circle.here"), {cx: across, cy: data.high * (1 - walk.distance[i] / most)});
  by(`slider-${k}`).value = i;
  const upper = walk.upper[i] === null ? "no certified upper bound" : `at most ${walk.upper[i]}`;
  const event = i === walk.farthest ? `; the farthest point, by ${walk.event}` : "";
  by("told").textContent = `t = ${walk.t[i].toFixed(4)}, at ${at(walk.point[i])}: distance ${walk.distance[i]} ` +
    `${data.unit}, certified at least ${walk.lower[i]}, ${upper}; ` +
    `${walk.feet[i].length === 1 ? "foot" : "feet"} ${walk.feet[i].map(at).join(" and ")}${event}`;
}

function nearest(walk, t) {
  let best = 0;
  for (let i = 1; i < walk.t.length; i++) if (Math.abs(walk.t[i] - t) < Math.abs(walk.t[best] - t)) best = i;
  return best;
}

data.walks.forEach((walk, k) => {
  const chart = by(`profile-${k}`);
  chart.addEventListener("pointermove", event => {
    const box = chart.getBoundingClientRect();
    show(k, nearest(walk, walk.t[0] + (event.clientX - box.left) / box.width * span(walk)));
  });
  by(`slider-${k}`).addEventListener("input", event => show(k, Number(event.target.value)));
  show(k, walk.farthest);
});
by("farthest").addEventListener("click", () => show(data.first, data.walks[data.first].farthest));
show(data.first, data.walks[data.first].farthest);
"""

SPACE = """\
<p>Drag to rotate, scroll to zoom. Event at the farthest point: {event}. Colors show the distances of the drawn
points; the bounds above are certified.</p>
<div id="space"></div>
<script>{script}</script>
<script type="application/json" id="data">{data}</script>
<script>
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
Plotly.newPlot("space", data.traces, data.layout, {{responsive: true}});
</script>
"""
# Pixels of the longer side of a picture in the plane, of the margin about it, and of a profile.
_SIDE, _MARGIN = 640.0, 14.0
_WIDE, _HIGH = 640.0, 150.0
# The room above the largest distance of a profile.
_ABOVE = 1.06


def page(
    a: ShapeLike | Deviation,
    b: ShapeLike | None = None,
    solution: HausdorffSolution | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    unit: str = "input units",
) -> str:
    """A distance as the text of a self-contained HTML page.

    For plane curves, the page shows both curves and the profile of the distance in each direction. Moving a marker
    along a profile shows the distance there with its bounds and the foot, and at the farthest point the event. Shapes
    in space can be rotated; the shape with the farthest point is colored by its distance to the opposite shape.

    >>> import jhd
    >>> a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)])
    >>> text = jhd.plot.page(a, b, jhd.hausdorff(a, b))
    >>> text.splitlines()[0]
    '<!doctype html>'

    Args:
        a: first shape; or a result of jhd.deviation, which contains both shapes and the largest distance.
        b: second shape, of the same dimension.
        solution: Hausdorff distance of both shapes, one and not a batch.
        labels: names of both shapes.
        unit: unit of the coordinates.

    Returns:
        The text of the page, to be written to a file.

    Raises:
        TypeError: the second shape or the solution is missing, or an object is no shape.
        ValueError: the solution is a batch.
        ImportError: the shapes are in space and plotly is not installed (extra `web`).
    """
    told = solution
    if isinstance(a, Deviation):
        a, b, solution, told = a.a, a.b, a.maximum, a
    if b is None or solution is None:
        raise TypeError("page() needs two shapes and their distance, or a result of jhd.deviation.")
    if not isinstance(solution, HausdorffSolution):
        raise TypeError(f"solution must be a result of jhd.hausdorff; got {type(solution).__name__}.")
    if np.ndim(solution.value) > 0:
        raise ValueError(f"solution is a batch of shape {np.shape(solution.value)}; show one at a time.")
    a, b = as_shape(a), as_shape(b)
    title = f"{labels[0]} and {labels[1]}: distance {float(solution)!r} {unit}"
    samples = told.samples if isinstance(told, Deviation) else None
    drawn = _in_plane(a, b, solution, labels, unit) if a.dim == 2 else _in_space(a, b, solution, labels, unit, samples)
    head = f"<h1>{html.escape(title)}</h1>\n<pre>{html.escape(repr(told))}</pre>"
    return PAGE.format(title=html.escape(title), head=head, body=drawn)


def page_of_figure(figure: Any, title: str) -> str:
    """A matplotlib figure as the text of an HTML page, with the figure as SVG, which is sharp at any size."""
    drawn = StringIO()
    figure.savefig(drawn, format="svg")
    text = drawn.getvalue()
    # The lines before the picture belong to a separate file.
    head = f"<h1>{html.escape(title)}</h1>"
    return PAGE.format(title=html.escape(title), head=head, body=text[text.index("<svg") :])


def plotly_script() -> str:
    """The script of plotly, for pages of shapes in space."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ImportError("pages of shapes in space need plotly: pip install jhd[web].") from error
    return get_plotlyjs()


def _in_plane(a: Any, b: Any, solution: HausdorffSolution, labels: Sequence[str], unit: str) -> str:
    """Both curves, the marks, a profile for each direction, and the script that moves the marker."""
    pair = [(a, b, labels[0], labels[1])]
    ways = [solution] if solution.directions is None else list(solution.directions)
    if solution.directions is not None or name_of(solution.direction) == "b_to_a":
        pair.append((b, a, labels[1], labels[0]))
    walks = [_walk(first, second, way) for (first, second, *_), way in zip(pair[-len(ways) :], ways, strict=True)]
    lines = [pieces_of(shape) for shape in (a, b)]
    everything = np.concatenate([lines[0].points, lines[1].points, np.asarray(solution.witness.feet)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = _SIDE / (float(np.max(high - low)) or 1.0)
    left, top = low[0] - _MARGIN / scale, high[1] + _MARGIN / scale
    width, height = scale * (high - low) + 2 * _MARGIN
    frame = {"left": left, "top": top, "scale": scale}
    paths = "\n".join(
        OUTLINE.format(name=name, path=_path(drawn, frame), color=color, style=style)
        for name, drawn, color, style in zip("ab", lines, (BLUE, ORANGE), ("", 'stroke-dasharray="7 3"'), strict=True)
    )
    profiles = "\n".join(
        _profile(k, walk, f"{names[2]} to {names[3]}", unit, ORANGE if names[0] is b else BLUE)
        for k, (walk, names) in enumerate(zip(walks, pair[-len(ways) :], strict=True))
    )
    larger = max(range(len(walks)), key=lambda k: float(ways[k].value))
    data = {**frame, "walks": walks, "wide": _WIDE, "high": _HIGH, "above": _ABOVE, "first": larger, "unit": unit}
    return PLANE.format(
        width=f"{width:.0f}",
        height=f"{height:.0f}",
        key=_key(labels),
        paths=paths,
        profiles=profiles,
        data=_as_json(data),
        script=SCRIPT,
    )


def _walk(a: AbstractCurve, b: Any, solution: HausdorffSolution) -> dict[str, Any]:
    """Points along a curve with their distances, among them the farthest point, and its event."""
    # About 1500 points along the whole curve.
    found = distance_profile(a, b, samples=int(np.clip(1500 // a.segments().count, 4, 64)))
    names = ("t", "point", "distance", "lower", "upper")
    walk: dict[str, Any] = {name: np.asarray(getattr(found, name)).tolist() for name in names}
    walk["dots"] = a.segments().degree == 0
    walk["feet"] = np.asarray(found.foot)[:, None].tolist()
    w = solution.witness
    feet = np.unique(np.asarray(w.feet), axis=0)
    place = float(w.element) + float(w.t) if a.segments().degree > 0 else float(w.element)
    index = int(np.searchsorted(walk["t"], place))
    farthest = (place, w.point, solution.value, solution.lower, solution.upper, feet)
    for name, value in zip(("t", "point", "distance", "lower", "upper", "feet"), farthest, strict=True):
        walk[name].insert(index, np.asarray(value).tolist())
    # As text: a browser rounds numbers to the nearest.
    walk["lower"] = [lower_text(x) for x in walk["lower"]]
    walk["upper"] = [upper_text(x) if np.isfinite(x) else None for x in walk["upper"]]
    return {**walk, "farthest": index, "event": name_of(solution.event).replace("_", " ")}


def _profile(k: int, walk: dict[str, Any], way: str, unit: str, color: str) -> str:
    """The distances along a curve as a line, with a slider below it."""
    t, distance = np.array(walk["t"]), np.array(walk["distance"])
    x = _WIDE * (t - t[0]) / (t[-1] - t[0] or 1.0)
    y = _HIGH * (1 - distance / (_ABOVE * float(np.max(distance)) or 1.0))
    # Points are not joined: each is a stroke without length.
    begin, end, width = ("M", "h0", 5) if walk["dots"] else ("L", "", 1.5)
    path = "M" + "".join(f"{begin}{p:.2f} {q:.2f}{end}" for p, q in zip(x, y, strict=True))[1:]
    text = f"distance from {way} ({unit})"
    return PROFILE.format(
        k=k, wide=_WIDE, high=_HIGH, path=path, color=color, width=width, text=html.escape(text), last=len(t) - 1
    )


def _path(drawn: DrawnPieces, frame: dict[str, Any]) -> str:
    """The pieces of a curve as SVG path data; points become strokes without length."""
    placed = (drawn.corners - [frame["left"], frame["top"]]) * [frame["scale"], -frame["scale"]]
    parts, last = [], None
    for piece, row in zip(placed, drawn.rows, strict=True):
        begin, *others = [f"{x:.2f} {y:.2f}" for x, y in piece]
        # A piece that starts at the end of the piece before it continues the path.
        parts.append("".join(f"L{p}" for p in others) if row[0] == last else f"M{begin}L{(others or [begin])[0]}")
        last = row[-1] if others else None
    return "".join(parts)


def _key(labels: Sequence[str]) -> str:
    pairs = zip(labels, (BLUE, ORANGE), strict=True)
    return " ".join(f'<b style="color:{color}">{html.escape(label)}</b>' for label, color in pairs)


def _in_space(
    a: Any, b: Any, solution: HausdorffSolution, labels: Sequence[str], unit: str, samples: DistanceSamples | None
) -> str:
    """Both shapes as plotly draws them; the shape with the farthest point is colored by its distance."""
    script = plotly_script()
    names = list(labels)
    if name_of(solution.direction) == "b_to_a":
        a, b, names = b, a, names[::-1]
    drawn = pieces_of(a)
    values = distances_at(drawn.points, b, float(solution), samples)
    traces = [
        _trace(drawn, names[0], values, f"distance to {names[1]} ({unit})"),
        _trace(pieces_of(b), names[1]),
        *_marks(solution),
    ]
    if not traces[0]["showlegend"]:
        traces.append(_in_key(names[0], drawn.points[0]))
    layout = {
        "scene": {"aspectmode": "data"},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"x": 0, "y": 1},
        "showlegend": True,
    }
    event = html.escape(name_of(solution.event).replace("_", " "))
    return SPACE.format(script=script, data=_as_json({"traces": traces, "layout": layout}), event=event)


def _trace(drawn: DrawnPieces, name: str, values: np.ndarray | None = None, title: str = "") -> dict[str, Any]:
    """A shape as a trace of plotly, colored by values or in one color."""
    size = drawn.rows.shape[1]
    scale = {
        "colorscale": "Viridis",
        "cmin": 0,
        "showscale": True,
        # Below the buttons.
        "colorbar": {"title": {"text": title, "side": "right"}, "len": 0.9, "y": 0.45},
    }
    shown = {"name": name, "legendgroup": name, "showlegend": True}
    if size == 3:
        corners = dict(zip("ijk", drawn.rows.T.tolist(), strict=True))
        colors = {"color": GRAY, "opacity": 0.2} if values is None else {"intensity": _short(values), **scale}
        return {"type": "mesh3d", **_places(drawn.points), **corners, **shown, **colors, "flatshading": False}
    rows = drawn.rows if size == 1 else np.concatenate([drawn.rows, drawn.rows[:, :1]], axis=1)
    points = drawn.points[rows.ravel()]
    if size == 2:
        # Every third point is NaN, to separate the lines.
        points = np.where(np.arange(len(points))[:, None] % 3 == 2, np.nan, points)
    colors = {"color": ORANGE} if values is None else {"color": _short(values[rows.ravel()]), **scale}
    style = {"line": {"width": 6, **colors}} if size == 2 else {"marker": {"size": 3, **colors}}
    # A key cannot show a line of many colors: plotly warns about it in the browser's console.
    shown["showlegend"] = size == 1 or values is None
    return {"type": "scatter3d", "mode": ("markers", "lines")[size - 1], **_places(points), **shown, **style}


def _in_key(name: str, place: np.ndarray) -> dict[str, Any]:
    """The key's line for one of many colors: of no length, shown and hidden with it."""
    # The color in the middle of the color scale.
    style = {"line": {"width": 6, "color": "#21918c"}, "legendgroup": name}
    return {"type": "scatter3d", "mode": "lines", "name": name, **style, **_places(np.stack([place, place]))}


def _marks(solution: HausdorffSolution) -> list[dict[str, Any]]:
    """The farthest point, its feet, and the lines that join them."""
    point, feet = np.asarray(solution.witness.point), np.unique(np.asarray(solution.witness.feet), axis=0)
    spokes = np.concatenate([[point, foot, np.full(3, np.nan)] for foot in feet])
    dot, square = {"size": 6, "color": VERMILLION}, {"size": 5, "color": "white", "symbol": "square"}
    edge = {"line": {"color": "black", "width": 2}}
    return [
        {"type": "scatter3d", "mode": "lines", "name": "joining line", "line": {"color": "black", "width": 5}}
        | _places(spokes),
        {"type": "scatter3d", "mode": "markers", "name": "farthest point", "marker": dot | edge} | _places(point[None]),
        {"type": "scatter3d", "mode": "markers", "name": "foot", "marker": square | edge} | _places(feet),
    ]


def _places(points: np.ndarray) -> dict[str, list[float | None]]:
    return {axis: _short(column) for axis, column in zip("xyz", points.T, strict=True)}


def _short(values: np.ndarray) -> list[float | None]:
    """Numbers to the precision of a screen; None for numbers that are not finite."""
    return [float(f"{x:.7g}") if np.isfinite(x) else None for x in values.tolist()]


def _as_json(content: dict[str, Any]) -> str:
    """JSON that is safe within a script: no NaN, and no text that ends the script."""
    return json.dumps(_finite(content), allow_nan=False).replace("<", "\\u003c")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
