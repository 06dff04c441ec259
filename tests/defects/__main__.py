"""Prints which suite notices each defect of the table: python -m tests.defects [number or part of a file name ...]."""

import sys
import tempfile
from pathlib import Path

from tests.defects.runner import Copy
from tests.defects.table import DEFECTS


def main(wanted: list[str]) -> int:
    """How many of the wanted defects, or of all, no test notices."""
    chosen = [
        (k, defect)
        for k, defect in enumerate(DEFECTS)
        if not wanted or any(word == str(k) or (not word.isdigit() and word in defect.file) for word in wanted)
    ]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        for k, defect in chosen:
            suite = copy.noticed(defect)
            missed += suite is None
            print(k, suite or "UNNOTICED", defect.file, repr(defect.new), defect.test, flush=True)
    return missed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) > 0)
