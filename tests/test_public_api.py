"""The public names are there, documented and light to import; the precision is what the environment says."""

import inspect
import os
import re
from typing import Any

import pytest

import jhd
import jhd._distance
import jhd._shapes
import jhd.io
from tests.processes import python

# Names of the public interface that are built, with the parameters that they take.
PARAMETERS = {
    "BezierCurve": ["control_points", "weights"],
    "BSplineCurve": ["control_points", "knots", "weights"],
    "BSplineCurve.uniform": ["control_points", "degree", "closed", "weights"],
    "BSplineCurve.clamped": ["control_points", "degree", "weights"],
    "BezierSegments": ["control_points", "weights", "next_segment"],
    "BezierSegments.join": ["curves"],
    "BezierSegments.pad": ["self", "count"],
    "BezierSegments.elevate": ["self", "degree"],
    "BezierSegments.split": ["self", "t"],
    "BezierSegments.transform": ["self", "matrix", "offset"],
    "stack_curves": ["curves"],
    "pairwise": ["shapes", "others", "method", "executor", "store", "progress"],
    "nearest_shapes": ["queries", "shapes", "k", "method", "executor", "progress"],
    "pairs_within": ["shapes", "others", "method", "threshold", "rtol", "atol", "executor", "progress"],
    "pivot_distances": ["shapes", "points", "executor", "progress"],
    "Pairwise": ["value", "lower", "upper", "result", "computed"],
    "Neighbors": ["index", "value", "lower", "upper", "result", "ties", "computed"],
    "PairsWithin": ["index", "lower", "upper", "undecided", "result", "computed"],
    "point_set": ["array"],
    "polyline": ["points", "closed"],
    "circle": ["center", "radius"],
    "project": ["points", "shape", "method", "throw"],
    "stationary_points": ["points", "curve", "capacity", "throw"],
    "directed_hausdorff": ["a", "b", "method", "rtol", "atol", "throw"],
    "hausdorff": ["a", "b", "method", "rtol", "atol", "throw"],
    "certify": ["a", "b", "solution", "directed", "slack", "max_cells", "progress"],
    "verify": ["content", "max_seconds"],
    "Certificate": ["content"],
    "Certificate.matches": ["self", "a", "b"],
    "hausdorff_at_most": ["a", "b", "threshold", "method", "directed", "rtol", "atol", "progress"],
    "minimum_at_most": ["a", "b", "threshold", "method", "rtol", "atol", "progress"],
    "critical_pairs": ["a", "b", "capacity"],
    "minimize_hausdorff": ["build", "parameters", "target", "starts", "max_steps", "stop_below", "method", "progress"],
    "fit_outline": ["target", "tolerance", "degree", "smooth", "max_segments", "max_steps", "max_seconds", "progress"],
    "fit_curve": ["target", "degree", "segments", "ends", "closed", "smooth", "max_steps", "stop_below", "method"],
    "soft_hausdorff": ["a", "b", "temperature", "method"],
    "BranchAndBound": ["atol", "rtol", "max_steps", "queue_size"],
    "published.TwoStep": ["samples", "spacing", "max_rounds", "per", "variant"],
    "published.AlgebraicEvents": ["box_size", "capacity", "max_boxes"],
    "published.BiarcTrimming": ["box_size", "deviation", "capacity", "max_boxes", "variant", "pixels"],
    "published.CubeIntervals": ["cells", "rule", "pairs", "ends"],
    "ImplicitSurface": ["coefficients", "lower", "upper"],
    "TriangleMesh": ["vertices", "triangles"],
    "signed_distance": ["points", "mesh", "sign", "method"],
    "published.VertexVoxels": ["resolution", "capacity", "transform"],
    "voxelize": ["surface", "cells", "ranges", "progress"],
    "biarcs": ["curve", "tolerance"],
    "distance_map": ["curve", "lower", "upper", "resolution"],
    "BestFirstProjection": [],
    "ProjectedPolyhedronProjection": ["capacity"],
    "IntervalHalvingProjection": ["interval", "tolerance", "max_steps"],
    "NewtonProjection": ["tolerance", "max_steps"],
    "HybridProjection": ["interval", "rough", "tolerance", "max_steps"],
    "HausdorffSolution": ["value", "lower", "upper", "witness", "result", "stats", "directed"],
    "Witness": ["element", "t", "point", "feet", "feet_elements", "feet_params", "multipliers", "event", "direction"],
    "Projection": ["distance", "lower", "upper", "foot", "segment", "t", "result"],
    "StationaryPoints": ["segment", "t", "lower", "upper", "distance", "valid", "result"],
    "CriticalPairs": ["value", "witness", "valid", "result"],
    "FitSolution": ["parameters", "shape", "error", "optimality", "result", "stats", "history"],
    "NotProvenError": ["message", "solution"],
}
KEYWORD_ONLY = {
    "pairwise": ["executor", "store", "progress"],
    "nearest_shapes": ["executor", "progress"],
    "pairs_within": ["threshold", "rtol", "atol", "executor", "progress"],
    "certify": ["directed", "slack", "max_cells", "progress"],
    "project": ["throw"],
    "signed_distance": ["method"],
    "stationary_points": ["capacity", "throw"],
    "directed_hausdorff": ["rtol", "atol", "throw"],
    "hausdorff": ["rtol", "atol", "throw"],
    "minimize_hausdorff": ["temperature", "starts", "seed", "max_steps", "stop_below", "method", "progress"],
    "fit_curve": ["degree", "segments", "ends", "max_steps", "stop_below", "method"],
}
MODULES = [jhd, jhd._shapes, jhd._distance, jhd.io, jhd.published, jhd.typing]


def found(path):
    thing: Any = jhd
    for part in path.split("."):
        thing = getattr(thing, part)
    return thing


def public(module):
    """The names that are no modules and have no leading underscore."""
    return [(n, x) for n, x in vars(module).items() if not n.startswith("_") and not inspect.ismodule(x)]


def test_a_public_name_takes_its_parameters_in_this_order():
    for path, expected in PARAMETERS.items():
        parameters = inspect.signature(found(path)).parameters
        assert [name for name in parameters if name in expected] == expected, path
        for name in KEYWORD_ONLY.get(path, []):
            assert parameters[name].kind is inspect.Parameter.KEYWORD_ONLY, f"{path}: {name}"


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
