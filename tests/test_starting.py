"""An interrupt while the package is imported: one line and a status of the command line, Python's own of programs."""

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
    (folder / "jax.py").write_text(FAKE, encoding="utf-8")
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


@pytest.mark.parametrize("code", ["import jhd", "import sys; sys.argv = ['-m']; import jhd"])
def test_a_program_that_imports_the_package_sees_the_interrupt_as_it_is(code, tmp_path):
    status, out, err = interrupted(tmp_path, "-c", code)
    assert (status, out) == (-signal.SIGINT, "") and err.rstrip().endswith("KeyboardInterrupt")
