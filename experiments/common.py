"""Shared parts of all experiments: arguments, the compile cache, timing, and files that record their origin.

An experiment NAME.py writes NAME.json (every number, full precision) and NAME.md (the table to read).
"""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import claims
import common_origin
import common_parameters
import jax
import numpy as np

from jhd._results.solution import to_plain
from jhd._runtime.compiled import _options
from jhd._runtime.storage import chosen_folder
from jhd.io import load_shape

_HERE = Path(__file__).resolve().parent
_PACKAGES = ("jhd", "jax", "equinox", "optimistix", "numpy", "scipy")
# Libraries that some experiments compare with; an experiment skips a library if it is not installed.
_PEERS = (
    "shapely",
    "trimesh",
    "libigl",
    "point-cloud-utils",
    "open3d",
    "scikit-image",
    "fonttools",
    "matplotlib",
    "optax",
)


class Run:
    """One run of an experiment: its options, its random numbers and the folder of its files.

    Args:
        file: the experiment's `__file__`.
        text: its docstring, shown by --help.
            one_core: whether to keep the process on one core, to compare speeds; ignored in a smoke run.
            meshes: whether the experiment accepts mesh files instead of the meshes that it generates.
            pair: type of the two shapes that the user can pass instead of the built-in ones; None if unsupported.
    """

    def __init__(
        self, file: str, text: str | None, one_core: bool = False, meshes: bool = False, pair: type | None = None
    ):
        parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--smoke", action="store_true", help="shrink everything: a test that it runs")
        parser.add_argument("--out", type=Path, help="folder of the files (default: experiments/output)")
        common_parameters.add_options(parser, meshes, pair is not None)
        options = parser.parse_args()
        self.meshes = [Path(file) for file in options.meshes]
        if bool(options.a) != bool(options.b):
            parser.error("--a and --b go together")
        self.shapes: list[Any] = [load_shape(options.a), load_shape(options.b)] if options.a else []
        if pair and not all(isinstance(shape, pair) for shape in self.shapes):
            parser.error(f"--a and --b: needs two of {pair.__name__}")
        self.file = Path(file).resolve()
        self.name = self.file.stem
        self.smoke: bool = options.smoke
        self.seed: int = options.seed
        # Options that differ from the defaults; a figure compares them with its own options.
        self.asked = common_parameters.asked(options)
        self.names = vars(sys.modules["__main__"])
        try:
            common_parameters.change(self.names, options.set)
        except ValueError as error:
            parser.error(str(error))
        # Numbers of a smoke run, or of a run with other options, must never overwrite those of a full run.
        part = Path("smoke" if options.smoke else "", "asked" if self.asked else "")
        self.folder: Path = options.out or _HERE / "output" / part
        self.random = np.random.default_rng(options.seed)
        self.started = time.perf_counter()
        # Recorded now, since the files may change before the run ends.
        self.code = common_origin.code_of(self.file)
        _use_cache()
        self.cores = _keep_to_one_core() if one_core and not options.smoke else os.cpu_count()

    @property
    def options(self) -> dict[str, Any] | None:
        """Compiler options for an experiment's functions; in a smoke run they compile fast, since calls are few."""
        return _options(0) if self.smoke else None

    def warm(self, action: Callable[[], Any]) -> None:
        """Call `action` before it is measured, so that it is compiled; a smoke run skips this call."""
        if not self.smoke:
            jax.block_until_ready(action())

    def save(self, numbers: dict[str, Any], table: str) -> None:
        """Write NAME.json and NAME.md, print the table, and assert the claims if the inputs are the defaults."""
        self.folder.mkdir(parents=True, exist_ok=True)
        content = {"context": self.context(), **plain(numbers)}
        (self.folder / f"{self.name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        (self.folder / f"{self.name}.md").write_text(table + "\n", encoding="utf-8")
        print(table, flush=True)
        if not self.asked:
            claims.check(self.name, content)

    def context(self) -> dict[str, Any]:
        """Return the origin of the numbers."""
        return {
            "experiment": self.name,
            "smoke": self.smoke,
            "seed": self.seed,
            "asked": plain(self.asked),
            "parameters": plain(common_parameters.parameters(self.names)),
            "versions": {"python": platform.python_version(), **_versions()},
            "code": self.code,
            "device": f"{jax.devices()[0].device_kind} ({platform.machine()}, {self.cores} core(s) used)",
            "command": " ".join(["python", f"experiments/{self.name}.py", *_without_folder(sys.argv[1:])]),
            **common_origin.machine(),
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "seconds": time.perf_counter() - self.started,
        }


def _versions() -> dict[str, str]:
    """Return the versions of the packages used, and of each peer library if it is installed."""
    found = {name: version(name) for name in _PACKAGES}
    for name in _PEERS:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _use_cache() -> None:
    """Enable JAX's persistent compile cache (default: next to jhd's cache), so that a second run compiles nothing."""
    ours = chosen_folder()
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR") or (None if ours is None else str(ours / "jax"))
    jax.config.update("jax_compilation_cache_dir", folder)
    # Keep every compiled function, unless the environment sets a minimum compile time.
    least = os.environ.get("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float(least))


def _keep_to_one_core() -> int | None:
    """Keep this process on one core if the system supports it; return the number of cores it may use."""
    if not hasattr(os, "sched_setaffinity"):
        return os.cpu_count()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    return 1


def plain(value: Any) -> Any:
    """Convert results to plain numbers, names, lists and dictionaries; non-finite numbers become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return to_plain(np.asarray(value) if isinstance(value, np.generic) else value)


def seconds(function: Callable[[], Any], repeats: int) -> float:
    """Return the median wall time of `repeats` calls after an uncounted one; if `repeats` is 0, time that one."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return float(np.median(times[1:] or times))


def bounds_text(lower: float, upper: float, digits: int) -> tuple[str, str]:
    """Format both bounds with `digits` digits, rounded outward, so that the printed bounds are still certified."""
    ways = (lower, ROUND_FLOOR), (upper, ROUND_CEILING)
    low, high = (Context(prec=digits, rounding=way).create_decimal_from_float(float(x)) for x, way in ways)
    return f"{low.normalize()}", f"{high.normalize()}"


def markdown(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Format a Markdown table with aligned columns."""
    cells = [list(header), *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    padded = [[cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in cells]
    lines = ["| " + " | ".join(row) + " |" for row in padded]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


def _without_folder(options: list[str]) -> list[str]:
    """Remove `--out` from a command: the folder depends on the machine, not on the experiment."""
    kept: list[str] = []
    for before, option in zip(["", *options], options, strict=False):
        if before != "--out" and option != "--out" and not option.startswith("--out="):
            kept.append(option)
    return kept
