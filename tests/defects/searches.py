"""Defects of jhd._distance.cells, nearest and search, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_distance/cells/branches.py",
        "rounding/test_margins.py",
        (
            "relative = gamma(2 * (3 * p + q * (g + 4) + 5 * n) + 20, dtype)",
            "relative = 0.0",
            "test_bounds_have_room_for_the_derived_error",
        ),
        (
            "(1 + gamma(4, dtype)) + eta + flushed",
            "(1 + gamma(4, dtype)) + flushed",
            "test_bounds_have_room_for_the_derived_error",
        ),
    ),
    *within(
        "_distance/nearest/curves.py",
        "rounding/test_margins.py",
        (
            "jnp.maximum(least, 0.0)) * (1 - gamma(7 * q + 12, dtype))",
            "jnp.maximum(least, 0.0))",
            "test_bounds_have_room_for_the_derived_error",
        ),
    ),
    *within(
        "_distance/search/curves.py",
        "distance/search/test_error_terms.py",
        ("found.upper + error", "found.upper", "test_the_bounds_of_a_step_are_widened"),
        ("measured.lower - error, state.lower", "measured.lower, state.lower", "test_the_bounds_of_a_step_are_widened"),
        (
            "return first_upper_bound(a, b, cell, runs) + evaluation_error(a, b)",
            "return first_upper_bound(a, b, cell, runs)",
            "test_the_first_bounds_of_cells_are_widened",
        ),
        ("measured.lower - error, 0.0", "measured.lower, 0.0", "test_the_first_bounds_of_cells_are_widened"),
    ),
    *within(
        "_distance/search/refined_witness.py",
        "distance/search/test_error_terms.py",
        (
            "found.lower - evaluation_error(a, b)",
            "found.lower",
            "test_the_lower_bound_of_a_polished_witness_is_widened",
        ),
    ),
    *within(
        "_distance/cells/triangles.py",
        "distance/cells/test_triangles.py",
        (
            "self.size * (gamma(40, self.corners.dtype) + ",
            "self.size * (",
            "test_points_of_cells_are_within_the_slack_of_the_exact_ones",
        ),
        (
            "+ depth * gamma(16, self.corners.dtype)",
            "+ 0 * depth",
            "test_points_of_cells_are_within_the_slack_of_the_exact_ones",
        ),
        (
            "(distance) + self.slack(depth))",
            "(distance))",
            "test_bounds_of_cells_are_above_the_distance_with_all_its_errors",
        ),
        (
            "distance + self.tree.error(distance)",
            "distance",
            "test_bounds_of_cells_are_above_the_distance_with_all_its_errors",
        ),
        (
            "self.slack(depth)) * (1 + 4e-16)",
            "self.slack(depth))",
            "test_bounds_of_cells_are_above_the_distance_with_all_its_errors",
        ),
    ),
    *within(
        "_distance/nearest/forms.py",
        "rounding/test_kernels.py",
        (
            "rest + gamma(terms.shape[0] + 8, terms.dtype) * sizes",
            "rest",
            "test_bounds_have_room_for_the_derived_error[rest]",
        ),
        (
            " * (1 + gamma(sizes[..., 0].size + 16, sizes.dtype))",
            "",
            "test_bounds_have_room_for_the_derived_error[slope",
        ),
        (
            "gamma(7 * _degrees(a) + 40, a.dtype) * jnp.abs(a) + side.error",
            "side.error + 0 * a",
            "test_errors_that_are_told_are_at_least_the_derived_ones[form]",
        ),
        (
            "gamma(6 * _degrees(a) + 8, a.dtype) * jnp.abs(a) + side.error",
            "side.error + 0 * a",
            "test_errors_that_are_told_are_at_least_the_derived_ones[values]",
        ),
        (
            "error = gamma(24, size.dtype) * size + jnp.abs",
            "error = jnp.abs",
            "test_bounds_have_room_for_the_derived_error[lower",
        ),
        ("size + jnp.abs(factors) * form_b.error", "size", "test_bounds_have_room_for_the_derived_error[lower"),
        (
            "jnp.maximum(least - slack, 0.0)",
            "jnp.maximum(least, 0.0)",
            "test_bounds_have_room_for_the_derived_error[nearest",
        ),
        ("most + slack", "most", "test_bounds_have_room_for_the_derived_error[farthest"),
    ),
    *within(
        "_distance/cells/surfaces.py",
        "rounding/test_kernels.py",
        (" + 2 * jnp.sum(reach * wrong, axis=1)", "", "test_bounds_have_room_for_the_derived_error[upper"),
    ),
    *within(
        "_distance/nearest/stationarity.py",
        "rounding/test_kernels.py",
        (
            "error = gamma(4 * n + point.shape[0] + 16, e.dtype)",
            "error = 0.0",
            "test_errors_that_are_told_are_at_least_the_derived_ones[stationarity",
        ),
    ),
    *within(
        "_distance/nearest/surface_points.py",
        "rounding/test_kernels.py",
        (
            " * (1 + 8 * unit_roundoff(dtype))\n\n\ndef thorough",
            "\n\n\ndef thorough",
            "test_bounds_have_room_for_the_derived_error[reach",
        ),
    ),
    *within(
        "_distance/nearest/chords.py",
        "rounding/test_kernels.py",
        (
            "return 4 * math.sqrt(dim) * gamma(40, dtype)",
            "return 0.0",
            "test_errors_that_are_told_are_at_least_the_derived_ones[chord",
        ),
    ),
    *within(
        "_distance/cells/graphs.py",
        "rounding/test_kernels.py",
        (
            "math.sqrt(3) * gamma(64, size.dtype) * size",
            "0.0 * size",
            "test_errors_that_are_told_are_at_least_the_derived_ones[graph",
        ),
    ),
    *within(
        "_distance/nearest/curves.py",
        "rounding/test_kernels.py",
        (
            "length * (1 + gamma(3 * degree + dim + 6, vector.dtype))",
            "length",
            "test_distances_of_points_have_room_for_the_derived_error",
        ),
        (" + _eta(degree, dim, radius)\n", "\n", "test_distances_of_points_have_room_for_the_derived_error"),
    ),
    *within(
        "_distance/search/curves.py",
        "distance/search/test_error_terms.py",
        (
            "closed=jnp.maximum(closed, lost), dropped",
            "closed=closed, dropped",
            "test_cells_that_a_full_table_loses_stay_in_the_upper_bound",
        ),
        (
            "dropped=state.dropped | (lost > goal)",
            "dropped=state.dropped",
            "test_cells_that_a_full_table_loses_stay_in_the_upper_bound",
        ),
    ),
    *within(
        "_distance/search/curves.py",
        "distance/search/test_branch_and_bound.py",
        (
            "(state.lower <= aim.ceiling) & (state.steps < limit)",
            "(state.steps < limit)",
            "distance/test_decision.py::test_far_thresholds_take_far_fewer_steps",
        ),
        (
            "result_where(closed, RESULTS.successful, RESULTS.gap_not_closed)",
            "result_where(True, RESULTS.successful, RESULTS.gap_not_closed)",
            "test_bounds_that_stay_open_are_raised_with_the_solution",
        ),
        (
            "result_where(~closed & state.dropped, RESULTS.capacity_reached, result)",
            "result",
            "test_a_full_table_is_folded_into_the_upper_bound",
        ),
    ),
    *within(
        "_distance/cells/branches.py",
        "distance/cells/test_branches.py",
        (
            "jnp.max(jnp.min(jax.vmap(halves)(both.e, both.w), axis=0))",
            "jnp.min(jnp.min(jax.vmap(halves)(both.e, both.w), axis=0))",
            "test_the_bound_is_the_larger_one_of_both_halves_wherever_the_cell_is_split",
        ),
        (
            "most = most * (1 + gamma(roundings, dtype)) + math.sqrt(dim) * gamma(roundings, dtype)",
            "most = most",
            "test_both_bounds_are_above_the_exact_distance",
        ),
    ),
    *within(
        "_distance/cells/pairs.py",
        "distance/cells/test_pairs.py",
        (
            "wrong = 16.0 * max(1,",
            "wrong = 0.0 * max(1,",
            "test_derivatives_over_cells_are_as_exact_as_their_bound_says_however_narrow_these_are",
        ),
        (
            "by_curvature = (jnp.sum(",
            "by_curvature = 0.5 * (jnp.sum(",
            "test_the_bound_by_convexity_is_the_distance_from_rectangles_wherever_it_is_taken",
        ),
    ),
    *within(
        "_distance/search/patch_boxes.py",
        "distance/search/test_patch_boxes.py",
        (
            "half = 0.5 * (high - low)",
            "half = 0.4 * (high - low)",
            "test_every_point_within_the_distance_is_in_a_part_that_is_found_or_settled",
        ),
        (
            "(low[:, k] >= settled.low[who, k]) & ",
            "",
            "test_every_point_within_the_distance_is_in_a_part_that_is_found_or_settled",
        ),
    ),
    *within(
        "_distance/cells/squared_distance_bounds.py",
        "distance/cells/test_squared_distance_bounds.py",
        (
            "(rest - _square(roots))",
            "(rest + _square(roots))",
            "test_bounds_are_below_dense_samples_and_near_them_on_small_parts",
        ),
        ("lower - smallest_normal(np.float64)", "lower", "test_subnormal_distances_are_not_rounded_upward"),
    ),
    *within(
        "_distance/cells/weighted.py",
        "distance/cells/test_weighted.py",
        (
            "return least * (1 - room), min(most + room * top, top)",
            "return least, most",
            "test_means_are_rounded_outward",
        ),
        (
            "not np.all(np.isfinite(upper[weights.upper > 0]))",
            "not np.all(np.isfinite(lower))",
            "test_what_has_no_upper_bound_leaves_the_mean_without",
        ),
        (
            "min(rest + room, 1.0)",
            "min(rest, 1.0)",
            "test_the_upper_bound_of_a_share_counts_the_rounding_of_a_difference",
        ),
        ("* (1 - _ROUNDED) * inside[-1]", "* inside[-1]", "test_a_share_is_reached_within_its_own_rounding"),
        (
            "(upper, a, b, 1 - room)",
            "(upper, b, a, 1 - room)",
            "test_shares_and_quantiles_of_all_choices_are_within_the_bounds",
        ),
    ),
    *within(
        "_distance/cells/signs.py",
        "distance/cells/test_surfaces.py",
        (
            "below & above & inside & jnp.isfinite(lengths)",
            "below & inside & jnp.isfinite(lengths)",
            "test_a_polynomial_of_one_sign_has_no_bound_from_signs",
        ),
        ("ends[1] < -1.01 * error", "ends[1] < 1e30 * error", "test_a_polynomial_of_one_sign_has_no_bound_from_signs"),
    ),
    *within(
        "_distance/cells/tracked_feet_surfaces.py",
        "distance/cells/test_tracked_feet_surfaces.py",
        (
            "total = (far + off) *",
            "total = far *",
            "test_upper_bounds_of_wavy_pieces_hold_all_sampled_distances_or_are_none",
        ),
        (
            "proven = (least_slope > 0) & (off * (1 + gamma(8, dtype)) <= reach) & inside",
            "proven = (least_slope > 0) & (off * (1 + gamma(8, dtype)) <= reach)",
            "test_upper_bounds_of_wavy_pieces_hold_all_sampled_distances_or_are_none",
        ),
    ),
    *within(
        "_distance/cells/tracked_feet_surfaces.py",
        "distance/cells/test_contraction.py",
        (
            "others + f.rest[0] + f.error[0]",
            "others + f.error[0]",
            "test_a_part_of_a_sphere_at_a_corner_leaves_little_and_holds_all_of_its_points",
        ),
    ),
    *within(
        "_distance/cells/flat_pieces.py",
        "distance/cells/test_flat_pieces.py",
        (
            "some = square > 0\n",
            "some = square >= 0\n",
            "test_at_the_apex_of_a_cone_no_plane_is_proven_and_every_number_is_finite",
        ),
    ),
    *within(
        "_distance/nearest/curves.py",
        "distance/nearest/test_curves.py",
        (
            "settled = jnp.minimum(state.settled, jnp.min(jnp.where(keep & room, jnp.inf, lower)))",
            "settled = state.settled",
            "test_a_full_queue_and_a_step_limit_leave_true_bounds",
        ),
        (
            "same &= jnp.all(weights[1:] == weights[:-1], axis=1)",
            "same &= True",
            "test_weights_tell_repeated_segments_apart",
        ),
    ),
    *within(
        "_distance/nearest/feet.py",
        "distance/nearest/test_feet.py",
        (
            "-downhill * jnp.sign(here.residual))",
            "-here.residual)",
            "test_newton_goes_downhill_where_the_distance_is_not_convex",
        ),
        (
            "forward, backward = (s > 1) & (nxt >= 0), (s < 0) & (last >= 0)",
            "forward, backward = (s > 1) & (nxt > 0), (s < 0) & (last > 0)",
            "distance/witness/test_events.py::test_feet_are_followed_across_joints_and_stop_at_free_ends",
        ),
        (
            "((slope > 0) == (s <= 0))",
            "((slope > 0) == (s >= 1))",
            "test_a_foot_is_pressed_against_an_end_where_the_distance_falls_towards_it",
        ),
    ),
    *within(
        "_distance/search/distribution.py",
        "distance/test_deviation.py",
        (
            "lower = _down(np.maximum(found.lower.astype(np.float64) - slack, 0.0))",
            "lower = _up(np.maximum(found.upper.astype(np.float64) + slack, 0.0)) * 1.01",
            "test_points_are_counted_and_not_cut",
        ),
        (
            "mean = mean[0], min(mean[1], rms[1])",
            "mean = mean[1], min(mean[1], rms[1])",
            "test_a_segment_and_one_of_its_ends",
        ),
    ),
]
