"""Voxelized surfaces against cells that are known exactly: spheres, planes, and the counts of the paper's cones."""

import math
from fractions import Fraction

import jax
import numpy as np
import pytest

from jhd import AdaptiveDistanceField, pivot_distances, polyline
from jhd._arithmetic.trivariate import RANGES
from jhd._fields import octree
from jhd._fields.octree import voxelize
from jhd._shapes.implicit import ImplicitSurface
from jhd.progress import Progress
from tests.sweeps import swept

LOWER, UPPER = [-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]


def parsed(text, lower=LOWER, upper=UPPER):
    return ImplicitSurface.parse(text, lower, upper)


def sphere(center, radius_sq, lower, upper):
    """The sphere whose stored coefficients are exact."""
    center, radius_sq = [Fraction(x) for x in center], Fraction(radius_sq)
    a = np.zeros((3, 3, 3))
    a[2, 0, 0] = a[0, 2, 0] = a[0, 0, 2] = 1
    exact = [*(-2 * x for x in center), sum(x * x for x in center) - radius_sq]
    a[1, 0, 0], a[0, 1, 0], a[0, 0, 1], a[0, 0, 0] = map(float, exact)
    assert [Fraction(float(x)) for x in (a[1, 0, 0], a[0, 1, 0], a[0, 0, 1], a[0, 0, 0])] == exact
    return ImplicitSurface(a, lower, upper)


def cells_of_sphere(center, radius_sq, lower, upper, cells):
    """Which closed cells hold a point of the sphere: its radius is between the least and the largest distance."""
    ends = []
    for c, low, high in zip(center, lower, upper, strict=True):
        low, high = Fraction(float(low)), Fraction(float(high))
        lines = [low + (high - low) * i / cells - Fraction(c) for i in range(cells + 1)]
        pairs = list(zip(lines, lines[1:], strict=False))
        ends.append(
            ([0 if x <= 0 <= y else min(x * x, y * y) for x, y in pairs], [max(x * x, y * y) for x, y in pairs])
        )
    common = math.lcm(Fraction(radius_sq).denominator, *(x.denominator for pair in ends for end in pair for x in end))
    least, most = (
        sum(
            np.array([int(x * common) for x in pair[i]], dtype=object).reshape(
                [-1 if k == axis else 1 for k in range(3)]
            )
            for axis, pair in enumerate(ends)
        )
        for i in (0, 1)
    )
    limit = int(Fraction(radius_sq) * common)
    return np.asarray((least <= limit) & (most >= limit), bool)


def grids(voxels, cells):
    """Kept and proven cells as arrays."""
    kept, proven = np.zeros((cells,) * 3, bool), np.zeros((cells,) * 3, bool)
    places = np.asarray(voxels.cells)
    kept[tuple(places.T)] = True
    proven[tuple(places[np.asarray(voxels.proven)].T)] = True
    assert len(places) == kept.sum()
    return kept, proven


TINY, HUGE = Fraction(1, 2**400), 2**300
# Center, squared radius, box, cells, and how many cells of the surface may stay unproven.
SPHERES = {
    "on the grid": ((0, 0, 0), 1, LOWER, UPPER, 32, 0),
    "any number of cells in any box": ((0.25, -0.5, 0.125), Fraction(9, 16), [-1, -2, -0.5], [2, 1, 3.3], 33, 2),
    "far away": ((2**26, 0, -(2**25)), 1, [2**26 - 2, -2.1, -(2**25) - 1.7], [2**26 + 1.3, 2, -(2**25) + 2], 32, 2),
    "tiny": ((TINY, 0, 0), TINY**2, [float(-2 * TINY)] * 3, [float(2 * TINY)] * 3, 16, 0),
    "huge": ((0, HUGE, 0), Fraction(HUGE**2, 4), [-float(HUGE)] * 3, [2.0 * HUGE] * 3, 20, 4),
    "only a cap inside a face": ((-3, Fraction(1, 32), Fraction(1, 32)), 1 + Fraction(1, 2048), LOWER, UPPER, 64, 0),
    "only a cap on an edge": ((-3, -3, Fraction(1, 32)), 2 + Fraction(1, 256), LOWER, UPPER, 64, 0),
    "touching the box in one point": ((0, 0, 0), 1, [1, -1, -1], [2, 0, 0], 8, 0),
    "an octant": ((0, 0, 0), 1, [-1, -1, -1], [0, 0, 0], 7, 0),
    "inside one cell": ((0.5, 0.5, 0.5), Fraction(1, 2**20), [0, 0, 0], [1, 1, 1], 31, 0),
    "a grid of one cell": ((0, 0, 0), 1, LOWER, UPPER, 1, 0),
}


def check_sphere(case, ranges):
    center, radius_sq, lower, upper, cells, unproven = SPHERES[case]
    true = cells_of_sphere(center, radius_sq, lower, upper, cells)
    kept, proven = grids(voxelize(sphere(center, radius_sq, lower, upper), cells, ranges=ranges), cells)
    assert not np.any(true & ~kept)
    assert not np.any(proven & ~true)
    assert np.sum(true & ~proven) <= unproven


@pytest.mark.parametrize("case", SPHERES)
def test_the_cells_of_a_sphere_are_kept_and_no_others_are_proven(case):
    check_sphere(case, "bernstein")


# Each range in a few cases, and each case in one range; then all pairs.
OTHER_RANGES = [name for name in RANGES if name != "bernstein"]
PAIRED = [(case, OTHER_RANGES[k % len(OTHER_RANGES)]) for k, case in enumerate(SPHERES)]
REST = [(case, name) for case in SPHERES for name in OTHER_RANGES if (case, name) not in PAIRED]


@pytest.mark.parametrize(("case", "ranges"), swept(PAIRED + REST, 0, 4))
def test_all_ranges_keep_the_cells_of_a_sphere(case, ranges):
    check_sphere(case, ranges)


CONES = ("x^2/4 + y^2/4 - z^2/9", "x^2/16 + y^2/4 - z^2/9")


@pytest.mark.parametrize(("text", "counts"), [(CONES[0], (8464, 8440)), (CONES[1], (12440, 12264))])
def test_the_cones_of_the_paper_have_its_numbers_of_cells(text, counts):
    found = voxelize(parsed(text), 64, ranges="modified_affine"), voxelize(parsed(text), 64)
    assert tuple(v.count for v in found) == counts
    fewer, more = (set(map(tuple, np.asarray(v.cells))) for v in found[::-1])
    assert fewer < more
    # The cells that are proven do not depend on the ranges.
    assert found[0].proven.sum() == found[1].proven.sum() > 0.97 * counts[1]


@pytest.mark.parametrize("text", ["z", "2*z - 0.25", "(z - 1/16)^2"])
def test_a_plane_between_cells_is_proven_on_both_sides(text):
    voxels = voxelize(parsed(text), 64)
    assert voxels.count == 2 * 64 * 64 and bool(voxels.proven.all())


def test_a_slanted_plane_has_exactly_its_cells():
    voxels = voxelize(parsed("x + 2*y + 4*z - 1"), 16)
    places = np.array(list(np.ndindex(16, 16, 16)))
    # In quarters: a cell holds a zero where its least value is not positive and its largest not negative.
    least = (places - 8) @ [1, 2, 4] - 4
    true = places[(least <= 0) & (least + 7 >= 0)]
    assert {tuple(x) for x in np.asarray(voxels.cells).tolist()} == {tuple(x) for x in true.tolist()}
    assert bool(voxels.proven.all())


def test_a_surface_without_change_of_sign_is_kept_and_not_proven():
    voxels = voxelize(parsed("(x - 0.3)^2 + (y - 0.3)^2 + (z - 0.3)^2"), 16)
    assert voxels.count > 0 and not voxels.proven.any()


@pytest.mark.parametrize("text", ["x^2 + y^2 + z^2 + 1e-4", "x^2 + y^2 + z^2 - 13", "z - 2.0000001"])
def test_a_surface_that_is_proven_empty_is_refused(text):
    with pytest.raises(ValueError, match="the surface is empty: the polynomial is proven to have no zero in the box"):
        voxelize(parsed(text), 16)


def test_cells_are_where_the_surface_is():
    surface = parsed("x^2 + y^2 + z^2 - 1", [-2, -1, -1], [2, 1.5, 3])
    voxels = voxelize(surface, 40)
    assert voxels.lower.tolist() == [-2, -1, -1]
    assert np.allclose(voxels.spacing, [0.1, 0.0625, 0.1], rtol=1e-15)
    radii = np.linalg.norm(voxels.centers, axis=1)
    assert np.abs(radii - 1).max() < np.linalg.norm(voxels.spacing)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # Points on the border of two cells may be counted to the other one.
    cells = np.floor((points - [-2, -1, -1]) / np.asarray(voxels.spacing)).astype(int)
    known = set(map(tuple, np.asarray(voxels.cells).tolist()))
    assert all(tuple(cell) in known for cell in cells.tolist())


def test_many_small_chunks_give_the_same_cells(monkeypatch):
    surface = parsed(CONES[0])
    whole = voxelize(surface, 64)
    monkeypatch.setattr(octree, "_CHUNKS", 1)
    seen = []
    parts = voxelize(surface, 64, progress=seen.append)
    assert len(seen) > 7
    assert np.array_equal(whole.cells, parts.cells) and np.array_equal(whole.proven, parts.proven)


@pytest.mark.slow
def test_without_exact_signs_less_is_proven_and_nothing_else(monkeypatch):
    monkeypatch.setattr(octree, "_EXACT", 0)
    voxels = voxelize(parsed("z"), 16)
    assert voxels.count == 2 * 16 * 16 and not voxels.proven.any()
    # Positive everywhere, within cells by more than rounding, at their corners by less.
    voxels = voxelize(parsed("x^2*(x^2 - 1)^2*(x^2 - 4)^2 + 1e-18"), 4)
    assert voxels.count > 0 and not voxels.proven.any()


def test_calls_without_an_answer_before_their_end_raise_at_the_time_limit():
    ball = sphere((0, 0, 0), 1, -2, 2)
    for call in (
        lambda: voxelize(ball, 64, max_seconds=1e-9),
        lambda: AdaptiveDistanceField.build(ball, 0.1, max_seconds=1e-9),
        lambda: pivot_distances([polyline([(0, 0), (1, 0)])], [(0, 2)], max_seconds=1e-9),
    ):
        with pytest.raises(TimeoutError, match="longer than max_seconds = 1e-09"):
            call()
    seen = []
    found = voxelize(ball, 8, max_seconds=600, progress=seen.append)
    assert seen and found.count == voxelize(ball, 8).count


def test_progress_tells_the_level_and_the_counts():
    seen = []
    voxels = voxelize(parsed(CONES[0]), 32, progress=seen.append)
    assert all(isinstance(x, Progress) for x in seen)
    assert [x.done for x in seen] == list(range(6)) and {x.total for x in seen} == {5}
    assert seen[-1].details["kept"] == voxels.count
    # Eight children for each cell that is kept on the level before.
    assert seen[-1].details["tested"] == 1 + 8 * sum(x.details["kept"] for x in seen[:-1])


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("cells", "ranges", "kind", "message"),
    [
        (0, "bernstein", ValueError, "cells is 0; needs 1 to 1048576"),
        (2**21, "bernstein", ValueError, "cells is 2097152; needs 1 to 1048576"),
        (8.0, "bernstein", TypeError, "cells must be a whole number; got float"),
        (8, "affine", ValueError, "ranges is 'affine'; needs one of 'bernstein', 'modified_affine'"),
    ],
)
def test_other_options_are_refused(cells, ranges, kind, message):
    with pytest.raises(kind, match=message):
        voxelize(parsed("z"), cells, ranges=ranges)


@pytest.mark.usefixtures("as_a_user")
def test_other_shapes_are_refused():
    with pytest.raises(TypeError, match="surface must be an ImplicitSurface; got str"):
        voxelize("x", 4)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="surface is traced"):
        jax.jit(lambda c: voxelize(ImplicitSurface(c, LOWER, UPPER), 4).cells)(np.ones((2, 1, 1)))


def lattice_signs(surface, cells):
    """Exact signs at the corners of cells and of their halves: an array of 2 cells + 1 places along each axis."""
    a = np.vectorize(lambda x: Fraction(float(x)), otypes=[object])(np.asarray(surface.coefficients))
    for low, high in zip(surface.lower.tolist(), surface.upper.tolist(), strict=True):
        step = (Fraction(high) - Fraction(low)) / (2 * cells)
        powers = [[(Fraction(low) + step * i) ** n for n in range(a.shape[0])] for i in range(2 * cells + 1)]
        # The variable in front becomes places at the back, three times.
        a = np.tensordot(a, np.array(powers, dtype=object), axes=(0, 1))
    return np.vectorize(lambda x: (x > 0) - (x < 0), otypes=[int])(a)


@pytest.mark.parametrize("seed", swept(range(8), 0, 1))
def test_cells_of_any_polynomial_agree_with_exact_signs(seed):
    rng = np.random.default_rng(seed)
    shape, cells = [(4, 3, 2), (2, 2, 2), (7, 1, 4), (5, 2, 3)][seed % 4], int(rng.integers(5, 14))
    a = rng.normal(size=shape) * 10.0 ** rng.uniform(-3, 3, shape)
    lower = rng.normal(size=3)
    surface = ImplicitSurface(a, lower, lower + rng.uniform(0.1, 3, 3))
    signs = lattice_signs(surface, cells)
    last = 2 * cells - 1
    places = [signs[i : i + last : 2, j : j + last : 2, k : k + last : 2] for i, j, k in np.ndindex(3, 3, 3)]
    true = (np.min(places, axis=0) <= 0) & (np.max(places, axis=0) >= 0)
    if not true.any():
        return
    for ranges in ("bernstein", "modified_affine", "horner"):
        kept, proven = grids(voxelize(surface, cells, ranges=ranges), cells)
        assert not np.any(true & ~kept) and not np.any(true & ~proven)


GOLDEN = "2.618033988749895"
BARTH = f"4*({GOLDEN}*x^2 - y^2)*({GOLDEN}*y^2 - z^2)*({GOLDEN}*z^2 - x^2) - 4.236067977499790*(x^2 + y^2 + z^2 - 1)^2"
QUARTIC = "x^4 - 5*x^2 + y^4 - 5*y^2 + z^4 - 5*z^2 + 11.8"


@pytest.mark.slow
@pytest.mark.parametrize("text", [BARTH, QUARTIC])
def test_bernstein_coefficients_keep_fewer_cells_and_most_are_proven(text):
    found = {
        ranges: voxelize(parsed(text), 64, ranges=ranges) for ranges in ("bernstein", "modified_affine", "interval")
    }
    counts = [found[ranges].count for ranges in ("bernstein", "modified_affine", "interval")]
    assert counts == sorted(counts) and counts[0] < counts[1] < counts[2]
    proven = {int(voxels.proven.sum()) for voxels in found.values()}
    assert len(proven) == 1 and proven.pop() > 0.98 * counts[0]
