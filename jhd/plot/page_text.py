"""The text of pages: HTML around pictures, and the script that moves a marker along a curve."""

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
    '<path id="{name}" d="{path}" fill="none" stroke="{colour}" stroke-width="1.8" stroke-linecap="round" {style}/>'
)

PLANE = """\
<p>{key} · move along a profile, or its slider; <button id="farthest">farthest place</button></p>
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
<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linecap="round"/>
<line class="here" y1="0" y2="{high:.0f}" stroke="#707070" stroke-dasharray="2 2"/>
<circle class="here" r="4" fill="#D55E00" stroke="black"/>
</svg>
<label>{text}<br><input type="range" id="slider-{k}" min="0" max="{last}" value="0"></label>
"""

# Places of the data are in input units; those of the pictures are pixels.
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
  const upper = walk.upper[i] === null ? "not proven from above" : `at most ${walk.upper[i]}`;
  const event = i === walk.farthest ? `; the farthest place, by ${walk.event}` : "";
  by("told").textContent = `t = ${walk.t[i].toFixed(4)}, at ${at(walk.point[i])}: distance ${walk.distance[i]} ` +
    `${data.unit}, proven to be at least ${walk.lower[i]}, ${upper}; ` +
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
<p>Drag to turn, scroll to come nearer. The farthest place arises by {event}. Colours are the distances of the places
that are drawn; what is proven are the bounds above.</p>
<div id="space"></div>
<script>{script}</script>
<script type="application/json" id="data">{data}</script>
<script>
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
Plotly.newPlot("space", data.traces, data.layout, {{responsive: true}});
</script>
"""
