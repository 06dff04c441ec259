"""Defects of jhd._shapes and jhd._triangles, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_shapes/patch_cells.py",
        "shapes/test_patch.py",
        (
            "2 * border, 2 * high)",
            "2 * border, 0 * high)",
            "test_nearly_flat_patches_and_their_meshes_are_within_the_deviation_of_each_other",
        ),
        (
            "bound = (s_uu + 2 * s_uv + s_vv) / 8",
            "bound = (s_uu + s_vv) / 8",
            "test_a_bilinear_patch_has_the_twist_as_its_deviation_and_a_flat_one_none",
        ),
    ),
    *within(
        "_triangles/winding.py",
        "distance/nearest/test_meshes.py",
        (
            "inside[rows] = np.abs(number) >= 0.5",
            "inside[rows] = number >= 0.5",
            "test_signed_distances_of_a_cube_are_negative_inside",
        ),
        (
            "remainder = 3 * (second + lost)",
            "remainder = 0 * (second + lost)",
            "test_errors_of_winding_numbers_hold_and_all_ways_to_decide_agree",
        ),
    ),
    *within(
        "_triangles/triangle_pairs.py",
        "triangles/test_triangle_pairs.py",
        ("- gamma(48, dtype) * size) * (1", ") * (1", "test_bounds_hold_the_exact_distance"),
        (" + gamma(48, dtype) * size + absolute_floor(dtype)", "", "test_bounds_hold_the_exact_distance"),
    ),
    *within(
        "_triangles/point_triangle.py",
        "triangles/test_closest_point.py",
        (
            "return gamma(64, dtype) + 6.2 * defect",
            "return 0.0 * defect",
            "test_bounds_hold_on_slivers_segments_points_and_large_triangles",
        ),
        (
            "(y > 0) & (off1 > 0) & (off2 > 0)",
            "(off1 > 0) & (off2 > 0)",
            "test_bounds_hold_on_slivers_segments_points_and_large_triangles",
        ),
    ),
    *within(
        "_triangles/pseudonormal.py",
        "distance/nearest/test_meshes.py",
        (
            "outward = 1.0 if float(mesh.volume) >= 0 else -1.0",
            "outward = 1.0",
            "test_signed_distances_of_a_cube_are_negative_inside",
        ),
        (
            "if not (mesh.is_closed and mesh.is_manifold):",
            "if not mesh.is_closed:",
            "test_a_mesh_with_a_hole_has_an_inside_by_winding_alone",
        ),
    ),
    *within(
        "_shapes/mesh.py",
        "shapes/test_mesh.py",
        (
            "(a * module_of(corners).cross(b, c)).sum() / 6",
            "(a * module_of(corners).cross(c, b)).sum() / 6",
            "test_a_cube_has_its_area_volume_box_and_normals",
        ),
        (
            "xp.cross(rows[1], rows[2])).sum() < 0",
            "xp.cross(rows[1], rows[2])).sum() > 0",
            "test_an_affine_map_moves_the_vertices_and_keeps_outside_outside",
        ),
        ("(array < 0) | (array >= count)", "array >= count", "test_what_is_no_mesh_is_refused"),
        (
            "0.5 * sizes.sum(), 2 * power",
            "0.5 * sizes.sum(), power",
            "test_measures_of_tiny_and_huge_meshes_keep_their_digits",
        ),
        ("(edges.count == 1) | (edges.balance == 0)", "edges.count > 0", "test_borders_and_orientation_are_seen"),
    ),
    *within(
        "_shapes/simple_curves.py",
        "shapes/test_curve.py",
        (
            "if closed and (is_traced(rows) or bool(np.any(rows[0] != rows[-1]))):",
            "if closed:",
            "test_polylines_close_once",
        ),
    ),
    *within(
        "_shapes/curve.py",
        "shapes/test_curve.py",
        ("turned(self.next_segment))", "self.next_segment)", "test_reversal_turns_segments_and_joints_around"),
        (
            "xp.where(after >= inside, after, -1)",
            "xp.where(after >= 0, after, -1)",
            "test_split_of_one_closed_segment_opens_it",
        ),
        ("if count < self.count:", "if count < 0:", "test_pad_repeats_the_last_segment"),
    ),
    *within(
        "_shapes/joints.py",
        "shapes/test_curve.py",
        ("meets &= ~single[start] | (start == rows[row] + 1)", "meets &= True", "test_joints_of_polylines"),
        (
            "meets & (~single | (index == rows[:, None] + 1))",
            "meets",
            "test_joints_are_the_same_known_and_traced_and_of_many_loose_segments_found_by_sorting",
        ),
    ),
    *within(
        "_shapes/checks.py",
        "shapes/test_bezier.py",
        (
            "np.argwhere(np.asarray(weights) <= 0)",
            "np.argwhere(np.asarray(weights) < 0)",
            "test_wrong_values_are_refused",
        ),
        ("if max(degrees) > limit:", "if max(degrees) > 2 * limit:", "test_degrees_have_a_limit_that_is_named"),
        (
            "if most / limit > least:",
            "if most / limit > 1e300:",
            "distance/search/test_branch_and_bound.py::test_weights_of_too_large_a_ratio_are_refused",
        ),
    ),
    *within(
        "_shapes/homogeneous.py",
        "shapes/test_bezier.py",
        ("(b - a) * math.comb(n, a)", "math.comb(n, a)", "test_derivative_agrees_with_differences"),
    ),
    *within(
        "_shapes/bspline.py",
        "shapes/test_bspline.py",
        ("xp.where(xp.asarray(jumps)[index], -1, index)", "index", "test_a_jump_is_a_free_end_and_a_kink_is_none"),
        ("jnp.where(index + n + 1 <= span, index + n + 1, index)", "index", "test_knot_insertion_keeps_the_curve"),
        (
            "jnp.roll(points, -1, axis=0) - points if self.periodic else",
            "jnp.roll(points, 1, axis=0) - points if self.periodic else",
            "test_uniform_closed_splines_agree_with_scipy_on_wrapped_points",
        ),
    ),
    *within(
        "_shapes/knots.py",
        "shapes/test_bspline.py",
        (
            "positive, numerator / xp.where(positive, width, 1.0), 0.0)",
            "positive, numerator / width, 0.0)",
            "test_a_traced_domain_of_length_zero_gives_numbers",
        ),
        ("(knots[p : p + count] == knots[:count]) |", "", "test_a_jump_is_a_free_end_and_a_kink_is_none"),
    ),
    *within(
        "_shapes/flattening.py",
        "shapes/test_flattening.py",
        ("norm * radial * (1 + _ROOM)", "0 * norm * radial", "test_cubics_of_arcs_of_ellipses_are_near_both_ways"),
        ("if not tolerance >= least:", "if not tolerance >= 0:", "test_what_cannot_be_done_is_refused"),
    ),
    *within(
        "_shapes/biarc.py",
        "shapes/test_biarc.py",
        ("if wanted < least:", "if False:", "test_what_cannot_be_approximated_is_refused"),
        ("4 * b / (length * (1 + b * b))", "2 * b / (length * (1 + b * b))", "test_the_arcs_of_a_circle_lie_on_it"),
    ),
]
