"""Interrupts while the package is imported: the command line ends with one line and a status, as it does later.

The import takes a second, and is over before `main` can catch an interrupt. Python code that imports the package gets
the usual KeyboardInterrupt.
"""

import sys
from pathlib import Path
from typing import Any

# Exit status that shells use for an interrupt.
INTERRUPTED = 130


def is_command_line() -> bool:
    """Whether this process is `jhd` or `python -m jhd`, whose first argument is `-m` until the module is found."""
    if sys.argv[:1] == ["-m"]:
        given = sys.orig_argv
        return "-m" in given[:-1] and given[given.index("-m") + 1] == "jhd"
    return bool(sys.argv) and Path(sys.argv[0]).stem == "jhd"


def tell_interrupts() -> None:
    """Let an interrupt that is not caught end the process with status 130 and one line."""
    usual = sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        if not issubclass(kind, KeyboardInterrupt):
            usual(kind, error, trace)
            return
        print("jhd: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)

    sys.excepthook = hook


if is_command_line():
    tell_interrupts()
