"""Adaptively sampled distance fields: distances of a mesh on an octree, signed or not, interpolated between corners.

Such a field answers millions of queries a second, has a derivative almost everywhere, and can be turned into a mesh
again. It is an approximation: the tolerance of its construction is checked at 19 points of each cell. How far it is off
can be sampled, or proven.

Sources: "3-D signed Euclidean distance transform and its applications" (Lin03, 2003), section 3; Frisken, Perry,
Rockwood, Jones, Adaptively sampled distance fields (2000).
"""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._results.display import count_text, described, opaque, value_text
from jhd._runtime.archives import read_arrays
from jhd._runtime.arrays import is_traced, real_array
from jhd._runtime.files import replace_file
from jhd.arithmetic.scaling import common_exponent
from jhd.fields.adaptive_build import DEEPEST, MODES, FieldProgress, Task, bounding_cube, build_octree, first_grid
from jhd.fields.adaptive_error import LeafBoxes, largest_error, meeting
from jhd.fields.adaptive_evaluate import LeafCells, values_at
from jhd.fields.adaptive_extract import Leaves, extracted
from jhd.fields.adaptive_samples import PUBLISHED_SIGN, SIGNS, Surface, is_inner, surface_of
from jhd.fields.adaptive_surfaces import MESH_SHARE, meshed
from jhd.fields.checks import one_of, positive, whole
from jhd.shapes.as_shape import taken_as
from jhd.shapes.checks import Numbers
from jhd.shapes.mesh import TriangleMesh, check_mesh
from jhd.triangles.closest_point import closest_points
from jhd.triangles.unit import in_unit

_FORMAT = "jhd.AdaptiveDistanceField 1"


class AdaptiveDistanceField(eqx.Module):
    """Distances to a mesh, negative inside or without a sign, stored at the corners of the leaves of an octree.

    Within a leaf the field is the trilinear interpolation of the values at its corners. Between leaves of one size it
    is continuous; between others it may jump by up to the tolerance. Made by `build`.

    In mode "band" the field is refined where the surface is, and coarse elsewhere. Leaves that miss the surface of a
    closed mesh have corners on one side of it, so there the sign is right. In mode "full" it is refined everywhere.

    Args:
        lower: the lower corner of the box, which has a margin about the mesh.
        spacing: the side of the finest cells; the box has roots.shape << depth of them along each axis.
        roots: for each cell of the coarsest grid a node, or -1 - i for leaf i.
        nodes: the same for the eight parts of each node, numbered 4 x + 2 y + z.
        places: lower corners of the leaves, counted in finest cells.
        widths: sides of the leaves, counted likewise.
        corners: the values at the corners of each leaf, numbered as the parts are.
        values: signed distances in the unit of the mesh; leaves share them.
        atol: the tolerance of the construction.
        depth: how often a cell of the coarsest grid is halved to give a finest one.
        mode: "band" or "full".
        sign: "winding", "pseudonormal" or "none"; "average" of the published method.
        unresolved: leaves that are off by more than the tolerance at one of their 19 points, because the largest depth
            or number of cells was reached.
    """

    lower: Float[Array, "3"]
    spacing: Float[Array, ""]
    roots: Int[Array, "x y z"]
    nodes: Int[Array, "nodes 8"]
    places: Int[Array, "leaves 3"]
    widths: Int[Array, " leaves"]
    corners: Int[Array, "leaves 8"]
    values: Float[Array, " samples"]
    atol: Float[Array, ""]
    depth: int = eqx.field(static=True)
    mode: str = eqx.field(static=True)
    sign: str = eqx.field(static=True)
    unresolved: int = eqx.field(static=True)

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        leaves = count_text(self.widths.shape[-1], "leaf", "leaves")
        beyond = f"{self.unresolved} beyond the tolerance" if self.unresolved else ""
        ways = (f"mode={self.mode!r}", f"sign={self.sign!r}", beyond)
        return described(self, leaves, f"depth {self.depth}", f"atol={value_text(self.atol)}", *ways)

    @classmethod
    def build(
        cls,
        mesh: Any,
        atol: Numbers,
        mode: str = "band",
        *,
        sign: str | None = None,
        max_depth: int = 12,
        max_cells: int = 1_500_000,
        progress: Callable[[FieldProgress], object] | None = None,
        method: Any = None,
    ) -> "AdaptiveDistanceField":
        """The field of a surface, refined until the interpolation is within the tolerance at 19 points of each cell.

        That is no bound of the error elsewhere: see `sampled_error` and `proven_error`. Gaps and sheets that are
        thinner than the tolerance can be lost, as an error of that size may close them. Parametric and polynomial
        surfaces are measured from their `to_mesh` at a quarter of the tolerance, which is proven, turned outward where
        it is closed; the side of a point is that of this mesh.

        Args:
            mesh: the surface: a mesh, a parametric or polynomial surface, or what jhd.as_shape takes for one.
            atol: the tolerance, positive, in the unit of the mesh.
            mode: "band" refines only cells that may meet the surface; "full" all of them, as published.
            sign: as for jhd.signed_distance: "winding", the default, for all meshes (where one is not closed the field
                jumps across its holes), or "pseudonormal", for closed ones without self-intersections; or "none":
                distances are at least 0, for open surfaces. These bend at the surface, so cells there are about as wide
                as twice atol.
            max_depth: most halvings of the cells of the first grid, 9 to 16 of which are as long as the box.
            max_cells: cells beyond which none is split; a million take 1.3 gigabytes while the field is
                built.
            progress: called with a FieldProgress after each level.
            method: None for exact distances. With mode="full", jhd.VertexVoxels(transform="vector_propagation") makes
                this algorithm 1 of Lin & Wang (2003) as published: it starts from the one cube about the mesh, takes
                the distances of the local search, which can be too large, and signs by averaged normals, which can be
                wrong. Where either jumps by more than the tolerance, cells are split to `max_depth`.

        Raises:
            TypeError: no surface, one that is traced, or numbers of another kind.
            ValueError: a tolerance that is not positive and finite, an unknown mode or sign, a depth or number out of
                range, normals of a mesh that is not closed and consistently oriented, a parametric or polynomial
                surface that is open where a sign is asked for, or one of which `to_mesh` makes no mesh; a method
                together with another mode or a sign.
        """
        shape, tolerance = taken_as("mesh", mesh), positive("atol", atol)
        if method is not None and (mode != "full" or sign is not None):
            raise ValueError(f"mode is {mode!r} and sign {sign!r}; a method needs mode='full' and has its own signs.")
        sign = "winding" if sign is None else sign
        mesh = meshed(shape, tolerance, one_of("sign", sign, SIGNS))[0]
        surface, power = _surface("mesh", mesh, sign, method)
        depth = whole("max_depth", max_depth, 0, DEEPEST)
        most = whole("max_cells", max_cells, 1, 1 << 27)
        grid = first_grid(mesh, tolerance) if method is None else bounding_cube(mesh)
        # What is beyond floats there asks for all cells, or for none.
        asked = _scaled(tolerance if mesh is shape else (1 - MESH_SHARE) * tolerance, -power)
        tree = build_octree(
            Task(surface, grid.scaled(-power), asked, one_of("mode", mode, MODES), depth, most, progress)
        )
        numbers = (grid.lower, np.ldexp(grid.side, -tree.depth), _scaled(tree.values, power), tolerance)
        lower, spacing, values, atol_ = (jnp.asarray(x, surface.dtype) for x in numbers)
        names = ("roots", "nodes", "places", "widths", "corners")
        integers = {name: jnp.asarray(getattr(tree, name), jnp.int32) for name in names}
        return cls(
            lower=lower,
            spacing=spacing,
            values=values,
            atol=atol_,
            depth=tree.depth,
            mode=mode,
            sign=surface.sign,
            unresolved=tree.unresolved,
            **integers,
        )

    @property
    def leaves(self) -> int:
        """Number of leaves."""
        return self.widths.shape[-1]

    @property
    def upper(self) -> Float[Array, "3"]:
        """The upper corner of the box."""
        return self.lower + self.spacing * (np.array(self.roots.shape) << self.depth)

    def __call__(self, points: Numbers) -> Float[Array, "..."]:
        """The field at points (..., 3), the batch shape kept; differentiable in the points and in the values.

        Outside of the box it is the value at the nearest point of the box plus the distance to that point: where the
        value there is right, an upper bound of the distance to the mesh, too large by twice that distance at most.
        At the faces of leaves the derivative is that of the leaf with the larger coordinates.

        Raises:
            TypeError: points that are not real numbers.
            ValueError: points that are not finite, empty, or not in space. Under tracing NaN gives NaN.
        """
        queries = real_array("points", points)
        if queries.ndim == 0 or queries.shape[-1] != 3:
            raise ValueError(f"points has shape {queries.shape}; needs (..., 3).")
        if queries.size == 0:
            raise ValueError(f"points is empty: its shape is {queries.shape}.")
        return values_at(self._cells(), queries.reshape(-1, 3), self.depth).reshape(queries.shape[:-1])

    def to_mesh(self, resolution: int) -> TriangleMesh:
        """The zero set by marching cubes, vertices outward; closed for the field of a closed mesh.

        What is thinner than a cell of the grid may be lost, whatever the field is.

        Args:
            resolution: cells of the grid along the longest side of the box, 2 to 4096. Time and memory go with its
                square.

        Raises:
            ImportError: scikit-image is not installed.
            TypeError: a resolution that is no whole number, or a field that is traced.
            ValueError: a resolution out of range, no zero on the grid, or a field without signs.
            MemoryError: the mesh would take more memory than there is.
        """
        if self.sign == "none":
            raise ValueError("the field has no signs, so its zero set is no surface; needs a field with signs.")
        count, known = whole("resolution", resolution, 2, 4096), self._known()
        power = int(common_exponent(np.asarray(known.lower), np.asarray(known.upper)))
        known = known._times(-power)
        at_corners = np.asarray(known.values)[np.asarray(known.corners)]
        places, widths = (np.asarray(x, np.int64) for x in (known.places, known.widths))
        cells = np.array(known.roots.shape) << known.depth
        leaves = Leaves(places, widths, at_corners.min(axis=1), at_corners.max(axis=1), cells)
        low, high = (np.asarray(x, np.float64) for x in (known.lower, known.upper))
        found = extracted(leaves, low, high, count, known._numbers)
        return TriangleMesh(np.ldexp(np.asarray(found.vertices), power), found.triangles)

    def sampled_error(self, mesh: Any, samples: int = 100_000, seed: int = 0) -> float:
        """The largest |field - distance| at random points: of the band in mode "band", of the box in "full".

        The band is the leaves that may meet the surface; points are uniform in it. For a parametric or polynomial
        surface the signed distance is that of the mesh that `build` made of it.

        Args:
            mesh: the surface that the field was built from.
            samples: number of points.
            seed: of the random numbers.

        Raises:
            TypeError: no surface, numbers that are not whole, or what is traced.
            ValueError: numbers out of range, or no leaf that meets the mesh.
        """
        surface, power = _surface("mesh", meshed(mesh, float(self._known().atol), self.sign)[0], self._kind)
        count = whole("samples", samples, 1, 1 << 31)
        random, known = np.random.default_rng(whole("seed", seed, 0, 1 << 63)), self._known()._times(-power)
        boxes = known._boxes(surface)
        volume = boxes.width**3
        chosen = random.choice(len(volume), count, p=volume / volume.sum())
        points = boxes.lower[chosen] + boxes.width[chosen, None] * random.random((count, 3))
        points = points.astype(surface.dtype)
        found = closest_points(surface.mesh, points)
        exact = np.where(is_inner(surface, points, found, boxes.width[chosen]), -found.distance, found.distance)
        return float(_scaled(np.max(np.abs(known._numbers(points) - exact)), power))

    def proven_error(self, mesh: Any, *, rtol: float = 0.25, max_boxes: int = 400_000) -> float:
        """A proven upper bound of |field - signed distance|: in the band in mode "band", in the box in "full".

        The signed distance is that by the winding number (without a sign where the field has none), the mesh and the
        values are taken as they are stored, and the field as their exact interpolation in each leaf, its faces
        included; see jhd.fields.adaptive_error. Leaves are split for the proof until the bound is near the largest
        error seen, or there are too many boxes; then it is true, and larger than it might be. Some seconds for a
        hundred thousand boxes. Of a parametric or polynomial surface the bound holds for its distance with the side
        that its mesh gives, which is off by the mesh's deviation at most; where the point is farther than that from the
        surface, the side is the surface's own.

        Args:
            mesh: the surface that the field was built from, or any other.
            rtol: how far above the largest error seen the bound may stay, relative to that error.
            max_boxes: boxes beyond which none is split; the leaves themselves are looked at in any case.

        Raises:
            TypeError: no surface, numbers of another kind, or what is traced.
            ValueError: a mesh that is not closed and consistently oriented, whose signed distance jumps; numbers out of
                range; or no leaf that meets the mesh.
        """
        mesh, deviation = meshed(mesh, float(self._known().atol), self.sign)
        surface, power = _surface("mesh", mesh, self._kind)
        if not surface.linked:
            needed = "every edge of the mesh run along as often one way as the other"
            raise ValueError(f"proven_error needs {needed}: else the signed distance jumps across the holes.")
        ratio, most = positive("rtol", rtol), whole("max_boxes", max_boxes, 1, 1 << 31)
        error = largest_error(surface, self._known()._times(-power)._boxes(surface), ratio, most)
        bound = np.nextafter(_scaled(error, power), np.inf)
        return float(np.nextafter(bound + deviation, np.inf) if deviation else bound)

    def save(self, path: str | Path) -> None:
        """Writes the field as an .npz file of arrays, with exactly this name, as a whole or not at all."""
        known = self._known()
        arrays = {name: np.asarray(getattr(known, name)) for name in _ARRAYS}
        stream = io.BytesIO()
        np.savez_compressed(stream, format=_FORMAT, **arrays, **{name: getattr(known, name) for name in _OTHERS})
        replace_file(path, stream.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> "AdaptiveDistanceField":
        """Reads a field that `save` wrote, in the default precision.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: the file is no field, or is damaged; the message begins with its name.
        """
        try:
            return cls(**_checked(_content(path)))
        except FileNotFoundError:
            raise FileNotFoundError(f"{path}: no such file.") from None
        except (ValueError, TypeError, OverflowError) as error:
            raise ValueError(f"{path}: {str(error)[:200]}") from error

    def _times(self, power: int) -> "AdaptiveDistanceField":
        """The field of everything 2^power times as large.

        Raises:
            ValueError: it leaves the range of floats: the field is of another size than the mesh.
        """
        lengths = lambda f: (f.lower, f.spacing, f.values, f.atol)  # noqa: E731
        scaled = [_scaled(np.asarray(x), power) for x in lengths(self)]
        if not all(np.isfinite(x).all() for x in scaled[:3]):
            raise ValueError("the field is too large beside the mesh; needs the mesh that it was built from.")
        return eqx.tree_at(lengths, self, tuple(jnp.asarray(x) for x in scaled))

    @property
    def _kind(self) -> str:
        """The sign by which errors are told: pseudonormals give that of winding numbers where they are of use."""
        return "none" if self.sign == "none" else "winding"

    def _cells(self) -> LeafCells:
        return LeafCells(*(getattr(self, name) for name in LeafCells._fields))

    def _known(self) -> "AdaptiveDistanceField":
        if is_traced(self):
            raise TypeError("the field must be known here: what is found depends on its numbers; it is traced.")
        return self

    def _numbers(self, points: np.ndarray) -> np.ndarray:
        """The field at points in rows, on the host."""
        rows = jnp.asarray(points, self.values.dtype)
        return np.asarray(values_at(self._cells(), rows, self.depth), np.float64)

    def _boxes(self, surface: Surface) -> LeafBoxes:
        """The leaves that errors are about."""
        lower, spacing, values = (np.asarray(x, np.float64) for x in (self.lower, self.spacing, self.values))
        places, widths, corners = (np.asarray(x) for x in (self.places, self.widths, self.corners))
        boxes = LeafBoxes(lower + spacing * places, spacing * widths, values[corners])
        boxes = boxes if self.mode == "full" else meeting(surface, boxes)
        if not len(boxes.width):
            raise ValueError("no leaf of the field meets the mesh; needs the mesh that it was built from.")
        return boxes


_ARRAYS = (*LeafCells._fields, "atol")
_OTHERS = ("depth", "mode", "sign", "unresolved")


def _content(path: str | Path) -> Mapping[str, np.ndarray]:
    """The arrays of an archive."""
    if str(read_arrays(path, ["format"])["format"]) != _FORMAT:
        raise ValueError(f"it holds no field, or one of another version; needs {_FORMAT!r}.")
    return read_arrays(path, (*_ARRAYS, *_OTHERS))


def _checked(content: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The fields of a file, of the right kinds, with all indices in range."""
    known: dict[str, Any] = {"depth": int(content["depth"]), "unresolved": int(content["unresolved"])}
    known |= {
        "mode": one_of("mode", str(content["mode"]), MODES),
        "sign": one_of("sign", str(content["sign"]), (*SIGNS, PUBLISHED_SIGN)),
    }
    for name in ("lower", "spacing", "values", "atol"):
        known[name] = real_array(name, content[name])
    for name in ("roots", "nodes", "places", "widths", "corners"):
        known[name] = _indices(name, content[name])
    leaves, nodes = known["widths"].size, known["nodes"].shape[0]
    shapes = {"lower": (3,), "spacing": (), "atol": (), "nodes": (nodes, 8), "places": (leaves, 3)}
    shapes |= {"widths": (leaves,), "corners": (leaves, 8), "values": (known["values"].size,)}
    for name, shape in shapes.items():
        if known[name].shape != shape:
            raise ValueError(f"{name} has shape {known[name].shape}; needs {shape}.")
    ranges = {"roots": (-leaves, nodes), "nodes": (-leaves, nodes), "corners": (0, known["values"].size)}
    ranges |= {"widths": (1, (1 << DEEPEST) + 1)}
    for name, (first, end) in ranges.items():
        numbers = np.asarray(known[name])
        if numbers.size and not (first <= numbers.min() and numbers.max() < end):
            raise ValueError(f"{name} has numbers out of range; needs {first} to {end - 1}.")
    if known["roots"].ndim != 3 or not known["roots"].size or not 0 <= known["depth"] <= DEEPEST:
        raise ValueError(f"roots has shape {known['roots'].shape} and depth is {known['depth']}; that is no octree.")
    _check_leaves(known)
    return known


def _indices(name: str, given: np.ndarray) -> Array:
    if given.dtype.kind not in "iu" or (given.size and max(abs(int(given.min())), int(given.max())) >= 1 << 31):
        raise ValueError(f"{name} holds {given.dtype} up to {given.max(initial=0)}; needs integers of 32 bits.")
    return jnp.asarray(given.astype(np.int32))


def _check_leaves(known: dict[str, Any]) -> None:
    """Raises ValueError where leaves are out of the box, or lengths not positive."""
    places, widths = np.asarray(known["places"], np.int64), np.asarray(known["widths"], np.int64)
    cells = np.array(known["roots"].shape, np.int64) << known["depth"]
    if widths.size and (places.min() < 0 or np.any(places + widths[:, None] > cells)):
        raise ValueError(f"places has leaves out of the box, which is {cells.tolist()} finest cells.")
    if not (known["spacing"] > 0 and known["atol"] > 0):
        raise ValueError(f"spacing is {known['spacing']:g} and atol {known['atol']:g}; needs positive lengths.")


def _surface(name: str, mesh: Any, sign: str = "winding", method: Any = None) -> tuple[Surface, int]:
    """The mesh prepared in a unit of its own, and the power of two of that."""
    check_mesh(name, mesh)
    if is_traced(mesh):
        raise TypeError(f"{name} must be known: the cells depend on its numbers, so it cannot be traced.")
    unit, power = in_unit(mesh)
    return surface_of(unit, sign, None if method is None else method.search), power


def _scaled(x: Any, power: int) -> Any:
    """The product x 2^power, infinite where that is beyond all floats."""
    with np.errstate(over="ignore"):
        return np.ldexp(x, power)
