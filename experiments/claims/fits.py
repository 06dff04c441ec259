"""Claims of the experiments on fits."""

import numpy as np

from .collections import full


def check_fit_quadric(numbers):
    assert all(end["lower"] <= end["value"] <= end["upper"] for end in numbers["ends"])
    assert np.all(np.diff(numbers["path"]) <= 0)
    if full(numbers):
        first, last = numbers["ends"]
        assert all(end["upper"] - end["lower"] < 1e-9 for end in numbers["ends"])
        assert round(1 - last["upper"] / first["lower"], 2) == 0.22
        assert [round(end["value"], 2) for end in numbers["ends"]] == [0.18, 0.14]
        assert numbers["counts"]["evaluations"] < 40 and numbers["optimality"] < 1e-8


def check_active_set(numbers):
    first, *_, last = numbers["steps"]
    assert [first["equal"], len(first["pairs"]["value"])] == [1, 4]
    assert [last["equal"], len(last["pairs"]["value"])] == [numbers["parameters"] + 1, 8] == [7, 8]
    assert last["spread"] < 1e-14 and np.all(np.diff([step["distance"] for step in numbers["steps"]]) < 0)
    error = numbers["error"]
    assert error["lower"] <= 0.281167221 + 5e-10 and 0.281167221 - 5e-10 <= error["upper"] <= error["lower"] + 1e-9
    assert numbers["stats"]["steps"] == 10 and len(numbers["steps"]) == (11 if full(numbers) else 2)
    assert 0.4 < first["optimality"] < 0.45 and last["optimality"] < 1e-15 and round(first["distance"], 2) == 2.94


def check_quarter_circle(numbers):
    for run in numbers["runs"]:
        *_, third, second, last = run["off"]
        # The last step gains far more than the one before: faster than linearly.
        assert last < 1e-15 and last / second < 0.01 * second / third
        assert run["steps_within"] == run["stats"]["steps"] <= 9
    small, fits = not full(numbers), numbers["fits"]
    # A smoke run has one start and no quintic.
    if not small:
        assert {run["start"]: run["steps_within"] for run in numbers["runs"]} == {0.3: 8, 0.5: 5, 0.8: 9}
        assert max(run["off"][-1] for run in numbers["runs"]) < 1e-16
        assert [f"{off:.1e}" for off in numbers["runs"][1]["off"][-3:]] == ["6.6e-05", "3.0e-09", "2.7e-17"]
        assert all(max(fit["spread"], fit["optimality"]) < 5e-16 for fit in fits.values())
    assert list(fits) == ["parameter", "fixed", "free", "quintic"][: 3 if small else 4]
    known = {3: 1.960764699e-4, 5: 6.84399e-5, 7: 5.50781e-5, 9: 7.7034e-10}
    for fit, (maxima, distance) in zip(fits.values(), known.items(), strict=False):
        error = fit["error"]
        # They differ only by the rounding of two distances of points of size one, each rounded twice at least.
        assert fit["active"] == maxima and fit["spread"] < 4 * np.finfo(float).eps and fit["optimality"] < 1e-15
        assert error["lower"] <= error["value"] <= error["upper"] <= error["lower"] + 1.01e-12
        assert abs(error["value"] - distance) < 1e-5 * distance
        # The error curve, in rational arithmetic, stays below the certified bound.
        assert np.max(np.abs(fit["curve"]["error"])) <= error["upper"]


def check_registration(numbers):
    whole = full(numbers)
    for name, problem in numbers["problems"].items():
        for entry in (*problem["ours"], *problem["icp"], *problem["icp_then_ours"]):
            assert entry["lower"] <= entry["value"] <= entry["upper"]
        for alone, before, after in zip(problem["ours"], problem["icp"], problem["icp_then_ours"], strict=True):
            # Never farther than the start, up to the certified bounds of either, nor than without ICP, to 1e-9.
            assert after["lower"] <= min(alone["upper"] + 1e-9, before["upper"])
        best = min(entry["upper"] for entry in problem["ours"] + problem["icp_then_ours"])
        if name == "copy":
            # The motion itself is found, to rounding.
            assert best < 1e-13 and min(entry["angle_off"] for entry in problem["ours"]) < 1e-14
            ends = [problem[way] for way in ("ours", "icp")]
            assert all(entry["upper"] < 1e-13 or entry["lower"] > 0.05 for entries in ends for entry in entries)
            found = [[entry for entry in entries if entry["upper"] < 1e-13] for entries in ends]
            assert not whole or [len(entries) for entries in found] == [3, 4] and len(problem["ours"]) == 8
            assert all(max(entry["angle_off"], entry["shift_off"]) < 1e-13 for entries in found for entry in entries)
            continue
        gain = 1 - best / min(entry["lower"] for entry in problem["icp"])
        stated, small = (0.08, 0.05) if name == "rigid" else (0.26, 0.16)
        assert round(gain, 2) == stated if whole else gain > small
        count = 3 if name == "rigid" else 4
        for entry in (*problem["ours"], *problem["icp_then_ours"]):
            assert entry["optimality"] < 1e-14 and entry["active"] == count + 1
        # From the sides, at 90 and 270 degrees.
        sides = zip(problem["ours"][2::4], problem["icp"][2::4], strict=True)
        assert all(alone["lower"] > icp["upper"] for alone, icp in sides)


def check_degree_reduction(numbers):
    fewer = 0
    for case in numbers["cases"]:
        ours, *others = case["methods"].values()
        assert not case["not_certified_farther"] and all(other["lower"] > ours["upper"] for other in others)
        # One maximum more than parameters; if any is missing, the best curve lies in a valley, found less sharply.
        missing = 2 * (case["degree"] - 1) + 1 - ours["active"]
        assert missing in (0, 1) and ours["optimality"] < (1e-8 if missing else 1e-14)
        fewer += missing
        ratios = {name: entry["ratio"] for name, entry in case["methods"].items()}
        assert 1.0001 < ratios["soft Hausdorff"] < 1.12
        others = [ratios[name] for name in ("least squares", "projected least squares", "Chamfer")]
        assert min(others) > (1.09 if full(numbers) else 1.08)
    assert fewer <= len(numbers["cases"]) / 12
    if full(numbers):
        assert len(numbers["cases"]) == 24
        everything = [case["methods"] for case in numbers["cases"]]
        ours = sum(methods["ours"]["seconds"] for methods in everything)
        for name in ("Chamfer", "soft Hausdorff"):
            spent = [sum(methods[name][key] for methods in everything) for key in ("seconds", "search_seconds")]
            assert spent[0] < ours / 2 and spent[1] < 2 * ours, name


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
    if full(numbers):
        fits = [fit for glyph in numbers["glyphs"] for fit in glyph["fits"]]
        assert len(numbers["glyphs"]) == 6 and all(fit["upper"] <= fit["tolerance"] for fit in fits)
        for method, counts in {"fit_outline": (56, 62), "longest": (66, 77), "split": (92, 127)}.items():
            for tolerance, count in zip((0.004, 0.002), counts, strict=True):
                mine = [fit for fit in fits if (fit["method"], fit["tolerance"]) == (method, tolerance)]
                assert sum(fit["segments"] for fit in mine) == count
        assert all(fit["seconds"] < (30 if fit["method"] == "fit_outline" else 0.2) for fit in fits)
        assert [case["parameters"] for case in numbers["cases"]] == [60, 60]
        assert all(case["runs"]["warm"]["seconds_near"] < 15 for case in numbers["cases"])


def check_noisy_outline(numbers):
    for case in numbers["cases"]:
        fit = case["methods"]["minimax fit"]
        assert all(entry["lower"] <= entry["upper"] for entry in case["methods"].values())
        assert all(entry["lower"] > fit["upper"] for name, entry in case["methods"].items() if name != "minimax fit")
        assert np.all(np.diff([value for _, value in case["history"]]) < 0)
    if full(numbers):
        counts, chosen = [case["vertices"] for case in numbers["cases"]], numbers["context"]["parameters"]
        assert [numbers["segments"], counts[0], counts[-1]] == [20, 100, 10_000]
        assert [chosen["STEPS"], len(chosen["RATES"]), counts[-1] // chosen["TARGET_SAMPLES"]] == [600, 3, 5]
        seconds = [case["methods"]["minimax fit"]["seconds"] for case in numbers["cases"]]
        assert np.all(np.diff(np.divide(seconds, counts)) < 0)


def check_scan_with_outliers(numbers):
    # A smoke run has one fraction of outliers, and few points and steps.
    small = not full(numbers)
    for case in numbers["cases"]:
        fits, share = case["fits"], case["share"]
        for fit in fits.values():
            assert fit["lower"] <= fit["upper"] and fit["reached"] < fit["first"]
        least, most = ({name: fit[end] / numbers["noise"] for name, fit in fits.items()} for end in ("lower", "upper"))
        if share == 0:
            assert all(error < 1 for name, error in most.items() if name != "maximum")
            continue
        assert small or len(case["scan"]) == 400
        assert all(least[name] > (10 if small else 19) for name in ("maximum", "root mean square"))
        if small:
            assert most["mean"] < 3 and most["quantile"] < 0.5 * least["root mean square"]
        elif share <= 0.2:
            assert most["mean"] <= 1.5 and most["quantile"] <= 1
        else:
            assert min(least.values()) > 30
        assert small or max(most["maximum"], most["root mean square"]) < 64
    assert [case["share"] for case in numbers["cases"]] == ([0.1] if small else [0, 0.05, 0.1, 0.2, 0.3])


def check_scaling_of_fits(numbers):
    for case in numbers["by_vertices"] + numbers["by_segments"]:
        # The proof agrees with the value that the fit worked with.
        assert case["lower"] <= case["last"] * (1 + 1e-9) <= case["upper"] * (1 + 2e-9)
        assert case["upper"] < case["first"]
    if full(numbers):
        first, last = numbers["by_vertices"][0], numbers["by_vertices"][-1]
        assert last["vertices"] == 100_000 and last["step"] / first["step"] < last["vertices"] / first["vertices"] / 10
        before, after = numbers["by_segments"][-2:]
        assert before["points"] == 120 and after["step"] / before["step"] > after["points"] / before["points"]
        searched = [case for case in numbers["by_vertices"] if case["all"] is not None]
        slow, fast = searched[-1], searched[0]
        assert slow["vertices"] > fast["vertices"] and slow["all"] / fast["all"] > slow["vertices"] / fast["vertices"]


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
    if full(numbers):
        ends = [paths[name][-1] for name in ("soft, then hard", "the distance itself", "Chamfer")]
        assert [round(end.mean(), 3) for end in ends] == [0.026, 0.045, 0.038]
        assert [round(end.max(), 3) for end in ends] == [0.071, 0.116, 0.109]
        assert [round(soft, 1), round(hard, 1)] == [11.6, 3.6]
        assert all(way["path"][-1]["step"] == 200 for way in ways.values())
    assert all(seconds > 0 for seconds in numbers["seconds_of_a_step"].values())
