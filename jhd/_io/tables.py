"""Point tables in text: .csv and .txt files with one point per line, and an optional header that names the columns.

A table that could mean two things is refused with its line: decimal commas, two kinds of separators, lines of different
length, or further columns without a header that names the coordinates.
"""

import re
from io import StringIO

import numpy as np

from jhd._io.errors import ParseError, shown

_AXES = ("x", "y", "z")
_NAMES = {";": "semicolons", ",": "commas", "": "blanks"}


def table_in(text: str, name: str) -> np.ndarray:
    """The coordinates (points, 2 or 3) in a table whose columns are separated by blanks, commas or semicolons.

    Raises:
        ParseError: a cell that is not a number, or a table that could mean two things; with the name and the line.
    """
    lines = ((k, line.split("#")[0].strip()) for k, line in enumerate(StringIO(text, newline=None), start=1))
    table = _cells([(number, line) for number, line in lines if line], name)
    if not table:
        return np.empty((0, 3))
    number, first = table[0]
    if any(number_in(word) is not None for word in first):
        columns = list(range(len(first)))
        if len(first) not in (2, 3):
            message = f"{len(first)} columns; needs 2 or 3, or a first line that names the columns x, y (and z)."
            raise ParseError(message, name, number)
        if first == ["0", "1", "2"][: len(first)] and len(table) > 1 and all("." in word for word in table[1][1]):
            message = "0, 1, ... may be a point or the numbers of columns; write 0.0, or names x, y (and z)."
            raise ParseError(message, name, number)
    else:
        columns = _named(first, name, number)
        table = table[1:]
    return np.array([_row(words, columns, name, number) for number, words in table]).reshape(-1, len(columns))


def _cells(lines: list[tuple[int, str]], name: str) -> list[tuple[int, list[str]]]:
    """The cells of each numbered line, without quotation marks; all lines have the separator of the first one."""
    table: list[tuple[int, list[str]]] = []
    separator = next((sign for sign in ";," if lines and sign in lines[0][1]), "")
    for number, line in lines:
        words = [_unquoted(word) for word in (line.split(separator) if separator else line.split())]
        others = [sign for sign in ";," if sign != separator and sign in line]
        if separator and any(len(w.split()) > 1 and None not in map(number_in, w.split()) for w in words):
            others = [""]
        if others:
            message = f"has {_NAMES[others[0]]} next to {_NAMES[separator]}: {shown(line)}; use one separator"
            raise ParseError(f"{message}, and decimal points.", name, number)
        if table and len(words) != len(table[0][1]):
            raise ParseError(f"{len(words)} cells; the lines before have {len(table[0][1])}.", name, number)
        table.append((number, words))
    return table


def _unquoted(word: str) -> str:
    word = word.strip()
    return word[1:-1].strip() if len(word) > 1 and word[0] == word[-1] == '"' else word


def _row(words: list[str], columns: list[int], name: str, number: int) -> list[float]:
    row = [value for value in (number_in(words[k]) for k in columns) if value is not None]
    if len(row) < len(columns):
        raise ParseError(f"needs numbers; found {shown(' '.join(words))}.", name, number)
    return row


def _named(words: list[str], name: str, number: int) -> list[int]:
    """The columns of the coordinates in a header: x, y and z, also as in "X [mm]" or "//X"."""
    names = ["".join(re.findall("[a-z]+", word.lower())[:1]) for word in words]
    columns = [names.index(axis) for axis in _AXES if axis in names]
    if len(columns) < 2 or "y" not in names or any(names.count(axis) > 1 for axis in _AXES):
        message = f"needs numbers, or names with x, y (and z) once; found {shown(' '.join(words))}."
        raise ParseError(message, name, number)
    return columns


def number_in(word: str) -> float | None:
    """The number that a word is; None for other words."""
    # Python takes 1_0 and digits of other scripts for numbers.
    try:
        return float(word) if word.isascii() and "_" not in word else None
    except ValueError:
        return None
