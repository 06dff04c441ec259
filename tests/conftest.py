"""What all tests share: compiled programs are kept, shapes and types can be checked at run time, nothing is random.

The type checks of jaxtyping must be switched on before the package is imported, so this file imports nothing of it.
"""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import beartype
import hypothesis
import jax
import jaxtyping
import numpy as np
import pytest

os.environ["MPLBACKEND"] = "Agg"
# Small matrices on several threads beside other processes take several times as long; workers read it as they start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_FOLDER = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parent.parent / ".jax_cache"))
# Keeping a program takes as long as compiling one of the thousands of small ones, so they are made again.
_WORTH = "0.1"
# Tests in a process of their own find the same programs.
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = _WORTH
os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
# Programs without the source lines of their operations take a seventh less time to compile.
os.environ["JAX_TRACEBACK_IN_LOCATIONS_LIMIT"] = "0"
# Programs that the package itself keeps are read by the other processes of these tests, and again where they were
# dropped, without being traced; the folder goes with the tests. Those that are about keeping name one of their own.
_KEPT = None
if "JHD_CACHE" not in os.environ:
    _KEPT = tempfile.TemporaryDirectory()
    os.environ["JHD_CACHE"] = _KEPT.name
jax.config.update("jax_compilation_cache_dir", _FOLDER)
jax.config.update("jax_persistent_cache_min_compile_time_secs", float(_WORTH))
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
jax.config.update("jax_traceback_in_locations_limit", 0)

# An int serves where a float is asked for, as PEP 484 has it; counters of loops are ints where a loop is unrolled and
# arrays where it is compiled; the preparation of concrete curves runs on NumPy arrays.
_WIDER = {int: int | jax.Array, float: float | int | jax.Array, jax.Array: jax.Array | np.ndarray}
_FROZEN: Any = getattr(beartype, "FrozenDict", None) or beartype.BeartypeHintOverrides


# The older emitters take a seventh less of the time that a search needs to compile, and no optimization another tenth.
# To compile a program on one thread takes a twelfth less than on several; the other core is the other worker's.
# XLA ends a process that names a flag it does not know, and the first one is gone from jaxlib 0.11.2 on.
FLAGS = ("--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1")
QUICK_FLAGS = (*FLAGS, "--xla_backend_optimization_level=0")
# Bytes of a process from which on its programs are dropped if a file of tests begins, and within one, so that no
# process takes more than 2 GB; and how many more than the last drop left it must hold: modules and what the C library
# holds in pieces stay.
_ROOM, _MOST = 1500 << 20, 1800 << 20
_GROWTH = 150 << 20
_left = 0
# Those that take longest when nothing is compiled yet, quick and slow tests together. Files that share large programs
# do not stand beside each other: two processes that begin with them would compile the same.
_LONGEST = (
    "test_experiments.py",
    "test_search.py",
    "test_certificate.py",
    "test_mixed_pairs.py",
    "test_project.py",
    "test_two_step.py",
    "test_statistics.py",
    "test_surface_certificates.py",
    "test_fit.py",
    "test_hausdorff.py",
    "test_mutations.py",
    "test_derivative.py",
    "test_near_pairs.py",
    "test_adaptive.py",
    "test_minimum.py",
    "test_programs.py",
    "test_blocks.py",
    "test_algebraic.py",
    "test_memory.py",
    "test_bspline.py",
    "test_host_bounds.py",
    "test_trimming.py",
    "test_sharding.py",
    "test_surfaces.py",
    "test_near_top.py",
    "test_main.py",
    "test_polynomial_roots.py",
    "test_critical.py",
    "test_branch_and_bound.py",
    "test_cube_intervals.py",
    "test_polynomials.py",
    "test_distance_transform.py",
    "test_cases.py",
)


# Tests of parts that tests of calls cover too, and whose programs nothing else needs: they are slow ones.
_PARTS = (
    "arithmetic/test_bernstein.py",
    "arithmetic/test_isolated_zeros.py",
    "arithmetic/test_polynomial_roots.py",
    "arithmetic/test_polynomials.py",
    "arithmetic/test_simplices.py",
    "arithmetic/test_trivariate.py",
    "arithmetic/test_truncated.py",
    "distance/cells/",
    "distance/nearest/test_curves.py",
    "distance/nearest/test_surface_points.py",
    "distance/search/test_closest_triangles.py",
    "distance/search/test_patch_boxes.py",
    "distance/search/test_targets.py",
    "triangles/",
)


# What users pass as numbers and shapes is refused by the package itself, with messages of its own.
_PASSED = {
    "jhd._shapes.checks": ("Numbers",),
    "jhd._shapes.as_shape": ("ShapeLike",),
    "jhd._shapes.foreign": ("HasCoords", "HasVertices", "SciPySpline", "ShapelyGeometry", "SymPyPolynomial"),
}


def checked(function):
    """The function or class with its annotations checked at every call."""
    known = [(sys.modules.get(module), name) for module, names in _PASSED.items() for name in names]
    passed = {vars(module)[name]: object for module, name in known if module and name in vars(module)}
    return beartype.beartype(conf=beartype.BeartypeConf(hint_overrides=_FROZEN(_WIDER | passed)))(function)


def pytest_configure(config):
    """Quick tests compile without optimization, in less time; slow ones with it, as the programs of plain calls are.

    What is proven must hold for either: with and without fused multiplications and additions. OPTIMIZE=0 in the
    environment compiles slow tests as quick ones are, for those that compile for longer than they run. Checked
    annotations take a tenth of the time: the environment asks for them by CHECK_ANNOTATIONS=1, as the continuous
    integration does for the quick tests.
    """
    # What is started in the background ignores interrupts, and so does all that it starts; some tests send them.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    quick = config.option.markexpr == "not slow and not exhaustive" or os.environ.get("OPTIMIZE") == "0"
    flags = os.environ.get("XLA_FLAGS", "").split()
    # Worker processes inherit the flags.
    if not set(flags) & set(QUICK_FLAGS):
        os.environ["XLA_FLAGS"] = " ".join([*flags, *filter(_is_flag, QUICK_FLAGS if quick else FLAGS)])
    if os.environ.get("CHECK_ANNOTATIONS") == "1":
        # The hook takes the name of a checker, not the checker.
        jaxtyping.install_import_hook("jhd", f"{__name__}.checked")


def pytest_unconfigure():
    """The programs that these tests kept are removed."""
    if _KEPT is not None:
        _KEPT.cleanup()


def _is_flag(flag):
    """Return whether the installed XLA knows a flag, which only a process of its own can survive asking."""
    start = "from jaxlib import xla_client; xla_client.make_cpu_client()"
    asked = subprocess.run([sys.executable, "-c", start], env={**os.environ, "XLA_FLAGS": flag}, capture_output=True)
    return asked.returncode == 0


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Tests of parts are slow; the files that take longest come first, so that no process is left with one of them."""
    for item in items:
        path = os.path.relpath(item.path, Path(__file__).parent).replace(os.sep, "/")
        if path.startswith(_PARTS) and not item.get_closest_marker("exhaustive"):
            item.add_marker(pytest.mark.slow)
    places = {name: place for place, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


# Nearly all garbage of traces is young; full collections, which take half a second each, are asked for above.
gc.set_threshold(50_000, 20, 1_000)
hypothesis.settings.register_profile("jhd", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("jhd")


@pytest.fixture(autouse=True, scope="module")
def room_for_programs():
    """Drop all programs if a file of tests begins in a process that holds much memory, nearly all of it programs.

    What is there when a file begins mostly stays: to look through all of it again and again for garbage takes a
    fifteenth of the time.
    """
    drop_programs_above(max(_ROOM, _left + _GROWTH))
    gc.freeze()


@pytest.fixture(autouse=True)
def room_within_a_file():
    """Drop all programs in the middle of a file that makes very many: experiments make 4 GB of them."""
    drop_programs_above(max(_MOST, _left + _GROWTH))


def drop_programs_above(limit):
    """Drop all programs if the process holds more bytes than the limit."""
    global _left
    if _held() > limit:
        from jhd._runtime.c_library import give_back

        gc.unfreeze()
        jax.clear_caches()
        gc.collect()
        give_back()
        _left = _held()


def _held():
    """Bytes that the process holds, 0 where the system does not say."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if pages.exists() else 0


@pytest.fixture(autouse=True)
def programs_as_they_are_set(request):
    """Tests that set something keep no programs and read none, unless they name a folder; see JHD_CACHE above."""
    if "monkeypatch" in request.fixturenames:
        request.getfixturevalue("monkeypatch").setenv("JHD_CACHE", "0")


@pytest.fixture
def run(capsys, tmp_path):
    """Runs one command in a folder of its own: exit status, standard output, standard error."""
    import matplotlib as mpl

    from jhd.__main__ import main

    settings = dict(mpl.rcParams)

    def call(*arguments):
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    with contextlib.chdir(tmp_path):
        yield call
    assert dict(mpl.rcParams) == settings


@pytest.fixture
def as_a_user():
    """The package without checked annotations: what it refuses then, it refuses by itself."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
