"""What is drawn of a deviation is what was found, and nothing stands over anything else."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jhd
from jhd._plot.colored import distances_at, pieces_of, section
from jhd._results.solution import name_of


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def square():
    """A square above a tilted plane: the distance is (1 + x / 2) times the cosine of the slope."""
    above = jhd.TriangleMesh([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], [[0, 1, 2], [0, 2, 3]])
    plane = jhd.TriangleMesh([[-3, -3, 1.5], [4, -3, -2], [4, 4, -2], [-3, 4, 1.5]], [[0, 1, 2], [0, 2, 3]])
    return jhd.deviation(above, plane)


def by_gid(figure: Any, gid: str) -> list[Any]:
    return [artist for artist in figure.findobj() if artist.get_gid() == gid]


@pytest.mark.slow
def test_faces_have_the_color_of_their_distance_and_the_witness_is_in_front(square):
    ax: Any = jhd.plot.deviation(square, labels=("square", "plane"), unit="mm")
    (faces,) = by_gid(ax.figure, "deviation")
    pieces = pieces_of(square.a)
    distance = (1 + 0.5 * pieces.corners[:, :, 0].mean(axis=1)) / np.sqrt(1.25)
    expected = plt.get_cmap("viridis")(distance / float(square.maximum.value))
    # Faces come in the order of their depth.
    seen, wanted = (x[np.lexsort(np.round(x, 6).T)] for x in (np.asarray(faces.get_facecolor()), expected))
    np.testing.assert_allclose(seen, wanted, atol=0.02)
    (mark,) = by_gid(ax.figure, "witness")
    np.testing.assert_allclose(np.ravel(mark.get_data_3d()), np.asarray(square.maximum.witness.point))
    # Seen from the side of the farthest place, where x is one.
    assert np.cos(np.radians(ax.azim)) > 0
    assert "distance to plane (mm)" in [other.get_ylabel() for other in ax.figure.axes]


@pytest.mark.slow
def test_the_inset_shows_both_sections_at_the_right_distance(square):
    figure = jhd.plot.deviation(square).figure
    (inset,) = by_gid(figure, "inset")
    above, below = (by_gid(figure, f"section_{name}")[0].get_xydata() for name in "AB")
    reach = inset.get_xlim()[1]
    assert reach == pytest.approx(1.6 * float(square.maximum.value))
    assert np.nanmax(np.abs(below[:, 1] + float(square.maximum.value))) < 1e-9
    # The square's section ends at the witness, on its side.
    assert np.nanmin(np.abs(above).sum(axis=1)) < 1e-9 and np.nanmax(above[:, 1]) < 1e-9


def test_the_histogram_holds_all_of_the_shape_and_marks_the_bounds(square):
    ax: Any = jhd.plot.histogram(square)
    bars = [artist for artist in ax.patches if artist.get_gid() == "histogram_bars"]
    assert sum(bar.get_height() for bar in bars) == pytest.approx(100)
    marks = {line.get_gid(): line.get_xdata()[0] for line in ax.lines}
    assert marks == {"mean": square.mean.value, "rms": square.rms.value, "max.": float(square.maximum.value)}


def test_labels_of_a_whole_figure_do_not_run_into_each_other(square):
    figure: Any = jhd.plot.deviation(square, labels=("surface", "mesh"), unit="mm").figure
    figure.canvas.draw()
    boxes = [
        text.get_window_extent().padded(-1)
        for ax in figure.axes
        if ax.name != "3d"
        for text in (ax.xaxis.label, ax.yaxis.label, *(ax.get_legend().get_texts() if ax.get_legend() else ()))
        if text.get_text()
    ]
    assert len(boxes) >= 6
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
        assert box.x0 >= -1 and box.x1 <= figure.bbox.width + 1 and box.y0 >= -1


@pytest.mark.slow
def test_curves_and_points_are_colored_on_axes_of_ones_own(square):
    found = jhd.deviation(jhd.polyline([(0, 0, 1), (1, 0, 1)]), square.b)
    ax = jhd.plot.deviation(found, plt.figure().add_subplot(projection="3d"), color_bar=False)
    (lines,) = by_gid(ax.figure, "deviation")
    np.testing.assert_allclose(np.asarray(lines.get_colors())[-1], plt.get_cmap("viridis")(1.0), atol=0.02)
    assert len(ax.figure.axes) == 1
    figure = jhd.plot.deviation(jhd.deviation(jhd.point_set([(0, 1, 1), (1, 1, 1)]), square.b)).figure
    assert all(len(by_gid(figure, gid)) == 1 for gid in ("deviation", "histogram", "inset", "witness"))


def test_distances_that_are_known_are_not_searched_for_again(square, monkeypatch):
    rows = np.random.default_rng(4).uniform(0, 1, (300, 3))
    found = jhd.deviation(jhd.point_set(rows), square.b, rtol=1e-4)
    exact = np.asarray(jhd.project(rows, square.b).distance)
    monkeypatch.setattr("jhd._plot.colored.project", lambda *_, **__: pytest.fail("a search"))
    seen = distances_at(rows, square.b, float(found.maximum.value), found.samples)
    np.testing.assert_allclose(seen, exact, atol=float(found.maximum.value) / 256)


def test_the_shape_that_holds_the_witness_is_colored_without_a_search(square):
    solution = jhd.hausdorff(square.a, square.b)
    assert name_of(solution.direction) == "b_to_a"
    figure = jhd.plot.distances(square.a, square.b, solution, labels=("square", "plane")).figure
    (faces,) = by_gid(figure, "deviation")
    assert len(np.asarray(faces.get_facecolor())) == len(pieces_of(square.b).rows)
    assert "distance to square" in [ax.get_ylabel() for ax in figure.axes]
    assert not by_gid(figure, "histogram") and len(by_gid(figure, "inset")) == 1
    own = plt.figure().add_subplot(projection="3d")
    assert jhd.plot.distances(square.a, square.b, square.maximum, own, color_bar=False) is own
    (faces,) = by_gid(own.figure, "deviation")
    assert len(np.asarray(faces.get_facecolor())) == len(pieces_of(square.a).rows)


def test_a_section_of_triangles_is_where_they_meet_the_plane():
    pieces = pieces_of(jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [0, 2, 2]], [[0, 1, 2]]))
    lines = section(pieces, np.array([0, 0, 0.5]), np.array([0.0, 0, 1]))
    np.testing.assert_allclose(lines[..., 2], 0.5)
    np.testing.assert_allclose(lines[..., 1], 0.5)
    assert np.ptp(lines[..., 0]) == pytest.approx(1.5)


def test_values_go_to_trimesh_with_the_vertices(square):
    made = square.to_trimesh()
    np.testing.assert_allclose(made.vertex_attributes["distance"], np.array([1, 1.5, 1.5, 1]) / np.sqrt(1.25))
    assert made.faces.tolist() == np.asarray(square.a.triangles).tolist()


def test_distances_that_are_spread_evenly_have_a_histogram_without_gaps(square):
    bars: Any = jhd.plot.histogram(square).patches
    heights = np.array([bar.get_height() for bar in bars])
    starts = np.array([bar.get_x() for bar in bars]) * np.sqrt(1.25)
    # From 1 to 1.5, evenly; the bounds of a part overlap by less than a fiftieth of a bar.
    np.testing.assert_allclose(heights[starts > 0.99], heights[starts > 0.99].mean(), rtol=0.02)
    assert abs(heights.sum() - 100) < 1e-9 and heights[starts < 0.94].sum() == 0
