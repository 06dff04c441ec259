"""Pages of HTML: they hold what was found and nothing from a network, and in a browser the marker moves."""

import json
import re
import shutil
import sys
from html.parser import HTMLParser
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._plot import pages
from tests.processes import ran

BROWSERS = "chromium", "chromium-browser", "google-chrome", "chrome"


class Page(HTMLParser):
    """The elements of a page, by their ids, and the text of its scripts."""

    def __init__(self, text: str):
        super().__init__()
        self.ids: dict[str, dict[str, Any]] = {}
        self.scripts: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []
        self.data = json.loads(next(script for script in self.scripts if script.startswith("{")))

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        # Nothing is fetched: neither scripts nor styles nor pictures.
        assert not {"src", "href"} & found.keys() and tag != "link"
        if "id" in found:
            assert found["id"] not in self.ids
            self.ids[found["id"] or ""] = found
        if tag not in ("meta", "input", "br"):
            self.open.append(tag)
            if tag == "script":
                self.scripts.append("")

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data


@pytest.fixture(scope="module")
def lines():
    a, b = jhd.polyline([(0, 0), (2, 0)]), jhd.polyline([(0, 1), (1, 1)])
    return a, b, jhd.hausdorff(a, b)


@pytest.fixture(scope="module")
def square():
    """Two squares, half a unit apart."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    a, b = (jhd.TriangleMesh(corners + [0, 0, z], [[0, 1, 2], [0, 2, 3]]) for z in (0.0, 0.5))
    return a, b, jhd.hausdorff(a, b)


@pytest.mark.slow
def test_a_page_of_plane_curves_holds_walks_with_bounds_feet_and_the_farthest_place(lines):
    page = Page(jhd.plot.page(*lines, labels=("A<1>", "B"), unit="mm"))
    assert {"shapes", "a", "b", "marker", "feet", "spokes", "told", "farthest"} < page.ids.keys()
    assert {f"{what}-{k}" for what in ("profile", "slider") for k in (0, 1)} < page.ids.keys()
    there, back = page.data["walks"]
    top = there["farthest"]
    assert there["point"][top] == [2, 0] and there["feet"][top] == [[1, 1]]
    assert [float(there[x][top]) for x in ("lower", "upper")] == [float(lines[2].lower), float(lines[2].upper)]
    assert there["event"] == "a end" and page.data["first"] == 0 and page.data["unit"] == "mm"
    for walk in (there, back):
        assert len({len(walk[name]) for name in ("t", "point", "distance", "lower", "upper", "feet")}) == 1
        assert walk["t"] == sorted(walk["t"])
        assert np.all(np.array(walk["lower"], float) <= walk["distance"])
        assert np.all(walk["distance"] <= np.array(walk["upper"], float))
    # The straight line of B, in pixels: one unit above A's.
    frame = page.data
    numbers = re.findall(r"-?[\d.]+", page.ids["b"]["d"])
    first = np.array(numbers[:2], float) / frame["scale"] * [1, -1] + [frame["left"], frame["top"]]
    np.testing.assert_allclose(first, [0, 1], atol=1e-4)


def test_a_directed_distance_has_one_walk_along_its_own_curve(lines):
    a, b, both = lines
    data = Page(jhd.plot.page(a, b, both.directions[0], labels=("A", "B"))).data
    assert len(data["walks"]) == 1 and data["walks"][0]["point"][-1] == [2, 0]


def test_what_is_not_proven_is_said_and_names_cannot_end_a_script(lines):
    a, b, both = lines
    unproven = eqx.tree_at(lambda s: s.upper, both.directions[0], jnp.inf)
    data = Page(jhd.plot.page(a, b, unproven, unit="</script>")).data
    assert data["walks"][0]["upper"][data["walks"][0]["farthest"]] is None
    assert data["unit"] == "</script>"


def test_points_are_dots_with_nothing_between_them(lines):
    points = jhd.point_set([(0, 1), (1, 2)])
    text = jhd.plot.page(points, lines[0], eqx.tree_at(lambda s: s.witness.element, lines[2].directions[0], 1))
    (path,) = re.findall(r'<path d="([^"]*)"', text)
    assert path.count("M") == path.count("h0") == len(Page(text).data["walks"][0]["t"]) == 3
    assert "L" not in path


def test_a_page_asks_for_two_shapes_and_one_distance(lines):
    with pytest.raises(TypeError, match="two shapes and their distance"):
        jhd.plot.page(lines[0], lines[1])
    least: Any = jhd.minimum_distance(*lines[:2])
    with pytest.raises(TypeError, match="MinimumSolution"):
        jhd.plot.page(lines[0], lines[1], least)


def test_a_page_in_space_holds_both_shapes_the_distances_as_colors_and_the_marks(square):
    pytest.importorskip("plotly")
    found = jhd.deviation(*square[:2])
    for text in (jhd.plot.page(*square), jhd.plot.page(found)):
        page = Page(text)
        first, second, line, *marks = page.data["traces"]
        assert first["showlegend"]
        assert (first["type"], second["type"]) == ("mesh3d", "mesh3d")
        np.testing.assert_allclose(first["intensity"], 0.5, atol=1e-6)
        assert max(max(first[axis]) for axis in "ijk") < len(first["x"]) == len(first["intensity"])
        assert line["z"][2] is None and sorted(line["z"][:2]) == [0, 0.5]
        assert [mark["name"] for mark in marks] == ["farthest point", "foot"]
        assert any("Plotly" in script and len(script) > 1_000_000 for script in page.scripts)


def test_curves_and_points_in_space_are_lines_and_dots():
    line = pages._trace(pages.pieces_of(jhd.polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)])), "A", np.zeros(10_000))
    # A line of many colors has a line of its own in the key.
    assert (
        line["mode"] == "lines"
        and not line["showlegend"]
        and line["x"][2] is None
        and len(line["x"]) == len(line["line"]["color"])
    )
    dots = pages._trace(pages.pieces_of(jhd.point_set([(0, 0, 0), (1, 0, 0)])), "B")
    assert dots["mode"] == "markers" and dots["x"] == [0, 1]


def test_without_plotly_a_page_in_space_names_what_to_install(square, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(ImportError, match=r"pip install jhd\[web\]"):
        jhd.plot.page(*square)


def dumped(text, folder):
    """The page as a browser leaves it, and what it wrote to its console."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no headless browser: none of {', '.join(BROWSERS)} is installed")
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=9000"]
    command = [browser, *flags, f"--user-data-dir={folder}/profile", "--dump-dom", file.as_uri()]
    done = ran(*command)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.slow
def test_in_a_browser_the_marker_moves_with_the_slider(lines, tmp_path):
    text = jhd.plot.page(*lines)
    move = (
        "<script>const slider = document.getElementById('slider-0'); slider.value = 0;"
        "slider.dispatchEvent(new Event('input'));</script></body>"
    )
    (still, quiet), (moved, silent) = (dumped(page, tmp_path) for page in (text, text.replace("</body>", move)))
    assert quiet == silent == []
    first, second = (Page(page).ids["marker"] for page in (still, moved))
    assert first["cx"] != second["cx"]
    assert "the farthest point, by a end" in still and "the farthest point" not in moved.split('id="told"')[1][:400]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["meshes", "deviation", "lines", "points"])
def test_in_a_browser_a_page_in_space_draws_without_an_error(kind, square, tmp_path):
    pytest.importorskip("plotly")
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0.5)])
    line, other, points = jhd.polyline(corners), jhd.polyline(corners[:, ::-1] + 1), jhd.point_set(corners)
    pairs = {"lines": (line, other), "points": (points, square[0])}
    if kind == "deviation":
        text = jhd.plot.page(jhd.deviation(*square[:2]))
    else:
        a, b = pairs.get(kind, square[:2])
        text = jhd.plot.page(a, b, jhd.hausdorff(a, b))
    page, console = dumped(text, tmp_path)
    # What WebGL says of itself, and hints of how to be faster, are none of the page's.
    told = [line for line in console if "WebGL" not in line and "willReadFrequently" not in line]
    assert "main-svg" in page and told == []
