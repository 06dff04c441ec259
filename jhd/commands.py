"""What the commands of the command line do: each takes the parsed options, prints, and returns the exit status.

Numbers are printed in full, so that a bound that is read back is still the bound that was proven.
"""

import inspect
import json
import os
import platform
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jhd
from jhd.distance.method import AbstractHausdorffMethod
from jhd.distance.projection import AbstractProjectionMethod
from jhd.io import load_certificate, load_shape, save_curve, write_svg
from jhd.report import (
    check_picture_file,
    names_of,
    picture,
    progress_text,
    shape_line,
    solution_text,
    successful,
    surface_picture,
)
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.polynomial_text import read as read_polynomial
from jhd.solution import HausdorffSolution, name_of, to_plain

_DEMO_FONTS = {"Sans": "DejaVu Sans", "Serif": "DejaVu Serif"}
_DEMO_LETTER = "a"
_DEMO_FILE = "jhd-demo.png"
_PACKAGES = "jax", "jaxlib", "equinox", "optimistix", "numpy", "matplotlib"


def demo(options: Namespace) -> int:
    """Both directed distances between one letter in two fonts, in print and as a picture."""
    specs = [f"font:{font}:{_DEMO_LETTER}" for font in _DEMO_FONTS.values()]
    a, b = (load_shape(spec) for spec in specs)
    print(f"The letter {_DEMO_LETTER} in two fonts, in font units\n")
    print(shape_line("A", specs[0], a), shape_line("B", specs[1], b), sep="\n", end="\n\n")

    def both() -> list[HausdorffSolution]:
        return [jhd.directed_hausdorff(a, b, throw=False), jhd.directed_hausdorff(b, a, throw=False)]

    with _busy("computing; the first run compiles"):
        (there, back), first = _timed(both)
        _, again = _timed(both)
    print(solution_text("directed distance from A to B", there, "A", "B"), end="\n\n")
    print(solution_text("directed distance from B to A", back, "B", "A"), end="\n\n")
    larger, name = max((there, "from A to B"), (back, "from B to A"), key=lambda pair: float(pair[0]))
    print(f"Hausdorff distance, the larger of the two: {float(larger)!r} {name}")
    print(f"time       {first:.2f} s with compilation, {again:.3f} s once compiled (both directions)")
    print(f"device     {_device()}, {_precision()}")
    with _busy("drawing"):
        picture(_DEMO_FILE, a, b, (there, back), list(_DEMO_FONTS), "font units")
    print(f"picture    {Path(_DEMO_FILE).resolve()}")
    return _status(there, back)


def distance(options: Namespace) -> int:
    """The Hausdorff distance of two curves or of two surfaces, or the directed one."""
    a, b = _shapes(options)
    surfaces = isinstance(a, ImplicitSurface)
    entry = jhd.directed_hausdorff if options.directed else jhd.hausdorff
    method = _method(options.method, options.atol, AbstractHausdorffMethod)
    if options.plot:
        check_picture_file(options.plot)
    if options.certificate and surfaces:
        raise ValueError("--certificate: certificates are for curves; leave it out.")
    if options.certificate and not Path(options.certificate).absolute().parent.is_dir():
        raise ValueError(f"{options.certificate}: no such folder.")
    with _busy("computing; a first run compiles") as show:
        solution, seconds = _timed(lambda: entry(a, b, method, throw=False, progress=show))
    if name_of(solution.result) == "interrupted":
        print(solution_text("the bounds reached", solution, *names_of(solution)))
        return 1
    if options.plot:
        with _busy("drawing"):
            _draw(options.plot, a, b, solution, method)
    written = bool(options.certificate) and _certified(options.certificate, a, b, solution)
    status = 1 if options.certificate and not written else _status(solution)
    if options.json:
        asked = {"a": options.a, "b": options.b, "directed": options.directed, "method": _method_name(method)}
        box = {"box": [np.asarray(end).tolist() for end in a.box()]} if surfaces else {}
        _print_json(solution, **asked, **box, seconds=seconds)
        return status
    print(shape_line("A", options.a, a), shape_line("B", options.b, b), sep="\n", end="\n\n")
    title = "directed distance from A to B" if options.directed else "Hausdorff distance"
    print(solution_text(title, solution, *names_of(solution)), end="\n\n")
    print(f"method     {_method_name(method)}")
    print(f"time       {seconds:.2f} s with compilation")
    print(f"device     {_device()}, {_precision()}")
    if options.plot:
        print(f"picture    {Path(options.plot).resolve()}")
    if written:
        print(f"proof      {Path(options.certificate).resolve()}")
    return status


def fit(options: Namespace) -> int:
    """An outline by few segments of a degree, within a tolerance; its proven distance."""
    target = load_shape(options.target)
    if options.out and Path(options.out).suffix not in (".svg", ".json"):
        raise ValueError(f"{options.out}: the name must end in .svg or .json.")
    for file in (options.out, options.plot):
        if file and not Path(file).absolute().parent.is_dir():
            raise ValueError(f"{file}: no such folder.")
    if options.plot:
        check_picture_file(options.plot)
    start = time.perf_counter()
    with _busy("fitting; a first run compiles"):
        contours = jhd.fit_outline(target, options.tolerance, degree=options.degree, smooth=options.smooth)
        shape = jhd.BezierSegments.join([contour.shape for contour in contours])
        error = jhd.hausdorff(target, shape, throw=False)
    seconds = time.perf_counter() - start
    near = float(error.upper) <= options.tolerance
    if options.out:
        write = write_svg if options.out.endswith(".svg") else save_curve
        write(options.out, shape)
    if options.plot:
        with _busy("drawing"):
            pairs = ((target, shape), (shape, target))
            picture(options.plot, target, shape, [jhd.directed_hausdorff(*pair, throw=False) for pair in pairs])
    if options.json:
        asked = {"target": options.target, "tolerance": options.tolerance, "degree": options.degree}
        _print_json(error, **asked, within=near, segments=[c.shape.count for c in contours], seconds=seconds)
        return 0 if near else 1
    print(shape_line("A", options.target, target), shape_line("B", "fit", shape), sep="\n", end="\n\n")
    print(solution_text("Hausdorff distance", error, *names_of(error)), end="\n\n")
    print(f"within     {options.tolerance:g}" if near else f"farther than {options.tolerance:g}")
    print(f"time       {seconds:.2f} s with compilation")
    for name, file in (("fit", options.out), ("picture", options.plot)):
        if file:
            print(f"{name:<10} {Path(file).resolve()}")
    return 0 if near else 1


def verify(options: Namespace) -> int:
    """Checks a certificate in exact arithmetic and prints what it proves."""
    start = time.perf_counter()
    try:
        certificate = load_certificate(options.file)
        proven = certificate.verify()
    except jhd.CertificateError as error:
        print(f"jhd: refused: {options.file}: {error}", file=sys.stderr)
        return 1
    seconds = time.perf_counter() - start
    if options.json:
        print(json.dumps({"proven": proven._asdict(), "seconds": seconds}, indent=2))
        return 0
    name = "h(A, B)" if certificate.directed else "H(A, B)"
    upper = "" if proven.upper is None else f" <= {proven.upper!r}"
    plural = "" if proven.cells == 1 else "s"
    print(f"proven: {proven.lower!r} <= {name}{upper}, {proven.cells} cell{plural}, checked exactly in {seconds:.3f} s")
    return 0


def project(options: Namespace) -> int:
    """The nearest points of a curve to given points, one row each."""
    shape = load_shape(options.shape)
    points = _points(options)
    if points.shape[1] != shape.segments().dim:
        raise ValueError(f"a point has {points.shape[1]} coordinates; the curve has {shape.segments().dim}.")
    method = _method(options.method, None, AbstractProjectionMethod)
    with _busy("computing; a first run compiles"):
        found = jhd.project(points, shape, method=method, throw=False)
    if options.json:
        _print_json(found, shape=options.shape, points=points.tolist(), method=_method_name(method))
        return _status(found)
    columns = [
        "distance",
        "lower",
        "upper",
        "segment",
        "t",
        *(f"foot {axis}" for axis in "xyz"[: points.shape[1]]),
        "result",
    ]
    print("\t".join(columns))
    rows = [found.distance, found.lower, found.upper, found.segment, found.t, found.foot]
    for *numbers, foot, result in zip(*map(np.asarray, rows), to_plain(found.result), strict=True):
        print("\t".join([*(repr(x.item()) for x in (*numbers, *foot)), result]))
    return _status(found)


def doctor(options: Namespace) -> int:
    """Versions, devices, precision, compile cache, and one distance with a known answer."""
    facts = {
        "jhd": jhd.__version__,
        "python": f"{platform.python_version()} on {platform.platform()}",
        **{name: _version(name) for name in _PACKAGES},
        "devices": ", ".join(str(device) for device in jax.devices()) + f" ({jax.default_backend()})",
        "precision": _precision(),
        "compile cache": _cache(),
    }
    # The diagonal of a rectangle 4 by 3 against its base: the upper corner is 3 away, every other point less.
    base, diagonal = jhd.polyline([(0.0, 0.0), (4.0, 0.0)]), jhd.polyline([(0.0, 0.0), (4.0, 3.0)])
    solution = jhd.hausdorff(base, diagonal, throw=False)
    good = bool(float(solution.lower) <= 3.0 <= float(solution.upper)) and abs(float(solution) - 3.0) <= 1e-5
    facts["self-check"] = f"{'passed' if good else 'FAILED'}: the distance is 3, found {float(solution)!r}"
    if options.json:
        print(json.dumps({**facts, "passed": good}, indent=2))
    else:
        width = max(map(len, facts))
        print("\n".join(f"{name:<{width}}  {fact}" for name, fact in facts.items()))
    return 0 if good else 1


def _shapes(options: Namespace) -> tuple[Any, Any]:
    """Both curves, or where there is a box both surfaces.

    Raises:
        ValueError: a box that is none, or text that is no polynomial, with the column.
    """
    texts = {"A": options.a, "B": options.b}
    if options.box is None:
        return tuple(_curve(name, text) for name, text in texts.items())  # pyright: ignore[reportReturnType]
    if len(options.box) not in (2, 6):
        raise ValueError(
            f"--box has {len(options.box)} numbers; needs 2, or 6: three lower ends, then three upper ones."
        )
    lower, upper = np.array(options.box).reshape(2, -1)
    return tuple(_surface(name, text, lower, upper) for name, text in texts.items())  # pyright: ignore


def _curve(name: str, text: str) -> AbstractCurve:
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


def _draw(file: str, a: Any, b: Any, solution: HausdorffSolution, method: Any) -> None:
    """The picture of a distance: of curves with both directions, unless only one was asked for."""
    if isinstance(a, ImplicitSurface):
        surface_picture(file, a, b, solution)
        return
    pairs = [(a, b)] if solution.directed else [(a, b), (b, a)]
    picture(file, a, b, [jhd.directed_hausdorff(*pair, method, throw=False) for pair in pairs])


def _certified(file: str, a: AbstractCurve, b: AbstractCurve, solution: HausdorffSolution) -> bool:
    """Writes the certificate of the solution; False, after a line on stderr, where its bounds could not be proven."""
    try:
        with _busy("certifying"):
            certificate = jhd.certify(a, b, solution)
    except jhd.NotProvenError as error:
        print(f"jhd: no certificate: {error}", file=sys.stderr)
        return False
    certificate.save(file)
    return True


def _method(name: str | None, atol: float | None, kind: Any) -> Any:
    """The method of that name, with the tolerance if there is one; the default of the entries without both.

    Raises:
        ValueError: an unknown name, or a tolerance for a method that has none.
    """
    if name is None and atol is None:
        return jhd.BranchAndBound() if kind is AbstractHausdorffMethod else jhd.NearestSearch()
    if name is None and kind is AbstractHausdorffMethod:
        name = "BranchAndBound"
    known: dict[str, Any] = {
        key: item for key, item in vars(jhd).items() if inspect.isclass(item) and issubclass(item, kind)
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


def _method_name(method: Any) -> str:
    return type(method).__name__


def _points(options: Namespace) -> np.ndarray:
    """The points of the command line, of the file, or of standard input; rows of numbers apart by spaces or commas."""
    if options.coordinates and options.points:
        raise ValueError("give the point as X Y [Z] or by --points, not both.")
    if options.coordinates:
        return np.array([options.coordinates])
    name = options.points or "-"
    if name == "-" and sys.stdin.isatty():
        raise ValueError("no point: give X Y [Z], --points FILE, or rows on standard input.")
    text = sys.stdin.read() if name == "-" else Path(name).read_text(encoding="utf-8-sig")
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise ValueError(f"{name}:{number}: {error}.") from None
        if rows and row and len(row) != len(rows[0]):
            raise ValueError(f"{name}:{number}: {len(row)} coordinates; the rows before have {len(rows[0])}.")
        rows += [row] if row else []
    if not rows:
        raise ValueError(f"{name} holds no points.")
    return np.array(rows)


def _print_json(solution: Any, **context: Any) -> None:
    """Prints the result as `jhd.io.save_result` writes it, so that `jhd.io.load_result` reads it."""
    context |= {"version": jhd.__version__, "device": _device(), "precision": _precision()}
    content = {"type": type(solution).__name__, "solution": to_plain(solution), "context": context}
    print(json.dumps(content, indent=2, allow_nan=False))


def _status(*solutions: Any) -> int:
    return 0 if all(successful(solution) for solution in solutions) else 1


def _timed(action: Callable[[], Any]) -> tuple[Any, float]:
    """What the action returns, when all of it has been computed, and the seconds that took."""
    start = time.perf_counter()
    value = jax.block_until_ready(action())
    return value, time.perf_counter() - start


@contextmanager
def _busy(message: str) -> Iterator[Callable[[Any], None]]:
    """Shows the message while the block runs, and the progress handed to what it yields; on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return

    def show(text: str) -> None:
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    show(f"{message} ...")
    try:
        yield lambda progress: show(progress_text(progress))
    finally:
        show("")


def _device() -> str:
    return jax.devices()[0].device_kind


def _precision() -> str:
    return "float64" if jax.config.jax_enable_x64 else "float32"  # pyright: ignore[reportAttributeAccessIssue]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _cache() -> str:
    """The folder of compiled programs and what it holds."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if not folder:
        return "off"
    try:
        sizes = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file()]
    except OSError:
        return f"{folder} (not there yet)"
    return f"{folder} ({sum(sizes) / 1e6:.1f} MB in {len(sizes)} files)"
