"""What the experiments on fits claim."""

import numpy as np


def check_fit_quadric(numbers):
    assert all(end["lower"] <= end["value"] <= end["upper"] for end in numbers["ends"])
    assert np.all(np.diff(numbers["path"]) <= 0)


def check_active_set(numbers):
    first, *_, last = numbers["steps"]
    assert [first["equal"], len(first["pairs"]["value"])] == [1, 4]
    assert [last["equal"], len(last["pairs"]["value"])] == [numbers["parameters"] + 1, 8]
    assert last["spread"] < 1e-14 and np.all(np.diff([step["distance"] for step in numbers["steps"]]) < 0)
    error = numbers["error"]
    assert error["lower"] <= 0.281167221 + 5e-10 and 0.281167221 - 5e-10 <= error["upper"] <= error["lower"] + 1e-9
    assert numbers["stats"]["steps"] == 10 and len(numbers["steps"]) == (2 if numbers["context"]["smoke"] else 11)
    assert 0.4 < first["optimality"] and last["optimality"] < 1e-15


def check_quarter_circle(numbers):
    for run in numbers["runs"]:
        *_, third, second, last = run["off"]
        # The last step gains far more than the one before: faster than linearly.
        assert last < 1e-15 and last / second < 0.01 * second / third
        assert run["steps_within"] == run["stats"]["steps"] <= 9
    fits = numbers["fits"]
    for name, maxima in (("parameter", 3), ("fixed", 5), ("free", 7)):
        fit, error = fits[name], fits[name]["error"]
        # Two distances of points of size one, each rounded twice at least: that is all they differ by.
        assert fit["active"] == maxima and fit["spread"] < 4 * np.finfo(float).eps and fit["optimality"] < 1e-15
        assert error["lower"] <= error["value"] <= error["upper"] <= error["lower"] + 1.01e-12
        assert abs(error["value"] - fit["known"]) < 1e-5 * fit["known"]
        # The error curve, in rational arithmetic, stays below what is proven.
        assert np.max(np.abs(fit["curve"]["error"])) <= error["upper"]
    # A short run has no quintic.
    assert numbers["context"]["smoke"] or fits["quintic"]["error"]["value"] < fits["free"]["error"]["value"]


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
            # From the other starts the fit and ICP end in local minima.
            found = [sum(entry["upper"] < 1e-13 for entry in problem[way]) for way in ("ours", "icp")]
            assert numbers["context"]["smoke"] or max(found) <= len(problem["ours"]) / 2
            continue
        least = min(entry["lower"] for entry in problem["icp"])
        assert best < least / (1.05 if name == "rigid" else 1.2)
        count = 3 if name == "rigid" else 4
        for entry in problem["ours"]:
            assert entry["optimality"] < 1e-14 and entry["active"] == count + 1


def check_degree_reduction(numbers):
    fewer = 0
    for case in numbers["cases"]:
        ours, *others = case["methods"].values()
        assert not case["not_proven_farther"] and all(other["lower"] > ours["upper"] for other in others)
        # One maximum more than parameters; where there is none, the best curve is one of a valley, found less sharply.
        missing = 2 * (case["degree"] - 1) + 1 - ours["active"]
        assert missing in (0, 1) and ours["optimality"] < (1e-8 if missing else 1e-14)
        fewer += missing
        ratios = {name: entry["ratio"] for name, entry in case["methods"].items()}
        assert 1.0001 < ratios["soft Hausdorff"] < 1.075
        assert all(ratios[name] > 1.08 for name in ("least squares", "projected least squares", "Chamfer"))
    assert fewer <= len(numbers["cases"]) / 12


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
            # Coordinates are of size one: the last steps may be below their rounding.
            assert np.all(np.diff(run["value"]) <= 4 * np.finfo(float).eps)


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
