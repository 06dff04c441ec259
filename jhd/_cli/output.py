"""Results of commands as JSON or as a table, on standard output and in files."""

import csv
from argparse import Namespace
from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from jhd._cli.console import json_text
from jhd._runtime.files import replace_file

# The suffixes of --out of commands whose result is a table.
TABLE_SUFFIXES = ".csv", ".json"


def delivered(
    options: Namespace, found: Any, content: Any = None, table: Iterable[Sequence[Any]] = (), **context: Any
) -> bool:
    """Write a result to the file of --out and print it as JSON if --json is given; return whether it was printed.

    Args:
        options: the parsed options, of which `out` and `json` are used.
        found: the result.
        content: fields of the result in JSON; by default those of `found`.
        table: rows for a .csv file, the names of the columns first.
        context: options and facts in JSON, next to the result.
    """
    as_json = options.out is not None and Path(options.out).suffix.lower() == ".json"
    text = json_text(found, content, **context) if options.json or as_json else ""
    if options.out:
        replace_file(options.out, f"{text}\n" if as_json else _csv_text(table))
    if options.json:
        print(text)
    return options.json


def print_files(**files: str | None) -> None:
    """Print the names of the files that were written."""
    for name, file in files.items():
        if file:
            print(f"{name:<10} {Path(file).resolve()}")


def _csv_text(table: Iterable[Sequence[Any]]) -> str:
    stream = StringIO(newline="")
    # Floats are written in full, so that a bound that is read back is the certified bound.
    rows = ([cell.item() if isinstance(cell, np.generic) else cell for cell in row] for row in table)
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()
