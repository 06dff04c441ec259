"""What each experiment claims, asserted on its numbers as it ends: `check_NAME` for experiments/NAME.py.

Bounds, errors, counts and orders are claimed of any run, short ones too; claims of seconds are those of a full run on a
quiet machine and mostly stand in the experiments' docstrings. What is claimed of all inputs is asserted of those that a
run takes.
"""

import json
from collections.abc import Callable
from typing import Any

from . import collections, curves, fits, surfaces

CLAIMS: dict[str, Callable[[dict[str, Any]], None]] = {
    name.removeprefix("check_"): check
    for module in (collections, curves, fits, surfaces)
    for name, check in vars(module).items()
    if name.startswith("check_")
}


def check(name: str, numbers: dict[str, Any]) -> None:
    """Asserts what an experiment claims, on its numbers as they are read from its file."""
    CLAIMS[name](json.loads(json.dumps(numbers)))
