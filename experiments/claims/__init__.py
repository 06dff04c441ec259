"""The claim of each experiment, asserted on its numbers as it ends: `check_NAME` for experiments/NAME.py.

Claims about bounds, errors, counts and orders hold for any run, also for smoke runs. Claims about seconds and their
ratios are asserted for full runs only, with room for a busy machine. Claims about all inputs are asserted for the
inputs of a run. A measured number that is not asserted here belongs in no docstring and no caption.
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
