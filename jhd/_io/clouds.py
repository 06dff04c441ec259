"""Point clouds: rows of coordinates in text (.xyz, .csv, .txt), a NumPy array (.npy), or the vertices of a PLY file.

A table (.csv, .txt) that could mean two things is refused with its line: decimal commas, two kinds of separators, lines
of different length, or further columns without a header that names the coordinates.
"""

import os
import re
from io import StringIO
from pathlib import Path

import numpy as np

from jhd._io.errors import ParseError, read_bytes, read_text, shown
from jhd._io.ply import read_ply
from jhd._shapes.curve import BezierSegments
from jhd._shapes.simple_curves import point_set

# Formats that hold only points; a .ply file may hold a mesh too.
CLOUD_SUFFIXES = (".xyz", ".csv", ".txt", ".npy")
_AXES = ("x", "y", "z")
_NAMES = {";": "semicolons", ",": "commas", "": "blanks"}


def load_points(file: str | Path) -> BezierSegments:
    r"""Load a point set from a text, NumPy or PLY file.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "cloud.npy")
    ...     np.save(file, [(0.0, 0, 0), (3, 4, 0)])
    ...     jhd.io.load_points(file)
    BezierSegments(2 points, in space, box (0, 0, 0) to (3, 4, 0))

    Args:
        file: a file with one of these suffixes. Text has one point per line, and comments start with #.

            - `.xyz`: numbers separated by spaces or commas, the first three of them coordinates
            - `.csv`, `.txt`: 2 or 3 columns separated by blanks, commas or semicolons. A first line may name the
              columns; columns other than x, y and z are then ignored.
            - `.npy`: an array (count, 2) or (count, 3)
            - `.ply`: vertices, without faces

    Returns:
        The points in the order of the file.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: a file that cannot be read, with the line; or a file without points or with faces.
    """
    suffix = Path(file).suffix.lower()
    reader = {".npy": _array, ".ply": _vertices, ".csv": _table, ".txt": _table}.get(suffix, _rows)
    rows = reader(str(file))
    try:
        return point_set(rows)
    except (TypeError, ValueError) as error:
        raise ParseError(str(error), str(file)) from None


def _array(file: str) -> np.ndarray:
    try:
        # Mapped, so that a file too short for its array is refused before memory is allocated.
        mapped = np.load(file, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # NumPy raises many kinds of errors for other bytes
        raise ParseError(f"not an array of numbers: {' '.join(str(error)[:200].split())}", file) from None
    end = mapped.offset + mapped.nbytes if isinstance(mapped, np.memmap) else None
    size = os.path.getsize(file)
    if end is not None and end != size:
        raise ParseError(f"byte {end}: {size - end} bytes follow the array.", file)
    return np.array(mapped)


def _vertices(file: str) -> np.ndarray:
    found = read_ply(file, read_bytes(file))
    if len(found.sizes):
        raise ParseError(f"holds {len(found.sizes)} faces; load_mesh reads the mesh.", file)
    return found.vertices


def _rows(file: str) -> np.ndarray:
    return rows_in(read_text(file), file)[:, :3]


def rows_in(text: str, name: str) -> np.ndarray:
    """The numbers of each line, (lines, numbers), separated by spaces or commas; text after # is ignored.

    Raises:
        ParseError: a word that is not a number, such as 0,5 among spaces or nothing between two commas, or a line with
            more or fewer numbers than the lines before; with the name and the line.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(StringIO(text, newline=None), start=1):
        words = _words(line.split("#")[0])
        if not words:
            continue
        row = [value for value in map(number_in, words) if value is not None]
        if len(row) < len(words):
            raise ParseError(f"needs numbers; found {shown(line.rstrip())}.", name, number)
        if rows and len(row) != len(rows[0]):
            raise ParseError(f"{len(row)} numbers; the lines before have {len(rows[0])}.", name, number)
        rows.append(row)
    return np.array(rows) if rows else np.empty((0, 3))


def _words(line: str) -> list[str]:
    """The numbers of a line, with empty words for nothing between commas; a last comma separates nothing."""
    words = line.split()
    if "," not in line or (len(words) > 1 and any("," in word.strip(",") for word in words)):
        # Among spaces, commas within words are decimal commas, and such words are not numbers.
        return words
    parts = " ".join(words).removesuffix(",").split(",")
    return [word for part in parts for word in part.split() or [""]]


def _table(file: str) -> np.ndarray:
    """The coordinates (points, 2 or 3) in a table whose columns are separated by blanks, commas or semicolons."""
    text = read_text(file)
    lines = ((k, line.split("#")[0].strip()) for k, line in enumerate(StringIO(text, newline=None), start=1))
    table = _cells([(number, line) for number, line in lines if line], file)
    if not table:
        return np.empty((0, 3))
    number, first = table[0]
    if any(number_in(word) is not None for word in first):
        columns = list(range(len(first)))
        if len(first) not in (2, 3):
            message = f"{len(first)} columns; needs 2 or 3, or a first line that names the columns x, y (and z)."
            raise ParseError(message, file, number)
        if first == ["0", "1", "2"][: len(first)] and len(table) > 1 and all("." in word for word in table[1][1]):
            message = "0, 1, ... may be a point or the numbers of columns; write 0.0, or names x, y (and z)."
            raise ParseError(message, file, number)
    else:
        columns = _named(first, file, number)
        table = table[1:]
    return np.array([_row(words, columns, file, number) for number, words in table]).reshape(-1, len(columns))


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
