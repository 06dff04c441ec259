"""Conversion of the words of the command line to shapes, methods and points."""

import inspect
import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jhd
from jhd._distance.normalization.method import AbstractHausdorffMethod
from jhd._distance.project_methods import AbstractProjectionMethod
from jhd._distance.search.bodies import body_of
from jhd._io.clouds import load_points, rows_in
from jhd._io.errors import read_text
from jhd._io.load import SHAPE_SUFFIXES
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.polynomial_text import read as read_polynomial
from jhd.io import load_shape

# Classes that a projection can be asked for by, with their subclasses.
PROJECTIONS = (AbstractProjectionMethod, jhd.published.VertexVoxels)


def shapes_of(options: Namespace) -> tuple[Any, Any]:
    """Both shapes, of all kinds. With a box, a text that names no file, letter or path is read as a polynomial.

    Raises:
        ValueError: the box is invalid or there is no polynomial for it, or a text is no polynomial (with the column).
    """
    a, b = read_shapes({"A": options.a, "B": options.b}, options.box)
    return a, b


def shape_of(options: Namespace) -> Any:
    """The shape of a command that takes one, read in the same way."""
    return read_shapes({"SHAPE": options.shape}, options.box)[0]


def read_shapes(texts: dict[str, str], box: list[float] | None) -> list[Any]:
    """The shapes that texts name, by the names that errors use."""
    shapes = [read_shape(name, text, box) for name, text in texts.items()]
    check_box(
        box,
        shapes,
        f"neither {' nor '.join(texts)} is one" if len(texts) > 1 else f"{min(texts, default='no shape')} is not one",
    )
    return shapes


def read_shape(name: str, text: str, box: list[float] | None) -> Any:
    """The shape that a text names, or with a box the implicit surface of the polynomial in the text."""
    if box is None:
        return _without_box(name, text)
    if len(box) not in (2, 6):
        raise ValueError(f"--box has {len(box)} numbers; needs 2, or 6: three lower ends, then three upper ends.")
    try:
        return load_shape(text)
    except FileNotFoundError:
        if Path(text).suffix.lower() in SHAPE_SUFFIXES:
            raise
    lower, upper = np.array(box).reshape(2, -1)
    return _surface(name, text, lower, upper)


def check_box(box: list[float] | None, shapes: Sequence[Any], otherwise: str) -> None:
    """Raise ValueError if there is a box but no implicit surface for it."""
    if box is not None and not any(isinstance(shape, ImplicitSurface) for shape in shapes):
        raise ValueError(f"--box is for implicit surfaces, and {otherwise}; leave it out.")


def is_polynomial(text: str) -> bool:
    """Whether a text is a polynomial in x, y and z."""
    try:
        read_polynomial(text)
    except ValueError:
        return False
    return True


def box_of(*shapes: Any) -> dict[str, Any]:
    """The box of the implicit surfaces among the shapes, for the context of a stored result."""
    surface = next((shape for shape in shapes if isinstance(shape, ImplicitSurface)), None)
    return {} if surface is None else {"box": [np.asarray(end).tolist() for end in surface.bounds]}


def check_writable(file: str | None, *suffixes: str) -> None:
    """Raise ValueError if a file cannot have this name, before a long computation and not after it.

    Args:
        file: the name; None for no file.
        suffixes: suffixes that the name may have; none for any.
    """
    if file and suffixes and Path(file).suffix.lower() not in suffixes:
        raise ValueError(f"{file}: the name must end in {' or '.join(suffixes)}.")
    if file and not Path(file).absolute().parent.is_dir():
        raise ValueError(f"{file}: no such folder.")


def check_picture(file: str) -> None:
    """Raise ValueError if a picture cannot have this name."""
    from matplotlib.figure import Figure

    formats = Figure().canvas.get_supported_filetypes()
    suffix = Path(file).suffix
    if suffix.removeprefix(".").lower() not in formats:
        raise ValueError(f"{file}: the suffix is {suffix!r}; pictures are stored as {', '.join(formats)}.")
    check_writable(file)


def kind_of(shape: Any) -> str:
    """The kind of a shape in words."""
    return body_of(shape).name


def curve_of(name: str, text: str) -> AbstractCurve:
    """The curve that a text names.

    Raises:
        TypeError: the shape is no curve.
    """
    shape = load_shape(text)
    if not isinstance(shape, AbstractCurve):
        raise TypeError(f"{name} is a {kind_of(shape)}; needs a curve.")
    return shape


def _without_box(name: str, text: str) -> Any:
    try:
        return load_shape(text)
    except FileNotFoundError:
        if is_polynomial(text):
            raise ValueError(f"{name} is a polynomial; give the box of its surface: --box LOWER UPPER.") from None
        raise


def _surface(name: str, text: str, lower: np.ndarray, upper: np.ndarray) -> ImplicitSurface:
    try:
        return ImplicitSurface.parse(text, np.broadcast_to(lower, 3), np.broadcast_to(upper, 3))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def method_of(name: str, kind: Any) -> Any:
    """The class of the method of this name, in any spelling of capitals, hyphens and underscores.

    Raises:
        ValueError: the name is unknown.
    """
    known = {
        key: item
        for key, item in {**vars(jhd), **vars(jhd.published)}.items()
        if inspect.isclass(item) and issubclass(item, kind)
    }
    plain = name.replace("-", "").replace("_", "").lower()
    chosen = next((item for key, item in known.items() if key.lower() == plain), None)
    if chosen is None or inspect.isabstract(chosen):
        raise ValueError(f"unknown method {name!r}; there are {', '.join(sorted(known))}.")
    return chosen


def search_of(options: Namespace, *shapes: Any) -> Any:
    """The method of a search with its tolerances, from --method, --rtol and --atol.

    Raises:
        ValueError: the name is unknown, or the method takes no tolerance.
    """
    chosen = method_of(getattr(options, "method", None) or "BranchAndBound", AbstractHausdorffMethod)
    given = tolerances_of(options, *shapes)
    named = [f"--{name}" for name, value in given.items() if value is not None]
    if chosen is jhd.BranchAndBound:
        return chosen(atol=given["atol"], rtol=given["rtol"] or 0.0)
    if named:
        raise ValueError(f"{' and '.join(named)}: {chosen.__name__} takes no tolerance; leave it out.")
    return chosen()


def tolerances_of(options: Namespace, *shapes: Any) -> dict[str, float | None]:
    """The values of --rtol and of --atol in input units, None for each that is not given."""
    return {"rtol": options.rtol, "atol": None if options.atol is None else options.atol.of(*shapes)}


def points_of(options: Namespace) -> np.ndarray:
    """Points from the command line, a file, or standard input, in rows of numbers separated by spaces or commas."""
    if options.coordinates and options.points:
        raise ValueError("give the point as X Y [Z] or with --points, not both.")
    if options.coordinates:
        return np.array([options.coordinates])
    name = options.points or "-"
    if name == "-" and sys.stdin.isatty():
        raise ValueError("there is no point; give X Y [Z], --points FILE, or rows on standard input.")
    if Path(name).suffix.lower() in (".csv", ".txt", ".npy"):
        return np.asarray(load_points(name).control_points[:, 0])
    try:
        rows = rows_in(sys.stdin.read() if name == "-" else read_text(name), name)
    except UnicodeDecodeError as error:
        raise ValueError(f"standard input: byte {error.start} is not UTF-8 text.") from None
    if not len(rows):
        raise ValueError(f"{name} holds no points.")
    return rows
