"""The structure of a certificate: all keys, with values of the right kinds, in their ranges, and bounded in work.

Whether the cells cover the shapes, and whether the bounds hold, is left to the proofs.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from hashlib import sha256
from os import PathLike
from reprlib import repr  # of limited length and depth, whatever a file holds
from typing import Any, NamedTuple

from jhd._distance.certificate.verification.values import (
    CertificateError,
    check_index,
    check_keys,
    check_list,
    check_multiplier,
    check_numbers,
    check_parameters,
    check_positive,
    check_surface,
    check_surface_foot,
    check_surface_place,
)

FORMAT, VERSION = "jhd-certificate", 2
KINDS = {"directed": ("a_to_b",), "two_sided": ("a_to_b", "b_to_a"), "minimum": ("apart",)}
# The lists of cells in the order in which they stand in files; the last is of pairs of the witness and parts.
SECTIONS = ("a_to_b", "b_to_a", "apart", "witness")
# The names of the arrays of each kind of shape.
SHAPES = {
    "curve": ("control_points", "weights"),
    "patches": ("control_points", "weights"),
    "mesh": ("vertices", "triangles"),
    "surface": ("coefficients", "lower", "upper"),
}

# Characters in the names of pairs of parts.
_LETTERS = frozenset("abcdefxyABCDEFXY")
# Degrees that are read, of the maps of feet too; beyond them one cell could take hours.
_LARGEST_CURVE, _LARGEST_PATCH, _LARGEST_MAP = 30, 10, 3
# Largest number of feet of one cell, for the same reason.
MOST_FEET = 4
# Largest degree to check on a triangle: a few hundred milliseconds.
_LARGEST_ON_TRIANGLES = 60


class ShapeSize(NamedTuple):
    """Size of a shape: coordinates of a point, pieces, corners of the simplices of their domain, and total degree."""

    dim: int
    pieces: int
    corners: tuple[int, ...]
    degree: int

    @property
    def cell_corners(self) -> int:
        """Number of corners of the simplices that cover a piece."""
        return 1 if not self.corners else 3 if self.corners == (2, 2) else self.corners[0]

    @property
    def is_surface(self) -> bool:
        """Return whether the shape is the zero set of a polynomial, with the pieces of its box."""
        return self.corners == (4,)


def check_content(content: Any) -> dict[str, ShapeSize]:
    """Return the sizes of the shapes; raise CertificateError if anything except the cells is malformed."""
    if isinstance(content, str | bytes | PathLike):
        raise CertificateError("a text is no certificate: read the file with jhd.io.load_certificate or `opened`.")
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise CertificateError(f"is no certificate: it has no format {FORMAT!r}.")
    if content.get("version") != VERSION or isinstance(content["version"], bool):
        found = repr(content.get("version"))
        raise CertificateError(f"version is {found}; this checker knows version {VERSION}.")
    check_keys("the certificate", content, ("format", "version", "claim", "a", "b", "orders", "cells", "witness"))
    sizes = {name: _check_shape(name, content[name]) for name in ("a", "b")}
    if sizes["a"].dim != sizes["b"].dim:
        raise CertificateError(f"a has {sizes['a'].dim} coordinates a point and b has {sizes['b'].dim}.")
    directions = check_claim(content["claim"])
    if content["claim"]["kind"] == "minimum":
        _check_minimum(content, sizes)
    else:
        _check_maximum(content, directions, sizes)
    return sizes


def _check_maximum(content: Mapping[str, Any], directions: tuple[str, ...], sizes: Mapping[str, ShapeSize]) -> None:
    """Check cells for an upper bound, a witness for a lower bound."""
    if content["orders"] is not None:
        raise CertificateError("orders must be null if the claim is about a largest distance.")
    wanted = [] if content["claim"]["upper"] is None else list(directions)
    if content["witness"] is not None:
        _check_witness(content["witness"], directions, sizes)
        if content["claim"]["lower"] > 0 and sizes[content["witness"]["direction"][-1]].is_surface:
            wanted.append("witness")
    elif content["claim"]["lower"] > 0:
        raise CertificateError(f"claim.lower is {content['claim']['lower']!r} and there is no witness.")
    if wanted:
        check_keys("cells", content["cells"], wanted)
    elif content["cells"] is not None:
        raise CertificateError("claim.upper is null, so cells must be null.")


def _check_minimum(content: Mapping[str, Any], sizes: Mapping[str, ShapeSize]) -> None:
    """Check pairs of parts for a lower bound, a point on each shape for an upper bound."""
    if (content["claim"]["lower"] > 0) != (content["cells"] is not None):
        raise CertificateError("cells are needed if claim.lower is above zero, and must be null otherwise.")
    if (content["claim"]["upper"] is None) != (content["witness"] is None):
        raise CertificateError("witness is needed if there is a claim.upper, and must be null otherwise.")
    check_keys("orders", content["orders"], ("a", "b"))
    for name, size in sizes.items():
        _check_order(f"orders.{name}", content["orders"][name], size.pieces)
    if content["cells"] is not None:
        check_keys("cells", content["cells"], ("apart",))
    if content["witness"] is not None:
        check_keys("witness", content["witness"], ("a", "b"))
        for name, size in sizes.items():
            place, found = f"witness.{name}", content["witness"][name]
            if size.is_surface:
                check_surface_place(place, found)
                continue
            check_keys(place, found, ("piece", "at"))
            check_index(f"{place}.piece", found["piece"], size.pieces)
            check_place(f"{place}.at", found["at"], size)


def _check_order(place: str, order: Any, count: int) -> None:
    if order is None:
        return
    for index in check_list(place, order, count, count):
        check_index(place, index, count)
    if len(set(order)) < count:
        raise CertificateError(f"{place} names a piece twice.")


def check_pair(place: str, entry: Any, sizes: Sequence[ShapeSize]) -> None:
    """Raise CertificateError unless a pair of parts of shapes of these sizes has all that the proof reads."""
    proofs = ("plane", "zeros", "free") if any(size.is_surface for size in sizes) else ("plane",)
    found = [key for key in proofs if isinstance(entry, Mapping) and key in entry]
    check_keys(place, entry, ("pair", found[0] if len(found) == 1 else "plane"))
    if not isinstance(entry["pair"], str) or not entry["pair"].isascii() or not set(entry["pair"]) <= _LETTERS:
        raise CertificateError(f"{place}.pair is {repr(entry['pair'])}; needs letters.")
    if "free" in entry:
        if type(entry["free"]) is not int or entry["free"] not in (0, 1) or not sizes[entry["free"]].is_surface:
            raise CertificateError(f"{place}.free is {repr(entry['free'])}; needs the number of a surface, 0 or 1.")
    elif "zeros" in entry:
        zeros = check_list(f"{place}.zeros", entry["zeros"], 2, 2)
        for k, (numbers, size) in enumerate(zip(zeros, sizes, strict=True)):
            if size.is_surface:
                check_multiplier(f"{place}.zeros[{k}]", numbers, 4)
            elif numbers is not None:
                raise CertificateError(f"{place}.zeros[{k}] must be null: the shape is no surface.")
    else:
        dim = sizes[0].dim
        normal = check_list(f"{place}.plane", entry["plane"], dim, dim)
        check_numbers(f"{place}.plane", normal)
        if not any(normal):
            raise CertificateError(f"{place}.plane is {normal}; needs a direction.")


def check_claim(claim: Any) -> tuple[str, ...]:
    """Return the directions of a claim; raise CertificateError if it is malformed."""
    check_keys("claim", claim, ("kind", "lower", "upper"))
    if not isinstance(claim["kind"], str) or claim["kind"] not in KINDS:
        raise CertificateError(f"claim.kind is {repr(claim['kind'])}; needs one of {', '.join(KINDS)}.")
    check_numbers("claim.lower", [claim["lower"]], 0.0)
    if claim["upper"] is not None:
        check_numbers("claim.upper", [claim["upper"]], 0.0)
    return KINDS[claim["kind"]]


def check_entry(place: str, entry: Any, source: ShapeSize, target: ShapeSize) -> None:
    """Raise CertificateError unless a cell has all that the proof reads, with feet in the domains of their pieces."""
    check_keys(place, entry, ("piece", "cell", "feet", "multipliers", "bound", *["zero"] * source.is_surface))
    check_index(f"{place}.piece", entry["piece"], source.pieces)
    check_numbers(f"{place}.bound", [entry["bound"]], 0.0)
    if source.corners == (2,):
        cell = check_list(f"{place}.cell", entry["cell"], 2, 2)
        check_parameters(f"{place}.cell", cell)
        if cell[0] > cell[1]:
            raise CertificateError(f"{place}.cell is {cell}; its ends are in the wrong order.")
    _check_feet(place, entry, source, target)
    if entry["multipliers"] is not None:
        _check_multipliers(place, entry, source)
    elif len(entry["feet"]) > 1:
        raise CertificateError(f"{place} has {len(entry['feet'])} feet and no multipliers.")


def _check_feet(place: str, entry: Any, source: ShapeSize, target: ShapeSize) -> None:
    is_free = source.is_surface and entry["zero"] is None
    feet = check_list(f"{place}.feet", entry["feet"], 1 - is_free, 0 if is_free else MOST_FEET)
    if source.is_surface and not is_free:
        check_multiplier(f"{place}.zero", entry["zero"], 4)
    for k, foot in enumerate(feet):
        if target.is_surface:
            check_surface_foot(f"{place}.feet[{k}]", foot, source.cell_corners)
        else:
            _check_foot(f"{place}.feet[{k}]", foot, source, target)


def _check_multipliers(place: str, entry: Any, source: ShapeSize) -> None:
    count = len(entry["feet"])
    rows = check_list(f"{place}.multipliers", entry["multipliers"], count, count)
    for k, row in enumerate(rows):
        name = f"{place}.multipliers[{k}]"
        if len(check_list(name, row, 1, source.cell_corners)) not in (1, source.cell_corners):
            raise CertificateError(f"{name} is {repr(row)}; needs a list of 1 or {source.cell_corners}.")
        check_parameters(name, row, math.inf)
    if not any(x > 0 for row in rows for x in row):
        raise CertificateError(f"{place}.multipliers are all zero.")
    # Zeros of a polynomial on a side of a cell need not be next to others inside.
    if source.is_surface and not all(any(row[k % len(row)] > 0 for row in rows) for k in range(4)):
        raise CertificateError(f"{place}.multipliers are all zero at a corner.")


def _check_foot(place: str, foot: Any, source: ShapeSize, target: ShapeSize) -> None:
    check_keys(place, foot, ("piece", "map", "weights"))
    check_index(f"{place}.piece", foot["piece"], target.pieces)
    rows = check_list(f"{place}.map", foot["map"])
    if source.cell_corners == 4:
        sizes = {1: 0, 4: 1}
    elif source.cell_corners == 3:
        sizes = {(m + 1) * (m + 2) // 2: m for m in range(_LARGEST_MAP + 1)}
    else:
        sizes = {m * (source.cell_corners - 1) + 1: m for m in range(_LARGEST_MAP + 1)}
    if len(rows) not in sizes:
        raise CertificateError(f"{place}.map has {len(rows)} rows; needs one of {', '.join(map(str, sizes))}.")
    degree = 2 * (source.degree + max(sizes[len(rows)], 1) * target.degree)
    if source.cell_corners > 2 and degree > _LARGEST_ON_TRIANGLES:
        raise CertificateError(f"{place}.map gives a degree of {degree}; at most {_LARGEST_ON_TRIANGLES} is read.")
    weights = foot["weights"]
    if weights is not None:
        for w in check_list(f"{place}.weights", weights, len(rows), len(rows)):
            check_positive(f"{place}.weights", [w])
            check_parameters(f"{place}.weights", [w], math.inf)
    for k, row in enumerate(rows):
        most = 1.0 if weights is None else float(weights[k])
        check_place(f"{place}.map[{k}]", row, target, most)


def check_place(place: str, row: Any, size: ShapeSize, most: float = 1.0) -> None:
    """Raise CertificateError unless a row of parameters, times `most`, lies in the domain of a piece."""
    count = sum(size.corners) - len(size.corners)
    row = check_list(place, row, count, count)
    check_parameters(place, row, most)
    # Floats may round the sum down to one: the ratio does not.
    if size.corners == (3,) and not _is_at_most(row, most):
        raise CertificateError(f"{place} is {repr(row)}; needs a sum of at most {most!r}.")


def _is_at_most(row: Sequence[float], most: float) -> bool:
    ratios = [float(x).as_integer_ratio() for x in (*row, most)]
    bits = max(whole for _, whole in ratios)
    *found, limit = (top * (bits // whole) for top, whole in ratios)
    return sum(found) <= limit


def _check_witness(witness: Any, directions: Sequence[str], sizes: Mapping[str, ShapeSize]) -> None:
    direction = witness.get("direction") if isinstance(witness, Mapping) else None
    if direction not in directions:
        check_keys("witness", witness, ("direction",), list(witness) if isinstance(witness, Mapping) else ())
        raise CertificateError(f"witness.direction is {repr(direction)}; needs {' or '.join(directions)}.")
    source = sizes[str(direction)[0]]
    if source.is_surface:
        check_surface_place("witness", witness, ("direction", "cuts"))
    else:
        check_keys("witness", witness, ("direction", "piece", "at", "cuts"))
        check_index("witness.piece", witness["piece"], source.pieces)
        check_place("witness.at", witness["at"], source)
    if witness["cuts"] is not None:
        raise CertificateError("witness.cuts must be null.")


def digest(shape: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a shape: of its kind, and of the sizes and little-endian doubles of each array."""
    found = sha256(shape["kind"].encode())
    for name in SHAPES[shape["kind"]]:
        numbers, sizes = shape[name], []
        while isinstance(numbers, list):
            sizes.append(len(numbers))
            numbers = [x for row in numbers for x in row] if isinstance(numbers[0], list) else tuple(numbers)
        flat = numbers or ()
        # The sizes of nested lists are the sizes of all of them together, which also tells them apart.
        found.update(struct.pack(f"<{len(sizes) + 1}q", len(sizes), *sizes))
        found.update(struct.pack(f"<{len(flat)}d", *flat))
    return found.hexdigest()


# ---- shapes --------------------------------------------------------------------------------------


def _check_shape(name: str, shape: Any) -> ShapeSize:
    """Return the size of a shape after a check of all its numbers."""
    kind = shape.get("kind") if isinstance(shape, Mapping) else None
    if not isinstance(kind, str) or kind not in SHAPES:
        raise CertificateError(f"{name}.kind is {repr(kind)}; needs one of {', '.join(SHAPES)}.")
    check_keys(name, shape, ("kind", *SHAPES[kind]), ("sha256",))
    if kind == "surface":
        # A box is cut into six tetrahedra.
        size = ShapeSize(3, 6, (4,), check_surface(name, shape))
    else:
        size = _check_mesh(name, shape) if kind == "mesh" else _check_nets(name, shape)
    if "sha256" in shape and shape["sha256"] != digest(shape):
        raise CertificateError(f"{name}.sha256 is {repr(shape['sha256'])}, which is not the hash of its arrays.")
    return size


def _check_nets(name: str, shape: Mapping[str, Any]) -> ShapeSize:
    kind = shape["kind"]
    nets = check_list(f"{name}.control_points", shape["control_points"])
    lengths = (_LARGEST_CURVE + 1,) if kind == "curve" else (_LARGEST_PATCH + 1,) * 2
    sizes: list[int] = []
    inner: Any = nets
    for most in (*lengths, 3):
        inner = check_list(f"{name}.control_points", inner[0], 2 if len(sizes) == len(lengths) else 1, most)
        sizes.append(len(inner))
    *sizes, dim = sizes
    if kind == "patches" and dim != 3:
        raise CertificateError(f"{name}.control_points has {dim} coordinates a point; needs 3.")
    for k, net in enumerate(nets):
        _check_net(f"{name}.control_points[{k}]", net, [*sizes, dim])
    if shape["weights"] is not None:
        for k, net in enumerate(check_list(f"{name}.weights", shape["weights"], len(nets), len(nets))):
            _check_net(f"{name}.weights[{k}]", net, sizes, positive=True)
    corners = (2, 2) if kind == "patches" else (2,) if sizes[0] > 1 else ()
    return ShapeSize(dim, len(nets), corners, sum(n - 1 for n in sizes))


def _check_mesh(name: str, shape: Mapping[str, Any]) -> ShapeSize:
    vertices = check_list(f"{name}.vertices", shape["vertices"])
    for k, vertex in enumerate(vertices):
        _check_net(f"{name}.vertices[{k}]", vertex, [3])
    triangles = check_list(f"{name}.triangles", shape["triangles"])
    for k, triangle in enumerate(triangles):
        for index in check_list(f"{name}.triangles[{k}]", triangle, 3, 3):
            check_index(f"{name}.triangles[{k}]", index, len(vertices))
    return ShapeSize(3, len(triangles), (3,), 1)


def _check_net(place: str, net: Any, sizes: Sequence[int], positive: bool = False) -> None:
    rows = check_list(place, net, sizes[0], sizes[0])
    if len(sizes) > 1:
        for k, row in enumerate(rows):
            _check_net(f"{place}[{k}]", row, sizes[1:], positive)
    else:
        (check_positive if positive else check_numbers)(place, rows)
