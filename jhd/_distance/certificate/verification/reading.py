"""Certificates in files: lines of strict JSON, compressed or not, read one after the other.

The first line holds everything except the cells, and for each direction the number of cells; each further line is a
cell. So a file of any number of cells is checked in the memory that the shapes take.
"""

import gzip
import itertools
import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import TextIOBase
from pathlib import Path
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any

from jhd._distance.certificate.verification.structure import SECTIONS, VERSION, CertificateError, check_keys

# The first bytes of compressed files.
_GZIP = b"\x1f\x8b"
# The longest line or object that is read: a short compressed file must not fill the memory.
_LONGEST = 2**28


def parsed(text: str) -> Any:
    """Return the value of JSON text; refuse NaN, Infinity and repeated keys.

    Raises:
        json.JSONDecodeError: text that is no JSON.
        CertificateError: an object with a key that occurs twice.
        ValueError: a number that is none of JSON, or with more digits than Python reads.
        RecursionError: lists in lists beyond what Python reads.
    """
    return json.loads(text, parse_constant=_refused, object_pairs_hook=_unique)


@contextmanager
def opened(path: str | Path) -> Iterator[Any]:
    """Return the certificate in a file; its cells are read when they are requested, once and in order.

    Raises:
        OSError: there is no such file, or it is torn.
        ValueError: text that is no JSON, or no text (see `parsed`); lines are counted from the first of the file.
        CertificateError: JSON of another structure.
    """
    with open(path, "rb") as raw:
        compressed = raw.read(2) == _GZIP
    file: Any = gzip.open(path, "rt", encoding="utf-8-sig") if compressed else open(path, encoding="utf-8-sig")
    with file:
        yield _content(_Lines(file))


def lines_of(content: Mapping[str, Any]) -> Iterator[str]:
    """Return the lines of a file that hold a certificate whose cells are lists."""
    cells = content["cells"]
    counts = None if cells is None else {direction: len(rows) for direction, rows in cells.items()}
    yield json.dumps({**content, "cells": counts}, allow_nan=False) + "\n"
    rows = [cells[name] for name in SECTIONS if name in cells] if cells is not None else []
    for cell in itertools.chain(*rows):
        yield json.dumps(cell, allow_nan=False) + "\n"


class _Lines:
    """The lines of a file in turn."""

    def __init__(self, file: TextIOBase):
        self.file, self.number = file, 0

    def next(self) -> str:
        """Return the next line; empty at the end."""
        try:
            line = self.file.readline(_LONGEST)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise ValueError(f"the compressed data are broken after line {self.number}: {error}") from error
        if len(line) >= _LONGEST:
            raise CertificateError(f"a line has more than {_LONGEST} characters.")
        self.number += 1
        return line

    def value(self, line: str) -> Any:
        """Return the value of the last line that was read."""
        try:
            return parsed(line)
        except json.JSONDecodeError as error:
            error.lineno += self.number - 1
            raise

    def end(self) -> None:
        """Raise CertificateError if lines are left."""
        if self.next().strip():
            raise CertificateError(f"line {self.number} follows the end.")


def _content(lines: _Lines) -> Any:
    first = lines.next()
    if first.strip() == "{":
        # One object over many lines, as JSON is often written.
        return parsed(first + lines.file.read(_LONGEST))
    content = lines.value(first)
    if isinstance(content, Mapping) and content.get("version") == VERSION and isinstance(content.get("cells"), Mapping):
        return {**content, "cells": _streams(content["cells"], lines)}
    lines.end()
    return content


def _streams(counts: Mapping[str, Any], lines: _Lines) -> dict[str, "_CellsInTurn"]:
    """Return for each direction its cells, read on demand, in the order of the directions."""
    check_keys("cells", counts, [name for name in SECTIONS if name in counts])
    for name, count in counts.items():
        # More than any disk has bytes.
        if isinstance(count, bool) or not isinstance(count, int) or not 0 < count <= 2**53:
            raise CertificateError(f"cells.{name} is {repr(count)}; needs the number of its lines.")
    names = [name for name in SECTIONS if name in counts]
    return {name: _CellsInTurn(lines, name, counts[name], name == names[-1]) for name in names}


class _CellsInTurn:
    """The cells of a direction, read once, and their number."""

    def __init__(self, lines: _Lines, name: str, count: int, is_last: bool):
        self.lines, self.name, self.count, self.is_last = lines, name, count, is_last

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Any]:
        for k in range(self.count):
            line = self.lines.next()
            if not line.strip():
                message = f"cells.{self.name}[{k}] is missing: the file ends after {k} of {self.count} cells."
                raise CertificateError(message)
            yield self.lines.value(line)
        if self.is_last:
            self.lines.end()


def _refused(token: str) -> float:
    raise ValueError(f"{token} is no number of JSON.")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise CertificateError(f"the key {key[:80]!r} occurs twice in one object.")
        content[key] = value
    return content
