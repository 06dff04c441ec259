"""Searches from the host: progress, interruption, growing tables, and the same answer as in one program."""

import jax
import numpy as np
import pytest

import jhd
from jhd._distance.search import farthest_place
from jhd._distance.search.closest_triangles import TriangleSearch
from jhd._distance.search.farthest import CurveSearch, SurfaceSearch
from jhd._distance.search.farthest_place import FarthestSearch
from jhd._distance.search.meshes import MeshSearch
from jhd._distance.search.points import PointSearch
from jhd._distance.search.two_phase_minimum import InTurn
from jhd._results.solution import name_of
from tests.distance import pairs
from tests.distance.nearest.test_meshes import torus
from tests.distance.search.test_implicit_minimum import spheres
from tests.distance.search.test_surfaces import CONES
from tests.distance.test_minimum import ARCH
from tests.sweeps import swept

# Two directions that take many steps: a folded segment and the line it lies on.
LINE, FOLDED = pairs.both(pairs.BY_NAME["segment_folded"])


@pytest.mark.slow
def test_progress_comes_with_shrinking_bounds_of_both_directions():
    seen = []
    solution = jhd.hausdorff(LINE, FOLDED, throw=False, progress=seen.append)
    assert [p.stage for p in seen] == sorted(p.stage for p in seen)
    assert {p.stage for p in seen} == {"a_to_b", "b_to_a"}
    for direction in ("a_to_b", "b_to_a"):
        mine = [p for p in seen if p.stage == direction]
        steps = int(solution.stats[f"{direction}_steps"])
        assert mine[-1].done == steps
        pairwise = list(zip(mine[:-1], mine[1:], strict=True))
        assert all(p.done <= q.done and p.lower <= q.lower and q.upper <= p.upper for p, q in pairwise)
        assert all(p.lower <= p.upper and p.total >= p.done for p in mine)
    assert max(p.upper for p in seen if p.total == p.done) >= float(solution.lower)


@pytest.mark.slow
def test_a_long_search_reports_more_than_once():
    seen = []
    jhd.directed_hausdorff(FOLDED, LINE, throw=False, progress=seen.append)
    assert len(seen) >= 2
    assert seen[-1].upper - seen[-1].lower < seen[0].upper - seen[0].lower


def interrupt(_):
    raise KeyboardInterrupt


@pytest.mark.slow
def test_stretches_of_steps_that_take_long_end_with_each_of_them(monkeypatch):
    shapes = FARTHEST["to points"][1]
    whole, seen = jhd.directed_hausdorff(*shapes), []
    monkeypatch.setattr(farthest_place, "_SECONDS", 0.0)
    slow = jhd.directed_hausdorff(*shapes, progress=seen.append)
    assert [p.done for p in seen] == list(range(1, int(whole.stats["steps"]) + 1))
    assert len(seen) > 2
    assert (float(slow.lower), float(slow.upper)) == (float(whole.lower), float(whole.upper))


# A surface, and points whose nearest sample of it lies on another fold than their foot.
GRID = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1)
WAVY = jhd.BezierPatch(GRID + 3 * np.random.default_rng(2).normal(size=GRID.shape))
CROWD = jhd.point_set([5.09677513, 1.18783915, 2.91161431] + 1e-4 * np.random.default_rng(5).normal(size=(100, 3)))
SPREAD = jhd.point_set(np.random.default_rng(2).normal(size=(60, 3)) * 2 + [1.5, 1.5, 0])
# Pairs whose searches are not done where they begin, and the search of each kind.
FARTHEST = {
    "curves": (CurveSearch, (FOLDED, LINE)),
    "surfaces": (SurfaceSearch, CONES),
    "meshes": (MeshSearch, (torus(12, 8), torus(10, 7))),
    "from points": (PointSearch, (CROWD, WAVY)),
    "to points": (FarthestSearch, (WAVY, SPREAD)),
}
# From points the first block of them is always measured.
FEWEST = {"to points": 1}
# Quick tests of implicit surfaces alone interrupt their search too.
APART = [5.0, 1.0, 0.5]
CLOSEST = {
    "nets": (InTurn, (jhd.BezierCurve(ARCH), jhd.BezierCurve(ARCH * [1, -1] + [0.1, 2.5]))),
    "surfaces": (InTurn, spheres()),
    "meshes": (TriangleSearch, (torus(12, 8), torus(10, 7).transform(np.eye(3), APART))),
}


@pytest.mark.parametrize("kind", swept(FARTHEST, ["meshes"]))
def test_an_interrupted_search_hands_back_the_bounds_it_had_reached(kind, monkeypatch):
    search, shapes = FARTHEST[kind]
    monkeypatch.setattr(search, "first_steps", 1)
    whole = jhd.directed_hausdorff(*shapes)
    stopped = jhd.directed_hausdorff(*shapes, throw=False, progress=interrupt)
    assert name_of(stopped.result) == "interrupted"
    assert stopped.lower <= whole.lower and whole.upper <= stopped.upper < np.inf
    assert int(stopped.stats["steps"]) <= 1 < int(whole.stats["steps"])


@pytest.mark.parametrize("kind", swept(FARTHEST, slow=["curves", "meshes", "from points", "to points"]))
def test_an_interruption_of_one_direction_ends_the_other_where_it_begins(kind, monkeypatch):
    search, shapes = FARTHEST[kind]
    monkeypatch.setattr(search, "first_steps", 1)
    whole = jhd.hausdorff(*shapes)
    stopped = jhd.hausdorff(*shapes, throw=False, progress=interrupt)
    assert name_of(stopped.result) == "interrupted"
    assert int(stopped.stats["b_to_a_steps"]) == FEWEST.get(kind, 0)
    assert stopped.lower <= whole.lower and whole.upper <= stopped.upper < np.inf


@pytest.mark.parametrize("kind", swept(CLOSEST, ("meshes",), ("nets",)))
def test_an_interrupted_search_for_a_minimum_hands_back_the_bounds_it_had_reached(kind, monkeypatch):
    search, shapes = CLOSEST[kind]
    monkeypatch.setattr(search, "first_steps", 0)
    whole = jhd.minimum_distance(*shapes)
    stopped = jhd.minimum_distance(*shapes, throw=False, progress=interrupt)
    assert name_of(stopped.result) == "interrupted"
    assert 0 <= stopped.lower <= whole.lower and whole.upper <= stopped.upper
    assert int(stopped.stats["steps"]) == 0 < int(whole.stats["steps"])


@pytest.mark.exhaustive
def test_the_larger_distance_keeps_both_directed_ones():
    a, b = pairs.both(pairs.BY_NAME["arch_and_wave"])
    there, back = jhd.directed_hausdorff(a, b), jhd.directed_hausdorff(b, a)
    found = jhd.hausdorff(a, b)
    assert found.directions is not None and "directions" not in found.to_json()
    first, second = found.directions
    assert (first.lower, first.value, first.upper) == (there.lower, there.value, there.upper)
    # The second one is looked for only where it matters; its bounds are true in any case.
    assert second.lower <= back.upper and back.lower <= second.upper
    assert [name_of(d.direction) for d in found.directions] == ["a_to_b", "b_to_a"]
    assert max(float(first.upper), float(second.upper)) == float(found.upper)

    def moved(shift):
        return jhd.hausdorff(a, b.transform(np.eye(2), shift * np.ones(2)))

    batch = jax.jit(jax.vmap(moved))(np.array([0.0, 0.25]))
    assert batch.directions is not None and batch.directions[1].value.shape == (2,)
    np.testing.assert_allclose(batch.directions[0].value[0], there.value, rtol=1e-12)
    slopes = [jax.grad(lambda x, k=k: moved(x).directions[k].value)(0.25) for k in range(2)]  # pyright: ignore
    chosen = 0 if name_of(moved(0.25).direction) == "a_to_b" else 1
    np.testing.assert_allclose(slopes[chosen], jax.grad(lambda x: moved(x).value)(0.25), rtol=1e-12)


def test_a_clock_that_stands_still_does_no_harm(monkeypatch):
    search, shapes = FARTHEST["meshes"]
    monkeypatch.setattr(search, "first_steps", 1)
    monkeypatch.setattr("time.perf_counter", lambda: 0.0)
    assert int(jhd.directed_hausdorff(*shapes).stats["steps"]) > 2


@pytest.mark.slow
def test_an_interruption_is_raised_with_the_solution():
    with pytest.raises(jhd.NotProvenError, match="interrupted") as caught:
        jhd.directed_hausdorff(FOLDED, LINE, progress=interrupt)
    assert caught.value.solution.upper < np.inf


@pytest.mark.slow
def test_a_search_that_is_done_is_not_spoilt_by_an_interruption():
    a, b = pairs.both(pairs.BY_NAME["segment_over_parabola"])
    solution = jhd.directed_hausdorff(a, b, progress=interrupt)
    assert name_of(solution.result) == "successful"


@pytest.mark.exhaustive  # programs of its own
def test_the_host_takes_a_longer_table_where_one_program_folds():
    a, b = FOLDED, LINE
    method = jhd.BranchAndBound(queue_size=64)
    folded = jax.jit(lambda a, b: jhd.directed_hausdorff(a, b, method, throw=False))(a, b)
    grown = jhd.directed_hausdorff(a, b, method)
    assert name_of(folded.result) == "capacity_reached"
    assert name_of(grown.result) == "successful"
    assert folded.lower <= grown.upper
    assert grown.lower <= folded.upper


@pytest.mark.slow
def test_max_steps_holds_across_the_stretches():
    method = jhd.BranchAndBound(max_steps=150)
    solution = jhd.directed_hausdorff(FOLDED, LINE, method, throw=False)
    assert int(solution.stats["steps"]) == 150
    assert name_of(solution.result) == "gap_not_closed"


@pytest.mark.exhaustive
def test_other_methods_report_once():
    seen = []
    a, b = pairs.both(pairs.BY_NAME["arch_and_wave"])
    jhd.directed_hausdorff(a, b, jhd.published.TwoStep(), progress=seen.append)
    assert [p.stage for p in seen] == ["a_to_b"]
    assert seen[0].upper == np.inf


@pytest.mark.slow  # programs of its own
def test_known_curves_inside_a_traced_function_take_the_traced_way():
    a, b = pairs.both(pairs.BY_NAME["arch_and_wave"])
    scaled = jax.jit(lambda x: x * jhd.hausdorff(a, b).value)(2.0)
    assert float(scaled) == pytest.approx(2 * float(jhd.hausdorff(a, b)), rel=1e-12)
