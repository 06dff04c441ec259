"""How fast are nearest points and Hausdorff distances of meshes, compared with other libraries and sampling?

Two meshes of one surface, of about 70 000 and 3000 triangles; with --meshes A B, two files instead.

(1) Nearest points on the finer mesh for points spread evenly in its box and for points near the surface: seconds to
prepare, queries per second, and the difference of distances from ours. The peers are libigl, point-cloud-utils, Open3D
and trimesh, if they are installed. (2) Hausdorff distances: our certified one; libigl's function, which uses vertices
alone; and samples, spread evenly on both meshes, either against each other (SciPy's k-d tree, point-cloud-utils) or
against the other mesh itself, which gives a true lower bound. All run in one process, on one core; times are the least
of several.

Claims: for points spread evenly ours is the fastest search, one to four times as fast as libigl's; near the surface
both are as fast to a factor of 1.5. trimesh takes more than five times as long. The certified distance takes less than
half the time of a million samples. These are off by more than 1 %, too large against each other and too small against
meshes. libigl's function takes less time and is too small by more than 1 %.

Feeds: figure "mesh distances compared with other libraries" and both tables.
Takes: 3 minutes, with libigl, point-cloud-utils and trimesh (and rtree) installed.
"""

import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from typing import Any

import common_meshes
import numpy as np
from common import Run, markdown
from scipy.spatial import KDTree

import jhd

Queries = Callable[[np.ndarray], np.ndarray]
OURS = "jhd"
QUERIES, SMOKE_QUERIES = 100_000, 1_000
# Points near the surface are moved off it by this fraction of the diagonal, on average.
NEAR = 1e-3
SAMPLES, SMOKE_SAMPLES = (10_000, 100_000, 1_000_000), (1_000,)
REPEATS = 3


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True, meshes=True)
    if run.meshes:
        a, b = (common_meshes.load(file) for file in run.meshes[:2])
    else:
        a, b = (common_meshes.bumpy_sphere(n) for n in ((10, 5) if run.smoke else (76, 16)))
    queries = _queries(a, run)
    hausdorff = _hausdorff(a, b, run)
    numbers = {
        "triangles": [a.count, b.count],
        "queries": queries,
        "hausdorff": hausdorff,
        "peers": {peer["name"]: peer["version"] for peer in queries if peer["name"] != OURS},
    }
    run.save(numbers, _table_of_queries(queries) + "\n\n" + _table_of_distances(hausdorff))


# ---- nearest points --------------------------------------------------------------------------------


def _ours(vertices: np.ndarray, triangles: np.ndarray) -> Queries:
    # The cache of trees is keyed by the numbers of a mesh; an extra vertex without triangles makes the mesh a new one.
    other = np.concatenate([vertices, np.random.default_rng().random((1, 3))])
    mesh = jhd.TriangleMesh(other, triangles)
    return lambda points: np.asarray(jhd.project(points, mesh).distance)


def _libigl(vertices: np.ndarray, triangles: np.ndarray) -> Queries:
    tree = import_module("igl").AABB()
    tree.init(vertices, triangles)
    return lambda points: np.sqrt(tree.squared_distance(vertices, triangles, points)[0])


def _point_cloud_utils(vertices: np.ndarray, triangles: np.ndarray) -> Queries:
    # point-cloud-utils prepares the mesh anew in every call.
    closest = import_module("point_cloud_utils").closest_points_on_mesh
    return lambda points: closest(points, vertices, triangles)[0]


def _open3d(vertices: np.ndarray, triangles: np.ndarray) -> Queries:
    open3d = import_module("open3d")
    single = open3d.core.Dtype.Float32
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        open3d.core.Tensor(vertices, single), open3d.core.Tensor(triangles.astype(np.uint32), open3d.core.Dtype.UInt32)
    )
    return lambda points: scene.compute_distance(open3d.core.Tensor(points, single), nthreads=1).numpy()


def _trimesh(vertices: np.ndarray, triangles: np.ndarray) -> Queries:
    trimesh = import_module("trimesh")
    import_module("rtree")
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    return lambda points: trimesh.proximity.closest_point(mesh, points)[1]


# Distributions, and for slow libraries the fraction of the points that they get.
_PEERS: dict[str, tuple[Callable[[np.ndarray, np.ndarray], Queries], str, float]] = {
    OURS: (_ours, "jhd", 1),
    "libigl": (_libigl, "libigl", 1),
    "point-cloud-utils": (_point_cloud_utils, "point-cloud-utils", 1),
    "Open3D": (_open3d, "open3d", 1),
    "trimesh": (_trimesh, "trimesh", 0.02),
}


def _queries(mesh: jhd.TriangleMesh, run: Run) -> list[dict[str, Any]]:
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    lower, upper = (np.asarray(end) for end in mesh.bounds)
    count, diagonal = SMOKE_QUERIES if run.smoke else QUERIES, float(np.linalg.norm(upper - lower))
    even = run.random.uniform(lower, upper, (count, 3))
    near = _spread(mesh, count, run.random) + NEAR * diagonal * run.random.normal(size=(count, 3))
    exact = [np.asarray(jhd.project(points, mesh).distance) for points in (even, near)]
    found = []
    for name, (prepare, package, share) in _PEERS.items():
        try:
            prepare(vertices, triangles)
        except ImportError:
            continue
        asked = [points[: max(10, int(share * count))] for points in (even, near)]
        found.append({"name": name, "version": version(package), **_rates(prepare, vertices, triangles, asked)})
        distances = [prepare(vertices, triangles)(points) for points in asked]
        errors = [float(np.max(np.abs(d - e[: len(d)]))) for d, e in zip(distances, exact, strict=True)]
        found[-1]["error"] = max(errors) / diagonal
    ours = found[0]
    for peer in found:
        peer["ratios"] = [mine / theirs for mine, theirs in zip(ours["rates"], peer["rates"], strict=True)]
    return found


def _rates(prepare: Callable[..., Queries], vertices: np.ndarray, triangles: np.ndarray, asked: Any) -> dict[str, Any]:
    """Return the seconds to prepare a mesh and answer for one point, and queries a second beyond that."""
    first, rates = np.inf, [0.0] * len(asked)
    for _ in range(REPEATS):
        start = time.perf_counter()
        query = prepare(vertices, triangles)
        query(asked[0][:1])
        first = min(first, time.perf_counter() - start)
        for k, points in enumerate(asked):
            again, many = _least(lambda q=query, p=points: q(p[:1]), 2), _least(lambda q=query, p=points: q(p), 2)
            rates[k] = max(rates[k], len(points) / max(many - again, many / 10))
    return {"prepare": first, "rates": rates}


def _least(call: Callable[[], object], repeats: int) -> float:
    """Return the least of several wall times."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def _spread(mesh: jhd.TriangleMesh, count: int, random: np.random.Generator) -> np.ndarray:
    """Return points spread evenly on a mesh."""
    corners = np.asarray(mesh.corners)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[random.choice(len(corners), count, p=area / area.sum())]
    return np.einsum("nk,nkd->nd", random.dirichlet(np.ones(3), count), chosen)


# ---- Hausdorff distances ---------------------------------------------------------------------------


def _hausdorff(a: jhd.TriangleMesh, b: jhd.TriangleMesh, run: Run) -> list[dict[str, Any]]:
    """Return each way's distance with its seconds; ours first."""
    solution = jhd.hausdorff(a, b)
    value, seconds = float(solution.value), _least(lambda: jhd.hausdorff(a, b), REPEATS)
    first = {"name": "jhd, certified", "value": value, "seconds": seconds}
    found = [first | {"lower": float(solution.lower), "upper": float(solution.upper)}]
    for name, call in _vertex_ways(a, b):
        try:
            found.append({"name": name, "value": float(call()), "seconds": _least(call, 2)})
        except ImportError:
            continue
    for count in SMOKE_SAMPLES if run.smoke else SAMPLES:
        found += _sampled(a, b, count, run.random)
    for way in found:
        way["error"] = way["value"] / value - 1
        way["ratio"] = way["seconds"] / seconds
    return found


def _vertex_ways(a: jhd.TriangleMesh, b: jhd.TriangleMesh) -> list[tuple[str, Callable[[], float]]]:
    arrays = [np.asarray(x) for mesh in (a, b) for x in (mesh.vertices, mesh.triangles)]
    return [("libigl, vertices", lambda: import_module("igl").hausdorff(*arrays))]


def _sampled(a: jhd.TriangleMesh, b: jhd.TriangleMesh, count: int, random: np.random.Generator) -> list[dict[str, Any]]:
    """Estimate distances by `count` samples on each mesh; from samples to a mesh they are true lower bounds."""
    start = time.perf_counter()
    p, q = (_spread(mesh, count, random) for mesh in (a, b))
    spreading = time.perf_counter() - start

    def to_samples() -> float:
        return max(float(KDTree(y).query(x)[0].max()) for x, y in ((p, q), (q, p)))

    def to_meshes() -> float:
        return max(float(np.max(jhd.project(x, mesh).distance)) for x, mesh in ((p, b), (q, a)))

    def to_samples_too() -> float:
        return float(import_module("point_cloud_utils").hausdorff_distance(p, q))

    ways = {"samples, SciPy": to_samples, "samples, point-cloud-utils": to_samples_too, "samples to meshes": to_meshes}
    found = []
    for name, call in ways.items():
        repeats = 1 if count > 100_000 else 2
        times: list[float] = []
        value = 0.0
        try:
            for _ in range(repeats):
                start = time.perf_counter()
                value = call()
                times.append(time.perf_counter() - start)
        except ImportError:
            continue
        found.append({"name": name, "samples": count, "value": value, "seconds": spreading + min(times)})
    return found


# ---- tables ----------------------------------------------------------------------------------------


def _table_of_queries(queries: list[dict[str, Any]]) -> str:
    header = ["library", "version", "to prepare, s", "even, queries/s", "near, queries/s", "jhd / it, even"]
    header += ["jhd / it, near", "largest difference / diagonal"]
    rows = []
    for peer in queries:
        rates = [f"{rate:,.0f}".replace(",", " ") for rate in peer["rates"]]
        ratios = [f"{ratio:.2f}" for ratio in peer["ratios"]]
        rows.append([peer["name"], peer["version"], f"{peer['prepare']:.3f}", *rates, *ratios, f"{peer['error']:.1e}"])
    return markdown(header, rows)


def _table_of_distances(found: list[dict[str, Any]]) -> str:
    header = ["Hausdorff distance by", "samples on each", "value", "above the certified one, %", "seconds", "it / jhd"]
    rows = []
    for way in found:
        numbers = [f"{way['value']:.9f}", f"{100 * way['error']:+.3f}", f"{way['seconds']:.2f}", f"{way['ratio']:.1f}"]
        rows.append([way["name"], way.get("samples", ""), *numbers])
    bounds = f"Certified: {found[0]['lower']:.12f} to {found[0]['upper']:.12f}."
    return markdown(header, rows) + "\n\n" + bounds


if __name__ == "__main__":
    main()
