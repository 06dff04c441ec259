"""The first answers of a process, in CPU seconds; in a second process every executable is read from disk."""

import sys
import time

import numpy as np

import jhd
from jhd._runtime import programs, storage


def main() -> None:
    """Print the CPU seconds of each answer; fail if a second process compiles what the first one kept."""
    folder = storage.programs_folder()
    assert folder is not None
    before = storage.contents(folder).files
    t = np.linspace(0.0, 1.0, 4)
    points = np.stack([t, t * (1 - t)], axis=1)
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    box = [-2.0] * 3, [2.0] * 3
    calls = {
        "curves": lambda: jhd.hausdorff(jhd.BezierCurve(points), jhd.BezierCurve(points + 0.3)),
        "rational": lambda: jhd.hausdorff(jhd.BezierCurve(points, 1 + t), jhd.BezierCurve(points + 0.3, 1 + t)),
        "cones": lambda: jhd.hausdorff(
            jhd.ImplicitSurface.parse("x**2/4 + y**2/4 - z**2/9", *box),
            jhd.ImplicitSurface.parse("x**2/16 + y**2/4 - z**2/9", *box),
        ),
        "meshes": lambda: jhd.hausdorff(
            jhd.TriangleMesh(corners, triangles), jhd.TriangleMesh(corners + 0.5, triangles)
        ),
        "fit": lambda: jhd.fit_curve(jhd.polyline(points), degree=3),
    }
    for name, call in calls.items():
        start = time.process_time()
        call()
        print(f"  {name:<9} {time.process_time() - start:6.2f} CPU s", flush=True)
    made = storage.contents(folder).files - before
    print(f"  {made} executables were compiled and kept")
    if (made > 0) != (sys.argv[1:] == ["first"]):
        raise SystemExit("the first process must keep its executables, and the second one must compile none.")
    if programs.refused:
        raise SystemExit(f"executables that were not kept: {programs.refused}")


if __name__ == "__main__":
    main()
