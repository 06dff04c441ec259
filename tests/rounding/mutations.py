"""Error terms of proven bounds, each removed from a copy of the package in turn; the test that is to notice must fail.

Run as a program with numbers of mutations, or none for all, it prints what each of them did.
"""

import contextlib
import io
import multiprocessing
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

_ROOT = Path(__file__).parents[2]
# What the package and its tests import: loaded once, before any copy of the package is.
_LOADED = (
    "jax",
    "jax.numpy",
    "numpy",
    "equinox",
    "optimistix",
    "hypothesis",
    "pytest",
    "matplotlib.pyplot",
    "beartype",
)
# Seconds that the tests of one name may take, on a machine that has much else to do.
_LONGEST = 120.0
# What is added to the status of tests that ran, so that no other end of a process looks like theirs.
_RAN = 50


class Mutation(NamedTuple):
    """A term of a file that is taken away, and the test that notices."""

    file: str
    old: str
    new: str
    test: str


_BALLS = "arithmetic/balls.py"
_BALLS_TEST = "arithmetic/test_balls.py::test_"
_SUMS = f"{_BALLS_TEST}sums_differences_and_products_hold_those_of_all_their_numbers"
_BRANCHES = "distance/cells/branches.py"
_NEAREST = "distance/nearest/curves.py"
_MARGINS = "rounding/test_margins.py::test_bounds_have_room_for_the_derived_error"
_SEARCH = "distance/search/curves.py"
_SEARCH_TEST = "distance/search/test_error_terms.py::test_the_"
_TRIANGLES = "distance/cells/triangles.py"
_TRIANGLES_TEST = "distance/cells/test_triangles.py::test_"

_FORMS = "distance/nearest/forms.py"
_UPPER = "distance/cells/surfaces.py"
_NETS = "distance/frame/net_jets.py"
_PREPARATION = "distance/frame/curves.py"
_STATIONARITY = "distance/nearest/stationarity.py"
_PLACES = "distance/nearest/places.py"
_BLOCKS = "distance/nearest/blocks.py"
_GRAPHS = "distance/cells/graphs.py"
_ROUNDING = "arithmetic/rounding.py"
_ROUNDING_TEST = "arithmetic/test_rounding.py::test_"
_KERNELS = "rounding/test_kernels.py::test_"
_BOUNDS = f"{_KERNELS}bounds_have_room_for_the_derived_error"
_TOLD = f"{_KERNELS}errors_that_are_told_are_at_least_the_derived_ones"
_OF_NETS = f"{_KERNELS}points_of_nets"
_MOVED_CURVES = f"{_KERNELS}curves_are_moved"

MUTATIONS = [
    Mutation(_BALLS, "x - gamma(3, size.dtype) * size - 4", "x - 4", f"{_BALLS_TEST}the_ends_of_balls_lie_outside"),
    Mutation(_BALLS, "size - 4 * smallest_normal(size.dtype)", "size", f"{_BALLS_TEST}the_ends_of_balls_lie_outside"),
    Mutation(_BALLS, "+ error) * (1 + gamma(4, dtype)) + g", "+ error) + g", f"{_BALLS_TEST}the_hull_of_values"),
    Mutation(_BALLS, "gamma(6, dtype) * size + _tiny", "_tiny", f"{_BALLS_TEST}the_hull_of_values"),
    Mutation(_BALLS, "(x.rad + y.rad) * (1 + gamma(4, dtype))", "(x.rad + y.rad)", _SUMS),
    Mutation(
        _BALLS,
        "(1 + gamma(4, dtype)) + gamma(2, dtype) * jnp.abs(mid) + _tiny(dtype))\n\n\ndef minus",
        "(1 + gamma(4, dtype)) + _tiny(dtype))\n\n\ndef minus",
        _SUMS,
    ),
    Mutation(_BALLS, "rad * (1 + gamma(8, dtype)) + gamma(2", "rad + gamma(2", _SUMS),
    Mutation(_BALLS, "(1 + gamma(8, dtype)) + gamma(2, dtype) * jnp.abs(mid)", "(1 + gamma(8, dtype))", _SUMS),
    Mutation(_BALLS, "rad * (1 + gamma(n + 8, dtype))", "rad", f"{_BALLS_TEST}scalar_products"),
    Mutation(_BALLS, " + gamma(n + 4, dtype) * sizes", "", f"{_BALLS_TEST}scalar_products"),
    Mutation(_BALLS, " + gamma(4, dtype) * mid + _tiny", " + _tiny", f"{_BALLS_TEST}reciprocals"),
    Mutation(_BALLS, "rad + gamma(2 * n + 8, dtype) * jnp.abs(mid)", "rad", f"{_BALLS_TEST}no_indefinite"),
    Mutation(_BRANCHES, "relative = gamma(2 * (3 * p + q * (g + 4) + 5 * n) + 20, dtype)", "relative = 0.0", _MARGINS),
    Mutation(_BRANCHES, "(1 + gamma(4, dtype)) + eta + flushed", "(1 + gamma(4, dtype)) + flushed", _MARGINS),
    Mutation(
        _NEAREST, "jnp.maximum(least, 0.0)) * (1 - gamma(7 * q + 12, dtype))", "jnp.maximum(least, 0.0))", _MARGINS
    ),
    Mutation(_SEARCH, "found.upper + error", "found.upper", f"{_SEARCH_TEST}bounds_of_a_step"),
    Mutation(
        _SEARCH, "measured.lower - error, state.lower", "measured.lower, state.lower", f"{_SEARCH_TEST}bounds_of_a"
    ),
    Mutation(_SEARCH, "(cell) + error\n", "(cell)\n", f"{_SEARCH_TEST}first_bounds"),
    Mutation(
        _SEARCH, "first_upper_bound(a, b, cell) + error,", "first_upper_bound(a, b, cell),", f"{_SEARCH_TEST}first"
    ),
    Mutation(_SEARCH, "measured.lower - error, 0.0", "measured.lower, 0.0", f"{_SEARCH_TEST}first_bounds"),
    Mutation(
        _SEARCH, "found.lower - evaluation_error(a, b)", "found.lower", f"{_SEARCH_TEST}lower_bound_of_a_polished"
    ),
    Mutation(_TRIANGLES, "self.size * (gamma(40, self.corners.dtype) + ", "self.size * (", f"{_TRIANGLES_TEST}points"),
    Mutation(_TRIANGLES, "+ depth * gamma(16, self.corners.dtype)", "+ 0 * depth", f"{_TRIANGLES_TEST}points"),
    Mutation(_TRIANGLES, "(distance) + self.slack(depth))", "(distance))", f"{_TRIANGLES_TEST}bounds"),
    Mutation(_TRIANGLES, "distance + self.tree.error(distance)", "distance", f"{_TRIANGLES_TEST}bounds"),
    Mutation(_TRIANGLES, "self.slack(depth)) * (1 + 4e-16)", "self.slack(depth))", f"{_TRIANGLES_TEST}bounds"),
    Mutation(_FORMS, "rest + gamma(terms.shape[0] + 8, terms.dtype) * sizes", "rest", f"{_BOUNDS}[rest]"),
    Mutation(_FORMS, " * (1 + gamma(sizes[..., 0].size + 16, sizes.dtype))", "", f"{_BOUNDS}[slope"),
    Mutation(
        _FORMS, "gamma(7 * _degrees(a) + 40, a.dtype) * jnp.abs(a) + side.error", "side.error + 0 * a", f"{_TOLD}[form]"
    ),
    Mutation(
        _FORMS,
        "gamma(6 * _degrees(a) + 8, a.dtype) * jnp.abs(a) + side.error",
        "side.error + 0 * a",
        f"{_TOLD}[values]",
    ),
    Mutation(_FORMS, "error = gamma(24, size.dtype) * size + jnp.abs", "error = jnp.abs", f"{_BOUNDS}[lower"),
    Mutation(_FORMS, "size + jnp.abs(factors) * form_b.error", "size", f"{_BOUNDS}[lower"),
    Mutation(_FORMS, "jnp.maximum(least - slack, 0.0)", "jnp.maximum(least, 0.0)", f"{_BOUNDS}[nearest"),
    Mutation(_FORMS, "most + slack", "most", f"{_BOUNDS}[farthest"),
    Mutation(_UPPER, " + 2 * jnp.sum(reach * wrong, axis=1)", "", f"{_BOUNDS}[upper"),
    Mutation(_NETS, "(3 if net.weights is None else 6)", "3", _OF_NETS),
    Mutation(_NETS, "(7 if net.weights is None else 20)", "7", _OF_NETS),
    Mutation(
        _NETS,
        "return gamma((3 if net.weights is None else 6) * sum(net.degrees) + 8, net.points.dtype)",
        "return 0.0",
        _OF_NETS,
    ),
    Mutation(_NETS, "return math.sqrt(net.dim) * gamma(roundings, net.points.dtype)", "return 0.0", _OF_NETS),
    Mutation(_PREPARATION, "math.sqrt(dim) * gamma(4 * (degree + 7) + 1, dtype)", "0.0", _MOVED_CURVES),
    Mutation(
        _STATIONARITY, "error = gamma(4 * n + point.shape[0] + 16, e.dtype)", "error = 0.0", f"{_TOLD}[stationarity"
    ),
    Mutation(_PLACES, " * (1 + 8 * unit_roundoff(dtype))\n\n\ndef thorough", "\n\n\ndef thorough", f"{_BOUNDS}[reach"),
    Mutation(_BLOCKS, "return 4 * math.sqrt(dim) * gamma(40, dtype)", "return 0.0", f"{_TOLD}[chord"),
    Mutation(_GRAPHS, "math.sqrt(3) * gamma(64, size.dtype) * size", "0.0 * size", f"{_TOLD}[graph"),
    Mutation(
        _NEAREST, "length * (1 + gamma(3 * degree + dim + 6, vector.dtype))", "length", f"{_KERNELS}distances_of_points"
    ),
    Mutation(_NEAREST, " + _eta(degree, dim, radius)\n", "\n", f"{_KERNELS}distances_of_points"),
    Mutation(_ROUNDING, "1.02 * operations", "1.0 * operations", f"{_ROUNDING_TEST}gamma_is"),
    Mutation(_ROUNDING, " + 2 * operations * smallest_normal(m.dtype)", "", f"{_ROUNDING_TEST}gamma_is"),
]


def text_of(mutation: Mutation) -> str:
    """The file of the package, as it is."""
    return (_ROOT / "jhd" / mutation.file).read_text()


class Copy:
    """A copy of the package and its tests, into which mutations are written one after the other."""

    def __init__(self, folder: Path):
        self.folder = folder
        for name in ("jhd", "tests"):
            shutil.copytree(_ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", ".jax_cache"))
        shutil.copy(_ROOT / "pyproject.toml", folder)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(_LOADED))

    def passes(self, tests: Sequence[str]) -> bool:
        """Whether the tests of these names pass."""
        process = self._context.Process(target=_tested, args=(self.folder, tests))
        process.start()
        process.join(_LONGEST)
        if process.is_alive():
            process.kill()
            process.join()
        if process.exitcode not in (_RAN, _RAN + 1):
            raise RuntimeError(f"the tests {tests} did not run: status {process.exitcode}.")
        return process.exitcode == _RAN

    def caught(self, mutation: Mutation) -> bool:
        """Whether the test fails with the term removed.

        Raises:
            ValueError: the term is not in the file, or more than once.
        """
        file, text = self.folder / "jhd" / mutation.file, text_of(mutation)
        if text.count(mutation.old) != 1:
            raise ValueError(f"{mutation.old!r} is in {mutation.file} {text.count(mutation.old)} times; needs once.")
        try:
            file.write_text(text.replace(mutation.old, mutation.new))
            return not self.passes([mutation.test])
        finally:
            file.write_text(text)


def _tested(folder: Path, tests: Sequence[str]) -> None:
    """Runs tests in a process of its own and ends it with their status."""
    import pytest

    os.chdir(folder)
    # What checks annotations takes several times as long to import.
    os.environ.pop("CHECK_ANNOTATIONS", None)
    # This file belongs to the tests as they are; those of the copy are others of the same names.
    for name in [name for name in sys.modules if name.partition(".")[0] in ("tests", "jhd")]:
        del sys.modules[name]
    # No bytecode: two versions of a file may be written within the time that tells them apart.
    sys.dont_write_bytecode = True
    sys.path[:] = [str(folder), *(path for path in sys.path if Path(path or ".").resolve() != _ROOT)]
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder / "cache")
    files, names = zip(*(test.split("::") for test in tests), strict=True)
    # Rewriting assertions takes longer than the tests, and only messages come of it.
    options = ["-q", "-x", "-n0", "--assert=plain", "-p", "no:cacheprovider"]
    arguments = [*options, *sorted({f"tests/{file}" for file in files}), "-k", " or ".join(sorted(set(names)))]
    with contextlib.redirect_stdout(io.StringIO()):
        status = pytest.main(arguments)
    import jhd

    assert Path(jhd.__file__).is_relative_to(folder)
    sys.exit(_RAN + int(status))


def run(mutations: Sequence[Mutation]) -> list[Mutation]:
    """The mutations that no test noticed.

    Raises:
        RuntimeError: a test fails without any mutation.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder).resolve())
        if not copy.passes([mutation.test for mutation in mutations]):
            raise RuntimeError("a test fails without any mutation.")
        return [mutation for mutation in mutations if not copy.caught(mutation)]


if __name__ == "__main__":
    for mutation in [MUTATIONS[int(k)] for k in sys.argv[1:]] or MUTATIONS:
        print("survived" if run([mutation]) else "noticed", mutation, flush=True)
