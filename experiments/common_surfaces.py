"""Well-known implicit surfaces, and functions for experiments on them."""

from typing import Any

import jhd

CONES = "x^2/4 + y^2/4 - z^2/9", "x^2/16 + y^2/4 - z^2/9"
# The exact distances of the paper's cones in [-2, 2]^3: H = h(B, A) = (sqrt(43) - 4) / 3 and h(A, B).
CONES_EXACT, CONES_EXACT_A_TO_B = 0.852479508100667, 0.798859586020371
BOX = (-2.0, 2.0)
TANGLECUBE = "x^4 - 5*x^2 + y^4 - 5*y^2 + z^4 - 5*z^2 + 11.8"
CLEBSCH = (
    "81*(x^3 + y^3 + z^3) - 189*(x^2*y + x^2*z + y^2*x + y^2*z + z^2*x + z^2*y) + 54*x*y*z"
    " + 126*(x*y + x*z + y*z) - 9*(x^2 + y^2 + z^2) - 9*(x + y + z) + 1"
)
CAYLEY = "4*(x^2 + y^2 + z^2) + 16*x*y*z - 1"
GOLDEN_SQ = "2.618033988749895"
BARTH = (
    f"4*({GOLDEN_SQ}*x^2 - y^2)*({GOLDEN_SQ}*y^2 - z^2)*({GOLDEN_SQ}*z^2 - x^2)"
    " - 4.23606797749979*(x^2 + y^2 + z^2 - 1)^2"
)
# A rounded box without symmetry, in [-1.5, 1.5]^3, and an ellipsoid that replaces it in smoke runs: JAX compiles for
# each degree, most surfaces of smoke runs have degree two, and distances of this one close in few steps.
ROUNDED = "x^4 + 2.2*y^4 + 4*z^4 + 0.5*x^2*y^2 + 0.4*x^2*y - 0.3*y^2*z + 0.2*x - 0.15*z - 1"
ROUND = "x^2 + 2.2*y^2 + 4*z^2 + 1.2*x*y - 1.5*y*z + 0.2*x - 0.15*z - 1"
# Circles of radius 0.4 about one of radius 1.1.
TORUS = "(x^2 + y^2 + z^2 + 1.05)^2 - 4.84*(x^2 + y^2)"


def surface(text: str, lower: Any = BOX[0], upper: Any = BOX[1]) -> jhd.ImplicitSurface:
    """Parse an implicit surface in a box, a cube if its ends are numbers."""
    lower, upper = ([end] * 3 if isinstance(end, int | float) else end for end in (lower, upper))
    return jhd.ImplicitSurface.parse(text, lower, upper)


def kept(shape: jhd.ImplicitSurface, cells: int, ranges: str) -> dict[str, Any]:
    """Count the cells kept on each level of a voxelization, and all cells tested."""
    levels: dict[int, int] = {}
    tested = 0

    def report(progress: jhd.progress.Progress) -> None:
        nonlocal tested
        levels[progress.done], tested = (int(progress.details[name]) for name in ("kept", "tested"))

    voxels = jhd.voxelize(shape, cells, ranges=ranges, progress=report)
    return {"levels": list(levels.values()), "tested": tested, "certified": int(voxels.proven.sum())}


def bounds(solution: jhd.HausdorffSolution) -> tuple[float, float]:
    """Return both bounds of a solution."""
    return float(solution.lower), float(solution.upper)
