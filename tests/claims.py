"""What each experiment claims, asserted on the numbers of a small run: `check_NAME` for experiments/NAME.py.

Claims of seconds are those of a full run on a quiet machine and stand in the experiments; here are bounds, errors,
counts and orders. What is claimed of all inputs is asserted of those that a small run takes.
"""

import numpy as np

from tests.claims_collections import check_collection_search as check_collection_search
from tests.claims_collections import check_duplicates as check_duplicates
from tests.claims_collections import check_scan_to_model as check_scan_to_model
from tests.claims_collections import check_throughput as check_throughput
from tests.claims_collections import check_to_a_million as check_to_a_million
from tests.claims_collections import check_workers as check_workers

# What TwoStep and the proven projections promise, in units of the coordinates (some hundred, and some).
ERROR = 1e-10


def both_directions(numbers):
    for entry in numbers["directions"].values():
        found = entry["solution"]
        assert entry["error"] < ERROR
        assert 0 < found["value"] - ERROR <= found["lower"] <= found["value"]
        assert found["upper"] is None and found["result"] == "successful"
    # Candidates lie on the curve, so none is farther than the farthest point; the best of them is that one.
    best = max(c["solution"]["value"] for c in numbers["candidates"])
    chosen = numbers["directions"]["a_to_b"]
    assert abs(best - chosen["reference"]) < ERROR
    # The maximum may be flat: its place is known to the root of its error.
    assert min(abs(c["t"] - chosen["t"]) for c in numbers["candidates"]) < ERROR**0.5
    for candidate in numbers["candidates"]:
        assert candidate["solution"]["value"] >= candidate["distance"] - ERROR
    shown = numbers["stationary"]
    nearest = numbers["samples"]["distance"][shown["sample"]]
    assert abs(min(shown["distance"]) - nearest) < ERROR


def check_cao14_open_closed(numbers):
    both_directions(numbers)
    assert len(numbers["samples"]["t"]) == 11
    assert {c["solution"]["witness"]["event"] for c in numbers["candidates"]} == {"antipodal", "one_to_two"}


def check_cao14_closed_closed(numbers):
    both_directions(numbers)
    ours = [s for s in numbers["speeds"] if s["name"] == "TwoStep"]
    samples = [s for s in numbers["speeds"] if s["name"] != "TwoStep"]
    assert ours and samples
    assert all(max(s["errors"]) < ERROR for s in ours)
    assert all(min(s["errors"]) > ERROR for s in samples)
    assert all(s["seconds"] > 0 and s["ratio"] > 0 for s in numbers["speeds"])


def check_point_bezier(numbers):
    for name, entries in numbers["random"]["methods"].items():
        proven = name in ("ProjectedPolyhedron", "NearestSearch")
        for entry in entries:
            assert entry["lower_above"] < ERROR
            assert entry["wrong"] == 0 if proven else 0.01 < entry["wrong"] < 0.3
            assert not proven or entry["largest_error"] < ERROR
    for name in ("ProjectedPolyhedron", "NearestSearch"):
        assert np.max(np.abs(numbers["path"]["errors"][name])) < ERROR
    ours, *samples = numbers["speed"]["entries"]
    assert ours["error"] < ERROR and all(s["error"] > ERROR for s in samples)


def check_ranges(numbers):
    for ways in numbers["surfaces"].values():
        least = ways["bernstein"]["levels"][-1]
        assert all(way["proven"] <= least <= way["levels"][-1] for way in ways.values())
        assert all(way["rate"] > 0 and way["seconds"] > 0 for way in ways.values())


def holds(found, exact):
    return found["lower"] <= exact and (found["upper"] is None or exact <= found["upper"])


def check_spurious_cells(numbers):
    *counterexamples, empty = numbers["pairs"]
    for pair in counterexamples:
        assert not any(holds(found, pair["exact"]) for found in pair["paper"])
        assert all(holds(found, pair["exact"]) for found in pair["safe"])
    assert {found["result"] for found in empty["paper"]} == {"unproven"}
    assert {found["result"] for found in empty["safe"]} == {"unverified"}


def check_algsurf_table(numbers):
    assert all(holds(found, numbers["exact"]) for found in numbers["rules"])
    for found in numbers["rules"]:
        assert found["separable"] < numbers["paper"]["seconds"] / 1000


def check_surface_gallery(numbers):
    for pair in numbers["pairs"]:
        found = pair["solution"]
        assert 0 < found["lower"] <= found["value"] <= found["upper"] <= found["lower"] + 0.1
        assert pair["cubes"]["lower"] <= found["upper"] and found["lower"] <= pair["cubes"]["upper"]


def check_fit_quadric(numbers):
    assert all(end["lower"] <= end["value"] <= end["upper"] for end in numbers["ends"])
    assert np.all(np.diff(numbers["path"]) <= 0)


def check_lin03_field(numbers):
    for mesh in numbers["meshes"]:
        assert mesh["closed"] and 0 < mesh["sampled"] <= mesh["proven"]
        assert all(0 < way["lower"] <= way["upper"] < 4 * mesh["atol"] for way in mesh["hausdorff"].values())


def check_local_search_error(numbers):
    for mesh in numbers["meshes"]:
        assert [way["published"] for way in mesh["ways"]].count(True) == 1
        for way in mesh["ways"]:
            # Never below the exact distance, up to rounding; and often above.
            assert way["smallest"] > -1e-12 and way["largest"] > 1e-3
            assert 0.01 < way["wrong"] < 0.6 and way["wrong_signs"] < 0.01


def check_mesh_hausdorff_figure(numbers):
    for name, entry in numbers["directions"].items():
        found, rounds = entry["solution"], entry["rounds"]
        assert np.max(numbers[name[0]]["distance"]) <= found["upper"]
        assert 0 <= found["upper"] - found["lower"] <= 1e-8 * found["value"]
        assert np.all(np.diff([row["lower"] for row in rounds]) >= 0)
        assert np.all(np.diff([row["upper"] for row in rounds]) <= 0)


def check_mesh_peers(numbers):
    assert numbers["queries"][0]["name"] == "jhd"
    assert all(min(peer["rates"]) > 0 and peer["error"] < 1e-4 for peer in numbers["queries"])
    ours, *others = numbers["hausdorff"]
    assert ours["lower"] <= ours["value"] <= ours["upper"] <= ours["lower"] + 1e-8
    for way in others:
        # Points of the meshes against the other mesh are never too far.
        assert way["value"] <= ours["upper"] if way["name"] == "samples to meshes" else way["seconds"] > 0


def check_lin03_spheres(numbers):
    found, eps = numbers["distance"], numbers["eps"]
    assert found["lower"] <= 2 <= found["upper"] <= found["lower"] + 3e-12
    first = np.array([answer["first"] for answer in numbers["answers"]])
    every = np.concatenate([answer["distances"] for answer in numbers["answers"]])
    # It depends on the grid and on the pair of cubes, is never below the distance, and mostly beyond the stated error.
    assert np.ptp(first) > 1e-3 and np.ptp(every) > np.ptp(first) and every.min() >= 2 - 1e-12
    assert np.mean(first - 2 > eps) > 0.5 and eps < every.max() - 2 < 0.0167
    assert numbers["pairs_that_print_alike"] > 0 and f"{numbers['line']['distance']:.4f}" == "2.0020"
    as_printed, as_read = np.split(np.array(numbers["printed_points_off"]), 2)
    assert as_printed.min() > 7e-4 and as_read.max() < 5e-5


def check_lin03_transform(numbers):
    # The fourth pixel is the feature, and each pixel has the offset to it.
    assert all(offsets == [3, 2, 1, 0, -1, -2, -3] for offsets in numbers["line"].values())
    for case in (case for cases in numbers["shapes"].values() for case in cases):
        exact, published = case["exact"], case["vector_propagation"]
        assert exact["wrong"] == 0 and exact["attained"] and max(exact["largest"], -exact["smallest"]) < 1e-12
        assert published["wrong"] < 1e-3 and published["largest"] < 0.1 and published["smallest"] > -1e-12


def check_active_set(numbers):
    first, *_, last = numbers["steps"]
    assert [first["equal"], len(first["pairs"]["value"])] == [1, 4]
    assert [last["equal"], len(last["pairs"]["value"])] == [numbers["parameters"] + 1, 8]
    assert last["spread"] < 1e-14 and np.all(np.diff([step["distance"] for step in numbers["steps"]]) < 0)
    error = numbers["error"]
    assert error["lower"] <= 0.281167221 + 5e-10 and 0.281167221 - 5e-10 <= error["upper"] <= error["lower"] + 1e-9
    assert len(numbers["steps"]) == 11 and 0.4 < first["optimality"] and last["optimality"] < 1e-15


def check_quarter_circle(numbers):
    for run in numbers["runs"]:
        *before, last = run["off"]
        assert last < 1e-15 and before[-1] < 1e-8 and run["steps_within"] == run["stats"]["steps"] <= 9
    fits = numbers["fits"]
    # The quintic of a small run is cut short.
    for name, maxima in (("parameter", 3), ("fixed", 5), ("free", 7)):
        fit, error = fits[name], fits[name]["error"]
        # Two distances of points of size one, each rounded twice at least: that is all they differ by.
        assert fit["active"] == maxima and fit["spread"] < 4 * np.finfo(float).eps and fit["optimality"] < 1e-15
        assert error["lower"] <= error["value"] <= error["upper"] <= error["lower"] + 1.01e-12
        assert abs(error["value"] - fit["known"]) < 1e-5 * fit["known"]
        # The error curve, in rational arithmetic, stays below what is proven.
        assert np.max(np.abs(fit["curve"]["error"])) <= error["upper"]
    assert fits["quintic"]["error"]["value"] < fits["free"]["error"]["value"]


def check_gradient_check(numbers):
    path = {key: np.array(numbers["path"][key]) for key in ("event", "rule", "naive", "difference")}
    off, naive = (np.abs(path[key] - path["difference"]) for key in ("rule", "naive"))
    two = path["event"] == "one_to_two"
    assert {"antipodal", "one_to_two"} <= set(path["event"])
    assert np.max(off) < 1e-6 and np.max(naive[~two]) < 1e-6 and np.min(naive[two]) > 1e-3 and np.max(naive) > 0.5
    assert numbers["pairs"]
    assert all(max(e["first"]) < 1e-6 and max(e["second"]) < 1e-4 for e in numbers["pairs"].values())


def check_convergence(numbers):
    for pair, families in numbers["local"].items():
        for family, entry in families.items():
            fitted = entry["order"] is not None
            assert (entry["slope"] is not None) == fitted, (pair, family)
            assert not fitted or abs(entry["slope"] - entry["order"]) < 0.2, (pair, family)
    assert np.abs(numbers["local"]["coincident_circle"]["ours"]["gap"][-1]) < 1e-13

    def needed(pair, family):
        entry = numbers["cells"][pair][family]
        return next((n for n, gap in zip(entry["count"], entry["gap"], strict=True) if gap <= numbers["goal"]), np.inf)

    for pair in ("antipodal", "one_to_two"):
        assert needed(pair, "ours") == 3 and needed(pair, "ours, halved") <= 9
        assert all(needed(pair, family) >= 27 for family in ("Lipschitz", "one branch", "lambda"))


def check_flattening_check(numbers):
    assert all(entry["answers"]["undecided"] == 0 and entry["count"] > 0 for entry in numbers["entries"])
    for entry in numbers["entries"]:
        lower, upper = (np.array(entry[key]) for key in ("lower", "upper"))
        # The answers are those of the bounds, which are found another way.
        assert entry["answers"]["yes"] == np.sum(lower <= entry["tolerance"]) == np.sum(upper <= entry["tolerance"])
        fonttools = entry["name"] in ("cu2qu", "qu2cu")
        if fonttools or entry["family"] in ("letters", "inflection", "loop"):
            assert entry["answers"]["no"] == 0, (entry["name"], entry["family"])
        elif entry["family"] == "hairpin" or (entry["family"] == "near-cusp" and entry["size"] >= 100):
            assert entry["answers"]["no"] > 0, (entry["name"], entry["family"])
    assert all(specimen["answer"] == "no" for specimen in numbers["specimens"])
    steps = {way: sum(entry["steps"][way] for entry in numbers["entries"]) for way in ("distance", "decision")}
    assert steps["decision"] < steps["distance"]


def check_fonts(numbers):
    matrix = numbers["matrix"]
    lower, value, upper = (np.array(matrix[key]) for key in ("lower", "value", "upper"))
    assert np.all(lower <= value) and np.all(value <= upper) and matrix["gap"] < 1e-9
    for name, tables in (("rows", (lower, upper)), ("columns", (lower.T, upper.T))):
        found = numbers["searches"][name]
        assert found["distances"] + found["decisions"] < value.size
        for letter, nearest, tied, low, high in zip(
            numbers["letters"], found["nearest"], found["tied"], *tables, strict=True
        ):
            best = numbers["letters"].index(nearest)
            others = [k for k, other in enumerate(numbers["letters"]) if k != best and other not in tied]
            # What the search calls nearest, the matrix proves: no letter but those tied can be nearer.
            assert np.all(high[best] < low[others]), (name, letter)
    assert all(entry["largest_error"] > entry["spacing"] / 10 for entry in numbers["samples"])


def check_first_call(numbers):
    for entry in numbers["entries"].values():
        assert entry["without"]["bounds"] == entry["first"]["bounds"] == entry["second"]["bounds"]
        assert entry["without"]["read"] == entry["first"]["read"] == 0 < entry["second"]["read"]
        assert entry["second"]["compiled"] == 0 < entry["first"]["compiled"]
        assert entry["without"]["phases"]["writing"] == 0 < entry["first"]["phases"]["writing"]


def check_scaling(numbers):
    for entry in (entry for entries in numbers["kinds"].values() for entry in entries):
        assert entry["gap"] <= 1e-10 and entry["cells"] < 500 and entry["cells, both"] >= entry["cells"]
        assert entry["segments"] <= entry["padded"]
    # In bounded memory: a program for four segments reserves less than a megabyte, a process less than a gigabyte.
    for program in numbers["programs"]:
        assert 0 < program["directed, reserved"] <= program["both, reserved"] < 1e6
        assert 0 <= program["plain, peak"] <= program["both, peak"] < 1e9


def check_sampling_versus_proof(numbers):
    for pair in numbers["pairs"].values():
        ours = [entry for entry in pair["entries"] if entry["method"] == "jhd"]
        others = [entry for entry in pair["entries"] if entry["method"] != "jhd"]
        assert all(entry["gap"] <= entry["tolerance"] and entry["error"] <= entry["gap"] for entry in ours)
        assert others and all(entry["error"] > 1e-10 for entry in others)
        found = ours[-1]["solution"]
        # The distance is known; its curves are stored exactly.
        assert pair["known"] is None or found["lower"] <= pair["known"] <= found["upper"]


def check_registration(numbers):
    for name, problem in numbers["problems"].items():
        for entry in (*problem["ours"], *problem["icp"], *problem["icp_then_ours"]):
            assert entry["lower"] <= entry["value"] <= entry["upper"]
        for before, after in zip(problem["icp"], problem["icp_then_ours"], strict=True):
            # Never farther than where it began, up to what is proven of either.
            assert after["lower"] <= before["upper"]
        best = min(entry["upper"] for entry in problem["ours"] + problem["icp_then_ours"])
        if name == "copy":
            # The motion itself is found, to rounding.
            assert best < 1e-13 and min(entry["angle_off"] for entry in problem["ours"]) < 1e-14
            continue
        least = min(entry["lower"] for entry in problem["icp"])
        assert best < least / (1.05 if name == "rigid" else 1.2)
        count = 3 if name == "rigid" else 4
        for entry in problem["ours"]:
            assert entry["optimality"] < 1e-14 and entry["active"] == count + 1


def check_degree_reduction(numbers):
    for case in numbers["cases"]:
        ours, *others = case["methods"].values()
        assert not case["not_proven_farther"] and all(other["lower"] > ours["upper"] for other in others)
        assert ours["optimality"] < 1e-14 and ours["active"] == 2 * (case["degree"] - 1) + 1
        ratios = {name: entry["ratio"] for name, entry in case["methods"].items()}
        assert 1.0001 < ratios["soft Hausdorff"] < 1.07
        assert all(ratios[name] > 1.08 for name in ("least squares", "projected least squares", "Chamfer"))


def check_outline_fit(numbers):
    for glyph in numbers["glyphs"]:
        for tolerance in {fit["tolerance"] for fit in glyph["fits"]}:
            fits = {fit["method"]: fit for fit in glyph["fits"] if fit["tolerance"] == tolerance}
            assert fits["fit_outline"]["upper"] <= tolerance
            assert all(fit["lower"] <= fit["upper"] for fit in fits.values())
            assert fits["fit_outline"]["segments"] <= min(fit["segments"] for fit in fits.values())
    for case in numbers["cases"]:
        for run in case["runs"].values():
            assert run["lower"] <= run["value"][-1] * (1 + 1e-9) and run["upper"] <= 1.01 * case["best"]
            assert np.all(np.diff(run["value"]) <= 0)


def check_noisy_outline(numbers):
    for case in numbers["cases"]:
        fit = case["methods"]["minimax fit"]
        assert all(entry["lower"] <= entry["upper"] for entry in case["methods"].values())
        assert all(entry["lower"] > fit["upper"] for name, entry in case["methods"].items() if name != "minimax fit")
        assert np.all(np.diff([value for _, value in case["history"]]) < 0)


def check_scan_with_outliers(numbers):
    (case,) = numbers["cases"]
    assert case["share"] == 0.1
    for fit in case["fits"].values():
        assert fit["lower"] <= fit["upper"] and fit["reached"] < fit["first"]
    error = {name: fit["upper"] / numbers["noise"] for name, fit in case["fits"].items()}
    astray = min(case["fits"][name]["lower"] / numbers["noise"] for name in ("maximum", "root mean square"))
    # Of the few points and steps of a small run.
    assert error["mean"] < 3 and astray > 10 and error["quantile"] < 0.5 * astray


def check_scaling_of_fits(numbers):
    for case in numbers["by_vertices"] + numbers["by_segments"]:
        # What is proven is what the fit worked with.
        assert case["lower"] <= case["last"] * (1 + 1e-9) <= case["upper"] * (1 + 2e-9)
        assert case["upper"] < case["first"]


def check_kim10_table(numbers):
    for entry in numbers["entries"]:
        proven = entry["values"]["BranchAndBound"]
        assert proven <= entry["upper"] <= proven + 1.01e-10 * entry["diagonal"]
        for value in entry["values"].values():
            assert abs(value - proven) <= 1e-9 * entry["diagonal"]
        assert entry["boxes"]["BiarcTrimming"] <= entry["boxes"]["AlgebraicEvents"]
        assert max(entry["left"]) < 0.1


def check_kim10_figures(numbers):
    assert 0 < numbers["checked"]["largest"] <= numbers["checked"]["error"]
    for pair in numbers["pairs"].values():
        found, parts = pair["solution"], pair["parts"]
        assert found["lower"] - 2 * pair["reach"] <= pair["lower"] <= found["upper"]
        # What is trimmed is within the bound, what is left has the farthest place, and is little.
        assert pair["trimmed_reaches"] <= pair["lower"] and pair["share_left"] < 0.1
        # Trimmed as published, nothing of the other curve is left, where the feet are.
        assert pair["share_left_of_b"] == 0 and not any(pair["parts_of_b"]["left"])
        segment, t = found["witness"]["segment"], found["witness"]["t"]
        rows = zip(parts["segment"], parts["t0"], parts["t1"], parts["left"], strict=True)
        assert any(left and s == segment and t0 <= t <= t1 for s, t0, t1, left in rows)


def check_two_sided_trimming(numbers):
    lost = 0
    for family, bounds in numbers["families"].items():
        for bound, summary in bounds.items():
            assert summary["lost"] == summary["below"], (family, bound)
            lost += summary["lost"]
    for trial in (trial for trials in numbers["trials"].values() for trial in trials):
        exact, allowed = trial["solution"], numbers["lost"] * trial["diagonal"]
        assert abs(trial["ours"] - exact["value"]) <= allowed
        for found in trial["bounds"].values():
            assert abs(found["one"]["value"] - exact["value"]) <= allowed
            assert found["both"]["value"] <= exact["upper"] + allowed
    assert lost > 0


def check_biarc_convergence(numbers):
    for name, curve in numbers["curves"].items():
        counts = [row["arcs"] for row in curve["rows"]]
        assert np.all(np.diff(counts) >= 0), name
        for row in curve["rows"]:
            rounding = 1e-14 * curve["diagonal"]
            assert row["sampled"] - rounding <= row["deviation"] <= row["tolerance"], name
            assert row["lower"] <= row["deviation"] and row["upper"] - row["lower"] <= 0.0101 * row["deviation"], name
            assert row["result"] == "successful" and row["arcs"] >= 0.9 * row["theory"], name


def check_surface_distances(numbers):
    for pair in numbers["pairs"]:
        found, gap = pair["solution"], pair["share"] * pair["diagonal"]
        assert found["result"] == "successful" and 0 <= found["upper"] - found["lower"] <= gap, pair["name"]
        assert pair["share"] > 1e-6 or pair["samples"]["off"] > 10 * (found["upper"] - found["lower"]), pair["name"]
        if pair["name"] == "torus, wider torus":
            assert found["lower"] <= 0.05 <= found["upper"]


def both_ways(mesh, shares):
    """Bounds of both directions as close as was asked for."""
    for way, share in shares.items():
        found = mesh[way]
        assert found["result"] == "successful" and 0 < found["lower"] <= found["upper"], way
        assert found["upper"] - found["lower"] <= share * found["upper"], way


def check_surface_bounds(numbers):
    for name, pair in numbers["pairs"].items():
        ours = pair["searches"]["jhd"]
        assert ours["enclosed"] and set(ours["results"]) == {"successful"}, name
        assert ours["between"][-1] <= numbers["goal"] and ours["cells"][-1] < 100, name
        for family, search in pair["searches"].items():
            # What values at nodes lose is far below.
            assert min(search["gap"]) > -1e-9, (name, family)
            reached = search["gap"][-1] <= numbers["goal"]
            assert family == "jhd" or not reached or search["cells"][-1] > ours["cells"][-1], (name, family)
            assert family == "jhd" or name != "ridge" or search["gap"][-1] > 1e-5, family


def check_marching_cubes_check(numbers):
    meshes = numbers["meshes"]
    for mesh in meshes:
        both_ways(mesh, dict.fromkeys(("to_surface", "to_mesh"), numbers["share"]))
    assert meshes[-1]["upper"] < meshes[0]["upper"] and numbers["power"] > 1
    assert meshes[-1]["to_mesh"]["lower"] <= 1.1 * meshes[-1]["to_surface"]["upper"]


def check_tessellation_check(numbers):
    for mesh in numbers["meshes"]:
        both_ways(mesh, numbers["shares"])
        for way in numbers["shares"]:
            assert mesh[way]["lower"] <= mesh["promised"] <= mesh["asked"]


def check_latent_shapes(numbers):
    ways = numbers["ways"]
    paths = {name: [np.array(x["distances"]) for x in way["path"]] for name, way in ways.items()}
    start = paths["Chamfer"][0]
    assert start.shape == (numbers["batch"],) and np.all(start > 0)
    for path in paths.values():
        np.testing.assert_array_equal(path[0], start)
        assert path[-1].mean() < start.mean()
    soft, hard, samples = (
        np.mean(ways[name]["moved"]) for name in ("soft, then hard", "the distance itself", "Chamfer")
    )
    assert hard < 0.6 * numbers["drawn"] < samples == numbers["drawn"]
    assert soft > 1.5 * hard
    assert all(seconds > 0 for seconds in numbers["seconds_of_a_step"].values())


CLAIMS = {name.removeprefix("check_"): f for name, f in list(globals().items()) if name.startswith("check_")}
