"""Runs tests against a copy of the package with one line changed; the test that the table names must fail."""

import contextlib
import io
import multiprocessing
import os
import resource
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

_ROOT = Path(__file__).parents[2]
# Imported once by a server, whose children import only the copy of the package and its tests.
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
# Seconds that one test may take on a busy machine, and bytes.
_LONGEST, _LARGEST = 240.0, 8 << 30
# Added to pytest's status, so that no other end of a process looks like the end of a test.
_RAN = 50
# pytest's statuses: all passed, some failed, an interrupt was not caught, none was selected.
_PASSED, _FAILED, _INTERRUPTED, _NONE = 0, 1, 2, 5
# The suites in the order of their cost, by the markers that select their tests.
SUITES = {
    "quick": "not slow and not exhaustive",
    "slow": "slow and not exhaustive",
    "exhaustive": "exhaustive",
}


class Defect(NamedTuple):
    """A change of one file of the package, and the test that notices it."""

    file: str
    old: str
    new: str
    test: str


def within(file: str, tests: str, *changes: tuple[str, str, str]) -> list[Defect]:
    """Defects of one file: the text replaced, new text, and test, in `tests` unless it names a file."""
    return [Defect(file, old, new, name if "::" in name else f"{tests}::{name}") for old, new, name in changes]


def text_of(file: str) -> str:
    """The text of a file of the package."""
    return (_ROOT / "jhd" / file).read_text(encoding="utf-8")


def is_there(test: str) -> bool:
    """Whether the file of a test defines its function."""
    file, name = test.split("::")
    return f"def {name.partition('[')[0]}(" in (_ROOT / "tests" / file).read_text(encoding="utf-8")


class Copy:
    """A copy of the package and its tests, into which defects are written one after the other."""

    def __init__(self, folder: Path):
        self.folder = folder.resolve()
        for name in ("jhd", "tests", "experiments"):
            kept = shutil.ignore_patterns("__pycache__", ".jax_cache", "output")
            shutil.copytree(_ROOT / name, self.folder / name, ignore=kept)
        for name in ("pyproject.toml", "README.md"):
            shutil.copy(_ROOT / name, self.folder)
        self._sound: dict[tuple[str, str], bool] = {}
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(_LOADED))

    def noticed(self, defect: Defect) -> str | None:
        """The suite whose test fails with the defect and passes without; None if there is none.

        Raises:
            ValueError: the text to be replaced is not in the file, or more than once.
            RuntimeError: the test fails without the defect, or does not run.
        """
        file, text = self.folder / "jhd" / defect.file, text_of(defect.file)
        if text.count(defect.old) != 1:
            raise ValueError(f"{defect.old!r} is in {defect.file} {text.count(defect.old)} times; needs once.")
        try:
            file.write_text(text.replace(defect.old, defect.new), encoding="utf-8")
            found = next((suite for suite in SUITES if self._status(defect.test, suite) == _FAILED), None)
        finally:
            file.write_text(text, encoding="utf-8")
        if found is not None and not self._passes(defect.test, found):
            raise RuntimeError(f"{defect.test} fails without the defect.")
        return found

    def _passes(self, test: str, suite: str) -> bool:
        """Whether a test passes with the package as it is; each is run once."""
        if (test, suite) not in self._sound:
            self._sound[test, suite] = self._status(test, suite) == _PASSED
        return self._sound[test, suite]

    def _status(self, test: str, suite: str) -> int:
        process = self._context.Process(target=_tested, args=(self.folder, test, SUITES[suite]))
        process.start()
        process.join(_LONGEST)
        if process.is_alive():
            # Some defects make a loop endless.
            process.kill()
            return _FAILED
        status = (process.exitcode or 0) - _RAN
        if status == _INTERRUPTED:
            return _FAILED
        if status not in (_PASSED, _FAILED, _NONE):
            raise RuntimeError(f"{test} did not run: status {process.exitcode}.")
        return status


def _tested(folder: Path, test: str, markers: str) -> None:
    """Runs a test in a process of its own and ends it with the status."""
    import jaxtyping
    import pytest

    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_DATA, (_LARGEST, _LARGEST))
    # Checking annotations takes several times as long as importing the package.
    jaxtyping.install_import_hook = lambda *_: None
    # This module belongs to the tests as they are; the copy has other modules of the same names.
    for name in [name for name in sys.modules if name.partition(".")[0] in ("tests", "jhd")]:
        del sys.modules[name]
    # No bytecode: two versions of a file may be written within the time that tells them apart.
    sys.dont_write_bytecode = True
    sys.path[:] = [str(folder), *(path for path in sys.path if Path(path or ".").resolve() != _ROOT)]
    os.environ["PYTHONPATH"] = str(folder)
    # Executables of unchanged functions are shared with the other tests.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_ROOT / ".jax_cache"))
    file, name = test.split("::")
    # Assertions are not rewritten: that takes longer than the tests, and only improves messages.
    options = ["-q", "-x", "-n0", "--assert=plain", "-p", "no:cacheprovider", "-m", markers]
    with contextlib.redirect_stdout(io.StringIO()):
        status = pytest.main([*options, f"tests/{file}", "-k", name])
    import jhd

    assert Path(jhd.__file__).is_relative_to(folder)
    sys.exit(_RAN + int(status))


def unnoticed(copy: Copy, defects: Sequence[Defect]) -> list[Defect]:
    """The defects that their tests do not notice."""
    return [defect for defect in defects if copy.noticed(defect) is None]
