"""What the experiments on surfaces, meshes and fields claim."""

import numpy as np

# Samples of shapes over the unit square lie on a grid of a twelfth, and no place is this far from one of them there.
_APART = 0.06


def holds(found, exact):
    return found["lower"] <= exact and (found["upper"] is None or exact <= found["upper"])


def both_ways(mesh, shares):
    """Bounds of both directions as close as was asked for."""
    for way, share in shares.items():
        found = mesh[way]
        assert found["result"] == "successful" and 0 < found["lower"] <= found["upper"], way
        assert found["upper"] - found["lower"] <= share * found["upper"], way


def check_ranges(numbers):
    for ways in numbers["surfaces"].values():
        least = ways["bernstein"]["levels"][-1]
        assert all(way["proven"] <= least <= way["levels"][-1] for way in ways.values())
        assert all(way["rate"] > 0 and way["seconds"] > 0 for way in ways.values())


def check_spurious_cells(numbers):
    *counterexamples, empty = numbers["pairs"]
    for pair in counterexamples:
        assert not any(holds(found, pair["exact"]) for found in pair["paper"])
        assert all(holds(found, pair["exact"]) for found in pair["safe"])
    assert {found["result"] for found in empty["paper"]} == {"not_certified"}
    assert {found["result"] for found in empty["safe"]} == {"existence_not_certified"}


def check_algsurf_table(numbers):
    assert all(holds(found, numbers["exact"]) for found in numbers["rules"])
    for found in numbers["rules"]:
        assert found["separable"] < numbers["paper"]["seconds"] / 1000


def check_surface_gallery(numbers):
    for pair in numbers["pairs"]:
        found = pair["solution"]
        assert 0 < found["lower"] <= found["value"] <= found["upper"] <= found["lower"] + 0.1
        assert pair["cubes"]["lower"] <= found["upper"] and found["lower"] <= pair["cubes"]["upper"]


def check_lin03_field(numbers):
    for mesh in numbers["meshes"]:
        assert mesh["closed"] and 0 < mesh["sampled"] <= mesh["proven"]
        assert all(0 < way["lower"] <= way["upper"] < 4 * mesh["atol"] for way in mesh["hausdorff"].values())


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


def check_surface_distances(numbers):
    for pair in numbers["pairs"]:
        found, gap = pair["solution"], pair["share"] * pair["diagonal"]
        assert found["result"] == "successful" and 0 <= found["upper"] - found["lower"] <= gap, pair["name"]
        assert pair["share"] > 1e-6 or pair["samples"]["off"] > 10 * (found["upper"] - found["lower"]), pair["name"]
        if pair["name"] == "torus, wider torus":
            assert found["lower"] <= 0.05 <= found["upper"]


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


def check_certificates(numbers):
    assert all(len(mix["certificates"]) + len(mix["refused"]) == numbers["pairs"] for mix in numbers["mixes"])
    for mix in numbers["mixes"]:
        name = (*mix["kinds"], mix["distance"])
        assert mix["refused"] == [], name
        for found in mix["certificates"]:
            kind = found["claim"]["kind"]
            least, most = found["bounds"]["a_to_b" if kind == "directed" else kind]
            assert least - _APART < found["samples"] < most + _APART, name
            assert found["proven"] and found["verify"] < 60, name
            assert found["accepted"] == found["escaped"] == [] and found["by program"] == 1, name
            assert sum(found["forgeries"].values()) == numbers["forgeries"], name
