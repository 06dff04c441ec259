"""Adaptively sampled distance fields of surfaces: distances on an octree, signed or not, interpolated between corners.

A field answers millions of queries a second, has a derivative almost everywhere, and can be converted back to a mesh.
It is an approximation: its construction checks the tolerance at 19 points of each cell only. The error of a field can
be sampled (`sampled_error`) or bounded with a proof (`proven_error`).

Sources: "3-D signed Euclidean distance transform and its applications" (Lin03, 2003), section 3; Frisken, Perry,
Rockwood, Jones, Adaptively sampled distance fields (2000).
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._arithmetic.scaling import common_exponent
from jhd._fields.adaptive_build import DEEPEST, MODES, Task, bounding_cube, build_octree, first_grid
from jhd._fields.adaptive_error import LeafBoxes, largest_error, meeting
from jhd._fields.adaptive_extract import LeafCells, Leaves, extracted, values_at
from jhd._fields.adaptive_samples import MESH_SHARE, PUBLISHED_SIGN, SIGNS, Surface, is_inner, meshed, surface_of
from jhd._results.display import count_text, described, opaque, value_text
from jhd._runtime.archives import read_arrays
from jhd._runtime.arrays import is_traced, one_of, positive, real_array, whole_between
from jhd._runtime.clock import with_time_limit
from jhd._runtime.files import replace_file
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.checks import Numbers, checked_points
from jhd._shapes.mesh import TriangleMesh, check_mesh
from jhd._triangles.closest_point import AbstractMeshSearch, closest_points
from jhd._triangles.unit import in_unit
from jhd.progress import Callback

_FORMAT = "jhd.AdaptiveDistanceField 1"


class AdaptiveDistanceField(eqx.Module):
    """Distances to a surface on an octree, negative inside or unsigned, stored at the corners of the leaves.

    Within a leaf the field is the trilinear interpolation of its corner values. The field is continuous between leaves
    of equal size; between leaves of different sizes it may jump by up to the tolerance. Create a field with `build`.

    In mode "band" the field is refined near the surface and coarse elsewhere. If the mesh is closed, every leaf that
    misses the surface has all corners on one side, so the sign is correct there. Mode "full" refines everywhere.

    Args:
        lower: lower corner of the box, which has a margin around the mesh.
        spacing: side of the finest cells. The box has `roots.shape << depth` finest cells along each axis.
        roots: for each cell of the coarsest grid the index of its node, or -1 - i for leaf i.
        nodes: for each node the same numbers for its eight children; child (x, y, z) has index 4 x + 2 y + z.
        leaf_corners: lower corners of the leaves, in units of finest cells.
        widths: sides of the leaves, in units of finest cells.
        corners: indices into `values` of the corners of each leaf, numbered like the children.
        values: distances in the unit of the mesh; leaves with a common corner use the same entry.
        tolerance: tolerance of the construction, in the unit of the mesh.
        depth: number of times that a cell of the coarsest grid is halved to give a finest cell.
        mode: "band" or "full".
        sign: "winding", "pseudonormal" or "none"; "average" for the published method.
        unresolved: number of leaves whose error exceeds the tolerance at one of their 19 test points, because
            `max_depth` or `max_cells` was reached.
    """

    lower: Float[Array, "3"]
    spacing: Float[Array, ""]
    roots: Int[Array, "x y z"]
    nodes: Int[Array, "nodes 8"]
    leaf_corners: Int[Array, "leaves 3"]
    widths: Int[Array, " leaves"]
    corners: Int[Array, "leaves 8"]
    values: Float[Array, " samples"]
    tolerance: Float[Array, ""]
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
        return described(self, leaves, f"depth {self.depth}", f"tolerance={value_text(self.tolerance)}", *ways)

    @classmethod
    def build(
        cls,
        surface: ShapeLike,
        tolerance: Numbers,
        mode: str = "band",
        *,
        sign: str | None = None,
        max_depth: int = 12,
        max_cells: int = 1_500_000,
        max_seconds: float | None = None,
        progress: Callback | None = None,
        method: AbstractMeshSearch | None = None,
    ) -> "AdaptiveDistanceField":
        """The field of a surface, refined until the error is within `tolerance` at 19 points of each cell.

        This is no bound of the error elsewhere; see `sampled_error` and `proven_error`. Gaps and sheets thinner than
        the tolerance can be lost. Parametric and implicit surfaces are first converted by `to_mesh`, with a certified
        error of a quarter of the tolerance. Closed ones are oriented outward. The sign of a point is then its side of
        this mesh.

        >>> import jhd
        >>> sphere = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", -2, 2)
        >>> field = jhd.AdaptiveDistanceField.build(sphere, tolerance=0.1)
        >>> field.unresolved, abs(float(field([0.9, 0, 0])) + 0.1) < 0.1
        (0, True)

        Args:
            surface: mesh, parametric or implicit surface, or an object that jhd.as_shape converts to one.
            tolerance: tolerance, positive, in the unit of the surface.
            mode: "band" refines only the cells that may meet the surface; "full" refines all cells, as published.
            sign: how the side of a point is determined; see jhd.signed_distance. None means "winding", for all
                meshes; if a mesh is not closed, the field jumps across its holes. "pseudonormal" is for closed meshes
                without self-intersections. "none" stores unsigned distances, for open surfaces; the field has a crease
                at the surface, so cells there are about 2 tolerance wide.
            max_depth: largest number of halvings of the cells of the first grid, 0 to 15. The first grid has 9 to 16
                cells along the longest side of the box.
            max_cells: number of cells beyond which no cell is split. Building a million cells takes 1.3 GB.
            max_seconds: time limit in seconds, checked after each level; by default none.
            progress: callback that receives a Progress after each level.
            method: None computes exact distances. jhd.published.VertexVoxels(transform="vector_propagation") with
                mode="full" gives algorithm 1 of Lin & Wang (2003) as published. It starts from one cube around the
                mesh. Its distances come from the local search and can be too large; its signs come from averaged
                normals and can be wrong. If the distances or the signs jump by more than the tolerance, cells are
                split down to `max_depth`.

        Returns:
            The field. Its `unresolved` is 0 if the tolerance was reached at all tested points.

        Raises:
            TypeError: the input is no surface, it is traced, or a number has the wrong type.
            ValueError: the tolerance or `max_seconds` is not positive and finite, the mode or sign is unknown, or a
                number is out of range; pseudonormals are requested for a mesh that is not closed and consistently
                oriented; a sign is requested for an open parametric or implicit surface; `to_mesh` fails; or a method
                is given with another mode or with a sign.
            TimeoutError: the field takes longer than `max_seconds`, meshing included, at a report of progress.
        """
        shape, tolerance = taken_as("surface", surface), positive("tolerance", tolerance)
        report = with_time_limit(progress, max_seconds)
        if method is not None and (mode != "full" or sign is not None):
            raise ValueError(f"mode is {mode!r} and sign {sign!r}; a method needs mode='full' and has its own signs.")
        sign = "winding" if sign is None else sign
        drawn = meshed(shape, tolerance, one_of("sign", sign, SIGNS))[0]
        known, power = _surface(drawn, sign, method)
        depth = whole_between("max_depth", max_depth, 0, DEEPEST)
        most = whole_between("max_cells", max_cells, 1, 1 << 27)
        grid = first_grid(drawn, tolerance) if method is None else bounding_cube(drawn)
        # A tolerance beyond floats in this unit refines all cells, or none.
        asked = _scaled(tolerance if drawn is shape else (1 - MESH_SHARE) * tolerance, -power)
        tree = build_octree(Task(known, grid.scaled(-power), asked, one_of("mode", mode, MODES), depth, most, report))
        numbers = (grid.lower, np.ldexp(grid.side, -tree.depth), _scaled(tree.values, power), tolerance)
        lower, spacing, values, tolerance_ = (jnp.asarray(x, known.dtype) for x in numbers)
        names = ("roots", "nodes", "leaf_corners", "widths", "corners")
        integers = {name: jnp.asarray(getattr(tree, name), jnp.int32) for name in names}
        return cls(
            lower=lower,
            spacing=spacing,
            values=values,
            tolerance=tolerance_,
            depth=tree.depth,
            mode=mode,
            sign=known.sign,
            unresolved=tree.unresolved,
            **integers,
        )

    @property
    def leaves(self) -> int:
        """Number of leaves."""
        return self.widths.shape[-1]

    @property
    def upper(self) -> Float[Array, "3"]:
        """Upper corner of the box."""
        return self.lower + self.spacing * (np.array(self.roots.shape) << self.depth)

    def __call__(self, points: Numbers) -> Float[Array, "..."]:
        """Values of the field at points of shape (..., 3); differentiable in the points and in the values.

        Outside the box, the value is the field at the nearest point of the box plus the distance to that point. If the
        field is exact there, this exceeds the distance to the mesh by zero to two times the distance to the box. On a
        face between leaves, the derivative comes from the leaf with the larger coordinates.

        Args:
            points: coordinates, (..., 3), in the unit of the mesh.

        Returns:
            Distances of shape (...), negative inside.

        Raises:
            TypeError: the points are not real numbers.
            ValueError: the points are not finite, empty, or not in space. Under tracing, NaN gives NaN.
        """
        queries = checked_points(points)
        return values_at(self._cells(), queries.reshape(-1, 3), self.depth).reshape(queries.shape[:-1])

    def to_mesh(self, resolution: int) -> TriangleMesh:
        """Zero set of the field as a mesh, by marching cubes; closed if the field was built from a closed mesh.

        Parts thinner than a cell of the marching-cubes grid may be lost, regardless of the accuracy of the field.

        >>> import jhd
        >>> sphere = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", -2, 2)
        >>> jhd.AdaptiveDistanceField.build(sphere, tolerance=0.1).to_mesh(16).is_closed
        True

        Args:
            resolution: number of grid cells along the longest side of the box, 2 to 4096. Time and memory grow with its
                square.

        Returns:
            A TriangleMesh in the unit of the field, oriented outward.

        Raises:
            ImportError: scikit-image is not installed.
            TypeError: the resolution is no whole number, or the field is traced.
            ValueError: the resolution is out of range, the field has no zero on the grid, or it has no signs.
            MemoryError: the mesh would need more memory than is free.
        """
        if self.sign == "none":
            raise ValueError("the field has no signs, so its zero set is no surface; build it with sign='winding'.")
        count, known = whole_between("resolution", resolution, 2, 4096), self._known()
        power = int(common_exponent(np.asarray(known.lower), np.asarray(known.upper)))
        known = known._times(-power)
        at_corners = np.asarray(known.values)[np.asarray(known.corners)]
        leaf_corners, widths = (np.asarray(x, np.int64) for x in (known.leaf_corners, known.widths))
        cells = np.array(known.roots.shape) << known.depth
        leaves = Leaves(leaf_corners, widths, at_corners.min(axis=1), at_corners.max(axis=1), cells)
        low, high = (np.asarray(x, np.float64) for x in (known.lower, known.upper))
        found = extracted(leaves, low, high, count, known._numbers)
        return TriangleMesh(np.ldexp(np.asarray(found.vertices), power), found.triangles)

    def sampled_error(self, surface: ShapeLike, samples: int = 100_000, seed: int = 0) -> float:
        """Largest |field - distance| at random points: in the band for mode "band", in the box for mode "full".

        The band consists of the leaves that may meet the surface; points are uniform in the band. For a parametric or
        implicit surface, the distance is measured to the mesh that `build` made of the surface.

        Args:
            surface: surface from which the field was built.
            samples: number of points, at least 1.
            seed: seed of the random numbers, at least 0.

        Returns:
            The largest error found, in the unit of the mesh: a lower bound of the largest error.

        Raises:
            TypeError: the input is no surface, a number is not whole, or the field or the surface is traced.
            ValueError: a number is out of range, or no leaf meets the mesh.
        """
        mesh, power = _surface(meshed(surface, float(self._known().tolerance), self.sign)[0], self._kind)
        count = whole_between("samples", samples, 1, 1 << 31)
        random, known = np.random.default_rng(whole_between("seed", seed, 0, 1 << 63)), self._known()._times(-power)
        boxes = known._boxes(mesh)
        volume = boxes.width**3
        chosen = random.choice(len(volume), count, p=volume / volume.sum())
        points = (boxes.lower[chosen] + boxes.width[chosen, None] * random.random((count, 3))).astype(mesh.dtype)
        found = closest_points(mesh.mesh, points)
        exact = np.where(is_inner(mesh, points, found, boxes.width[chosen]), -found.distance, found.distance)
        return float(_scaled(np.max(np.abs(known._numbers(points) - exact)), power))

    def proven_error(self, surface: ShapeLike, *, rtol: float = 0.25, max_boxes: int = 400_000) -> float:
        """Certified upper bound of |field - signed distance|: in the band for mode "band", in the box for mode "full".

        The sign of the distance is given by the winding number (a field without signs is compared with the unsigned
        distance). The mesh and the values are taken as stored, and the field as their exact interpolation in each leaf,
        faces included. Leaves are split until the bound is close to the largest error
        seen, or until there are too many boxes; the bound is then valid but wider. A hundred thousand boxes take
        seconds.

        For a parametric or implicit surface, the bound holds for its distance, with the side determined by its mesh.
        The side can differ from the side of the surface only within the certified error of that mesh.

        Args:
            surface: surface from which the field was built, or any other.
            rtol: allowed excess of the bound over the largest error seen, relative to that error; positive.
            max_boxes: number of boxes beyond which no box is split. All leaves are examined in any case.

        Returns:
            The bound, in the unit of the mesh.

        Raises:
            TypeError: the input is no surface, a number has the wrong type, or the field or the surface is traced.
            ValueError: the mesh is not closed and consistently oriented, so its signed distance jumps; a number is out
                of range; or no leaf meets the mesh.
        """
        drawn, deviation = meshed(surface, float(self._known().tolerance), self.sign)
        mesh, power = _surface(drawn, self._kind)
        if not mesh.linked:
            needed = "a mesh whose edges are each traversed equally often in both directions"
            raise ValueError(f"proven_error needs {needed}; otherwise the signed distance jumps across the holes.")
        ratio, most = positive("rtol", rtol), whole_between("max_boxes", max_boxes, 1, 1 << 31)
        error = largest_error(mesh, self._known()._times(-power)._boxes(mesh), ratio, most)
        bound = np.nextafter(_scaled(error, power), np.inf)
        return float(np.nextafter(bound + deviation, np.inf) if deviation else bound)

    def save(self, path: str | Path) -> None:
        """Write the field to an .npz file with exactly this name. An interrupted call leaves no partial file.

        Args:
            path: name of the file.

        Returns:
            None.
        """
        known = self._known()
        arrays = {name: np.asarray(getattr(known, name)) for name in _ARRAYS}
        stream = io.BytesIO()
        np.savez_compressed(stream, format=_FORMAT, **arrays, **{name: getattr(known, name) for name in _OTHERS})
        replace_file(path, stream.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> "AdaptiveDistanceField":
        """Read a field that `save` wrote, in the default precision.

        Args:
            path: name of the file.

        Returns:
            The field.

        Raises:
            FileNotFoundError: the file does not exist.
            ValueError: the file holds no field, or is damaged; the message begins with its name.
        """
        try:
            return cls(**_checked(_content(path)))
        except FileNotFoundError:
            raise FileNotFoundError(f"{path}: no such file.") from None
        except (ValueError, TypeError, OverflowError) as error:
            raise ValueError(f"{path}: {str(error)[:200]}") from error

    def _times(self, power: int) -> "AdaptiveDistanceField":
        """The field with all lengths multiplied by 2^power; ValueError if they exceed the range of floats."""
        lengths = lambda f: (f.lower, f.spacing, f.values, f.tolerance)  # noqa: E731
        scaled = [_scaled(np.asarray(x), power) for x in lengths(self)]
        if not all(np.isfinite(x).all() for x in scaled[:3]):
            raise ValueError("the field is too large compared with the mesh; needs the mesh that it was built from.")
        return eqx.tree_at(lengths, self, tuple(jnp.asarray(x) for x in scaled))

    @property
    def _kind(self) -> str:
        """The sign for measuring errors: valid pseudonormals give the same sign as winding numbers."""
        return "none" if self.sign == "none" else "winding"

    def _cells(self) -> LeafCells:
        return LeafCells(*(getattr(self, name) for name in LeafCells._fields))

    def _known(self) -> "AdaptiveDistanceField":
        if is_traced(self):
            raise TypeError("the field is traced; needs concrete numbers here, as the cells depend on them.")
        return self

    def _numbers(self, points: np.ndarray) -> np.ndarray:
        """The field at points (points, 3), on the host."""
        rows = jnp.asarray(points, self.values.dtype)
        return np.asarray(values_at(self._cells(), rows, self.depth), np.float64)

    def _boxes(self, surface: Surface) -> LeafBoxes:
        """The leaves in which errors are measured."""
        lower, spacing, values = (np.asarray(x, np.float64) for x in (self.lower, self.spacing, self.values))
        leaf_corners, widths, corners = (np.asarray(x) for x in (self.leaf_corners, self.widths, self.corners))
        boxes = LeafBoxes(lower + spacing * leaf_corners, spacing * widths, values[corners])
        boxes = boxes if self.mode == "full" else meeting(surface, boxes)
        if not len(boxes.width):
            raise ValueError("no leaf of the field meets the mesh; needs the mesh that it was built from.")
        return boxes


_ARRAYS = (*LeafCells._fields, "tolerance")
_OTHERS = ("depth", "mode", "sign", "unresolved")


def _content(path: str | Path) -> Mapping[str, np.ndarray]:
    """The arrays of an archive."""
    if str(read_arrays(path, ["format"])["format"]) != _FORMAT:
        raise ValueError(f"the file holds no field, or a field of another version; needs {_FORMAT!r}.")
    return read_arrays(path, (*_ARRAYS, *_OTHERS))


def _checked(content: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The fields of a file, of the right kinds, with all indices in range."""
    known: dict[str, Any] = {"depth": int(content["depth"]), "unresolved": int(content["unresolved"])}
    known |= {
        "mode": one_of("mode", str(content["mode"]), MODES),
        "sign": one_of("sign", str(content["sign"]), (*SIGNS, PUBLISHED_SIGN)),
    }
    for name in ("lower", "spacing", "values", "tolerance"):
        known[name] = real_array(name, content[name])
    for name in ("roots", "nodes", "leaf_corners", "widths", "corners"):
        known[name] = _indices(name, content[name])
    leaves, nodes = known["widths"].size, known["nodes"].shape[0]
    shapes = {"lower": (3,), "spacing": (), "tolerance": (), "nodes": (nodes, 8), "leaf_corners": (leaves, 3)}
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
        raise ValueError(f"roots has shape {known['roots'].shape} and depth is {known['depth']}; this is no octree.")
    _check_leaves(known)
    return known


def _indices(name: str, given: np.ndarray) -> Array:
    if given.dtype.kind not in "iu" or (given.size and max(abs(int(given.min())), int(given.max())) >= 1 << 31):
        raise ValueError(f"{name} holds {given.dtype} up to {given.max(initial=0)}; needs integers of 32 bits.")
    return jnp.asarray(given.astype(np.int32))


def _check_leaves(known: dict[str, Any]) -> None:
    """Raise ValueError if leaves are out of the box, or lengths not positive."""
    leaf_corners, widths = np.asarray(known["leaf_corners"], np.int64), np.asarray(known["widths"], np.int64)
    cells = np.array(known["roots"].shape, np.int64) << known["depth"]
    if widths.size and (leaf_corners.min() < 0 or np.any(leaf_corners + widths[:, None] > cells)):
        raise ValueError(f"leaf_corners has leaves out of the box, which is {cells.tolist()} finest cells.")
    if not (known["spacing"] > 0 and known["tolerance"] > 0):
        raise ValueError(
            f"spacing is {known['spacing']:g} and tolerance {known['tolerance']:g}; needs positive lengths."
        )


def _surface(mesh: Any, sign: str = "winding", method: AbstractMeshSearch | None = None) -> tuple[Surface, int]:
    """The mesh prepared in a unit of its own, and the power of two of this unit."""
    check_mesh("surface", mesh)
    if is_traced(mesh):
        raise TypeError("surface is traced; needs concrete numbers, as the cells depend on them.")
    unit, power = in_unit(mesh)
    return surface_of(unit, sign, method), power


def _scaled(x: Any, power: int) -> Any:
    """The product x 2^power, infinite if it exceeds all floats."""
    with np.errstate(over="ignore"):
        return np.ldexp(x, power)
