"""How long does the first call of a process take, with and without a cache on disk?

If a script asks for one distance, it pays for importing, tracing, compiling and the search. For each entry three fresh
processes make one call: with JHD_CACHE=0; with an empty folder, which the call fills; and with this folder, now a warm
cache. CPU seconds (of all threads, user and system) are counted from the end of `import jhd` to the answer, by phase:
tracing and lowering; XLA; writing and reading compiled functions; and the rest, which is the search and the small
functions compiled around it. The last two entries are functions under the user's own `jax.jit`: they call the kept
search on the host. Without a folder phases are not told apart. If a process has a folder, it is repeated and the
quickest run counts: other work increases CPU seconds.

Claims: the bounds are bitwise identical in all three. With a warm cache, distances of curves, surfaces and meshes
compile at most two small operations, and take less than a fifth of the time without it, like a gradient; a fit takes
less than a quarter, functions under jax.jit less than two fifths.

Feeds: figure and table "first_call".
Takes: 7 minutes.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from common import Run, markdown

import jhd
from jhd._runtime import compiled

_BOX = [-2.0] * 3, [2.0] * 3
_WAYS = ("without", "first", "second")
_PHASES = ("tracing", "XLA", "writing", "reading", "rest")
_REPEATS = 3


def main() -> None:
    """Measure and save."""
    run = Run(__file__, __doc__)
    entries = {name: _measured(name, run) for name in (("meshes",) if run.smoke else _ENTRIES)}
    run.save({"entries": entries}, _table(entries))


def _measured(name: str, run: Run) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        found = {"without": _in_a_process(name, "0"), "first": _in_a_process(name, folder)}
        seconds = [_in_a_process(name, folder) for _ in range(1 if run.smoke else _REPEATS)]
        kept = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    return {**found, "second": min(seconds, key=lambda one: one["seconds"]), "bytes": kept}


def _in_a_process(name: str, folder: str) -> dict[str, Any]:
    """Return the report of a fresh process on its first call, without JAX's own cache."""
    environment = {key: value for key, value in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, "-c", f"import first_call; first_call.report({name!r})"]
    done = subprocess.run(
        command,
        cwd=Path(__file__).parent,
        env={**environment, "JHD_CACHE": folder},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def report(name: str) -> None:
    """Print CPU seconds by phase, functions compiled and read, and the bounds of one call in this process."""
    spent: dict[str, float] = dict.fromkeys(_PHASES, 0.0)
    counts = {"compiled": 0, "read": 0}

    def timed(holder: Any, attribute: str, phase: str) -> None:
        function = getattr(holder, attribute)

        def call(*args: Any, **options: Any) -> Any:
            began = time.process_time()
            result = function(*args, **options)
            spent[phase] += time.process_time() - began
            counts["read"] += phase == "reading" and result is not None
            return result

        setattr(holder, attribute, call)

    def heard(event: str, *_: Any, **__: Any) -> None:
        counts["compiled"] += event.endswith("backend_compile_duration")

    jax.monitoring.register_event_duration_secs_listener(heard)
    timed(compiled, "load", "reading")
    timed(compiled, "store", "writing")
    timed(compiled._Kept, "_compiled", "tracing")
    timed(jax.stages.Lowered, "compile", "XLA")
    began = time.process_time()
    lower, upper = _ENTRIES[name]()
    answer = [float(lower).hex(), float(upper).hex()]
    seconds = time.process_time() - began
    # Compilation happens within tracing, so its time is subtracted.
    spent["tracing"] = max(spent["tracing"] - spent["XLA"], 0.0)
    spent["rest"] = seconds - sum(spent.values())
    print(json.dumps({"seconds": seconds, "phases": spent, **counts, "bounds": answer}))


def _cubics(rational: bool = False) -> tuple[jhd.BezierCurve, jhd.BezierCurve]:
    random = np.random.default_rng(0)
    weights = [random.uniform(1.0, 2.0, 4) if rational else None for _ in range(2)]
    first, second = (jhd.BezierCurve(random.normal(size=(4, 2)), w) for w in weights)
    return first, second


def _curves() -> Any:
    found = jhd.hausdorff(*_cubics())
    return found.lower, found.upper


def _rational() -> Any:
    found = jhd.hausdorff(*_cubics(rational=True))
    return found.lower, found.upper


def _cones() -> Any:
    texts = "x**2/4 + y**2/4 - z**2/9", "x**2/16 + y**2/4 - z**2/9"
    a, b = (jhd.ImplicitSurface.parse(text, *_BOX) for text in texts)
    found = jhd.hausdorff(a, b)
    return found.lower, found.upper


def _meshes() -> Any:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    a, b = (jhd.TriangleMesh(corners + [move, 0.0, 0.0], faces) for move in (0.0, 0.5))
    found = jhd.hausdorff(a, b)
    return found.lower, found.upper


def _smallest() -> Any:
    a = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", *_BOX)
    b = jhd.ImplicitSurface.parse("(x - 3)**2 + y**2 + z**2 - 1", [1.0, -2.0, -2.0], [5.0, 2.0, 2.0])
    found = jhd.minimum_distance(a, b)
    return found.lower, found.upper


def _fit() -> Any:
    quarter = jhd.BezierCurve([(1, 0), (1, 1), (0, 1)], [1, np.sqrt(0.5), 1])
    error = jhd.fit_curve(quarter, degree=3, ends="free").error
    return error.lower, error.upper


def _derivative() -> Any:
    a, b = _cubics()
    value, slope = jax.value_and_grad(lambda points: jhd.hausdorff(jhd.BezierCurve(points), b).value)(a.control_points)
    return value, slope[0, 0]


def _jit() -> Any:
    a, b = _cubics()
    found = jax.jit(lambda p, q: jhd.hausdorff(jhd.BezierCurve(p), jhd.BezierCurve(q)))(
        a.control_points, b.control_points
    )
    return found.lower, found.upper


def _jit_of_derivative() -> Any:
    a, b = _cubics()
    slope = jax.jit(jax.grad(lambda p, q: jhd.hausdorff(jhd.BezierCurve(p), jhd.BezierCurve(q)).value))(
        a.control_points, b.control_points
    )
    return slope[0, 0], slope[0, 1]


_ENTRIES: dict[str, Callable[[], Any]] = {
    "two cubics": _curves,
    "two rational cubics": _rational,
    "cones": _cones,
    "meshes": _meshes,
    "smallest distance of spheres": _smallest,
    "fit_curve": _fit,
    "value and gradient": _derivative,
    "jit": _jit,
    "jit of grad": _jit_of_derivative,
}


def _table(entries: dict[str, Any]) -> str:
    header = ["first call (CPU s)", "no cache", "cold cache", "warm cache", "reading", "read", "compiled", "MB"]
    rows = [
        [
            name,
            *(f"{entry[way]['seconds']:.2f}" for way in _WAYS),
            f"{entry['second']['phases']['reading']:.2f}",
            entry["second"]["read"],
            entry["second"]["compiled"],
            f"{entry['bytes'] / 1e6:.1f}",
        ]
        for name, entry in entries.items()
    ]
    return markdown(header, rows)


if __name__ == "__main__":
    main()
