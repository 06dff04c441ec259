"""How fast does a mesh of 67 000 triangles become an adaptive distance field, and how near is the mesh made from it?

Two closed meshes, of about as many triangles as those of the paper (67 036 and 47 858): a bumpy sphere and a knotted
tube. With --meshes FILE, the mesh of a file replaces the first one. Each becomes a field with a tolerance of 1e-3 of
its longest side, refined in the band about the surface. The first call is timed in a process of its own, compilation
included, and later ones here. A million points are looked up, and the largest error is sampled and certified. Marching
cubes turn the field into a mesh again, and its Hausdorff distances from and to the original mesh are bounded. The first
mesh also gets a field of ten times the tolerance that is refined everywhere, as published. Stored are a slice of each
field with its cells, and a view of the extracted surface with the distance of each visible point to the mesh.

The paper prints 52 s and 41 s for its two meshes, on a 933 MHz Pentium III and without a tolerance. These times show
only the order of magnitude of their day.

Claims: on the generated meshes less than 15 s with compilation; the largest error is certified to be below twice the
tolerance; the extracted surface is within twice the tolerance of the mesh, both ways. If the mesh of a file has gaps or
sheets thinner than the tolerance, these may be closed or lost, and then the mesh is farther from the surface.

Feeds: figure "adaptive field of a mesh" and the table of times.
Takes: 5 minutes.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import common_meshes
import jax
import numpy as np
from common import Run, markdown, seconds

import jhd

# The tolerances of both modes, and of the Hausdorff distances, as fractions of the longest side.
BAND, FULL, HAUSDORFF = 1e-3, 1e-2, 1e-4
# Triangles and seconds printed in the paper, and vertices.
PRINTED = ((67_036, 52.0), (47_858, 41.0))
PRINTED_VERTICES = (33_519, 23_931)
# Cells along the box for the extracted mesh, pixels of a slice and of a view.
RESOLUTION, SLICE, VIEW = 384, 240, 260
# A triangle of the mesh itself is drawn by the middles of about half as many parts as SHARES squared.
SHARES = 8
# Eye direction of the view, and its upward direction.
EYE, UP = np.array([0.45, 0.35, 1.0]), np.array([0.0, 1.0, 0.0])
_FIRST_CALL = """
import sys, time, numpy, jhd
with numpy.load(sys.argv[1]) as stored:
    mesh = jhd.TriangleMesh(stored["V"], stored["F"])
start = time.perf_counter()
jhd.AdaptiveDistanceField.build(mesh, float(sys.argv[2])).values.block_until_ready()
print(time.perf_counter() - start)
"""


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, meshes=True)
    n = 6 if run.smoke else 75
    given = [(run.meshes[0].stem, common_meshes.load(run.meshes[0]))] if run.meshes else []
    first = given or [("bumpy sphere", common_meshes.bumpy_sphere(n))]
    second = ("knotted tube", knot(40, 6) if run.smoke else knot(600, 40))
    meshes = [*first, second]
    found = [_measured(name, mesh, run, full=not k) for k, (name, mesh) in enumerate(meshes)]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    numbers = {"meshes": found, "printed": PRINTED, "printed_vertices": PRINTED_VERTICES, "peak_gigabytes": peak}
    run.save(numbers, _table(found) + f"\n\nPeak memory {peak:.1f} GB.")


def knot(rows: int, columns: int) -> jhd.TriangleMesh:
    """Return a closed tube about a trefoil knot, of 2 rows columns triangles."""
    u = np.linspace(0, 2 * np.pi, rows, endpoint=False)[:, None]
    v = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None, :, None]

    def curve(u: np.ndarray) -> np.ndarray:
        reach = 2 + np.cos(3 * u)
        return np.concatenate([reach * np.cos(2 * u), reach * np.sin(2 * u), 1.5 * np.sin(3 * u)], axis=1) / 7

    along = curve(u + 1e-4) - curve(u - 1e-4)
    side = np.cross(along, [0.0, 0.0, 1.0])
    up = np.cross(side, along)
    side, up = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (side, up))
    points = curve(u)[:, None] + 0.06 * (np.cos(v) * side[:, None] + np.sin(v) * up[:, None])
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + j, (i + 1) % rows * columns + (j + 1) % columns
    mesh = jhd.TriangleMesh(points.reshape(-1, 3), np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3))
    return mesh if float(mesh.volume) > 0 else jhd.TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1])


def _measured(name: str, mesh: jhd.TriangleMesh, run: Run, full: bool) -> dict[str, Any]:
    lower, upper = (np.asarray(end) for end in mesh.bounds)
    size = float(np.max(upper - lower))
    atol = (20 if run.smoke else 1) * BAND * size
    resolution = 24 if run.smoke else RESOLUTION
    field = jhd.AdaptiveDistanceField.build(mesh, atol)
    extracted = field.to_mesh(resolution)
    points = run.random.uniform(field.lower, field.upper, (1_000 if run.smoke else 1_000_000, 3))
    sampled = field.sampled_error(mesh, 1_000 if run.smoke else 100_000, run.seed)
    certified = field.proven_error(mesh, max_boxes=10_000 if run.smoke else 400_000)
    method = jhd.BranchAndBound(atol=(100 if run.smoke else 1) * HAUSDORFF * size)
    ways = {
        "from": jhd.directed_hausdorff(extracted, mesh, method),
        "to": jhd.directed_hausdorff(mesh, extracted, method),
    }
    return {
        "name": name,
        "triangles": mesh.count,
        "vertices": len(mesh.vertices),
        "size": size,
        "atol": atol,
        "first_call": _first_call(mesh, atol) if full or not run.smoke else np.nan,
        "build": seconds(lambda: jhd.AdaptiveDistanceField.build(mesh, atol).values, 0 if run.smoke else 3),
        "leaves": field.leaves,
        "depth": field.depth,
        "unresolved": field.unresolved,
        "queries_per_second": len(points) / seconds(lambda: field(points), 0 if run.smoke else 3),
        "sampled": sampled,
        "certified": certified,
        "extract": seconds(lambda: field.to_mesh(resolution).vertices, 0 if run.smoke else 1),
        "extracted_triangles": extracted.count,
        "closed": extracted.is_closed,
        "hausdorff": {key: {"lower": x.lower, "upper": x.upper} for key, x in ways.items()},
        "full": _full(mesh, (10 if run.smoke else 1) * FULL * size, run.smoke) if full else None,
        "slice": _slice(field, 40 if run.smoke else SLICE),
        "view": _view(extracted, mesh, 40 if run.smoke else VIEW),
        "input": _lit(mesh, 40 if run.smoke else VIEW),
    }


def _first_call(mesh: jhd.TriangleMesh, atol: float) -> float:
    """Return the seconds of the first field that a process builds, without cached compiled functions."""
    environment = {key: value for key, value in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
    environment["JHD_CACHE"] = "0"
    root = str(Path(__file__).resolve().parent.parent)
    environment["PYTHONPATH"] = os.pathsep.join([root, environment.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.npz"
        np.savez(file, V=np.asarray(mesh.vertices), F=np.asarray(mesh.triangles))
        command = [sys.executable, "-c", _FIRST_CALL, str(file), repr(atol)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def _full(mesh: jhd.TriangleMesh, atol: float, smoke: bool) -> dict[str, Any]:
    """Build a field in the published mode, which refines everywhere."""
    field = jhd.AdaptiveDistanceField.build(mesh, atol, "full")
    time = seconds(lambda: jhd.AdaptiveDistanceField.build(mesh, atol, "full").values, 0 if smoke else 1)
    return {"atol": atol, "build": time, "leaves": field.leaves, "sampled": field.sampled_error(mesh, 20_000)}


def _slice(field: jhd.AdaptiveDistanceField, pixels: int) -> dict[str, Any]:
    """Return the field in the middle plane of the third axis, and the leaves that it cuts: lower corners and sides."""
    lower, upper, spacing = (np.asarray(x) for x in (field.lower, field.upper, field.spacing))
    # A little off the middle, which contains faces of leaves.
    height = 0.5 * (lower[2] + upper[2]) + 0.3 * float(spacing)
    steps = [np.linspace(a, b, pixels) for a, b in zip(lower[:2], upper[:2], strict=True)]
    x, y = np.meshgrid(*steps, indexing="ij")
    values = np.asarray(field(np.stack([x, y, np.full_like(x, height)], axis=-1)))
    corners, sides = lower + spacing * np.asarray(field.leaf_corners), spacing * np.asarray(field.widths)
    cut = (corners[:, 2] <= height) & (height < corners[:, 2] + sides)
    return {
        "lower": lower[:2],
        "upper": upper[:2],
        "values": np.round(values, 5),
        "cells": np.column_stack([corners[cut, :2], sides[cut]]),
    }


def _view(extracted: jhd.TriangleMesh, mesh: jhd.TriangleMesh, pixels: int) -> dict[str, Any]:
    """Return a parallel view: for each pixel on the surface, its distance to the mesh, and how it faces the eye."""
    places, light, side = _seen(extracted, pixels, 1)
    visible = np.isfinite(light)
    distance = np.full(light.shape, np.nan)
    distance[visible] = np.asarray(jhd.project(places[visible], mesh).distance)
    return {"error": _rows(distance), "light": _rows(light), "side": side}


def _lit(mesh: jhd.TriangleMesh, pixels: int) -> dict[str, Any]:
    """Return a view of a mesh from this direction, without distances."""
    _, light, side = _seen(mesh, pixels, SHARES)
    return {"light": _rows(light), "side": side}


def _seen(mesh: jhd.TriangleMesh, pixels: int, shares: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return for each pixel the nearest point of a mesh, how it faces the eye, and the side of the view.

    Triangles are drawn by the middles of about `shares` squared / 2 parts; large triangles need several parts.
    """
    eye = EYE / np.linalg.norm(EYE)
    right = np.cross(UP, eye)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(eye, right), eye], axis=1)
    normals = np.asarray(mesh.normals)
    facing = np.flatnonzero(normals @ eye > 0)
    i, j = np.nonzero(np.add.outer(np.arange(shares), np.arange(shares)) < shares)
    inner = (np.stack([i, j], axis=1) + 1 / 3) / shares
    corners = np.asarray(mesh.corners)[facing]
    points = (corners[:, None, 0] + inner @ (corners[:, 1:] - corners[:, :1])).reshape(-1, 3)
    facing = np.repeat(facing, len(inner))
    # The nearest one is written last.
    order = np.argsort(points @ eye, kind="stable")
    points, facing = points[order], facing[order]
    seen = (points @ axes)[:, :2]
    low, side = seen.min(axis=0), float(np.max(np.ptp(seen, axis=0)) * 1.001)
    column, row = ((seen - low) / side * pixels).astype(int).T
    places, light = np.full((pixels, pixels, 3), np.nan), np.full((pixels, pixels), np.nan)
    places[row, column], light[row, column] = points, (normals @ eye)[facing]
    return places, light, side


def _rows(image: np.ndarray) -> list[list[float | None]]:
    """Round an image to three digits, for drawing."""
    return [[None if np.isnan(x) else float(f"{x:.3g}") for x in row] for row in image]


def _table(found: list[dict[str, Any]]) -> str:
    header = [
        "mesh",
        "triangles",
        "vertices",
        "printed for (triangles, vertices: s)",
        "first call, s",
        "build, s",
        "leaves",
        "depth",
        "queries, M/s",
    ]
    header += [
        "sampled error / atol",
        "certified / atol",
        "mesh again, s",
        "triangles",
        "mesh again -> mesh / size",
        "back / size",
    ]
    rows = []
    for case, (count, time), vertices in zip(found, PRINTED, PRINTED_VERTICES, strict=True):
        ways = [f"{float(case['hausdorff'][key]['upper']) / case['size']:.2e}" for key in ("from", "to")]
        numbers = [f"{case['first_call']:.1f}", f"{case['build']:.1f}", case["leaves"], case["depth"]]
        errors = [f"{case[key] / case['atol']:.2f}" for key in ("sampled", "certified")]
        rate = f"{case['queries_per_second'] / 1e6:.1f}"
        again = [f"{case['extract']:.1f}", case["extracted_triangles"]]
        size = [case["triangles"], case["vertices"], f"{count}, {vertices}: {time:g}"]
        rows.append([case["name"], *size, *numbers, rate, *errors, *again, *ways])
    text = markdown(header, rows)
    full = found[0]["full"]
    said = f"{found[0]['name']}, refined everywhere, tolerance {full['atol'] / found[0]['size']:.0e} of its size"
    return f"{text}\n\n{said}: {full['leaves']} leaves, {full['build']:.1f} s. Backend {jax.default_backend()}."


if __name__ == "__main__":
    main()
