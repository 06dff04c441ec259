"""The command line before the package is imported: interrupts end it with one line, and help comes at once."""

import os
import signal
from pathlib import Path

import pytest

import jhd
from tests.processes import python

ROOT = Path(jhd.__file__).resolve().parent.parent
# What the package imports first is one that interrupts; without its own handler a process in the background hears none.
FAKE = """
import os, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
os.kill(os.getpid(), signal.SIGINT)
time.sleep(60)
"""


def interrupted(folder, *command):
    for name in ("jax", "numpy"):
        (folder / f"{name}.py").write_text(FAKE, encoding="utf-8")
    paths = os.pathsep.join(map(str, (folder, ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths}
    done = python(*command, status=None, cwd=folder, env=environment)
    return done.returncode, done.stdout, done.stderr


def script(folder):
    """What an installer writes for the command."""
    (folder / "jhd").write_text("import sys\nfrom jhd.__main__ import main\nsys.exit(main())\n", encoding="utf-8")
    return [str(folder / "jhd")]


@pytest.mark.parametrize("command", [lambda _: ["-m", "jhd", "doctor"], lambda _: ["-W", "error", "-m", "jhd"], script])
def test_an_interrupt_during_the_import_ends_the_command_line_with_one_line(command, tmp_path):
    assert interrupted(tmp_path, *command(tmp_path)) == (130, "", "jhd: interrupted\n")


def test_help_and_the_version_are_answered_before_the_package_is_imported(tmp_path):
    status, out, err = interrupted(tmp_path, *script(tmp_path), "--help")
    assert (status, err) == (0, "") and all(command in out for command in ("hausdorff", "project", "doctor"))
    status, out, err = interrupted(tmp_path, "-W", "error", "-m", "jhd", "hausdorff", "--help")
    assert (status, err) == (0, "") and out.startswith("usage: jhd hausdorff ")
    answer = (
        "Exit status: 0 done; 1 bounds not closed, or no certificate; 2 invalid input. With --threshold: 0 yes, 3 no"
    )
    assert answer in out
    assert interrupted(tmp_path, "-m", "jhd", "--version") == (0, f"jhd {jhd.__version__}\n", "")
    status, out, err = interrupted(tmp_path, "-m", "jhd", "draw", "--help")
    assert (status, out) == (2, "") and err.startswith("jhd: error: argument COMMAND: invalid choice: 'draw'")
    # A shape that is named like the option is none.
    assert interrupted(tmp_path, "-m", "jhd", "minimum", "--", "a.svg", "--help")[0] == 130


@pytest.mark.parametrize("code", ["import jhd", "import sys; sys.argv = ['-m']; import jhd"])
def test_a_program_that_imports_the_package_sees_the_interrupt_as_it_is(code, tmp_path):
    status, out, err = interrupted(tmp_path, "-c", code)
    assert (status, out) == (-signal.SIGINT, "") and err.rstrip().endswith("KeyboardInterrupt")
