"""Certificates: bounds of a distance together with their proof, which anyone can check later.

`certify` makes a certificate from the shapes and a solution, on the host, independently of the search. Cells cover the
shapes (see jhd._distance.certificate.subdivision, and surface_cover for pairs with an implicit surface), and one point
proves the lower bound. The certificate is checked exactly while it is made. `Certificate.verify` checks everything
again, with jhd._distance.certificate.verification alone.
"""

import gzip
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jhd._distance.certificate.mixed_pairs import Report, asked_of, prove_largest, prove_minimum
from jhd._distance.certificate.sides import plain_shape
from jhd._distance.certificate.verification.proofs import NAMES, Proven
from jhd._distance.certificate.verification.proofs import verify as checked
from jhd._distance.certificate.verification.reading import lines_of
from jhd._distance.certificate.verification.structure import FORMAT, VERSION, check_content, digest
from jhd._distance.certificate.verification.values import LARGEST, LARGEST_IN_ALL
from jhd._distance.search.bodies import diagonal_of
from jhd._results.solution import Decision, HausdorffSolution, MinimumSolution
from jhd._results.unproven import NotProvenError
from jhd._runtime.arrays import is_traced
from jhd._runtime.clock import Clock
from jhd._runtime.decimals import lower_text, upper_text
from jhd._runtime.files import replace_file
from jhd._shapes.as_shape import Shape, ShapeLike, taken_as
from jhd._shapes.checks import check_same_dim
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd.progress import Callback, Progress

_KINDS = (
    "points, a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an ImplicitSurface or a "
    "TriangleMesh"
)


@dataclass(frozen=True, repr=False)
class Certificate:
    """A claim lower <= distance <= upper about two shapes, with its proof.

    Args:
        content: the JSON object: `format`, `version`, the arrays `a` and `b`, the `claim`, `cells` and the `witness`.

    Raises:
        CertificateError: the content has another structure. `verify` checks whether it proves its claim.
    """

    content: dict[str, object]

    def __post_init__(self) -> None:
        check_content(self.content)

    def _part(self, name: str) -> Any:
        return self.content[name]

    @property
    def lower(self) -> float:
        """The claimed lower bound."""
        return float(self._part("claim")["lower"])

    @property
    def upper(self) -> float:
        """The claimed upper bound; inf if none is claimed."""
        upper = self._part("claim")["upper"]
        return math.inf if upper is None else float(upper)

    @property
    def directed(self) -> bool:
        """Whether the claim is about the distance from `a` to `b` only."""
        return self._part("claim")["kind"] == "directed"

    @property
    def cells(self) -> int:
        """Number of cells that prove the upper bound; for a minimum distance, of pairs that prove the lower bound."""
        return sum(map(len, (self._part("cells") or {}).values()))

    def __repr__(self) -> str:
        name = NAMES[self._part("claim")["kind"]]
        return f"Certificate({lower_text(self.lower)} <= {name} <= {upper_text(self.upper)}, {self.cells} cells)"

    def verify(self, max_seconds: float | None = None, progress: Callback | None = None) -> Proven:
        """Check the whole proof in exact arithmetic, without any result of the search.

        Args:
            max_seconds: time limit in seconds; by default none.
            progress: a function that is called with a Progress, whose stage names the next part of the certificate.

        Returns:
            A Proven: the bounds that are proven.

        Raises:
            CertificateError: a part of the claim is not proven, or the check takes too long. The message names the
                part.
            ValueError: `max_seconds` is not a positive number.
        """
        return verify(self.content, max_seconds=max_seconds, progress=progress)

    def matches(self, a: ShapeLike, b: ShapeLike) -> bool:
        """Whether the claim is about these shapes: their stored arrays must be identical to the last bit.

        Args:
            a: the first shape, or an object that `jhd.as_shape` accepts.
            b: the second shape, or an object that `jhd.as_shape` accepts.

        Returns:
            True if both shapes match.
        """
        shapes = (plain_shape(taken_as(name, shape)) for name, shape in (("a", a), ("b", b)))
        return all(digest(self._part(name)) == shape["sha256"] for name, shape in zip("ab", shapes, strict=True))

    def to_dict(self) -> dict[str, object]:
        """The certificate as a dictionary, as in `content`."""
        return dict(self.content)

    def to_json(self) -> str:
        """The certificate as JSON Lines: an object with the numbers of cells, then one line for each cell.

        `jhd.io.load_certificate` reads a file with this text and restores all floats exactly.
        """
        return "".join(lines_of(self.content))

    def save(self, file: str | Path) -> None:
        """Write the certificate to a file, completely or not at all; compressed if the name ends in .gz.

        Args:
            file: the path of the file, which is replaced if it exists.

        Returns:
            None.
        """
        text = self.to_json()
        replace_file(file, gzip.compress(text.encode(), mtime=0) if str(file).endswith(".gz") else text)


def verify(
    content: Certificate | Mapping[str, object], *, max_seconds: float | None = None, progress: Callback | None = None
) -> Proven:
    """Check a certificate completely in exact arithmetic, and return the bounds that it proves.

    `jhd verify proof.json` does the same for a file. The checker needs only Python's standard library: without JAX, run
    `python jhd/_distance/certificate/verification proof.json` in a clone.

    >>> import jhd
    >>> a, b = jhd.point_set([(0, 0), (4, 0)]), jhd.point_set([(0, 0)])
    >>> proven = jhd.verify(jhd.certify(a, b, jhd.directed_hausdorff(a, b)))
    >>> proven.kind, bool(proven.lower <= 4 <= proven.upper)
    ('directed', True)

    Args:
        content: a Certificate, or its `content`, a dictionary whose lists of cells may be any iterables. To check that
            it belongs to given shapes, use `certificate.matches(a, b)`.
        max_seconds: time limit in seconds; by default none. The check ends before the first cell if the number of cells
            and the degrees show that it would take longer.
        progress: a function that is called with a Progress, whose stage names the next part of the certificate.

    Returns:
        A Proven: the kind of distance, and its proven bounds.

    Raises:
        CertificateError: something is missing, invalid or not proven, or the check takes too long. The message names
            it.
        ValueError: `max_seconds` is not a positive number.
    """
    done = itertools.count()
    told = None if progress is None else lambda place: progress(Progress(place, next(done)))
    return checked(content, max_seconds, told)


def certify(
    a: ShapeLike,
    b: ShapeLike,
    solution: HausdorffSolution | MinimumSolution | Decision,
    *,
    directed: bool = False,
    slack: float | None = None,
    max_cells: int = 100_000,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> Certificate:
    """A certificate of the bounds of a solution, which can be saved and checked independently.

    An upper bound of inf is not claimed, and a lower bound of 0 needs no proof. The certified bounds may be slightly
    wider than the bounds of the solution (see `slack`); the certificate states them. Shapes that coincide up to
    rounding need very many cells: choose a larger `slack`.

    >>> import jhd
    >>> a, b = jhd.point_set([(0, 0), (4, 0)]), jhd.point_set([(0, 0)])
    >>> certificate = jhd.certify(a, b, jhd.directed_hausdorff(a, b))
    >>> proven = certificate.verify()
    >>> bool(proven.lower <= 4 <= proven.upper), certificate.matches(a, b)
    (True, True)

    Args:
        a: the first shape, as it was passed to the distance: points, a curve, a parametric or implicit surface, or a
            mesh.
        b: the second shape, as it was passed to the distance.
        solution: one result (not a batch) of directed_hausdorff, hausdorff, hausdorff_at_most, minimum_distance or
            minimum_at_most for these shapes. For a decision, the bound that gives the answer is certified; for an
            undecided decision, both bounds are.
        directed: for a decision about the two-sided distance: whether to certify the distance from `a` to `b` only; by
            default False.
        slack: how much wider the certified bounds may be than the bounds of the solution, in the unit of the
            coordinates. By default 0 for decisions and for Hausdorff distances of two curves, otherwise 1e-9 of the
            diagonal of the joint bounding box.
        max_cells: largest number of cells in one direction, or of pairs of parts. A smooth piece needs a few, or more
            if `b` is not smooth.
        max_seconds: time limit in seconds, checked after each round of cells; by default none.
        progress: a function that is called with a Progress from time to time; its items are cells.

    Returns:
        A Certificate, whose bounds have all been checked in exact arithmetic.

    Raises:
        TypeError: a shape or solution of another kind, a traced object or a batch.
        ValueError: the dimensions differ, a polynomial has too high a degree, `slack` is negative, `max_cells` is not a
            positive whole number, or `directed` is True for a minimum distance or a two-sided HausdorffSolution.
        NotProvenError: a bound of the solution could not be certified for these shapes, needs more cells or takes
            longer than `max_seconds`. For implicit surfaces: a bound rests on points without a change of sign, which
            prove nothing.
    """
    first: Shape = taken_as("a", a)
    second: Shape = taken_as("b", b)
    _check_arguments(first, second, solution, max_cells)
    report = _reporting(solution, progress, max_seconds)
    if isinstance(solution, MinimumSolution) or (isinstance(solution, Decision) and solution.distance == "minimum"):
        if directed:
            raise ValueError("directed is True, but a minimum distance has no direction: leave directed out.")
        slack = _checked_slack(slack, first, second, sharp=isinstance(solution, Decision))
        found = prove_minimum(first, second, solution, slack, max_cells, report)
    else:
        curves = isinstance(first, AbstractCurve) and isinstance(second, AbstractCurve)
        slack = _checked_slack(slack, first, second, sharp=curves or isinstance(solution, Decision))
        asked = asked_of(solution, directed, slack)
        cells, witness = prove_largest(first, second, asked, max_cells, report)
        upper = asked.upper if math.isfinite(asked.upper) else None
        claim = {"kind": asked.kind, "lower": asked.lower, "upper": upper}
        found = {"claim": claim, "orders": None, "cells": cells, "witness": witness}
    shapes = {"a": plain_shape(first), "b": plain_shape(second)}
    return Certificate({"format": FORMAT, "version": VERSION, **shapes, **found})


def _check_arguments(a: object, b: object, solution: object, max_cells: object) -> None:
    for name, shape in (("a", a), ("b", b)):
        if not isinstance(shape, Shape):
            raise TypeError(f"{name} must be {_KINDS}; got {type(shape).__name__}.")
    if not isinstance(solution, HausdorffSolution | MinimumSolution | Decision):
        accepted = "a HausdorffSolution (such as the maximum of a Deviation), a MinimumSolution or a Decision"
        raise TypeError(f"solution must be {accepted}; got {type(solution).__name__}.")
    if is_traced(a, b, solution) or np.ndim(solution.lower) > 0:
        raise TypeError("certify needs concrete shapes and one concrete solution; index a batch first.")
    if not isinstance(max_cells, int) or isinstance(max_cells, bool) or max_cells < 1:
        raise ValueError(f"max_cells is {max_cells!r}; needs a positive whole number.")
    for name, shape in (("a", a), ("b", b)):
        if isinstance(shape, ImplicitSurface):
            _check_degrees(name, shape)
    check_same_dim(*(shape.dim for shape in (a, b) if isinstance(shape, Shape)))


def _check_degrees(name: str, surface: ImplicitSurface) -> None:
    if max(surface.degrees) > LARGEST or surface.degree > LARGEST_IN_ALL:
        most = f"{LARGEST} in each variable and {LARGEST_IN_ALL} in all"
        raise ValueError(f"{name} has degrees {surface.degrees}; certificates go up to {most}.")


def _checked_slack(slack: object, a: Shape, b: Shape, sharp: bool) -> float:
    if slack is None:
        return 0.0 if sharp else 1e-9 * diagonal_of(a, b)
    if isinstance(slack, bool) or not isinstance(slack, int | float | np.number) or not 0 <= float(slack) < math.inf:
        raise ValueError(f"slack is {slack!r}; needs one number of at least 0.")
    return float(slack)


def _reporting(solution: Any, progress: Callback | None, max_seconds: float | None) -> Report:
    clock = Clock(max_seconds)

    def report(direction: str, proven: int, left: int) -> None:
        if progress is not None:
            progress(Progress(direction, proven, proven + left))
        if left and clock.is_over():
            noun = "pairs" if direction in ("apart", "witness") else "cells"
            counted = f"{proven} {noun} are proven and {left} are left. Raise max_seconds or slack."
            raise NotProvenError(f"There is no certificate after {max_seconds} seconds: {counted}", solution)

    return report
