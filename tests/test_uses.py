"""Each kind of shape as users put it into traced code: closed over, passed, built or moved there, by every entry.

Most uses are only traced, which takes no compiler: what asks for numbers that are not known there fails so.
"""

from collections.abc import Callable
from itertools import product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
import pytest

import jhd
from tests.sweeps import swept

_PLANE = np.array([(0.0, 0.0), (1.0, 2.0), (3.0, 1.0), (4.0, 3.0)])
_SPACE = np.concatenate([_PLANE, 0.5 * _PLANE[::-1, :1]], axis=1)
_GRID = np.stack(np.broadcast_arrays(*np.ogrid[0:4.0, 0:4.0], 0.3), axis=2) + 0.1 * np.sin(np.arange(48.0)).reshape(
    4, 4, 3
)
_WEIGHTS = np.array([1.0, 0.5, 2.0, 1.0])
_SPHERE = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-2.0] * 3, [2.0] * 3)

# A shape of each kind, from a number that scales it.
_SHAPES: dict[str, Callable[[Any], Any]] = {
    "Bezier": lambda s: jhd.BezierCurve(s * _PLANE),
    "rational": lambda s: jhd.BezierCurve(s * _PLANE, s * _WEIGHTS),
    "clamped": lambda s: jhd.BSplineCurve.clamped(s * _PLANE, degree=2),
    "closed": lambda s: jhd.BSplineCurve.uniform(s * _PLANE, periodic=True),
    "NURBS": lambda s: jhd.BSplineCurve.clamped(s * _PLANE, degree=2, weights=s * _WEIGHTS),
    "segments": lambda s: jhd.BezierSegments(s * _PLANE[np.array([(0, 1, 2), (2, 3, 0)])]),
    "polyline": lambda s: jhd.polyline(s * _PLANE),
    "circle": lambda s: jhd.circle((1.0, 0.5), s),
    "points": lambda s: jhd.point_set(s * _PLANE),
    "curve in space": lambda s: jhd.BSplineCurve.clamped(s * _SPACE, degree=2),
    "patch": lambda s: jhd.BezierPatch(s * _GRID),
    "B-spline surface": lambda s: jhd.BSplineSurface.clamped(s * _GRID, (2, 2)),
    "mesh": lambda s: jhd.TriangleMesh(s * _SPACE, [(0, 1, 2), (1, 2, 3)]),
    "points in space": lambda s: jhd.point_set(s * _SPACE),
    "implicit": lambda s: jhd.ImplicitSurface(s * np.asarray(_SPHERE.coefficients), [-2.0] * 3, [2.0] * 3),
}
_KINDS = tuple(_SHAPES)
_CURVES = _KINDS[:8] + ("curve in space",)
_TO = np.eye(3) + 0.1
# The default gap of searches, relative to the size; programs of other sizes differ within it.
_SAME = 1e-9


def _other(shape: Any, s: Any) -> Any:
    """What distances are taken to: a polyline of the same dimension."""
    return jhd.polyline(s * (_PLANE if _dim(shape) == 2 else _SPACE)[::2] + 0.25)


def _dim(shape: Any) -> int:
    return getattr(shape, "dim", 3)


_ENTRIES: dict[str, Callable[[Any, Any], Any]] = {
    "hausdorff": lambda a, b: jhd.hausdorff(a, b).value,
    "directed": lambda a, b: jhd.directed_hausdorff(a, b).value,
    "directed to": lambda a, b: jhd.directed_hausdorff(b, a).value,
    "minimum": lambda a, b: jhd.minimum_distance(a, b).value,
    "project": lambda a, b: jhd.project(b.segments().control_points[0], a).distance.sum(),
    "soft": lambda a, b: jhd.soft_hausdorff(a, b, 0.1),
    "mean": lambda a, b: jhd.MeanDistance()(a, b).value,
    "quantile": lambda a, b: jhd.QuantileDistance(0.5, directed=True)(a, b).value,
}


def _moved(shape: Any, s: Any) -> Any:
    dim = _dim(shape)
    return shape.transform(s * _TO[:dim, :dim], s * np.ones(dim))


def _use(kind: str, way: str, entry: str, differentiated: bool) -> tuple[Callable[[Any], Any], Any]:
    """A function of arrays and where it is asked for."""
    known, measured = _SHAPES[kind](1.0), _ENTRIES[entry]
    if way == "argument":
        arrays, rest = eqx.partition(known, eqx.is_inexact_array if differentiated else eqx.is_array)
        return lambda x: measured(eqx.combine(x, rest), _other(known, 1.0)), arrays
    taken = {
        "known": lambda s: (known, _other(known, s)),
        "all known": lambda s: (known, _other(known, 1.0)),
        "built": lambda s: (_SHAPES[kind](s), _other(known, 1.0)),
        "moved": lambda s: (_moved(known, s), _other(known, 1.0)),
    }[way]
    return lambda s: measured(*taken(s)), jnp.asarray(1.1)


def _twice(x: Any) -> Any:
    return jax.tree_util.tree_map(lambda y: jnp.stack([y, y]), x)


_TRACES: dict[str, Callable[[Callable[[Any], Any], Any], tuple[Callable[[Any], Any], Any]]] = {
    "jit": lambda f, x: (jax.jit(f), x),
    "grad": lambda f, x: (jax.grad(f), x),
    "vmap": lambda f, x: (jax.vmap(f), _twice(x)),
    "scan": lambda f, x: (lambda rows: jax.lax.scan(lambda total, y: (total + f(y), None), 0.0, rows)[0], _twice(x)),
}
_WAYS = "known", "all known", "argument", "built", "moved"
# Those whose search is part of the program take a second to trace, those of batches three.
_LONG = "hausdorff", "directed", "directed to", "minimum"
_SHORT = "project", "mean", "quantile"


def _serves(kind: str, entry: str) -> bool:
    if entry == "soft":
        return kind in _CURVES
    return not (kind == "implicit" and entry in ("mean", "quantile"))


def _covering(i: int, j: int) -> tuple[str, str, str, str]:
    """A kind in a way: known ones by an entry that is long to trace, the others by one that is short."""
    entries = [entry for entry in (_SHORT if j else _LONG) if _serves(_KINDS[i], entry)]
    traces = [trace for trace in _TRACES if j or trace != "vmap"]
    return _KINDS[i], _WAYS[j], entries[(i + j) % len(entries)], traces[(i + i // 4 + j) % len(traces)]


# Each kind as known, and in one of the other ways; slow tests take a second one of those.
_WAY_OF = [(i, j) for i in range(len(_KINDS)) for j in (0, 1 + i % (len(_WAYS) - 1))]
_COVERING = [_covering(i, j) for i, j in _WAY_OF]
_COVERING += [("clamped", "known", "soft", "jit"), ("closed", "known", "directed", "vmap")]
_OTHERS = [_covering(*x) for x in product(range(len(_KINDS)), range(len(_WAYS))) if x not in _WAY_OF]
_OFTEN = [_covering(i, 1 + (i + 1 + i // 4 % 3) % (len(_WAYS) - 1)) for i in range(len(_KINDS))]


def _traced(kind: str, way: str, entry: str, trace: str) -> Any:
    function, x = _TRACES[trace](*_use(kind, way, entry, trace == "grad"))
    return jax.make_jaxpr(function)(x)


@pytest.mark.parametrize(("kind", "way", "entry", "trace"), swept(_COVERING + _OTHERS, _COVERING, _OFTEN))
def test_each_kind_of_shape_is_traced_however_it_comes(kind, way, entry, trace):
    (found,) = _traced(kind, way, entry, trace).out_avals[:1]
    assert jnp.issubdtype(found.dtype, jnp.floating)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", _KINDS)
def test_each_kind_of_shape_is_traced_by_every_entry(kind):
    failed = {}
    for way, entry, trace in product(_WAYS, [entry for entry in _ENTRIES if _serves(kind, entry)], _TRACES):
        try:
            (found,) = _traced(kind, way, entry, trace).out_avals[:1]
            assert jnp.issubdtype(found.dtype, jnp.floating)
        except Exception as error:  # all cells that fail are named
            failed[way, entry, trace] = repr(error)
    assert not failed


# Those whose programs are small: they call the search, or only look for feet.
@pytest.mark.parametrize(
    ("kind", "way", "entry", "trace"),
    [
        ("closed", "moved", "project", "jit"),
        ("mesh", "built", "project", "vmap"),
    ],
)
def test_what_a_program_finds_is_what_the_plain_call_finds(kind, way, entry, trace):
    plain, x = _use(kind, way, entry, trace == "grad")
    function, given = _TRACES[trace](plain, x)
    np.testing.assert_allclose(jax.jit(function)(given), np.broadcast_to(plain(x), np.shape(given)), rtol=_SAME)


def _spline() -> jhd.BSplineCurve:
    return jhd.BSplineCurve.clamped(_PLANE, degree=2)


def _shifted(p: Any) -> jhd.BSplineCurve:
    return _spline().transform(p[0] * jnp.eye(2), p[1:])


_START, _GOAL = jnp.asarray([1.0, 0.0, 0.0]), jnp.asarray([1.2, 0.1, 0.2])


def _missed(p: Any) -> float:
    return float(np.max(np.abs(np.asarray(p - _GOAL))))


@pytest.mark.slow
def test_optimistix_minimizes_the_distance_to_a_known_spline():
    target = _shifted(_GOAL)
    loss = lambda p, _: jhd.hausdorff(_shifted(p), target).value  # noqa: E731
    found = optx.minimise(loss, optx.BFGS(1e-6, 1e-6), _START, max_steps=40, throw=False)
    assert _missed(found.value) < 0.5 * _missed(_START)


def test_optimistix_fits_a_known_spline_to_samples_by_least_squares():
    samples = _shifted(_GOAL)(np.linspace(0.0, 2.0, 4))
    distances = lambda p, _: jhd.project(samples, _shifted(p)).distance  # noqa: E731
    found = optx.least_squares(distances, optx.LevenbergMarquardt(1e-8, 1e-8), _START, max_steps=40, throw=False)
    assert _missed(found.value) < 0.1 * _missed(_START)


@pytest.mark.slow
def test_an_optax_loop_moves_a_spline_toward_a_known_one():
    target, adam = _shifted(_GOAL), optax.adam(0.05)
    loss = jax.value_and_grad(lambda p: jnp.sum(jhd.project(target.control_points, _shifted(p)).distance ** 2))

    @jax.jit
    def step(p: Any, state: Any) -> Any:
        value, slope = loss(p)
        change, state = adam.update(slope, state)
        return value, optax.apply_updates(p, change), state

    p, state, values = _START, adam.init(_START), []
    for _ in range(20):
        value, p, state = step(p, state)
        values.append(float(value))
    assert values[-1] < 0.5 * values[0]


def test_filter_jit_takes_a_shape_and_knows_another():
    mesh, other = _SHAPES["mesh"](1.0), _SHAPES["mesh"](1.5)
    distance = lambda x: jhd.hausdorff(x, other).value  # noqa: E731
    np.testing.assert_allclose(eqx.filter_jit(distance)(mesh), distance(mesh), rtol=_SAME)


def test_a_scan_of_steps_moves_a_known_mesh_toward_points():
    mesh, points = _SHAPES["mesh"](1.0), _SPACE + 0.25
    loss = jax.value_and_grad(lambda shift: jnp.sum(jhd.project(points, mesh.transform(np.eye(3), shift)).distance))

    def step(shift: Any, _: Any) -> Any:
        value, slope = loss(shift)
        return shift - 0.02 * slope, value

    values = jax.jit(lambda: jax.lax.scan(step, jnp.zeros(3), length=5)[1])()
    assert float(values[-1]) < float(values[0])
