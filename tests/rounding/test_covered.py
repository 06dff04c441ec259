"""Every use of a rounding constant is compared with derived errors, or is listed with the reason why it is not."""

import ast
from pathlib import Path

import jhd

# What constants of rounding are made of.
NAMES = {"gamma", "absolute_error", "unit_roundoff", "smallest_normal", "eps", "tiny", "smallest_subnormal"}
FOLDERS = ("_arithmetic/rounding.py", "_distance/normalization", "_distance/nearest", "_distance/cells")

_CURVES = "test_margins.py"
_KERNELS = "test_kernels.py"
_EXACT = "tests of their own, against exact rationals"
_SAMPLED = "tests of its own, in a narrow format against exact values"

# File, function, number of uses: where they are compared.
COVERED = {
    ("_arithmetic/rounding.py", "gamma", 1): _EXACT,
    ("_arithmetic/rounding.py", "absolute_error", 2): _EXACT,
    ("_arithmetic/rounding.py", "_margin", 2): _EXACT,
    ("_arithmetic/rounding.py", "flush_down", 1): _EXACT,
    ("_distance/cells/flat_pieces.py", "_sag", 9): _KERNELS,
    ("_distance/cells/branches.py", "_split_bound", 3): _CURVES,
    ("_distance/cells/branches.py", "_split_bound.bound", 3): _CURVES,
    ("_distance/cells/branches.py", "first_upper_bound", 2): _CURVES,
    ("_distance/cells/branches.py", "first_upper_bound.bound", 1): _CURVES,
    ("_distance/cells/branches.py", "_run_bound", 2): _CURVES,
    ("_distance/cells/foot_maps.py", "_length", 1): _KERNELS,
    ("_distance/cells/foot_maps.py", "bound_between", 9): _KERNELS,
    ("_distance/cells/graphs.py", "control_points", 1): _KERNELS,
    ("_distance/cells/graphs.py", "rates", 2): _KERNELS,
    ("_distance/cells/graphs.py", "values_on_graph", 1): _KERNELS,
    ("_distance/cells/graphs.py", "values_over", 1): _KERNELS,
    ("_distance/cells/normal_offset_bounds.py", "_divided", 5): _SAMPLED,
    ("_distance/cells/normal_offset_bounds.py", "growth_beyond", 1): _SAMPLED,
    ("_distance/cells/normal_offset_bounds.py", "heights_between", 8): _SAMPLED,
    ("_distance/cells/lagrange.py", "joined_upper", 2): _KERNELS,
    ("_distance/cells/tracked_feet_upper.py", "_apart", 1): _KERNELS,
    ("_distance/cells/tracked_feet_upper.py", "displacement", 1): _KERNELS,
    ("_distance/cells/tracked_feet.py", "_bound_of", 2): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "_convexity.proven", 1): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "_moving", 5): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "_rest", 2): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "distance_to_surface", 6): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "points_of_surface", 1): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "square_to_surface", 1): _SAMPLED,
    ("_distance/cells/tracked_feet_surfaces.py", "narrowed", 6): _SAMPLED,
    ("_distance/cells/surfaces.py", "upper_bounds", 3): _KERNELS,
    ("_distance/cells/triangles.py", "MeshSide.slack", 2): _SAMPLED,
    ("_distance/normalization/curves.py", "evaluation_error", 1): _KERNELS,
    ("_distance/normalization/curves.py", "preparation_error", 1): _KERNELS,
    ("_distance/normalization/isolated.py", "isolated_radius", 3): _KERNELS,
    ("_distance/normalization/net_jets.py", "eta", 1): _KERNELS,
    ("_distance/normalization/net_jets.py", "point_error", 1): _KERNELS,
    ("_distance/normalization/surfaces.py", "_rounded", 1): _KERNELS,
    ("_distance/nearest/chords.py", "chord_error", 1): _KERNELS,
    ("_distance/nearest/curves.py", "_eta", 1): _CURVES,
    ("_distance/nearest/curves.py", "_flushed", 1): _CURVES,
    ("_distance/nearest/curves.py", "cell_bound", 2): _CURVES,
    ("_distance/nearest/curves.py", "length_bound", 1): _KERNELS,
    ("_distance/nearest/forms.py", "Form.rest", 1): _KERNELS,
    ("_distance/nearest/forms.py", "box_distances", 2): _KERNELS,
    ("_distance/nearest/forms.py", "boxes", 2): _KERNELS,
    ("_distance/nearest/forms.py", "form", 1): _KERNELS,
    ("_distance/nearest/forms.py", "lower_bounds", 4): _KERNELS,
    ("_distance/nearest/forms.py", "signed_values", 1): _KERNELS,
    ("_distance/nearest/forms.py", "slope_changes", 1): _KERNELS,
    ("_distance/nearest/surface_points.py", "reach", 2): _KERNELS,
    ("_distance/nearest/stationarity.py", "stationarity", 2): _KERNELS,
}

_FORMAT = "says what a format is, or changes a tolerance from one to another; no bound"
_UNPROVEN = "guides a choice of which nothing that is proven depends"
_POWERS = "scalings by powers of two, of which only what is flushed is lost; tested at every scale"
_FREE = "numbers that may be chosen freely are computed within it: the tool takes their roundings for errors"
_DECIDED = "a decision, of which the tool says that ranges do not tell; tested against exact distances"
_BALLS = "widens balls that have margins of their own (tests/arithmetic/test_balls.py); their sum is not derived"
_HOST = "NumPy on the host, which has no jaxpr; tested against exact values"
_MINIMIZED = "bounds of random cells in both precisions beside minimized samples; terms are not compared one by one"
_TWICE = "divides a vector by its largest component: the tool counts the error of that twice"

NOT_COVERED = {
    ("_arithmetic/rounding.py", "like_double", 2): _FORMAT,
    ("_arithmetic/rounding.py", "smallest_normal", 1): _FORMAT,
    ("_arithmetic/rounding.py", "unit_roundoff", 1): _FORMAT,
    ("_distance/cells/mean_bounds.py", "", 1): _HOST,
    ("_distance/cells/mean_bounds.py", "_over_controls", 1): _HOST,
    ("_distance/cells/mean_bounds.py", "distances_over", 1): _HOST,
    ("_distance/cells/flat_pieces.py", "beside_net", 2): _FREE,
    ("_distance/cells/flat_pieces.py", "bound_of", 4): _FREE,
    ("_distance/cells/flat_pieces.py", "trials", 6): _FREE,
    ("_distance/cells/foot_maps.py", "_in_plane", 1): _UNPROVEN,
    ("_distance/cells/graphs.py", "_graph", 2): _FREE,
    ("_distance/cells/graphs.py", "beside_graph", 1): _DECIDED,
    ("_distance/cells/normal_offset_bounds.py", "valley", 4): _BALLS,
    ("_distance/cells/implicit.py", "_with_errors", 1): _BALLS,
    ("_distance/cells/implicit.py", "between", 2): _BALLS,
    ("_distance/cells/implicit.py", "error_of", 1): _BALLS,
    ("_distance/cells/implicit.py", "shape_over", 3): _BALLS,
    ("_distance/cells/lagrange.py", "_bound", 2): _UNPROVEN,
    ("_distance/cells/lagrange.py", "_of_boxes", 1): _TWICE,
    ("_distance/cells/lagrange.py", "_of_second_order", 2): _BALLS,
    ("_distance/cells/lagrange.py", "_outer_square", 1): _BALLS,
    ("_distance/cells/lagrange.py", "_pointwise", 3): _BALLS,
    ("_distance/cells/lagrange.py", "_second_order", 5): _BALLS,
    ("_distance/cells/arc_length_area.py", "", 3): _HOST,
    ("_distance/cells/arc_length_area.py", "_measured", 1): _HOST,
    ("_distance/cells/arc_length_area.py", "_multiplied", 1): _HOST,
    ("_distance/cells/arc_length_area.py", "off_by", 1): _HOST,
    ("_distance/cells/tracked_feet_upper.py", "_off", 5): _DECIDED,
    ("_distance/cells/tracked_feet_upper.py", "moving_bounds", 3): _FREE,
    ("_distance/cells/tracked_feet_upper.py", "piece_about", 3): _FREE,
    ("_distance/cells/tracked_feet_minimum.py", "least_of_rest.over", 2): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "_along", 1): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "_box", 2): _FREE,
    ("_distance/cells/tracked_feet_nets.py", "_convexity", 2): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "_direct", 2): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "_powers", 1): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "_shifted", 1): _MINIMIZED,
    ("_distance/cells/tracked_feet_nets.py", "square_to_net", 4): _MINIMIZED,
    ("_distance/cells/pairs.py", "_by_convexity", 8): _BALLS,
    ("_distance/cells/pairs.py", "_by_convexity.taken", 1): _BALLS,
    ("_distance/cells/pairs.py", "_by_gaps", 2): _TWICE,
    ("_distance/cells/pairs.py", "_monotone", 4): _BALLS,
    ("_distance/cells/pairs.py", "bound", 5): _TWICE,
    ("_distance/cells/pairs.py", "newton_step", 1): _UNPROVEN,
    ("_distance/cells/signs.py", "sign_bounds", 3): _DECIDED,
    ("_distance/cells/squared_distance_bounds.py", "_less_squares", 1): _HOST,
    ("_distance/cells/squared_distance_bounds.py", "distances_by_squares", 2): _HOST,
    ("_distance/cells/squared_distance_bounds.py", "distances_by_squares.distance", 2): _HOST,
    ("_distance/cells/surfaces.py", "_spread", 1): _FREE,
    ("_distance/cells/weighted.py", "", 1): _HOST,
    ("_distance/cells/weighted.py", "_of_cells", 1): _HOST,
    ("_distance/cells/weighted.py", "mean_bounds", 1): _HOST,
    ("_distance/cells/weighted.py", "quantile_bounds", 1): _HOST,
    ("_distance/cells/weighted.py", "share_bounds", 1): _HOST,
    ("_distance/normalization/stopping.py", "default_tolerance", 1): _FORMAT,
    ("_distance/normalization/coordinates.py", "Frame.common", 1): _POWERS,
    ("_distance/normalization/coordinates.py", "moved_by", 2): _HOST,
    ("_distance/normalization/coordinates.py", "user_length", 2): _POWERS,
    ("_distance/normalization/isolated.py", "isolated_points", 6): _HOST,
    ("_distance/normalization/surfaces.py", "_exact", 2): _HOST,
    ("_distance/normalization/surfaces.py", "_scaled", 1): _POWERS,
    ("_distance/nearest/chords.py", "chords_between", 1): _FREE,
    ("_distance/nearest/feet.py", "FootEquation.rounding", 3): _UNPROVEN,
    ("_distance/nearest/curves.py", "_cut", 1): _UNPROVEN,
    ("_distance/nearest/curves.py", "_resolution", 1): _UNPROVEN,
    ("_distance/nearest/meshes.py", "_traced", 1): _POWERS,
    ("_distance/nearest/surface_points.py", "exact_radius", 2): _HOST,
    ("_distance/nearest/surface_points.py", "proven_radius", 1): _DECIDED,
    ("_distance/nearest/surfaces.py", "_convex_about", 5): _DECIDED,
    ("_distance/nearest/surfaces.py", "_definite", 2): _DECIDED,
    ("_distance/nearest/surfaces.py", "nearest", 1): _UNPROVEN,
    ("_distance/nearest/target.py", "MeshTarget.error", 1): _HOST,
}


def uses(file):
    """Functions of a file and how often they use constants of rounding."""
    found = {}

    def walk(node, within):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                walk(child, [*within, child.name])
                continue
            name = child.id if isinstance(child, ast.Name) else getattr(child, "attr", None)
            if name in NAMES:
                found[".".join(within)] = found.get(".".join(within), 0) + 1
            walk(child, within)

    walk(ast.parse(file.read_text()), [])
    return found


def test_every_use_of_a_constant_is_compared_or_listed_with_its_reason():
    root = Path(jhd.__file__).parent
    files = [
        file for place in FOLDERS for file in ([root / place] if place.endswith(".py") else (root / place).glob("*.py"))
    ]
    found = {(str(f.relative_to(root)), name, count) for f in files for name, count in uses(f).items()}
    assert found == COVERED.keys() | NOT_COVERED.keys()
    assert not COVERED.keys() & NOT_COVERED.keys()
