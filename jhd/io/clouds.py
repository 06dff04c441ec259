"""Point clouds: rows of coordinates in text (.xyz) or as an array of NumPy (.npy)."""

from pathlib import Path

import numpy as np

from jhd.io.errors import ParseError
from jhd.shapes.curve import BezierSegments, points

CLOUD_SUFFIXES = (".xyz", ".npy")


def load_points(file: str | Path) -> BezierSegments:
    """The set of points that a file holds.

    Args:
        file: `NAME.xyz`, with a point in each line, numbers apart by spaces or commas, of which the first three are
            coordinates, and comments behind #; or `NAME.npy`, an array (count, 2) or (count, 3).

    Raises:
        FileNotFoundError: a file that does not exist.
        ParseError: a file that cannot be read, with the line, or that holds no points.
    """
    rows = _array(str(file)) if Path(file).suffix.lower() == ".npy" else _rows(str(file))
    try:
        return points(rows)
    except (TypeError, ValueError) as error:
        raise ParseError(str(error), str(file)) from None


def _array(file: str) -> np.ndarray:
    try:
        return np.load(file, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ParseError(f"no array of numbers: {error}", file) from None


def _rows(file: str) -> np.ndarray:
    rows: list[list[float]] = []
    for number, line in enumerate(Path(file).read_text(encoding="utf-8-sig").splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise ParseError(f"{error}.", file, number) from None
        if rows and len(row) != len(rows[0]):
            raise ParseError(f"{len(row)} numbers; the lines before have {len(rows[0])}.", file, number)
        rows.append(row)
    return np.array(rows)[:, :3] if rows else np.empty((0, 3))
