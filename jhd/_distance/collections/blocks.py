"""Pairs of curves in blocks: shapes are padded to a few sizes, with one compiled function for each size.

Degrees are raised within the compiled function, by matrices that are passed in, after coordinates were centered. So
jhd._distance.normalization.curves accounts for the errors, and one function serves curves of several degrees. The
result of a pair depends on its two curves alone, to the last bit, and not on its block. If a process has several
devices, each of them measures a part of a block.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import PartitionSpec
from jaxtyping import Array

from jhd._arithmetic.scaling import unit_weights
from jhd._distance.normalization.coordinates import Frame, common_points, extremes, frame_of, reported
from jhd._distance.normalization.curves import elevation_matrix, raised, raised_degree
from jhd._distance.normalization.directions import larger
from jhd._distance.normalization.stopping import Aim
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._results.solution import DIRECTIONS, in_direction
from jhd._runtime.arrays import varying
from jhd._runtime.compiled import optimized
from jhd._shapes.curve import BezierSegments
from jhd._shapes.unchecked import trusted

# Numbers of segments that are compiled, and pairs of a block: some tenths of a second of work each. A function takes
# ten seconds to compile, and a repeated segment costs little.
SIZES = {16: 256, 48: 256, 192: 128, 768: 32}


class PairKind(NamedTuple):
    """The kind of pairs that a function is compiled for: segments, degree, dimension, and whether there are weights."""

    size: int
    degree: int
    dim: int
    rational: bool


class CurveRows(NamedTuple):
    """Curves of one size: their arrays on the host, and the matrices that raise their degrees."""

    points: Any  # control points, the last one of each segment repeated up to the compiled degree
    weights: Any  # weights, repeated in the same way, or None
    next_segment: Any  # the joints
    raising: Any  # a matrix for each curve, zero for repeated points


class Block(NamedTuple):
    """Pairs of curves of one kind, and the range in which each distance matters."""

    a: CurveRows  # the first curve of each pair
    b: CurveRows  # the second curve of each pair
    level: Any  # distances up to this length do not matter, in the unit of the coordinates
    ceiling: Any  # distances above this length need no closer bounds
    count: Any  # number of pairs to measure; the others fill the block
    method: BranchAndBound  # the options


class MeasuredPairs(NamedTuple):
    """Distances of pairs with their bounds, in the unit of the coordinates; `result` holds numbers of RESULTS."""

    value: Any
    lower: Any
    upper: Any
    result: Any


def kind_of(a: BezierSegments, b: BezierSegments) -> PairKind | None:
    """Return the kind of a pair of curves; None if they have too many segments for blocks."""
    most = max(a.count, b.count)
    size = next((size for size in SIZES if size >= most), None)
    rational = a.weights is not None or b.weights is not None
    return None if size is None else PairKind(size, raised_degree(max(a.degree, b.degree)), a.dim, rational)


def row_of(curve: BezierSegments, kind: PairKind) -> CurveRows:
    """Return one curve in the form for compiled functions of this kind."""
    segment = np.minimum(np.arange(kind.size), curve.count - 1)
    slot = np.minimum(np.arange(kind.degree + 1), curve.degree)
    points, weights = np.asarray(curve.control_points), None
    if kind.rational:
        weights = np.ones(points.shape[:-1], points.dtype) if curve.weights is None else np.asarray(curve.weights)
        weights = weights[segment][:, slot]
    raising = _raising(curve.degree, kind.degree).astype(points.dtype)
    return CurveRows(points[segment][:, slot], weights, np.asarray(curve.next_segment)[segment], raising)


@lru_cache(maxsize=64)
def _raising(degree: int, target: int) -> np.ndarray:
    matrix = np.zeros((target + 1, target + 1))
    matrix[:, : degree + 1] = elevation_matrix(degree, target)
    return matrix


def block_of(rows: list[tuple[CurveRows, CurveRows]], level: Any, ceiling: Any, length: int, method: Any) -> Block:
    """Return the block of these pairs, filled up to its length by repetitions that are not measured."""
    index = np.minimum(np.arange(length), len(rows) - 1)
    a, b = (_stacked([pair[k] for pair in rows], index) for k in range(2))
    dtype = a.points.dtype
    return Block(a, b, np.asarray(level, dtype)[index], np.asarray(ceiling, dtype)[index], len(rows), method)


def _stacked(rows: list[CurveRows], index: np.ndarray) -> CurveRows:
    return CurveRows(*(None if x[0] is None else np.stack([x[k] for k in index]) for x in zip(*rows, strict=True)))


def measure_block(block: Block) -> MeasuredPairs:
    """Return the distances of a block's pairs, each measured by one of this process's devices."""
    devices = _devices()
    if len(devices) == 1:
        found = _measured(block._replace(count=np.asarray(block.count)))
        return MeasuredPairs(*(np.asarray(x)[: block.count] for x in found))
    shares, place = _shares(block, len(devices))
    return MeasuredPairs(*(np.asarray(x)[place] for x in _shared(devices)(shares)))


def _devices() -> tuple[Any, ...]:
    """Return the devices of this process, or only the one that the user has chosen."""
    chosen: Any = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return tuple(jax.local_devices()) if chosen is None else (chosen,)


def _shares(block: Block, parts: int) -> tuple[Block, np.ndarray]:
    """Return the block with its pairs dealt to `parts` parts in turn, and the position of each pair.

    Consecutive pairs take about equally long, so the parts do too.
    """
    length = -(-len(block.level) // parts)
    pairs = np.minimum(np.arange(length) * parts + np.arange(parts)[:, None], len(block.level) - 1).ravel()
    a, b, level, ceiling = jax.tree_util.tree_map(lambda x: x[pairs], (block.a, block.b, block.level, block.ceiling))
    counts = (block.count - np.arange(parts) + parts - 1) // parts
    pair = np.arange(block.count)
    return Block(a, b, level, ceiling, counts, block.method), pair % parts * length + pair // parts


@lru_cache(maxsize=4)
def _shared(devices: tuple[Any, ...]) -> Any:
    """Return `_measured` with a part of the pairs on each device, without waiting for each other."""
    shares: Any = PartitionSpec("pairs")
    everywhere: Any = PartitionSpec()
    places = Block(shares, shares, shares, shares, shares, everywhere)

    def on_each(block: Block) -> MeasuredPairs:
        return _measured(block._replace(count=block.count[0]))

    mesh = jax.sharding.Mesh(np.array(devices), ("pairs",))
    return optimized(jax.shard_map(on_each, mesh=mesh, in_specs=(places,), out_specs=shares))


@optimized
def _measured(block: Block) -> MeasuredPairs:
    # Side by side each pair would last as long as the longest one, which serves an accelerator alone.
    return _in_turn(block) if jax.default_backend() == "cpu" else _side_by_side(block)


def _in_turn(block: Block) -> MeasuredPairs:
    """Measure only the first `count` pairs, so that a partly filled block costs only its pairs."""
    pairs = block.a, block.b, block.level, block.ceiling

    def one(k: Any, out: MeasuredPairs) -> MeasuredPairs:
        found = _pair(jax.tree_util.tree_map(lambda x: x[k], pairs), block.method)
        return MeasuredPairs(*(x.at[k].set(y) for x, y in zip(out, found, strict=True)))

    number = jnp.zeros_like(block.level)
    empty = varying(MeasuredPairs(number, number, number, jnp.zeros(number.shape, int)), pairs)
    return jax.lax.fori_loop(0, block.count, one, empty)


def _side_by_side(block: Block) -> MeasuredPairs:
    ceiling = jnp.where(jnp.arange(block.ceiling.size) < block.count, block.ceiling, -1.0)
    return jax.vmap(lambda pair: _pair(pair, block.method))((block.a, block.b, block.level, ceiling))


def _pair(pair: tuple[CurveRows, CurveRows, Array, Array], method: BranchAndBound) -> MeasuredPairs:
    """Measure both directions of one pair, with its level and its ceiling."""
    a, b, level, ceiling = pair
    frame = frame_of([extremes(row.points) for row in (a, b)])
    p, q = (_in_common(frame, row) for row in (a, b))
    low = frame.common(level, 0.0)
    high = jnp.where(jnp.isfinite(ceiling), frame.common(ceiling, np.inf), jnp.inf)

    def one(aim: Aim, turn: Any) -> tuple[Aim, Any]:
        found = method._directed(turn[0], turn[1], frame, aim)
        # In the second direction, distances below the first one do not matter, and none does if the first is above the
        # ceiling.
        most = jnp.where(found.lower > aim.ceiling, -1.0, aim.ceiling)
        return Aim(jnp.maximum(aim.level, found.lower), most), found

    both = jax.tree_util.tree_map(lambda x, y: jnp.stack([x, y]), (p, q), (q, p))
    _, found = jax.lax.scan(one, varying(Aim(low, high), both), both)
    there, back = (jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(2))
    there, back = in_direction(there, DIRECTIONS.a_to_b), in_direction(back, DIRECTIONS.b_to_a)
    whole = larger(reported(frame, there), reported(frame, back))
    return MeasuredPairs(whole.value, whole.lower, whole.upper, jnp.asarray(whole.result._value, int))


def _in_common(frame: Frame, row: CurveRows) -> BezierSegments:
    """Return the curve in common coordinates and of the compiled degree, as in jhd._distance.normalization.curves."""
    weights = None if row.weights is None else unit_weights(row.weights)
    return trusted(*raised(row.raising, common_points(frame, row.points), weights), row.next_segment)
