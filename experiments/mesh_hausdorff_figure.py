"""Where are two meshes of one surface farthest from each other, and how fast is that certified?

A fine mesh of a surface with bumps, and a coarse one with vertices on this surface; or two files, if --meshes A B or
--a A --b B are passed. Both directed Hausdorff distances, with the bounds after each round of the search. For the
picture: distances of points all over each mesh to the other mesh, and a section of both through the farthest point and
its feet.

Claims: both distances are certified to 1e-9 of their size within 20 rounds; a farthest point has one foot in a
triangle, or several equally far feet, and no sampled point is farther than the upper bound.

Feeds: figure "Hausdorff distance of two meshes".
Takes: 1 minute.
"""

import time
from typing import Any

import common_meshes
import numpy as np
from common import Run, markdown, plain

import jhd

# Number of points on each mesh with a computed color.
PLACES, SMOKE_PLACES = 40_000, 2_000
# Half the width of the section, as a multiple of the distance.
WINDOW = 4.0
DIRECTIONS = ("a_to_b", "b_to_a")


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True, meshes=True, pair=jhd.TriangleMesh)
    if run.shapes or run.meshes:
        a, b = run.shapes or (common_meshes.load(file) for file in run.meshes[:2])
    else:
        a, b = (common_meshes.bumpy_sphere(n) for n in ((16, 5) if run.smoke else (64, 8)))
    places = SMOKE_PLACES if run.smoke else PLACES
    found = {"a_to_b": _directed(a, b), "b_to_a": _directed(b, a)}
    best = max(DIRECTIONS, key=lambda name: found[name]["solution"].value)
    numbers = {
        "a": {"vertices": a.vertices, "triangles": a.triangles, **_colored(a, b, places)},
        "b": {"vertices": b.vertices, "triangles": b.triangles, **_colored(b, a, places)},
        "directions": found,
        "larger": best,
        "section": _section(a, b, found[best]["solution"].witness),
    }
    run.save(numbers, _table(a, b, numbers))


def _directed(a: jhd.TriangleMesh, b: jhd.TriangleMesh) -> dict[str, Any]:
    """Return the directed distance of a warm call, and the bounds after each round with the seconds since its start."""
    jhd.directed_hausdorff(a, b)
    rounds: list[dict[str, Any]] = []
    start = time.perf_counter()

    def report(progress: jhd.progress.Progress) -> None:
        kept = {"steps": progress.done, "waiting": (progress.total or 0) - progress.done}
        kept |= {"lower": progress.lower, "upper": progress.upper}
        rounds.append({**kept, "seconds": time.perf_counter() - start})

    solution = jhd.directed_hausdorff(a, b, progress=report)
    return {"solution": solution, "seconds": time.perf_counter() - start, "rounds": rounds}


def _colored(mesh: jhd.TriangleMesh, other: jhd.TriangleMesh, places: int) -> dict[str, Any]:
    """Cut the triangles into k^2 parts, about `places` in total; return them with the distances of their middles."""
    k = max(1, round((places / mesh.count) ** 0.5))
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i in range(k) for j in range(k - i)]
    down = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(k) for j in range(k - 1 - i)]
    share = np.array(up + down) / k
    weights = np.concatenate([1 - share.sum(axis=2, keepdims=True), share], axis=2)
    middles = np.einsum("pk,tkd->tpd", weights.mean(axis=1), np.asarray(mesh.corners))
    distance = np.asarray(jhd.project(middles.reshape(-1, 3), other).distance)
    return {"weights": weights, "distance": distance.reshape(mesh.count, len(weights))}


def _section(a: jhd.TriangleMesh, b: jhd.TriangleMesh, witness: jhd.Witness) -> dict[str, Any]:
    """Return the lines in which a plane through the farthest point and its feet cuts both meshes, near this point.

    The second axis points from the first foot to the point.
    """
    point, feet = np.asarray(witness.point), np.asarray(witness.feet)
    away = point - feet[0]
    distance = float(np.linalg.norm(away))
    away = away / distance
    # Towards the foot farthest from the line; if there is only one foot, any direction will do.
    sides = np.concatenate([feet - feet[0], distance * 1e-6 * np.eye(3)])
    sides = sides - np.outer(sides @ away, away)
    along = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    axes = np.stack([along / np.linalg.norm(along), away])
    lines = {name: _cut(mesh, point, axes, WINDOW * distance) for name, mesh in (("a", a), ("b", b))}
    used = np.asarray(witness.multipliers) > 0
    return {**lines, "feet": (feet[used] - point) @ axes.T, "distance": distance, "width": WINDOW * distance}


def _cut(mesh: jhd.TriangleMesh, point: np.ndarray, axes: np.ndarray, width: float) -> np.ndarray:
    """Return the ends of the segments in which a plane cuts the triangles near a point, (segments, 2, 2)."""
    offsets = np.asarray(mesh.corners) - point
    height = offsets @ np.cross(axes[0], axes[1])
    place = offsets @ axes.T
    rows = np.flatnonzero((height.min(axis=1) < 0) & (height.max(axis=1) > 0))
    after = [1, 2, 0]
    h, g = height[rows], height[rows][:, after]
    crossed = (h < 0) != (g < 0)
    share = np.where(crossed, h / np.where(crossed, h - g, 1.0), 0.0)[..., None]
    ends = (1 - share) * place[rows] + share * place[rows][:, after]
    segments = ends[crossed].reshape(-1, 2, 2)
    return segments[np.any(np.all(np.abs(segments) <= 2 * width, axis=2), axis=1)]


def _table(a: jhd.TriangleMesh, b: jhd.TriangleMesh, numbers: dict[str, Any]) -> str:
    header = ["direction", "triangles", "lower", "upper", "farthest place colored", "event", "rounds", "seconds"]
    rows = []
    for name, counts in zip(DIRECTIONS, ((a.count, b.count), (b.count, a.count)), strict=True):
        entry, farthest = numbers["directions"][name], float(numbers[name[0]]["distance"].max())
        solution = plain(entry["solution"])
        bounds = [f"{solution[end]:.12f}" for end in ("lower", "upper")]
        event, steps = solution["witness"]["event"].replace("_", " "), solution["stats"]["steps"]
        sizes = " to ".join(map(str, counts))
        rows.append([name, sizes, *bounds, f"{farthest:.6f}", event, steps, f"{entry['seconds']:.2f}"])
    return markdown(header, rows)


if __name__ == "__main__":
    main()
