"""How does the time of a fit grow with the vertices of its target, and with its own segments?

Closed chains of cubics are fitted to a noisy closed outline. (1) 20 cubics and outlines of 100 to 100 000 vertices; (2)
outlines of 2000 vertices and 5 to 80 cubics, 15 to 240 free points. Each fit takes some steps. Measured are the CPU
seconds of the start by least squares, of a step, and of the proof of the end, once compiled. For comparison, if it does
not take too long: critical_pairs, which searches for all maxima of both curves.

Claims: a step grows more slowly than the number of vertices; the search for all maxima, which one step repeats several
times, grows faster. The errors of all fits are certified, and every fit ends below its start.

Feeds: figure "time of fits".
Takes: 4 minutes.
"""

import time
from typing import Any

import jax
from common import Run, markdown
from noisy_outline import outline

import jhd

COUNTS, SEGMENTS = (100, 300, 1000, 3000, 10_000, 30_000, 100_000), 20
CUBICS, VERTICES = (5, 10, 20, 40, 80), 2000
STEPS = 6
# Largest number of vertices for the search for all maxima.
PATIENCE = 1000


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    counts, segments, steps = ((150, 190), 8, 1) if run.smoke else (COUNTS, SEGMENTS, STEPS)
    cubics, vertices = ((8,), 170) if run.smoke else (CUBICS, VERTICES)
    by_vertices = [_case(run, count, segments, steps) for count in counts]
    by_segments = [_case(run, vertices, count, steps) for count in cubics]
    header = ["vertices", "cubics", "start, s", "a step, s", "proof, s", "all maxima once, s", "distance"]
    rows = [
        [c["vertices"], c["segments"], *(_shown(c[name]) for name in ("start", "step", "proof", "all")), c["upper"]]
        for c in by_vertices + by_segments
    ]
    run.save({"by_vertices": by_vertices, "by_segments": by_segments}, markdown(header, rows))


def _shown(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.3f}"


def _case(run: Run, count: int, segments: int, steps: int) -> dict[str, Any]:
    """Return the times of one fit."""
    target = jhd.polyline(outline(count, run.random), closed=True)
    at: list[float] = []

    def fitted(most: int) -> jhd.FitSolution:
        at.clear()
        at.append(time.process_time())
        note = lambda news: at.append(time.process_time())  # noqa: E731
        return jhd.fit_curve(target, degree=3, segments=segments, max_steps=most, progress=note)

    run.warm(lambda: fitted(1))
    found = fitted(steps)
    at.append(time.process_time())
    return {
        "vertices": count,
        "segments": segments,
        "points": 3 * segments,
        "start": at[1] - at[0],
        "step": (at[-2] - at[1]) / (len(at) - 3),
        "proof": at[-1] - at[-2],
        "all": _all_maxima(target, found.shape) if count <= PATIENCE and not run.smoke else None,
        "first": float(found.history[0]),
        "lower": float(found.error.lower),
        "upper": float(found.error.upper),
        "last": float(found.history[-1]),
    }


def _all_maxima(target: jhd.BezierSegments, shape: jhd.BezierSegments) -> float:
    """Return the seconds of one search for all maxima."""
    look = lambda: jax.block_until_ready(jhd.critical_pairs(target, shape, 128).value)  # noqa: E731
    look()
    began = time.process_time()
    look()
    return time.process_time() - began


if __name__ == "__main__":
    main()
