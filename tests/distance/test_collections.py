"""Many shapes at once: what pairs get alone they get in a collection, and few distances serve for all.

Curves of at most sixteen segments and degree three share one program; sets of points take none.
"""

import _thread
import itertools
import multiprocessing
import signal
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import jhd
from jhd._distance.collections import blocks, tasks
from jhd._results.solution import names_of


def squares(sides):
    return [jhd.polyline([(0, 0), (s, 0), (s, s), (0, s)], closed=True) for s in sides]


def some_curves(seed, count=9, scale=1.0):
    """Ragged curves of degrees 0 to 3: chains, points, two that are the same, one whose points all coincide."""
    random = np.random.default_rng(seed)
    shapes = []
    for k in range(count):
        points = random.standard_normal((1 + k % 5, 1 + k % 4, 2)).cumsum(axis=0) + 3 * random.standard_normal(2)
        shapes.append(jhd.BezierSegments(scale * points))
    shapes[3] = jhd.BezierSegments(np.zeros((2, 3, 2)) + scale)
    return [*shapes, shapes[1]]


CURVES = some_curves(1)


@pytest.fixture(scope="module")
def every():
    """The distances of all pairs of the curves."""
    return jhd.pairwise(CURVES)


def clouds(seed, count):
    random = np.random.default_rng(seed)
    return [jhd.point_set(random.standard_normal((3 + k, 2)) + k % 3) for k in range(count)]


class InPlace(Executor):
    """Does everything at once, in this thread, and counts."""

    def __init__(self):
        self.count = 0

    def submit(self, fn, /, *args, **kwargs):
        self.count += 1
        future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


class Interrupted(InPlace):
    """Hears an interrupt while the fifth task is handed over."""

    def submit(self, fn, /, *args, **kwargs):
        if self.count == 4:
            signal.raise_signal(signal.SIGINT)
        return super().submit(fn, *args, **kwargs)


class Stuck(InPlace):
    """Does four tasks, and of the fifth there is an interrupt and no end."""

    def submit(self, fn, /, *args, **kwargs):
        if self.count < 4:
            return super().submit(fn, *args, **kwargs)
        threading.Timer(0.2, _thread.interrupt_main).start()
        return Future()


@pytest.mark.slow
def test_all_pairs_of_squares_have_their_distances():
    sides = np.array([1.0, 2.0, 5.0, 5.5])
    found = jhd.pairwise(squares(sides))
    exact = np.sqrt(2) * np.abs(sides[:, None] - sides)
    # A square in another one is nearest at its corners, which the other square may hold.
    assert np.all(found.lower <= exact * (1 + 1e-15)) and np.all(exact * (1 - 1e-15) <= found.upper)
    assert np.all(found.upper - found.lower <= 1e-9) and np.all(found.lower <= found.value)
    assert found.computed == 6 and set(names_of(found.result)) == {"successful"}
    assert repr(found) == "Pairwise(4 x 4 distances, 16 known, 6 computed)"


@pytest.mark.exhaustive
def test_shapes_of_all_kinds_are_measured_beside_each_other():
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    shapes = [
        jhd.TriangleMesh(corners, faces),
        jhd.point_set(corners),
        jhd.TriangleMesh(corners + 0.25, faces),
        jhd.polyline([(0, 0, 0), (1, 1, 1)]),
    ]
    method = jhd.BranchAndBound(atol=1e-3)
    every = jhd.pairwise(shapes, method=method)
    for i, j in itertools.combinations(range(4), 2):
        alone = jhd.hausdorff(shapes[i], shapes[j], method)
        assert every.lower[i, j] <= alone.upper and alone.lower <= every.upper[i, j]
    near = jhd.nearest_shapes(shapes, shapes, 2, method)
    for i in range(4):
        second = np.sort(every.upper[i])[1]
        assert near.lower[i, 1] <= second and np.sort(every.lower[i])[1] <= near.upper[i, 1]
    within = jhd.pairs_within(shapes, method=method, threshold=0.5)
    found = {(i, j) for i, j in itertools.combinations(range(4), 2) if every.upper[i, j] <= 0.5}
    assert {tuple(pair) for pair in within.index} == found == {(0, 2)}


@pytest.mark.slow
def test_other_processes_find_the_same_bits():
    curves = some_curves(5, 20)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        found = jhd.pairwise(curves, executor=pool)
    for name in ("value", "lower", "upper"):
        np.testing.assert_array_equal(getattr(found, name), getattr(jhd.pairwise(curves), name))


@pytest.mark.slow
def test_bounds_of_a_pair_are_those_of_the_single_call(every):
    for i, j in ((0, 2), (1, 5), (3, 7)):
        alone = jhd.hausdorff(CURVES[i], CURVES[j])
        assert every.lower[i, j] <= alone.upper and alone.lower <= every.upper[i, j]


@pytest.mark.slow
def test_what_a_pair_gets_depends_on_nothing_else(every):
    order = [4, 0, 9, 3, 1, 2]
    pool = InPlace()
    found = jhd.pairwise([CURVES[k] for k in order], [CURVES[k] for k in (2, 7)], executor=pool)
    assert pool.count == 1 and found.computed == 12
    for (i, k), (j, m) in itertools.product(enumerate(order), enumerate((2, 7))):
        if k < m:
            assert [x[i, j] for x in (found.value, found.lower, found.upper)] == [
                x[k, m] for x in (every.value, every.lower, every.upper)
            ]


@pytest.mark.slow
def test_padded_curves_are_kept_as_far_as_there_is_room(monkeypatch, every):
    from jhd._distance.collections import shapes

    collection, kind = shapes.Collection("shapes", CURVES), blocks.PairKind(16, 3, 2, False)
    size = sum(x.nbytes for x in collection.row(0, kind) if x is not None)
    assert collection.row(0, kind) is collection.row(0, kind)
    monkeypatch.setattr(shapes, "_KEPT", 3 * size)
    for k in range(10):
        row = collection.row(k, kind)
        assert collection.row(k, kind) is row and len(collection._rows) <= 3
    np.testing.assert_array_equal(jhd.pairwise(CURVES).value, every.value)


@pytest.mark.slow
def test_the_table_of_one_collection_is_symmetric_and_zero_for_a_shape_and_itself(every):
    np.testing.assert_array_equal(every.value, every.value.T)
    np.testing.assert_array_equal(np.diag(every.upper), 0.0)
    assert every.computed == 45 and every.value[1, 9] == 0.0


@pytest.mark.parametrize("exponent", [0, -480, 480])
def test_signatures_bound_every_pair_at_every_scale(exponent, every):
    # Powers of two change no digit of a distance.
    shapes = some_curves(1, scale=2.0**exponent)
    signs = jhd.pivot_distances(shapes)
    assert np.all(signs.lower <= signs.upper)
    most = np.max(np.maximum(signs.lower[:, None] - signs.upper, signs.lower - signs.upper[:, None]), axis=-1)
    assert np.all(np.ldexp(most, -exponent) <= every.upper)
    # Chords of quadratics and cubics deviate, so the bounds are no better than that.
    assert np.all(signs.upper - signs.lower <= 2.0**exponent)
    near = jhd.nearest_shapes(shapes, shapes, 3)
    inside = np.take_along_axis(every.value, near.index, axis=1)
    np.testing.assert_array_equal(np.ldexp(near.value, -exponent), inside)


def test_bounds_of_all_pairs_hold_and_the_reach_covers_the_shapes(every):
    from jhd._distance.collections.pivots import PivotBounds, lattice_over, reaches
    from jhd._distance.collections.shapes import Collection

    for offset in (0.0, 1e9):
        moved = [jhd.BezierSegments(np.asarray(shape.control_points) + offset) for shape in CURVES]
        signs = jhd.pivot_distances(moved)
        lower, upper = PivotBounds(signs, signs).between(np.arange(len(moved)), np.arange(len(moved)))
        exact = every if offset == 0.0 else jhd.pairwise(moved)
        assert np.all(lower <= exact.upper) and np.all(exact.lower <= upper)
        assert np.median(lower[exact.value > 0] / exact.value[exact.value > 0]) > 0.8
        collection = Collection("shapes", moved)
        lattice = lattice_over(collection)
        for shape, reach in zip(moved, reaches(collection, lattice), strict=True):
            places = np.asarray(shape(np.linspace(0, shape.count, 33)))
            apart = np.linalg.norm(places[:, None] - lattice.points, axis=-1).min(axis=1)
            assert np.all(apart <= reach)


@pytest.mark.parametrize("k", [1, 3])
def test_the_nearest_shapes_are_those_of_all_distances(k):
    queries = some_curves(2)
    table = jhd.pairwise(queries, CURVES)
    found = jhd.nearest_shapes(queries, CURVES, k)
    best = np.sort(table.value, axis=1)[:, :k]
    np.testing.assert_array_equal(np.sort(found.value, axis=1), best)
    assert set(names_of(found.result)) == {"successful"} and found.computed < table.computed
    for row, index, ties in zip(table.lower, found.index, found.ties, strict=True):
        near = set(np.flatnonzero(row <= np.sort(row)[k - 1]))
        assert near <= {*index, *ties} and not {*index} & {*ties}


def test_ties_are_named():
    found = jhd.nearest_shapes(squares([3.0]), squares([1.0, 2.0, 4.0, 9.0]))
    assert sorted([*found.index[0], *found.ties[0]]) == [1, 2] and found.tied.tolist() == [True]
    assert repr(found) == f"Neighbors(1 of each of 1 queries, 1 tied, {found.computed} computed)"


@pytest.mark.parametrize("threshold", [1e-9, 1.0, 2.5])
def test_pairs_within_a_threshold_are_those_of_all_distances(threshold, every):
    found = jhd.pairs_within(CURVES, threshold=threshold)
    near = [(i, j) for i, j in itertools.combinations(range(len(CURVES)), 2) if every.value[i, j] <= threshold]
    assert [tuple(pair) for pair in found.index] == near and len(near) > 0
    assert np.all(found.upper <= threshold) and len(found.undecided) == 0 and found.computed < every.computed
    assert repr(found) == f"PairsWithin({len(near)} pairs, 0 undecided, {found.computed} computed)"
    between = jhd.pairs_within(CURVES[:4], CURVES[4:], threshold=threshold)
    assert [(i, j + 4) for i, j in between.index] == [(i, j) for i, j in near if i < 4 <= j]


def test_a_threshold_within_the_bounds_of_a_pair_is_undecided():
    a, b = some_curves(3)[2], some_curves(4)[2]
    value = float(jhd.pairwise([a], [b]).value[0, 0])
    found = jhd.pairs_within([a], [b], threshold=value)
    assert len(found.index) + len(found.undecided) == 1
    assert (names_of(found.result) == "gap_not_closed") == (len(found.undecided) == 1)
    twice = jhd.pairs_within([a, a], threshold=0.0)
    assert twice.index.tolist() == [[0, 1]] and len(twice.undecided) == 0


def test_sets_of_points_are_measured_beside_curves():
    shapes = [*clouds(1, 3), CURVES[2], np.array([[0.0, 1.0], [2.0, 2.0]])]
    found = jhd.pairwise(shapes)
    taken: list[Any] = [jhd.as_shape(shape) for shape in shapes]
    for i, j in ((0, 1), (0, 2), (1, 4)):
        a, b = (np.asarray(taken[k].control_points)[:, 0] for k in (i, j))
        table = np.linalg.norm(a[:, None] - b, axis=-1)
        exact = max(table.min(axis=1).max(), table.min(axis=0).max())
        assert found.lower[i, j] <= exact * (1 + 1e-15) and exact * (1 - 1e-15) <= found.upper[i, j]
    near = jhd.nearest_shapes(shapes, shapes, 2)
    np.testing.assert_array_equal(near.value[:, 1], np.sort(found.value, axis=1)[:, 1])


def test_a_call_out_of_time_says_so():
    sets = clouds(5, 40)
    for found in (
        jhd.pairwise(sets, max_seconds=1e-9),
        jhd.nearest_shapes(sets, sets, 2, max_seconds=1e-9),
        jhd.pairs_within(sets, threshold=2.2, max_seconds=1e-9),
    ):
        names = set(np.ravel(names_of(found.result)))
        assert "out_of_time" in names and "interrupted" not in names and not np.all(found.ok)
    table = jhd.pairwise(sets[:2])
    assert table.to_dict()["result"] == [["successful"] * 2] * 2


def test_an_interrupted_call_keeps_what_is_done_and_says_so():
    shapes, told = clouds(2, 9), []

    def stop(progress):
        told.append(progress)
        if progress.stage == "distances":
            raise KeyboardInterrupt

    exact = jhd.pairwise(shapes)
    with ThreadPoolExecutor(1) as pool:
        found = jhd.pairwise(shapes, executor=pool, progress=stop)
        known = ~np.isnan(found.value)
        assert 9 < known.sum() < 81 and told[-1].total == 36 and told[-1].done == found.computed
        np.testing.assert_array_equal(found.value[known], exact.value[known])
        names = np.array(names_of(found.result)).reshape(known.shape)
        assert set(names[known]) == {"successful"} and set(names[~known]) == {"interrupted"}
        assert np.all(found.lower <= exact.upper) and np.all(exact.lower <= found.upper)
        near = jhd.nearest_shapes(shapes[:2], shapes[2:], progress=stop)
        assert set(names_of(near.result)) == {"interrupted"} and near.computed == 0
        chosen = np.take_along_axis(exact.value[:2, 2:], near.index, axis=1)
        assert np.all(near.lower <= chosen) and np.all(chosen <= near.upper)
        within = jhd.pairs_within(clouds(3, 16), threshold=2.3, executor=pool, progress=stop)
        assert names_of(within.result) == "interrupted" and len(within.undecided) > 0


@pytest.mark.parametrize(("executor", "taken"), [(Interrupted, 5), (Stuck, 4)])
def test_an_interrupt_is_heard_between_calls_of_an_executor_and_while_one_waits(executor, taken, monkeypatch):
    # One task at a time.
    monkeypatch.setattr(tasks, "_AHEAD", 1)
    monkeypatch.setattr(tasks, "_OPEN", 1)
    pool = executor()
    found = jhd.pairwise(clouds(2, 12), executor=pool)
    assert (pool.count, found.computed) == (taken, 32) and "interrupted" in names_of(found.result)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_is_no_collection_is_refused(as_a_user):
    space = jhd.polyline([(0, 0, 0), (1, 1, 1)])
    with pytest.raises(ValueError, match="shapes is empty"):
        jhd.pairwise([])
    with pytest.raises(TypeError, match=r"others\[1\]: shape must be a shape of jhd"):
        jhd.pairwise(CURVES, [CURVES[0], 3])  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r"others\[1\]: text is not a shape: jhd\.io\.load_shape"):
        jhd.pairwise(CURVES, [CURVES[0], "a"])  # pyright: ignore[reportArgumentType]
    one = r"(shapes|queries) must be a list of shapes; got a single BezierSegments\."
    for call in (jhd.pairwise, jhd.nearest_shapes, jhd.pivot_distances):
        with pytest.raises(TypeError, match=one):
            call(CURVES[0], CURVES[1])
    for given, got in (({"a": CURVES[0]}, r"dict: pass list\(shapes\.values\(\)\)"), (np.zeros((5, 2)), "one array")):
        with pytest.raises(TypeError, match=f"shapes must be a list of shapes; got {got}"):
            jhd.nearest_shapes(CURVES, given)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="shapes must be a list of shapes; got NoneType"):
        jhd.pairwise(None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="executor is 3; needs a concurrent.futures.Executor"):
        jhd.pairwise(CURVES, executor=3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"shapes\[1\] has 3 coordinates and shapes\[0\] has 2"):
        jhd.pairs_within([CURVES[0], space], threshold=1.0)
    with pytest.raises(ValueError, match="queries has shapes of 3 coordinates and shapes of 2"):
        jhd.nearest_shapes([space], CURVES)
    with pytest.raises(ValueError, match="k is 11; there are 10 shapes"):
        jhd.nearest_shapes(CURVES, CURVES, 11)
    with pytest.raises(ValueError, match="threshold is -1"):
        jhd.pairs_within(CURVES, threshold=-1.0)
    with pytest.raises(TypeError, match="method must be BranchAndBound"):
        jhd.nearest_shapes(CURVES, CURVES, method=jhd.published.TwoStep())  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="method must be"):
        jhd.pairwise(CURVES, method=jhd.published.CubeIntervals())
    with pytest.raises(ValueError, match=r"points has shape \(1, 3\); needs \(points, 2\)"):
        jhd.pivot_distances(CURVES, np.zeros((1, 3)))
