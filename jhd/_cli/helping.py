"""Fast help: the command line prints help and the version before it imports the package, which takes seconds.

Importing the package from Python is not affected.
"""

import sys
from collections.abc import Sequence

from jhd._runtime.starting import is_command_line

_ASKED = {"-h", "--help", "--version"}


def asks_for_help(words: Sequence[str]) -> bool:
    """Whether a command line asks for help or the version, which needs no computation."""
    return not _ASKED.isdisjoint(words[: words.index("--")] if "--" in words else words)


if is_command_line() and asks_for_help(sys.argv[1:]):
    # Here, as `python -m jhd` warns of a module that is there before it is run.
    from jhd.__main__ import main

    sys.exit(main())
