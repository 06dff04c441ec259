"""Pictures of the nearest shapes: what stands in which panel, in one scale, in the plane and in space."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import jhd
from jhd import plot
from jhd._results.solution import RESULTS

BASE = jhd.polyline([(0.0, 0.0), (2.0, 0.0)])
ARCH = jhd.BezierSegments([[[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]])
CUBE = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
FOUND = jhd.Neighbors(
    np.array([[0, 2], [1, 0]]),
    np.array([[0.5, 1.0], [0.25, np.nan]]),
    np.array([[0.5, 1.0], [0.25, 0.5]]),
    np.array([[0.5, 1.0], [0.25, np.inf]]),
    RESULTS.successful,
    (np.array([1, 3]), np.array([], int)),
    4,
)


def titles(axes) -> list[Any]:
    return [[ax.get_title() for ax in row] for row in axes]


def colors(ax):
    return [line.get_color() for line in ax.lines]


def test_each_neighbor_lies_over_its_query_with_the_distance_and_the_number_of_ties():
    figure = Figure()
    panels: Any = figure.subplots(2, 3)
    shapes = [ARCH, jhd.point_set([[0.0, 1.0], [3.0, 1.0]]), BASE, ARCH]
    assert plot.neighbors([BASE, ARCH], shapes, FOUND, panels, names=["arch", "$5", "base", "o"]) is panels
    assert titles(panels) == [
        ["0", "arch\n$d$ = 0.5", "base\n$d$ = 1\n2 more tied"],
        ["1", "\\$5\n$d$ = 0.25", "arch\n$d$ ≥ 0.5"],
    ]
    assert [[colors(ax) for ax in row] for row in panels] == [[[plot.BLUE], *2 * [[plot.BLUE, plot.ORANGE]]]] * 2
    for row in panels:
        assert len({(ax.get_xlim(), ax.get_ylim()) for ax in row}) == 1
    assert panels[1, 0].get_xlim()[1] > 3 > panels[0, 0].get_xlim()[1]
    figure.canvas.draw()


def test_chosen_queries_make_a_figure_of_their_own():
    axes = plot.neighbors([BASE, ARCH], 4 * [ARCH], FOUND, rows=[1], query_names=["base", "arch"])
    try:
        assert axes.shape == (1, 3) and titles(axes)[0][0] == "arch"
        assert [text.get_text() for text in axes[0, 0].figure.legends[0].get_texts()] == ["query", "neighbor"]
    finally:
        plt.close(axes[0, 0].figure)


def test_shapes_in_space_of_several_kinds_are_drawn():
    axes = plot.neighbors([CUBE, CUBE], [CUBE, jhd.point_set([[0.0, 0, 2], [1, 0, 0]]), CUBE], FOUND)
    try:
        assert [len(ax.collections) for ax in axes.flat] == [1, 1, 1, 1, 1, 1]
        assert axes[1, 1].get_zlim()[1] > 2 and len(axes[1, 1].lines) == 2
        axes[0, 0].figure.canvas.draw()
    finally:
        plt.close(axes[0, 0].figure)


def test_axes_of_another_number_are_refused():
    panels: Any = Figure().subplots(2, 2)
    with pytest.raises(ValueError, match=r"axes has shape \(2, 2\); needs \(2, 3\), a row for each query"):
        plot.neighbors([BASE, ARCH], 4 * [ARCH], FOUND, panels)
    with pytest.raises(ValueError, match="no query to draw"):
        plot.neighbors([BASE, ARCH], 4 * [ARCH], FOUND, rows=[])
