"""Certificates: bounds of a Hausdorff distance together with what proves them, to be checked by anyone later.

`certify` makes one from the curves and a solution, on the host and in a way of its own: cells cover the curves breadth
first (jhd.distance.certificate.covering), and the lower bound is proven at one place. What it returns has been checked
exactly while it was made; `Certificate.verify` checks all of it again, by jhd.distance.certificate.verification alone.
"""

import gzip
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jhd.arrays import is_traced
from jhd.distance.certificate.covering import Measure, UncoveredError, cover
from jhd.distance.certificate.curve_witness import witness_of
from jhd.distance.certificate.host import host, plain_shape
from jhd.distance.certificate.verification.first_version import current
from jhd.distance.certificate.verification.proofs import Proven, verify
from jhd.distance.certificate.verification.reading import lines_of
from jhd.distance.certificate.verification.structure import FORMAT, KINDS, VERSION, check_content
from jhd.distance.frame.curves import prepare
from jhd.files import replace_file
from jhd.shapes.as_shape import taken_as
from jhd.shapes.curve import AbstractCurve, check_curve
from jhd.solution import HausdorffSolution, NotProvenError


@dataclass(frozen=True, repr=False)
class Certificate:
    """A claim lower <= distance <= upper about two curves, with what proves it.

    Args:
        content: the JSON object: `format`, `version`, the arrays `a` and `b`, the `claim`, `cells` and the `witness`.

    Raises:
        CertificateError: the content has another structure. Whether it proves its claim is left to `verify`.
    """

    content: dict[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "content", current(self.content))
        check_content(self.content)

    @property
    def lower(self) -> float:
        """The claimed lower bound."""
        return float(self.content["claim"]["lower"])

    @property
    def upper(self) -> float:
        """The claimed upper bound; inf where none is claimed."""
        upper = self.content["claim"]["upper"]
        return math.inf if upper is None else float(upper)

    @property
    def directed(self) -> bool:
        """Whether the claim is about the distance from a to b alone."""
        return self.content["claim"]["kind"] == "directed"

    @property
    def cells(self) -> int:
        """Number of cells that prove the upper bound."""
        return sum(map(len, (self.content["cells"] or {}).values()))

    def __repr__(self) -> str:
        name = "h(A, B)" if self.directed else "H(A, B)"
        return f"Certificate({self.lower!r} <= {name} <= {self.upper!r}, {self.cells} cells)"

    def verify(self) -> Proven:
        """Checks every number in exact arithmetic, without anything of the search.

        Returns:
            What is proven.

        Raises:
            CertificateError: a part of the claim is not proven; it says which.
        """
        return verify(self.content)

    def matches(self, a: AbstractCurve, b: AbstractCurve) -> bool:
        """Whether the claim is about these curves: the same control points and weights, to the last digit."""
        return [self.content[name] for name in ("a", "b")] == [plain_shape(shape) for shape in (a, b)]

    def to_json(self) -> str:
        """The certificate as lines of JSON, a line for each cell; the same floats are read back."""
        return "".join(lines_of(self.content))

    def save(self, file: str | Path) -> None:
        """Writes the certificate, as a whole or not at all; compressed where the name ends in .gz."""
        text = self.to_json()
        replace_file(file, gzip.compress(text.encode(), mtime=0) if str(file).endswith(".gz") else text)


def certify(
    a: Any,
    b: Any,
    solution: HausdorffSolution,
    *,
    max_cells: int = 100_000,
    progress: Callable[[dict[str, Any]], None] | None = None,
) -> Certificate:
    """A certificate of the bounds of a solution.

    An upper bound of inf and a lower bound of 0, where a method proves none, are not claimed or need no proof.

    Args:
        a: the first curve of the distance, as it was handed in.
        b: the second one.
        solution: what directed_hausdorff or hausdorff returned for them: one, not a batch.
        max_cells: most cells in one direction. A smooth segment takes a handful, more where b is far from smooth.
        progress: called with a dictionary of `direction`, `cells` and `open` after each generation of cells.

    Returns:
        The certificate; every bound of it has been checked in exact arithmetic.

    Raises:
        TypeError: a shape or solution of another kind, a traced one or a batch.
        ValueError: curves of different dimensions, or max_cells that is no positive whole number.
        NotProvenError: a bound of the solution could not be proven of these curves, or takes more cells.
    """
    a, b = taken_as("a", a), taken_as("b", b)
    _check_arguments(a, b, solution, max_cells)
    x, y = a.segments(), b.segments()
    p, q, frame = prepare(x, y)
    first, second = host(x, frame), host(y, frame)
    measures = {"a_to_b": Measure(first, second, q), "b_to_a": Measure(second, first, p)}
    kind = "directed" if solution.directed else "two_sided"
    lower, upper = float(solution.lower), float(solution.upper)
    cells: dict[str, Any] | None = {} if math.isfinite(upper) else None
    for direction in KINDS[kind] if cells is not None else ():
        try:
            found = cover(measures[direction], upper, frame, max_cells, _reporting(progress, direction))
        except UncoveredError as error:
            raise NotProvenError(f"The upper bound {upper!r} is not proven, {direction}: {error}", solution) from error
        cells = {**(cells or {}), direction: found}
    witness = None
    if lower > 0:
        witness = witness_of(solution, {name: measures[name] for name in KINDS[kind]}, frame)
    claim = {"kind": kind, "lower": lower, "upper": upper if math.isfinite(upper) else None}
    curves = {"a": plain_shape(x), "b": plain_shape(y)}
    content = {"format": FORMAT, "version": VERSION, "claim": claim, **curves, "cells": cells, "witness": witness}
    return Certificate(content)


def _check_arguments(a: object, b: object, solution: object, max_cells: object) -> None:
    check_curve("a", a)
    check_curve("b", b)
    if not isinstance(solution, HausdorffSolution):
        raise TypeError(f"solution must be a HausdorffSolution; got {type(solution).__name__}.")
    if is_traced(a, b, solution) or np.ndim(solution.value) > 0:
        raise TypeError("certify needs concrete curves and one concrete solution; index a batch first.")
    if not isinstance(max_cells, int) or isinstance(max_cells, bool) or max_cells < 1:
        raise ValueError(f"max_cells is {max_cells!r}; needs a positive whole number.")
    dims = [shape.segments().dim for shape in (a, b) if isinstance(shape, AbstractCurve)]
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates a point and b has {dims[1]}; needs the same.")


def _reporting(progress: Callable[[dict[str, Any]], None] | None, direction: str) -> Callable[[int, int], None]:
    def report(proven: int, left: int) -> None:
        if progress is not None:
            progress({"direction": direction, "cells": proven, "open": left})

    return report
