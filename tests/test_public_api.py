"""The public names are there, documented and light to import; the precision is what the environment says."""

import inspect
import os
import re
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

import optimistix as optx
import pytest
from typing_extensions import TypeAliasType

import jhd
import jhd._distance
import jhd._shapes
import jhd.io
from jhd.typing import ShapeLike
from tests.processes import python

MODULES = [jhd, jhd._shapes, jhd._distance, jhd.io, jhd.published, jhd.typing]
OPEN = [jhd, jhd.io, jhd.plot, jhd.published, jhd.progress, jhd.arithmetic, jhd.typing]
DUNDERS = "__call__", "__getitem__"
ENUMERATIONS = ("RESULTS", "EVENTS", "ANSWERS", "DIRECTIONS")
NAMES = """
jhd: ANSWERS AdaptiveDistanceField Approximation BSplineCurve BSplineSurface BestFirstProjection BezierCurve
    BezierPatch BezierPatches BezierSegments BiarcCurve Bounds BranchAndBound Certificate CertificateError
    CriticalPairs DIRECTIONS Decision Deviation DistanceMap DistanceProfile DistanceSamples DistanceTransform EVENTS
    FitSolution HausdorffSolution HybridProjection ImplicitSurface IntervalHalvingProjection MaxDistance
    MeanDistance MinimumSolution Neighbors NewtonProjection NotProvenError NotRegularError PairsWithin Pairwise
    Partials PatchMesh PivotDistances Prepared ProjectedPolyhedronProjection Projection QuantileDistance RESULTS
    RMSDistance StationaryPoints StatisticSolution TriangleMesh Voxels Witness arc_length arithmetic as_shape biarcs
    certify circle critical_pairs deviation directed_hausdorff distance_map distance_profile distance_transform
    fit_curve fit_outline hausdorff hausdorff_at_most inline_searches io minimize_hausdorff minimum_at_most
    minimum_distance nearest_shapes pairs_within pairwise pivot_distances plot point_set polyline prepare progress
    project published signed_distance signed_distance_transform soft_hausdorff stack_curves stationary_points
    surface_area typing verify voxelize
jhd.io: ParseError curve_from_dict curve_to_dict format_path load_certificate load_curve load_glyph load_glyphs
    load_iges load_mesh load_points load_result load_shape load_surface load_svg parse_font_spec parse_path
    save_curve save_iges save_mesh save_result save_surface save_svg surface_from_dict surface_to_dict to_geomdl
    to_path to_scipy to_shapely
jhd.plot: BLUE GRAY ORANGE VERMILLION curve deviation distance_profile distances histogram mesh meshes neighbors
    page section solution surface surfaces voxels witness
jhd.published: AlgebraicEvents BiarcTrimming CubeIntervals TiedPairs TwoStep VertexVoxels VoxelPairs
jhd.progress: Callback Progress
jhd.arithmetic: Interval
jhd.typing: Curve Method Numbers ProjectionMethod Result Shape ShapeLike Solution Statistic Surface
jhd.RESULTS: capacity_reached empty_surface existence_not_certified fit_missed_a_maximum fit_nonsmooth_stall
    fit_roundoff_limited fit_slow_progress fit_steps_exhausted fit_tolerance_missed gap_not_closed interrupted
    many_nearest_points nonfinite_value nonisolated_maxima not_certified out_of_time
jhd.EVENTS: a_end antipodal b_end coincident corner one_to_two
jhd.ANSWERS: no undecided yes
jhd.DIRECTIONS: a_to_b b_to_a
"""
SIGNATURES = """
AbstractBounds()
AbstractCurve()
AbstractCurve.__call__(t)
AbstractCurve.bounds
AbstractCurve.derivative()
AbstractCurve.dim
AbstractCurve.elevate(degree)
AbstractCurve.homogeneous
AbstractCurve.reverse()
AbstractCurve.segments()
AbstractCurve.split(t)
AbstractCurve.to_cubics(tolerance, *, max_segments=1000000)
AbstractCurve.to_polyline(tolerance, *, max_segments=1000000)
AbstractCurve.transform(matrix, offset=0.0)
AbstractCurveMethod()
AbstractCurveMethod.serves(a, b)
AbstractHasArea()
AbstractHasArea.area(*, rtol=0.0001, atol=None, max_cells=262144, throw=True, max_seconds=None)
AbstractHasLength()
AbstractHasLength.length(*, rtol=1e-06, atol=None, max_cells=262144, throw=True, max_seconds=None)
AbstractHausdorffMethod()
AbstractHostMethod()
AbstractMeshSearch()
AbstractMethod()
AbstractMethod.serves(a, b)
AbstractOutcome()
AbstractOutcome.ok
AbstractPatch()
AbstractPatch.__call__(u, v)
AbstractPatch.bounds
AbstractPatch.degrees
AbstractPatch.dim
AbstractPatch.homogeneous
AbstractPatch.partials(u, v)
AbstractPatch.patches()
AbstractPatch.to_mesh(tolerance, *, max_triangles=2000000)
AbstractPatch.transform(matrix, offset=0.0)
AbstractProjectionMethod()
AbstractResult()
AbstractResult.to_dict()
AbstractResult.to_json(**options)
AbstractSolution()
AbstractSolution.__getitem__(index)
AbstractStatistic()
AbstractStatistic.__call__(a, b, *, weights=None, rtol=0.001, atol=None, throw=True, max_seconds=None,
    progress=None)
AbstractStatistic.estimate(a, b, weights=None, nodes=None)
AdaptiveDistanceField(lower, spacing, roots, nodes, leaf_corners, widths, corners, values, tolerance, depth, mode,
    sign, unresolved)
AdaptiveDistanceField.__call__(points)
AdaptiveDistanceField.build(surface, tolerance, mode='band', *, sign=None, max_depth=12, max_cells=1500000,
    max_seconds=None, progress=None, method=None)
AdaptiveDistanceField.leaves
AdaptiveDistanceField.load(path)
AdaptiveDistanceField.proven_error(surface, *, rtol=0.25, max_boxes=400000)
AdaptiveDistanceField.sampled_error(surface, samples=100000, seed=0)
AdaptiveDistanceField.save(path)
AdaptiveDistanceField.to_mesh(resolution)
AdaptiveDistanceField.upper
Approximation(shape, deviation)
BSplineCurve(control_points, knots, weights=None, periodic=False)
BSplineCurve.__call__(t)
BSplineCurve.clamped(control_points, degree=3, weights=None)
BSplineCurve.degree
BSplineCurve.domain
BSplineCurve.elevate(degree)
BSplineCurve.from_scipy(spline)
BSplineCurve.insert_knot(t)
BSplineCurve.segments()
BSplineCurve.split(t)
BSplineCurve.to_open()
BSplineCurve.to_periodic()
BSplineCurve.uniform(control_points, degree=3, periodic=False, weights=None)
BSplineSurface(control_points, knots_u, knots_v, weights=None)
BSplineSurface.clamped(control_points, degrees=(3, 3), weights=None)
BSplineSurface.degrees
BSplineSurface.domain
BSplineSurface.patches()
BSplineSurface.restrict(u0, u1, v0, v1)
BestFirstProjection()
BezierCurve(control_points, weights=None)
BezierCurve.__call__(t)
BezierCurve.degree
BezierCurve.derivative()
BezierCurve.elevate(degree)
BezierCurve.restrict(t0, t1)
BezierCurve.reverse()
BezierCurve.segments()
BezierCurve.split(t)
BezierPatch(control_points, weights=None)
BezierPatch.degrees
BezierPatch.elevate(degree_u, degree_v)
BezierPatch.patches()
BezierPatch.restrict(u0, u1, v0, v1)
BezierPatch.split(t, axis=0)
BezierPatches(control_points, weights=None)
BezierPatches.count
BezierPatches.degrees
BezierPatches.elevate(degree_u, degree_v)
BezierPatches.join(surfaces)
BezierPatches.patches()
BezierPatches.point(patch, u, v)
BezierSegments(control_points, weights=None, next_segment=None)
BezierSegments.__call__(t)
BezierSegments.count
BezierSegments.degree
BezierSegments.derivative()
BezierSegments.elevate(degree)
BezierSegments.from_path(path)
BezierSegments.from_shapely(geometry)
BezierSegments.join(curves)
BezierSegments.next_segment
BezierSegments.pad(count)
BezierSegments.point(segment, t)
BezierSegments.restrict(t0, t1)
BezierSegments.reverse()
BezierSegments.segments()
BezierSegments.split(t)
BiarcCurve(start, end, bulge, segment, t0, t1, deviation, next_segment)
BiarcCurve.center
BiarcCurve.count
BiarcCurve.curvature
BiarcCurve.radius
BiarcCurve.segments()
BiarcCurve.sweep
BiarcCurve.tangents
Bounds(lower, upper)
Bounds.value
BranchAndBound(max_steps=4000, queue_size=512, *, rtol=0.0, atol=None)
BranchAndBound.serves(a, b)
Certificate(content)
Certificate.cells
Certificate.directed
Certificate.lower
Certificate.matches(a, b)
Certificate.save(file)
Certificate.to_dict()
Certificate.to_json()
Certificate.upper
Certificate.verify(max_seconds=None, progress=None)
CriticalPairs(value, witness, valid, result)
Decision(answer, lower, upper, result, stats, distance='two_sided', point_a=None, point_b=None)
Deviation(a, b, maximum, mean, rms, size, samples, result, stats)
Deviation.at(params=None)
Deviation.fraction_within(threshold)
Deviation.quantile(q)
Deviation.to_dict()
Deviation.to_pyvista()
Deviation.to_trimesh()
DistanceMap(distance, nearest, lower, spacing, error, arcs)
DistanceMap.centers
DistanceMap.enclose(points)
DistanceMap.max_error
DistanceProfile(t, point, distance, lower, upper, foot, result)
DistanceSamples(point, lower, upper, fraction, ends)
DistanceTransform(distance, nearest)
FitSolution(parameters, shape, error, optimality, multipliers, pairs, result, stats, history, statistic=None)
HausdorffSolution(value, lower, upper, witness, result, stats, directed=True, directions=None)
HausdorffSolution.direction
HausdorffSolution.event
HybridProjection(interval=0.1, rough=0.01, xtol=1e-14, max_steps=64)
ImplicitSurface(coefficients, lower, upper, *, reduced=None)
ImplicitSurface.__call__(points)
ImplicitSurface.bounds
ImplicitSurface.degree
ImplicitSurface.degrees
ImplicitSurface.dim
ImplicitSurface.gradient(points)
ImplicitSurface.parse(polynomial, lower, upper)
ImplicitSurface.to_mesh(tolerance, *, max_triangles=2000000)
ImplicitSurface.transform(matrix, offset=0.0)
IntervalHalvingProjection(interval=0.1, xtol=1e-08, max_steps=200)
MaxDistance(directed=False)
MeanDistance(directed=False, weights=None)
MinimumSolution(value, lower, upper, point_a, point_b, result, stats)
Neighbors(index, value, lower, upper, result, ties, computed)
Neighbors.tied
NewtonProjection(xtol=1e-14, max_steps=32)
PairsWithin(index, lower, upper, undecided, result, computed)
Pairwise(value, lower, upper, result, computed)
Partials(point, u, v, uu, uv, vv)
PatchMesh(shape, deviation, patch, u, v)
PatchMesh.on(surface)
PivotDistances(points, lower, upper, covering_radius)
Prepared(shape)
ProjectedPolyhedronProjection(capacity=32)
Projection(distance, lower, upper, foot, element, t, result)
QuantileDistance(q, directed=False, weights=None)
RMSDistance(directed=False, weights=None)
StationaryPoints(segment, t, lower, upper, distance, valid, result)
StatisticSolution(value, lower, upper, direction, result)
TriangleMesh(vertices, triangles)
TriangleMesh.area
TriangleMesh.bounds
TriangleMesh.corners
TriangleMesh.count
TriangleMesh.dim
TriangleMesh.from_object(mesh)
TriangleMesh.is_closed
TriangleMesh.is_manifold
TriangleMesh.normals
TriangleMesh.point(triangle, t)
TriangleMesh.to_pyvista()
TriangleMesh.to_trimesh()
TriangleMesh.transform(matrix, offset=0.0)
TriangleMesh.volume
Voxels(cells, lower, spacing, proven)
Voxels.centers
Voxels.count
Witness(element, t, point, feet, feet_elements, feet_params, multipliers, event, direction)
arc_length(curve, *, rtol=1e-06, atol=None, max_cells=262144, throw=True, max_seconds=None)
arithmetic.Interval(lower, upper)
arithmetic.Interval.__getitem__(index)
arithmetic.Interval.contains(x)
arithmetic.Interval.empty
arithmetic.Interval.exact(x)
arithmetic.Interval.hull(other)
arithmetic.Interval.intersection(other)
arithmetic.Interval.maximum(other)
arithmetic.Interval.midpoint
arithmetic.Interval.minimum(other)
arithmetic.Interval.shape
arithmetic.Interval.sqrt()
arithmetic.Interval.square()
arithmetic.Interval.whole(shape=())
arithmetic.Interval.width
as_shape(shape)
biarcs(curve, tolerance)
certify(a, b, solution, *, directed=False, slack=None, max_cells=100000, max_seconds=None, progress=None)
circle(center, radius)
critical_pairs(a, b, capacity=16)
deviation(a, b, *, rtol=0.001, atol=None, quantile=None, weights=None, max_cells=131072, throw=True,
    max_seconds=None, progress=None)
directed_hausdorff(a, b, method=None, *, rtol=None, atol=None, throw=True, max_seconds=None, progress=None)
distance_map(curve, lower, upper, resolution, *, tolerance=None, tile=32)
distance_profile(a, b, samples=64)
distance_transform(features, spacing=1.0, *, method='exact')
fit_curve(target, *, degree, segments=None, tolerance=None, statistic=None, ends='fixed', closed=None, smooth=False,
    max_steps=60, max_seconds=None, stop_below=0.0, method=None, progress=None)
fit_outline(target, tolerance, *, degree=3, smooth=False, max_segments=64, max_steps=40, max_seconds=None,
    progress=None)
hausdorff(a, b, method=None, *, rtol=None, atol=None, throw=True, max_seconds=None, progress=None)
hausdorff_at_most(a, b, threshold, method=None, *, directed=False, rtol=None, atol=None, max_seconds=None,
    progress=None)
inline_searches(enabled=True)
io.curve_from_dict(content)
io.curve_to_dict(curve)
io.format_path(curve, *, tolerance=None)
io.load_certificate(file)
io.load_curve(file)
io.load_glyph(font, text, *, size=None)
io.load_glyphs(font, *, size=None)
io.load_iges(file, unit='MM')
io.load_mesh(file)
io.load_points(file)
io.load_result(file)
io.load_shape(text)
io.load_surface(file)
io.load_svg(file, ids=None, *, y_up=False)
io.parse_font_spec(spec)
io.parse_path(d)
io.save_curve(file, curve)
io.save_iges(file, shapes, *, unit='MM')
io.save_mesh(file, mesh, *, text=False)
io.save_result(file, solution, /, **context)
io.save_surface(file, surface)
io.save_svg(file, curves, *, y_up=False, tolerance=None)
io.surface_from_dict(content)
io.surface_to_dict(surface)
io.to_geomdl(surface)
io.to_path(curve, tolerance=None)
io.to_scipy(shape, *, homogeneous=False)
io.to_shapely(curve, tolerance=None, *, filled=False)
minimize_hausdorff(build, parameters, target, *, statistic=None, temperature=None, starts=1, seed=0, max_steps=60,
    max_seconds=None, stop_below=0.0, capacity=None, method=None, progress=None)
minimum_at_most(a, b, threshold, method=None, *, rtol=None, atol=None, max_seconds=None, progress=None)
minimum_distance(a, b, method=None, *, rtol=None, atol=None, throw=True, max_seconds=None, progress=None)
nearest_shapes(queries, shapes, k=1, method=None, *, rtol=None, atol=None, executor=None, max_seconds=None,
    progress=None)
pairs_within(shapes, others=None, method=None, *, threshold, rtol=None, atol=None, executor=None, max_seconds=None,
    progress=None)
pairwise(shapes, others=None, method=None, *, rtol=None, atol=None, executor=None, store=None, max_seconds=None,
    progress=None)
pivot_distances(shapes, points=None, *, executor=None, max_seconds=None, progress=None)
plot.curve(shape, ax=None, *, color='#0072B2', linestyle='-', label=None, control_polygon=True, samples=32)
plot.deviation(found, ax=None, *, labels=('A', 'B'), unit=None, witness=True, color_bar=True)
plot.distance_profile(a, b, ax=None, solution=None, *, labels=('A', 'B'), unit='input units', color='#0072B2',
    samples=None)
plot.distances(a, b, solution, ax=None, *, labels=('A', 'B'), unit=None, witness=True, color_bar=True)
plot.histogram(found, ax=None, *, labels=('A', 'B'), unit=None)
plot.mesh(shape, ax=None, *, color='#0072B2', label=None, alpha=1.0)
plot.meshes(shapes, ax=None, *, colors=('#0072B2', '#E69F00'), labels=('A', 'B'), alpha=0.6)
plot.neighbors(queries, shapes, found, axes=None, *, rows=None, query_names=None, names=None)
plot.page(a, b=None, solution=None, *, labels=('A', 'B'), unit='input units')
plot.section(shape, cells, ax=None, *, axis=2, at=None, legend=True)
plot.solution(a, b, solution, ax=None, *, labels=('A', 'B'), control_polygon=True, legend=True)
plot.surface(shape, ax=None, *, color='#0072B2', label=None, alpha=0.75, cells=48)
plot.surfaces(shapes, ax=None, *, colors=('#0072B2', '#E69F00'), labels=('A', 'B'), alpha=0.6, cells=48)
plot.voxels(cells, ax=None, *, colors=('#0072B2', '#D55E00'), legend=True)
plot.witness(solution, ax=None, *, distance=True, empty_circle=True)
point_set(array)
polyline(points, closed=False)
prepare(shape)
progress.Progress(stage, done, total=None, lower=None, upper=None, details=mappingproxy({}))
project(points, shape, method=None, *, throw=True, max_seconds=None)
published.AlgebraicEvents(box_size=None, capacity=256, max_boxes=8388608)
published.BiarcTrimming(box_size=None, deviation=None, capacity=256, max_boxes=8388608, variant='ours', pixels=512)
published.CubeIntervals(cells=64, rule='safe', pairs='separable', ends='cells')
published.CubeIntervals.serves(a, b)
published.TiedPairs(cells_a, cells_b, distance, points_a, points_b)
published.TwoStep(samples=None, spacing='uniform', max_rounds=16, per='segment', variant='ours')
published.VertexVoxels(resolution=None, capacity=16777216, transform='exact')
published.VertexVoxels.voxels(mesh)
published.VoxelPairs(spacing, samples=10, ties='first', origin=None)
published.VoxelPairs.pairs(a, b)
published.VoxelPairs.serves(a, b)
signed_distance(points, mesh, sign=None, *, method=None)
signed_distance_transform(inside, spacing=1.0)
soft_hausdorff(a, b, temperature, method=None, *, rtol=None, atol=None, throw=True)
stack_curves(curves)
stationary_points(points, curve, *, capacity=32, throw=True)
surface_area(surface, *, rtol=0.0001, atol=None, max_cells=262144, throw=True, max_seconds=None)
verify(content, *, max_seconds=None, progress=None)
voxelize(surface, cells, *, ranges='bernstein', max_seconds=None, progress=None)
"""


def public(module):
    """The names that are no modules and have no leading underscore."""
    return [(n, x) for n, x in vars(module).items() if not n.startswith("_") and not inspect.ismodule(x)]


def unwrapped(value):
    """The function of a method, a property or a decorated function; None for other members."""
    for name in ("__func__", "fget", "method"):
        value = getattr(value, name, value)
    return inspect.unwrap(value) if inspect.isfunction(value) else None


def public_things():
    """The functions, classes, methods and aliases of the public modules by name; inherited methods by their class."""
    found = {}
    for module in OPEN:
        for name in module.__all__:
            thing = getattr(module, name)
            path = f"{module.__name__}.{name}".removeprefix("jhd.")
            bases = [c for c in thing.__mro__ if c.__module__.startswith("jhd")] if inspect.isclass(thing) else []
            found |= {} if inspect.ismodule(thing) or bases else {path: thing}
            # A name that is exported twice, as that of a class or of its type, stands here once.
            new = {path if c is thing else c.__name__: c for c in bases if c not in found.values()}
            own = {f"{where}.{n}": unwrapped(x) for where, c in new.items() for n, x in vars(c).items()}
            found |= new | {where: x for where, x in own.items() if x and (is_open(where) or where.endswith(DUNDERS))}
    return found


def is_open(path):
    return not path.rpartition(".")[2].startswith("_")


def contains_any(hint) -> bool:
    """Whether Any stands somewhere in an annotation, also behind the name of an alias."""
    parts = [hint.__value__] if isinstance(hint, TypeAliasType) else get_args(hint)
    return hint is Any or any(map(contains_any, hint if isinstance(hint, list) else parts))


def test_no_public_parameter_result_or_field_is_any():
    assert contains_any(list[dict[str, Any]]) and contains_any(Callable[[Any], int]) and not contains_any(ShapeLike)
    wrong = []
    for path, thing in public_things().items():
        if not inspect.isclass(thing) and not inspect.isfunction(thing):
            hints = {"alias": thing}
        else:
            hints = get_type_hints(thing) | (get_type_hints(thing.__init__) if inspect.isclass(thing) else {})
        wrong += [f"{path}: {name}" for name, hint in hints.items() if is_open(name) and contains_any(hint)]
    assert not wrong


def signature_of(path, thing):
    """The parameters with their kinds and defaults, without annotations and `self`."""
    whole = inspect.signature(thing)
    bare = [p.replace(annotation=p.empty) for p in whole.parameters.values() if p.name not in ("self", "cls")]
    return f"{path}{whole.replace(parameters=bare, return_annotation=whole.empty)}"


def test_a_public_function_or_class_takes_these_parameters():
    """Enumerations and exceptions are left out; a property has no parentheses."""
    things = public_things()
    taken = {
        path: thing
        for path, thing in things.items()
        if (inspect.isclass(thing) and not issubclass(thing, Exception)) or inspect.isfunction(thing)
    }
    properties = {
        f"{path}.{name}"
        for path, thing in things.items()
        if inspect.isclass(thing)
        for name, x in vars(thing).items()
        if isinstance(x, property)
    }
    listed = sorted(
        path if path in properties else signature_of(path, thing)
        for path, thing in taken.items()
        if path not in ENUMERATIONS
    )
    assert listed == SIGNATURES.replace("\n    ", " ").strip().splitlines()


def members(enumeration):
    return set(vars(enumeration)["_name_to_item"])


def test_public_names_and_members_of_enumerations_are_these():
    held = {module.__name__: module.__all__ for module in OPEN}
    # Those of optimistix belong to its version.
    held |= {f"jhd.{name}": members(getattr(jhd, name)) - members(optx.RESULTS) for name in ENUMERATIONS}
    lines = [f"{where}: {' '.join(sorted(names))}" for where, names in held.items()]
    assert lines == NAMES.replace("\n    ", " ").strip().splitlines()


def test_a_public_name_has_a_docstring_of_its_own():
    for module in MODULES:
        for name, thing in public(module):
            doc = vars(thing).get("__doc__") if inspect.isclass(thing) else thing.__doc__
            # A dataclass without a docstring gets its signature in place of one.
            assert doc and not doc.startswith(f"{name}("), f"{module.__name__}.{name}"


def test_every_public_method_is_documented_and_annotated():
    for name, thing in public(jhd):
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            function = getattr(value, "__func__", value)
            if not member.startswith("_") and inspect.isfunction(function):
                assert inspect.getdoc(getattr(thing, member)), f"{name}.{member}"
                assert "return" in function.__annotations__, f"{name}.{member}"


def test_names_below_are_those_on_top():
    for module in (jhd._shapes, jhd._distance):
        for name, thing in public(module):
            # Abstract classes and the like, which few need, are public in their folder alone.
            assert getattr(jhd, name, thing) is thing, name


def test_the_version_is_one_of_pep_440():
    pattern = r"(\d+!)?\d+(\.\d+)*((a|b|rc)\d+)?(\.post\d+)?(\.dev\d+)?(\+[a-z0-9]+(\.[a-z0-9]+)*)?"
    assert re.fullmatch(pattern, jhd.__version__)


def in_process(code, **environment):
    """What a fresh interpreter prints; JAX_ENABLE_X64 is unset unless given."""
    variables = {name: value for name, value in os.environ.items() if name != "JAX_ENABLE_X64"} | environment
    return python("-W", "error", "-c", code, env=variables).stdout.split()


PRECISION = "print(jhd.point_set([[0, 1]]).control_points.dtype)"


def test_importing_is_light_switches_float64_on_and_loads_the_readers_of_files_when_they_are_named():
    heavy = ("matplotlib.pyplot", "scipy.spatial", "trimesh", "skimage", "svgelements", "shapely", "sympy")
    light = f"print(len([name for name in {heavy!r} if name in sys.modules]))"
    files = "'jhd.io' in sys.modules, callable(jhd.io.load_shape), 'jhd.io' in sys.modules"
    code = f"import jhd, sys; {light}; print(hasattr(jhd, 'nothing'), {files}); {PRECISION}"
    assert in_process(code) == ["0", "False", "False", "True", "True", "float64"]


@pytest.mark.slow
def test_the_environment_keeps_float32():
    """Whatever word says so; a word that says otherwise switches float64 on."""
    again = f"os.environ['JAX_ENABLE_X64'] = value; importlib.reload(jhd); {PRECISION}"
    code = f"import importlib, jhd, os; {PRECISION}\nfor value in ('False', 'off', '1'): {again}"
    assert in_process(code, JAX_ENABLE_X64="0") == ["float32", "float32", "float32", "float64"]


def test_every_public_name_is_listed():
    modules = {name for name, value in vars(jhd).items() if inspect.ismodule(value)}
    public = {name for name in vars(jhd) if not name.startswith("_")} - modules
    assert sorted(jhd.__all__) == sorted(public | {"arithmetic", "io", "plot", "progress", "published", "typing"})
