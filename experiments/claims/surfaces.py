"""Claims of the experiments on surfaces, meshes and fields."""

import numpy as np

from .collections import full

# Samples of shapes over the unit square lie on a grid of a twelfth; every point is nearer than this to one of them.
_APART = 0.06


def holds(found, exact):
    return found["lower"] <= exact and (found["upper"] is None or exact <= found["upper"])


def both_ways(mesh, shares):
    """Return bounds of both directions; they must be as close as required."""
    for way, share in shares.items():
        found = mesh[way]
        assert found["result"] == "successful" and 0 < found["lower"] <= found["upper"], way
        assert found["upper"] - found["lower"] <= share * found["upper"], way


def check_ranges(numbers):
    for ways in numbers["surfaces"].values():
        least = ways["bernstein"]["levels"][-1]
        assert all(way["certified"] <= least <= way["levels"][-1] for way in ways.values())
        assert all(way["rate"] > 0 and way["seconds"] > 0 for way in ways.values())
    if full(numbers):
        kept = {
            name: [ways[name]["levels"][-1] / ways[name]["certified"] for ways in numbers["surfaces"].values()]
            for name in ("bernstein", "modified_affine", "interval")
        }
        assert max(kept["bernstein"]) < 1.03 and 8 < max(kept["interval"]) < 9.5
        ends = min(kept["modified_affine"]), max(kept["modified_affine"])
        assert [round(100 * (x - 1)) for x in ends] == [3, 34]
        for ways in numbers["surfaces"].values():
            ours, affine = ways["bernstein"], ways["modified_affine"]
            assert affine["rate"] < 2.5 * ours["rate"] and ours["seconds"] < 2 * affine["seconds"]


def check_spurious_cells(numbers):
    *counterexamples, empty = numbers["pairs"]
    for pair in counterexamples:
        assert not any(holds(found, pair["exact"]) for found in pair["paper"])
        assert all(holds(found, pair["exact"]) for found in [*pair["safe"], pair["search"]] if found is not None)
    assert {found["result"] for found in empty["paper"]} == {"not_certified"}
    assert all(0 < found["lower"] <= found["upper"] for found in empty["paper"])
    assert {found["result"] for found in empty["safe"]} == {"existence_not_certified"}
    below, above = counterexamples
    misses = np.array(
        [[2.5 - x["upper"], y["lower"] - 0.1] for x, y in zip(below["paper"], above["paper"], strict=True)]
    )
    assert below["exact"] == 2.5 and above["exact"] == 0.1 and np.all(misses > [0.87, 1.5])
    if full(numbers):
        assert empty["search"]["result"] == "empty" and numbers["cells"][-1] == 256
        assert [f"{miss:.2g}" for miss in misses[-1]] == ["0.95", "1.7"]


def check_algsurf_table(numbers):
    assert all(holds(found, numbers["exact"]) for found in numbers["rules"])
    if full(numbers):
        paper = numbers["paper"]
        cells = [found for found in numbers["rules"] if found["rule"] == "paper"]
        assert [found["cells"] for found in cells] == [16, 32, 64, 128, 256] and paper["cells"] == 64
        # The printed middle and half width agree to ten digits, the roots that they stand for to rounding.
        ends = np.array([[found["lower"], found["upper"]] for found in cells])
        printed = paper["middle"] + paper["half"] * np.array([-1, 1])
        assert np.max(np.abs(ends[2] - printed)) < 1e-10 and np.max(np.abs(ends[2] - numbers["ends"])) < 1e-12
        assert [f"{end:.5f}" for end in ends[4]] == ["0.82458", "0.86673"]
        assert cells[2]["separable"] < paper["seconds"] / 1e6
        widths, pairs = np.ptp(ends, axis=1), np.array([found["pairs"] for found in cells])
        assert np.all(np.abs(widths[:-1] / widths[1:] - 2) < 0.1)
        assert np.all(np.abs(pairs[1:] / pairs[:-1] - 15.5) < 0.5)
        sharpest = numbers["search"][-1]
        assert sharpest["upper"] - sharpest["lower"] < 1e-11 and sharpest["seconds"] < 1


def check_surface_gallery(numbers):
    for pair in numbers["pairs"]:
        found = pair["solution"]
        assert 0 < found["lower"] <= found["value"] <= found["upper"] <= found["lower"] + 0.1
        assert pair["cubes"]["lower"] <= found["upper"] and found["lower"] <= pair["cubes"]["upper"]
        if full(numbers):
            gap = found["upper"] - found["lower"]
            assert pair["cubes"]["upper"] - pair["cubes"]["lower"] > 1e4 * gap, pair["name"]
            if pair["name"] == "torus, ellipsoid":
                # Feet of a point of its axis are a circle.
                assert found["result"] == "capacity_reached" and numbers["atol"] < gap < 2e-6
                assert np.hypot(*found["witness"]["point"][:2]) < 1e-9
            else:
                assert found["result"] == "successful" and gap <= numbers["atol"] == 1e-6, pair["name"]
                assert pair["seconds"] < 1, pair["name"]


def check_lin03_field(numbers):
    for mesh in numbers["meshes"]:
        assert mesh["closed"] and 0 < mesh["sampled"] <= mesh["certified"]
        assert all(0 < way["lower"] <= way["upper"] < 4 * mesh["atol"] for way in mesh["hausdorff"].values())
    if full(numbers):
        assert [mesh["triangles"] for mesh in numbers["meshes"]] == [67_500, 48_000]
        for mesh in numbers["meshes"]:
            assert max(mesh["certified"], *(way["upper"] for way in mesh["hausdorff"].values())) < 2 * mesh["atol"]
            assert mesh["first_call"] < 15


def check_mesh_hausdorff_figure(numbers):
    for name, entry in numbers["directions"].items():
        found, rounds = entry["solution"], entry["rounds"]
        assert np.max(numbers[name[0]]["distance"]) <= found["upper"]
        assert 0 <= found["upper"] - found["lower"] <= 1e-8 * found["value"]
        assert np.all(np.diff([row["lower"] for row in rounds]) >= 0)
        assert np.all(np.diff([row["upper"] for row in rounds]) <= 0)
        if full(numbers):
            assert rounds[-1]["steps"] < 20 and found["upper"] - found["lower"] <= 1e-9 * found["value"]
            witness = found["witness"]
            used = np.array(witness["feet"])[np.array(witness["multipliers"]) > 0]
            assert np.ptp(np.linalg.norm(used - witness["point"], axis=1)) < 1e-9


def check_mesh_peers(numbers):
    assert numbers["queries"][0]["name"] == "jhd"
    assert all(min(peer["rates"]) > 0 and peer["error"] < 1e-4 for peer in numbers["queries"])
    ours, *others = numbers["hausdorff"]
    assert ours["lower"] <= ours["value"] <= ours["upper"] <= ours["lower"] + 1e-8
    for way in others:
        # Distances from points of the meshes to the other mesh are never too large.
        assert way["value"] <= ours["upper"] if way["name"] == "samples to meshes" else way["seconds"] > 0
    if full(numbers):
        # Rates of jhd over those of a peer, for points spread evenly and near the surface.
        ratios = {peer["name"]: peer["ratios"] for peer in numbers["queries"][1:]}
        assert all(even > 1 for even, _ in ratios.values())
        if "libigl" in ratios:
            assert ratios["libigl"][0] < 4 and 2 / 3 < ratios["libigl"][1] < 1.5
        assert "trimesh" not in ratios or min(ratios["trimesh"]) > 5
        for way in others:
            if way.get("samples") == 1_000_000:
                assert way["ratio"] > 2 and (-1 if way["name"] == "samples to meshes" else 1) * way["error"] > 0.01
            elif way["name"] == "libigl, vertices":
                assert way["ratio"] < 1 and way["error"] < -0.01


def check_lin03_spheres(numbers):
    found, eps = numbers["distance"], numbers["eps"]
    assert found["lower"] <= 2 <= found["upper"] <= found["lower"] + 3e-12
    first = np.array([answer["first"] for answer in numbers["answers"]])
    every = np.concatenate([answer["distances"] for answer in numbers["answers"]])
    # The answer depends on the grid and the pair of cubes, is never too small, and mostly exceeds the stated error.
    assert np.ptp(first) > 1e-3 and np.ptp(every) > np.ptp(first) and every.min() >= 2 - 1e-12
    assert np.mean(first - 2 > eps) > 0.5 and eps < every.max() - 2 < 0.0167
    assert numbers["pairs_that_print_alike"] > 0 and f"{numbers['line']['distance']:.4f}" == "2.0020"
    as_printed, as_read = np.split(np.array(numbers["printed_points_off"]), 2)
    assert [f"{off:.1e}" for off in as_printed] == ["7.9e-04", "1.2e-03"] and as_read.max() < 5e-5
    if full(numbers):
        alike = [np.any(np.abs(np.array(answer["distances"]) - 2.0020) < 5e-5) for answer in numbers["answers"]]
        assert sum(alike) == 32 and len(alike) == 81 and f"{every.max():.4f}" == "2.0166"


def check_lin03_transform(numbers):
    # The fourth pixel is the feature, and each pixel has the offset to it.
    assert all(offsets == [3, 2, 1, 0, -1, -2, -3] for offsets in numbers["line"].values())
    for case in (case for cases in numbers["shapes"].values() for case in cases):
        exact, published = case["exact"], case["vector_propagation"]
        assert exact["wrong"] == 0 and exact["attained"] and max(exact["largest"], -exact["smallest"]) < 1e-12
        assert published["wrong"] < 1e-3 and published["largest"] < 0.1 and published["smallest"] > -1e-12
        assert not full(numbers) or exact["seconds"] < case["scipy"]
    printed, counted = (numbers["operations"][key] for key in ("printed", "counted"))
    assert printed == {"shifts": 70, "additions": 110, "comparisons": 38}
    assert counted == {**printed, "additions": 108}


def check_surface_distances(numbers):
    for pair in numbers["pairs"]:
        found, gap = pair["solution"], pair["share"] * pair["diagonal"]
        assert found["result"] == "successful" and 0 <= found["upper"] - found["lower"] <= gap, pair["name"]
        assert pair["share"] > 1e-6 or pair["samples"]["off"] > 10 * (found["upper"] - found["lower"]), pair["name"]
        if pair["name"] == "torus, wider torus":
            assert found["lower"] <= 0.05 <= found["upper"]
        if full(numbers):
            assert pair["seconds"] < 2, pair["name"]
            # In units of the tolerance: for patches, and for the tori at constant distance.
            least = 1e4 if pair["share"] == 1e-10 else 100 if pair["name"] == "torus, wider torus" else 0
            assert pair["samples"]["off"] >= least * gap, pair["name"]
            assert pair["share"] < 1e-4 or pair["samples"]["off"] < gap, pair["name"]


def check_surface_bounds(numbers):
    for name, pair in numbers["pairs"].items():
        ours = pair["searches"]["jhd"]
        assert ours["enclosed"] and set(ours["results"]) == {"successful"}, name
        assert ours["between"][-1] <= numbers["goal"] and ours["cells"][-1] < 100, name
        for family, search in pair["searches"].items():
            # Values at nodes lose far less than this.
            assert min(search["gap"]) > -1e-9, (name, family)
            reached = search["gap"][-1] <= numbers["goal"]
            assert family == "jhd" or not reached or search["cells"][-1] > ours["cells"][-1], (name, family)
            assert family == "jhd" or name != "ridge" or search["gap"][-1] > 1e-5, family
            assert family == "jhd" or name != "planes" or not reached, family
        if full(numbers):
            assert max(search["cells"][-1] for search in pair["searches"].values()) == 129
            if name == "parallel":
                moving = pair["searches"]["moving foot"]
                assert moving["gap"][-1] <= numbers["goal"] and moving["cells"][-1] > 2 * ours["cells"][-1]


def check_marching_cubes_check(numbers):
    meshes = numbers["meshes"]
    for mesh in meshes:
        both_ways(mesh, dict.fromkeys(("to_surface", "to_mesh"), numbers["share"]))
    assert meshes[-1]["upper"] < meshes[0]["upper"] and numbers["power"] > 1
    assert meshes[-1]["to_mesh"]["lower"] <= 1.1 * meshes[-1]["to_surface"]["upper"]
    if full(numbers):
        ways = [[mesh[way] for way in ("to_surface", "to_mesh")] for mesh in meshes]
        assert all(max(x["lower"] for x in pair) <= min(x["upper"] for x in pair) for pair in ways)
        assert 1.9 < numbers["power"] < 1.95
        for mesh, least, most in ((meshes[0], 1.14, 1.2), (meshes[-1], 0.91, 0.95)):
            found = mesh["to_surface"]
            assert least * found["upper"] < mesh["middles"] < most * found["lower"]
        assert all(found["samples"]["value"] > 1.9 * found["upper"] for found in ways[-1])


def check_tessellation_check(numbers):
    for mesh in numbers["meshes"]:
        both_ways(mesh, numbers["shares"])
        for way in numbers["shares"]:
            assert mesh[way]["lower"] <= mesh["promised"] <= mesh["asked"]
    if full(numbers):
        meshes = numbers["meshes"]
        assert numbers["patches"] == 100 and numbers["shares"] == {"to_surface": 0.02, "to_mesh": 0.05}
        assert [meshes[0]["count"], meshes[-1]["count"]] == [299, 45_900]
        for mesh in meshes:
            found = mesh["to_surface"]
            assert 0.73 * mesh["promised"] < found["lower"] <= found["upper"] < 0.97 * mesh["promised"]
        products = np.array([mesh["to_surface"]["upper"] * mesh["count"] for mesh in meshes])
        assert np.max(np.abs(products / np.mean(products) - 1)) < 0.1
        for way in numbers["shares"]:
            fine = meshes[-1][way]
            assert fine["samples"]["value"] > (39 if way == "to_surface" else 100) * fine["upper"]


def check_certificates(numbers):
    assert all(len(mix["certificates"]) + len(mix["refused"]) == numbers["pairs"] for mix in numbers["mixes"])
    for mix in numbers["mixes"]:
        name = (*mix["kinds"], mix["distance"])
        assert mix["refused"] == [], name
        for found in mix["certificates"]:
            kind = found["claim"]["kind"]
            least, most = found["bounds"]["a_to_b" if kind == "directed" else kind]
            assert least - _APART < found["samples"] < most + _APART, name
            assert found["verified"] and found["verify"] < 60, name
            assert found["accepted"] == found["escaped"] == [] and found["by program"] == 4, name
            assert sum(found["forgeries"].values()) == numbers["forgeries"], name
            assert not full(numbers) or (found["verify"] < 1 and found["cells"] <= 100), name
    if full(numbers):
        assert [len(numbers["mixes"]), numbers["pairs"], numbers["forgeries"]] == [23, 10, 200]
