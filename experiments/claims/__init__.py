"""The claim of each experiment, asserted on its numbers as it ends: `check_NAME` for experiments/NAME.py.

Claims about bounds, errors, counts and orders hold for any run, also for smoke runs. Claims about seconds hold for a
full run on a quiet machine; most of them are only stated in the experiments' docstrings. Claims about all inputs are
asserted for the inputs of a run.
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
    """Assert an experiment's claims on its numbers as read from its file."""
    CLAIMS[name](json.loads(json.dumps(numbers)))
