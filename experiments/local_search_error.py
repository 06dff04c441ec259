"""How often, and by how much, is the published local search for the nearest triangle of a mesh wrong?

The search visits the triangles around the vertices in the nearest voxels. Points are spread evenly in the box of each
mesh, and the distances found are compared with the exact ones of `project`. There are smooth meshes with triangles of
one size, and parts as CAD software writes them, with large triangles on flat sides and narrow ones on round edges. The
grids have 64, 128 and 256 voxels along each side of the cube around a mesh; the published grid has as many as it needs
to give each vertex its own voxel. Signs, by the published average of normals, are compared with winding numbers. With
--meshes FILE ... other meshes are measured. Errors are fractions of the diagonal of the box.

Claims: with one vertex a voxel 15 to 30 % of the distances are too large on smooth meshes, by at most 0.3 % of the
diagonal, and 11 to 32 % on parts, by up to 3 to 14 %, on a coarser grid by up to 26 %. Finer grids hardly reduce the
large errors of the plate and the profile. Very few signs are wrong.

Feeds: figure "error of the local search" and its table.
Takes: 3 minutes.
"""

import time
from collections.abc import Sequence
from typing import Any

import common_meshes
import numpy as np
from common import Run, markdown

import jhd

VOXELS, SMOKE_VOXELS = (64, 128, 256), (16,)
QUERIES, SMOKE_QUERIES = 200_000, 2_000
# Sides of the round edge of the profile: its vertices need a grid of 256 voxels; in a smoke run, of 64.
EDGE, SMOKE_EDGE = 8, 2
# Errors below this fraction of the diagonal are rounding errors.
ROUNDING = 1e-12
# Error levels; for each of them the fraction of points with larger errors is kept.
LEVELS = np.logspace(-6, 0, 121)
SMOOTH, PART, FILE = "smooth", "part", "file"
# The picture shows a section half way along the profile, whose vertices are at its two ends.
LENGTH, MARGIN = 4.0, 0.1


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True, meshes=True)
    given = [(file.stem, FILE, common_meshes.load(file)) for file in run.meshes]
    # In a smoke run, a smooth mesh and a part are enough.
    edge = SMOKE_EDGE if run.smoke else EDGE
    meshes = given or (_generated(8, edge)[::3] if run.smoke else _generated(64, edge))
    found = [{"name": name, "kind": kind, **_measured(mesh, run)} for name, kind, mesh in meshes]
    numbers = {"levels": LEVELS, "meshes": found, "section": _section(_profile(edge), 24 if run.smoke else 240)}
    run.save(numbers, _table(found))


def _generated(n: int, edge: int) -> list[tuple[str, str, jhd.TriangleMesh]]:
    return [
        ("bumpy sphere", SMOOTH, common_meshes.bumpy_sphere(n)),
        ("torus", SMOOTH, common_meshes.torus(5 * n // 2, n)),
        ("plate with holes", PART, common_meshes.plate(4, 3, 8)),
        ("L-profile", PART, _profile(edge)),
        ("chamfered box", PART, common_meshes.rounded_box((2, 1.4, 1), 0.02, 1)),
    ]


def _profile(edge: int) -> jhd.TriangleMesh:
    return common_meshes.profile(LENGTH, (1, 0.7), 0.12, 0.1, edge)


def _measured(mesh: jhd.TriangleMesh, run: Run) -> dict[str, Any]:
    lower, upper = (np.asarray(end) for end in mesh.bounds)
    points = run.random.uniform(lower, upper, (SMOKE_QUERIES if run.smoke else QUERIES, 3))
    diagonal = float(np.linalg.norm(upper - lower))
    exact, seconds = _timed(mesh, points, None)
    inside = np.asarray(jhd.signed_distance(points, mesh)) < 0 if mesh.is_closed and mesh.is_manifold else None
    least = _least(mesh)
    ways = []
    steps = set(SMOKE_VOXELS if run.smoke else VOXELS) | ({least} if least else set())
    for voxels in sorted(steps):
        method = jhd.published.VertexVoxels(voxels)
        found, local_seconds = _timed(mesh, points, method)
        way = {"voxels": voxels, "published": voxels == least, "seconds": local_seconds}
        way |= _errors((found - exact) / diagonal)
        if inside is not None:
            signed = np.asarray(jhd.signed_distance(points, mesh, method=method))
            way["wrong_signs"] = float(np.mean((signed < 0) != inside))
        ways.append(way)
    sizes = {"triangles": mesh.count, "queries": len(points), "diagonal": diagonal}
    return {**sizes, "exact_seconds": seconds, "ways": ways}


def _least(mesh: jhd.TriangleMesh) -> int | None:
    """Return the voxels along each side that leave each vertex its own; None if the memory does not suffice."""
    try:
        return jhd.published.VertexVoxels().voxels(mesh)
    except ValueError:
        return None


def _timed(
    mesh: jhd.TriangleMesh, points: np.ndarray, method: jhd.published.VertexVoxels | None
) -> tuple[np.ndarray, float]:
    """Return distances, and the seconds that they take once the mesh is prepared."""
    jhd.project(points, mesh, method)
    start = time.perf_counter()
    distance = np.asarray(jhd.project(points, mesh, method).distance)
    return distance, time.perf_counter() - start


def _errors(error: np.ndarray) -> dict[str, Any]:
    """Return the fraction of wrong distances, and the distribution of their errors."""
    wrong = error[error > ROUNDING]
    ordered = np.sort(error)
    return {
        "wrong": len(wrong) / len(error),
        "median": float(np.median(wrong)) if len(wrong) else 0.0,
        "largest": float(error.max()),
        "smallest": float(error.min()),
        "above": 1 - np.searchsorted(ordered, LEVELS, side="right") / len(error),
    }


def _section(mesh: jhd.TriangleMesh, cells: int) -> dict[str, Any]:
    """Return errors of the published grid in a section across the middle of a profile, and its outline there."""
    lower, upper = (np.asarray(end) for end in mesh.bounds)
    low, high = lower[:2] - MARGIN, upper[:2] + MARGIN
    x, y = (np.linspace(low[k], high[k], cells) for k in (0, 1))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((cells, cells), LENGTH / 2)], axis=-1)
    exact, found = (np.asarray(jhd.project(points, mesh, m).distance) for m in (None, jhd.published.VertexVoxels()))
    outline = np.asarray(mesh.vertices)[np.asarray(mesh.vertices)[:, 2] == 0, :2]
    diagonal = float(np.linalg.norm(upper - lower))
    return {"x": x, "y": y, "error": (found - exact) / diagonal, "outline": outline}


def _table(meshes: Sequence[dict[str, Any]]) -> str:
    header = ["mesh", "triangles", "voxels a side", "one vertex each", "too large, %", "median error, %"]
    header += ["largest error, %", "wrong signs, %", "local, s", "exact, s"]
    rows = []
    for mesh in meshes:
        for way in mesh["ways"]:
            shares = [f"{100 * way['wrong']:.1f}", f"{100 * way['median']:.3f}", f"{100 * way['largest']:.2f}"]
            signs = f"{100 * way['wrong_signs']:.3f}" if "wrong_signs" in way else ""
            times = [f"{way['seconds']:.2f}", f"{mesh['exact_seconds']:.2f}"]
            published = "yes" if way["published"] else ""
            rows.append([mesh["name"], mesh["triangles"], way["voxels"], published, *shares, signs, *times])
    return markdown(header, rows)


if __name__ == "__main__":
    main()
