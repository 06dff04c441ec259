"""The order in which faces are drawn: what is drawn last along a ray is what the ray meets first."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mpl_toolkits.mplot3d.proj3d import proj_transform

import jhd
from jhd import plot
from jhd._plot.faces import DepthTree, eye_of

CUBE = np.array(
    [
        [[0, 0, 0], [0, 1, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 0, 1], [1, 1, 1]],
        [[0, 0, 1], [1, 1, 1], [0, 1, 1]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 1]],
        [[0, 0, 0], [1, 0, 1], [0, 0, 1]],
        [[0, 1, 0], [1, 1, 1], [1, 1, 0]],
        [[0, 1, 0], [0, 1, 1], [1, 1, 1]],
        [[0, 0, 0], [0, 1, 1], [0, 1, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 1]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1]],
        [[1, 0, 0], [1, 1, 1], [1, 0, 1]],
    ],
    float,
)
# Three long triangles, each before the next one, and what cuts itself.
RANDOM = np.random.default_rng(5)
CYCLE = np.array(
    [[[0, 0, 0], [9, 1, 3], [9, 0, 3]], [[9, 2, 0], [3, 9, 3], [2, 9, 3]], [[4, 9, 0], [0, 1, 3], [1, 0, 3]]]
)
SCENES = {"cube": CUBE, "cycle": CYCLE.astype(float), "pierced": RANDOM.normal(size=(14, 3, 3))}


def met(eye, along, triangles):
    """How far along a ray each triangle is met; infinite where it is not (Moeller & Trumbore)."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(along, second)
    determinant = np.sum(first * across, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        away = eye - triangles[:, 0]
        u = np.sum(away * across, axis=1) / determinant
        turned = np.cross(away, first)
        v = turned @ along / determinant
        t = np.sum(second * turned, axis=1) / determinant
        return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)


@pytest.mark.parametrize("name", SCENES)
def test_what_is_drawn_last_along_a_ray_is_what_it_meets_first(name):
    triangles, random, hits = SCENES[name], np.random.default_rng(6), 0
    tree = DepthTree(triangles, 1000)
    # Parts have some corners more than once: as fans, all of them are triangles.
    width = tree.parts.shape[1]
    fans = np.stack([tree.parts[:, [0, k, k + 1]] for k in range(1, width - 1)], axis=1)
    middle, size = triangles.mean(axis=(0, 1)), np.ptp(triangles)
    for _ in range(20):
        eye = middle + random.normal(size=3) * size
        order = tree.order(np.append(eye, 1.0))
        assert sorted(order) == list(range(len(tree.parts)))
        for _ in range(20):
            weights = random.dirichlet(np.ones(3))
            along = weights @ triangles[random.integers(len(triangles))] - eye
            exact = np.min(met(eye, along, triangles))
            seen = np.min(met(eye, along, fans.reshape(-1, 3, 3)).reshape(len(fans), -1), axis=1)[order]
            (drawn,) = np.nonzero(seen < np.inf)
            if np.isfinite(exact) and len(drawn):
                hits += 1
                assert seen[drawn[-1]] == pytest.approx(exact, rel=1e-9)
    assert hits > 300


def test_parts_are_those_of_the_faces_and_have_their_area():
    tree = DepthTree(SCENES["pierced"], 1000)
    areas = [float(np.linalg.norm(np.sum(np.cross(x[1:-1] - x[0], x[2:] - x[0]), axis=0))) for x in tree.parts]
    whole = [float(np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0]))) for x in SCENES["pierced"]]
    np.testing.assert_allclose(np.bincount(tree.owner, areas), whole, rtol=1e-9)
    assert len(areas) > len(whole) and len(DepthTree(CUBE, 12).parts) == 12
    with pytest.raises(ValueError, match="more than 15 parts"):
        DepthTree(SCENES["pierced"], 15)


@pytest.mark.parametrize("kind", ["persp", "ortho"])
def test_the_eye_is_what_all_lines_of_sight_meet_in(kind):
    figure = plt.figure()
    ax: Any = figure.add_subplot(projection="3d", proj_type=kind)
    ax.set(xlim=(-1, 5), ylim=(0, 1), zlim=(2, 4))
    figure.canvas.draw()
    eye, point = eye_of(ax.M), np.array([1.0, 0.25, 3.0])
    toward = eye[:3] if kind == "ortho" else eye[:3] - point
    there = point + 0.1 * toward
    places = np.stack([point, there]).T
    (x, x_there), (y, y_there), (z, z_there) = proj_transform(places[0], places[1], places[2], ax.M)
    assert x == pytest.approx(x_there) and y == pytest.approx(y_there) and z_there < z
    assert eye[3] == (0 if kind == "ortho" else 1)
    plt.close(figure)


def test_a_cube_shows_its_three_faces_to_the_eye_and_no_other():
    figure: Any = plt.figure(figsize=(3, 3), dpi=60)
    ax = figure.add_axes((0, 0, 1, 1), projection="3d")
    cube = jhd.TriangleMesh(CUBE.reshape(-1, 3), np.arange(36).reshape(12, 3))
    plot.mesh(cube, ax)
    (faces,) = [artist for artist in ax.collections if artist.get_gid() == "surface"]
    shades = {tuple(color) for color in np.round(faces.get_facecolor(), 9)}
    for elevation, azimuth in ((20, 30), (35, -70), (10, 110), (60, -130), (-25, 40)):
        ax.view_init(elevation, azimuth)
        figure.canvas.draw()
        pixels = np.asarray(figure.canvas.buffer_rgba())[:, :, :3].reshape(-1, 3)
        inside = pixels[(pixels[:, 2].astype(int) - pixels[:, 0]) > 60]
        known, counts = np.unique(inside, axis=0, return_counts=True)
        # Opposite faces have one shade.
        assert len(shades) == 3 and np.count_nonzero(counts > 0.02 * len(inside)) == 3, (elevation, azimuth, known)
    plt.close(figure)
