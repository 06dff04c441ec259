"""Conversion of the words of the command line to shapes, methods and points."""

import inspect
import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

import jhd
from jhd.distance.normalization.method import AbstractHausdorffMethod
from jhd.distance.project_methods import AbstractProjectionMethod
from jhd.distance.search.points import is_points
from jhd.io import load_shape
from jhd.io.clouds import rows_in
from jhd.io.errors import read_text
from jhd.io.load import SHAPE_SUFFIXES
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.polynomial_text import read as read_polynomial

# Classes that a projection can be asked for by, with their subclasses.
PROJECTIONS = (AbstractProjectionMethod, jhd.published.VertexVoxels)


def shapes_of(options: Namespace) -> tuple[Any, Any]:
    """Both shapes, of all kinds. With a box, a text that names no file, letter or path is read as a polynomial.

    Raises:
        ValueError: the box is invalid or there is no polynomial for it, or a text is no polynomial (with the column).
    """
    a, b = _read({"A": options.a, "B": options.b}, options.box)
    return a, b


def shape_of(options: Namespace) -> Any:
    """The shape of a command that takes one, read in the same way."""
    return _read({"SHAPE": options.shape}, options.box)[0]


def _read(texts: dict[str, str], box: list[float] | None) -> list[Any]:
    if box is None:
        return [_without_box(name, text) for name, text in texts.items()]
    if len(box) not in (2, 6):
        raise ValueError(f"--box has {len(box)} numbers; needs 2, or 6: three lower ends, then three upper ends.")
    lower, upper = np.array(box).reshape(2, -1)
    shapes = [_in_box(name, text, lower, upper) for name, text in texts.items()]
    if not any(isinstance(shape, ImplicitSurface) for shape in shapes):
        which = " nor ".join(texts)
        none = f"neither {which} is one" if len(texts) > 1 else f"{which} is not one"
        raise ValueError(f"--box is for implicit surfaces, and {none}; leave it out.")
    return shapes


def _in_box(name: str, text: str, lower: np.ndarray, upper: np.ndarray) -> Any:
    """The shape that a text names, or the implicit surface of the polynomial in the text."""
    try:
        return load_shape(text)
    except FileNotFoundError:
        if Path(text).suffix.lower() in SHAPE_SUFFIXES:
            raise
    return _surface(name, text, lower, upper)


def box_of(*shapes: Any) -> dict[str, Any]:
    """The box of the implicit surfaces among the shapes, for the context of a stored result."""
    surface = next((shape for shape in shapes if isinstance(shape, ImplicitSurface)), None)
    return {} if surface is None else {"box": [np.asarray(end).tolist() for end in surface.bounds]}


def check_writable(*files: str | None) -> None:
    """Raises ValueError if the folder of a file does not exist, before a long computation and not after it."""
    for file in files:
        if file and not Path(file).absolute().parent.is_dir():
            raise ValueError(f"{file}: no such folder.")


def kind_of(shape: Any) -> str:
    """The kind of a shape in words."""
    if is_points(shape):
        return "set of points"
    kinds = {AbstractCurve: "curve", TriangleMesh: "mesh", ImplicitSurface: "implicit surface"}
    return next((name for kind, name in kinds.items() if isinstance(shape, kind)), "parametric surface")


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
        try:
            read_polynomial(text)
        except ValueError:
            pass
        else:
            raise ValueError(f"{name} is a polynomial; give the box of its surface: --box LOWER UPPER.") from None
        raise


def _surface(name: str, text: str, lower: np.ndarray, upper: np.ndarray) -> ImplicitSurface:
    try:
        return ImplicitSurface.parse(text, np.broadcast_to(lower, 3), np.broadcast_to(upper, 3))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def method_of(name: str | None, atol: float | None, kind: Any) -> Any:
    """The method of this name, with the tolerance if one is given; without both the default method.

    Raises:
        ValueError: the name is unknown, or the method has no tolerance.
    """
    if name is None and atol is None:
        return jhd.BranchAndBound() if kind is AbstractHausdorffMethod else jhd.BestFirstProjection()
    if name is None and kind is AbstractHausdorffMethod:
        name = "BranchAndBound"
    known: dict[str, Any] = {
        key: item
        for key, item in {**vars(jhd), **vars(jhd.published)}.items()
        if inspect.isclass(item) and issubclass(item, kind)
    }
    chosen = known
    if name is not None:
        plain = name.replace("-", "").replace("_", "").lower()
        chosen = {key: item for key, item in known.items() if key.lower() == plain}
    if not chosen:
        raise ValueError(f"unknown method {name!r}; there are {', '.join(sorted(known))}.")
    if atol is None:
        return next(iter(chosen.values()))()
    tolerant = {key: item for key, item in chosen.items() if "atol" in inspect.signature(item).parameters}
    if not tolerant:
        raise ValueError(f"--atol: {' and '.join(chosen)} proves no bounds to a tolerance; leave it out.")
    if len(tolerant) > 1:
        raise ValueError(f"--atol needs --method, one of {', '.join(tolerant)}.")
    return next(iter(tolerant.values()))(atol=atol)


def method_name(method: Any) -> str:
    """The name of the class of a method."""
    return type(method).__name__


def points_of(options: Namespace) -> np.ndarray:
    """Points from the command line, a file, or standard input, in rows of numbers separated by spaces or commas."""
    if options.coordinates and options.points:
        raise ValueError("give the point as X Y [Z] or with --points, not both.")
    if options.coordinates:
        return np.array([options.coordinates])
    name = options.points or "-"
    if name == "-" and sys.stdin.isatty():
        raise ValueError("there is no point; give X Y [Z], --points FILE, or rows on standard input.")
    rows = rows_in(sys.stdin.read() if name == "-" else read_text(name), name)
    if not len(rows):
        raise ValueError(f"{name} holds no points.")
    return rows
