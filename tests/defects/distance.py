"""Defects of the other folders of jhd._distance, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_distance/normalization/net_jets.py",
        "rounding/test_kernels.py",
        ("(3 if net.weights is None else 6)", "3", "test_points_of_nets_and_of_their_parts_are_as_close_as_told"),
        ("(7 if net.weights is None else 20)", "7", "test_points_of_nets_and_of_their_parts_are_as_close_as_told"),
        (
            "return gamma((3 if net.weights is None else 6) * sum(net.degrees) + 8, net.points.dtype)",
            "return 0.0",
            "test_points_of_nets_and_of_their_parts_are_as_close_as_told",
        ),
        (
            "return math.sqrt(net.dim) * gamma(roundings, net.points.dtype)",
            "return 0.0",
            "test_points_of_nets_and_of_their_parts_are_as_close_as_told",
        ),
    ),
    *within(
        "_distance/normalization/curves.py",
        "rounding/test_kernels.py",
        ("math.sqrt(dim) * gamma(4 * (degree + 7) + 1, dtype)", "0.0", "test_curves_are_moved_by_at_most_what_is_told"),
    ),
    *within(
        "_distance/witness/derivative.py",
        "distance/witness/test_derivative.py",
        (
            "for _ in range(2):\n            s = active.stationary",
            "for _ in range(1):\n            s = active.stationary",
            "test_second_derivatives_of_the_nearest_point_of_a_circle_are_those_of_the_direction",
        ),
    ),
    *within(
        "_distance/witness/balance.py",
        "distance/witness/test_sizes.py",
        (
            "return scale, tuple(part.in_unit(origin, scale) for part in rows)",
            "return scale / scale, tuple(part.in_unit(0 * origin, scale / scale) for part in rows)",
            "test_second_derivatives_between_spheres_do_not_depend_on_their_size[least-implicit-implicit-float32]",
        ),
    ),
    *within(
        "_distance/witness/rows.py",
        "distance/witness/test_sizes.py",
        (
            " | (size**2 < smallest_normal(x.dtype)), ~inside",
            ", ~inside",
            "distance/witness/test_balance.py::test_points_beside_a_mesh_are_triangles_that_have_no_coordinates",
        ),
        (
            "jax.lax.stop_gradient(jnp.max(jnp.abs(self.points - self.points[0])) ** 2)",
            "jnp.ones(())",
            "test_a_foot_on_a_triangle_of_another_size_moves_along_its_plane",
        ),
    ),
    *within(
        "_distance/witness/events.py",
        "distance/witness/test_events.py",
        (
            "EVENTS.where(self.around.corner, EVENTS.corner, event)",
            "EVENTS.where(self.around.end, EVENTS.corner, event)",
            "test_events_are_told_apart",
        ),
        ("EVENTS.where(least <= ZERO, EVENTS.coincident, event)", "event", "test_events_are_told_apart"),
        (
            "turned = two & (order[0] > order[1])",
            "turned = two & (order[0] < order[1])",
            "test_two_feet_are_named_in_the_order_of_b_with_multipliers_that_balance",
        ),
        (
            "EVENTS.where(self.held[single], EVENTS.b_end, EVENTS.antipodal)",
            "EVENTS.where(self.held[single], EVENTS.antipodal, EVENTS.b_end)",
            "test_events_are_told_apart",
        ),
    ),
    *within(
        "_distance/witness/active.py",
        "distance/witness/test_derivative.py",
        ("change = -_solve(", "change = _solve(", "test_the_witness_moves_as_differences_say"),
        ("jnp.where(normal @ c < 0, -normal, normal)", "normal", "test_the_gradient_agrees_with_differences"),
        (
            "share = jnp.clip(-slopes[1] /",
            "share = jnp.clip(slopes[1] /",
            "test_two_feet_share_the_derivative_by_their_multipliers",
        ),
        (
            "jnp.where(system.held[0], held, balanced)",
            "balanced",
            "distance/witness/test_multipliers.py::test_the_multipliers_of_a_corner_serve_both_of_its_legs",
        ),
        (
            "jnp.where(regular, right @ (columns / jnp.where(regular, determinant, 1.0)), 0.0)",
            "right @ (columns / determinant)",
            "test_degenerate_pairs_have_finite_derivatives",
        ),
    ),
    *within(
        "_distance/witness/derivative.py",
        "distance/witness/test_derivative.py",
        (
            "jnp.sum(pulls * (point - feet))",
            "jnp.sum(pulls * (point + feet))",
            "test_the_gradient_agrees_with_differences",
        ),
        (
            "apart = w.event != EVENTS.coincident",
            "apart = w.event != EVENTS.a_end",
            "test_at_distance_zero_the_gradient_is_zero",
        ),
        (
            "jnp.where(two, y[1:], y[1])",
            "y[1:]",
            "test_the_witness_moves_as_differences_say",
        ),
        (
            "usable._replace(distance=usable.distance & (known.distance > 0))",
            "usable",
            "test_a_point_on_the_curve_has_gradient_zero",
        ),
    ),
    *within(
        "_distance/normalization/custom_derivatives.py",
        "distance/witness/test_derivative.py",
        (
            "usable = where & jnp.isfinite(number) & jnp.isfinite(other)",
            "usable = where",
            "distance/search/test_targets.py::test_where_no_point_is_proven_derivatives_are_finite",
        ),
    ),
    *within(
        "_distance/normalization/coordinates.py",
        "distance/normalization/test_curves.py",
        (
            "exact = (xp.abs(scaled) > 2 * smallest_normal(scaled.dtype)) | (given == 0)",
            "exact = True",
            "test_lengths_are_rounded_outward_where_they_turn_subnormal",
        ),
        (
            "scaled - flushed, 0.0) if toward == 0 else scaled + flushed",
            "scaled, 0.0) if toward == 0 else scaled",
            "test_lengths_are_rounded_outward_where_they_turn_subnormal",
        ),
        (
            "xp.where(xp.isfinite(given), xp.minimum(scaled, xp.finfo(scaled.dtype).max), scaled)",
            "scaled",
            "distance/search/test_branch_and_bound.py::test_a_distance_beyond_the_largest_float_has_a_finite_lower_bound",
        ),
    ),
    *within(
        "_distance/normalization/implicit_derivatives.py",
        "distance/normalization/test_implicit_derivatives.py",
        (
            "jnp.where(usable.reshape(-1, *[1] * (x.ndim - 1)), x, 0.0)",
            "x",
            "test_where_there_are_none_or_they_are_not_finite_derivatives_are_zero",
        ),
        (
            "following(function, found, parts, constants) if is_traced(parts) else found",
            "found",
            "test_second_derivatives_of_functions_of_the_numbers_have_all_their_terms",
        ),
    ),
    *within(
        "_distance/decisions.py",
        "distance/test_decision.py",
        ("upper <= most, lower > most", "lower <= most, lower > most", "test_a_threshold_inside_the_gap_is_undecided"),
        ("upper <= most, lower > most", "upper <= most, upper > most", "test_a_threshold_inside_the_gap_is_undecided"),
        ("float(limit) < 0", "float(limit) < -1", "test_bad_thresholds_and_methods_are_refused"),
        (
            "(ordered(x) for x in (solution.lower, solution.upper, limit))",
            "(solution.lower, solution.upper, limit)",
            "distance/test_scales.py::test_decisions_about_subnormal_lengths_are_true",
        ),
    ),
    *within(
        "_distance/pairs.py",
        "distance/test_hausdorff.py",
        (
            "there, self.measured(turned=True,",
            "there, self.measured(turned=False,",
            "test_the_larger_direction_is_taken_and_named",
        ),
        (
            "a, b = (self._b, self._a) if turned else (self._a, self._b)",
            "a, b = self._a, self._b",
            "test_the_larger_direction_is_taken_and_named",
        ),
    ),
    *within(
        "_distance/minimum.py",
        "distance/test_points.py",
        (
            "return replace(found, point_a=found.point_b, point_b=found.point_a)",
            "return found",
            "distance/test_minimum.py::test_a_curve_and_a_patch",
        ),
        (
            "near = np.flatnonzero(np.asarray(found.lower) <= np.min(np.asarray(found.upper)))",
            "near = np.array([0])",
            "test_of_points_that_are_one_only_one_is_searched_beside_a_long_curve",
        ),
    ),
    *within(
        "_distance/search/branch_and_bound.py",
        "distance/test_minimum.py",
        (
            "    if twice:\n",
            "    if False:\n",
            "test_a_method_holds_the_options_and_not_both_are_given",
        ),
    ),
    *within(
        "_distance/search/search.py",
        "distance/test_minimum.py",
        ("if self.clock.is_over():", "if False:", "test_the_time_limit_ends_a_search_with_the_bounds_reached"),
    ),
    *within(
        "_distance/search/distribution.py",
        "distance/test_deviation.py",
        ("if self._ends():", "if False:", "test_a_time_limit_ends_a_step_and_leaves_true_bounds"),
    ),
    *within(
        "_distance/collections/pivots.py",
        "distance/test_collections.py",
        (
            "near &= columns[None, :] > rows[:, None]",
            "near &= columns[None, :] != rows[:, None]",
            "test_pairs_within_a_threshold_are_those_of_all_distances",
        ),
        (
            "(threshold + slack) * (1 + 1e-9)",
            "0.5 * threshold",
            "test_a_threshold_within_the_bounds_of_a_pair_is_undecided",
        ),
    ),
    *within(
        "_distance/collections/neighbors.py",
        "distance/test_collections.py",
        ("near[each, index] = False", "near[each, index] = True", "test_ties_are_named"),
        (
            "(known.lower <= _reach(known, k)[:, None]) & (known.result < 0)",
            "(known.lower < 0.5 * _reach(known, k)[:, None]) & (known.result < 0)",
            "test_the_nearest_shapes_are_those_of_all_distances",
        ),
        (
            "np.where(np.any(_open(known, k), axis=1), int(unfinished._value), worst)",
            "worst",
            "test_an_interrupted_call_keeps_what_is_done_and_says_so",
        ),
    ),
    *within(
        "_distance/collections/pivots.py",
        "distance/test_collections.py",
        (
            "jnp.where(low <= reach, high_b, -jnp.inf), axis=1) + reach",
            "jnp.where(low <= reach, high_b, -jnp.inf), axis=1)",
            "test_bounds_of_all_pairs_hold_and_the_reach_covers_the_shapes",
        ),
        (
            "jnp.maximum(low - high_b, low_b - high)",
            "jnp.maximum(high - low_b, low_b - high)",
            "test_bounds_of_all_pairs_hold_and_the_reach_covers_the_shapes",
        ),
    ),
    *within(
        "_distance/collections/store.py",
        "distance/collections/test_store.py",
        (
            "if hashlib.sha256(body).digest() != checksum:",
            "if False:",
            "test_a_part_that_is_damaged_or_was_being_written_is_computed_again",
        ),
        ("if found != mine:", "if False:", "test_a_store_of_something_else_is_refused_and_both_fingerprints_are_named"),
    ),
    *within(
        "_distance/collections/blocks.py",
        "distance/test_collections.py",
        (
            "return Aim(jnp.maximum(aim.level, found.lower), most), found",
            "return Aim(jnp.maximum(aim.level, found.upper * 2), most), found",
            "test_all_pairs_of_squares_have_their_distances",
        ),
    ),
    *within(
        "_distance/statistics/statistics.py",
        "distance/statistics/test_statistics.py",
        (
            "ends = (bounds.lower, -1), (bounds.upper, 1)",
            "ends = (bounds.lower, 1), (bounds.upper, -1)",
            "test_bounds_round_outward_in_the_precision_of_the_shapes",
        ),
        (
            "first = jnp.asarray(values[0] >= values[1])",
            "first = jnp.asarray(values[0] <= values[1])",
            "test_weights_count_and_the_larger_direction_is_taken_and_differentiated",
        ),
        (
            "if weights is not None:\n            raise ValueError",
            "if False:\n            raise ValueError",
            "test_what_is_no_measure_is_refused",
        ),
        (
            "if not value.is_confirmed:",
            "if False:",
            "distance/statistics/test_error_control.py::test_derivatives_over_more_pieces_than_are_looked_at_closely_are_refused",
        ),
    ),
    *within(
        "_distance/published/trimming.py",
        "distance/published/test_trimming.py",
        (
            "rows = np.flatnonzero(values[0] >= level)",
            "rows = np.flatnonzero(values[0] >= 1.5 * level)",
            "test_random_chains_agree_and_keep_their_maximum",
        ),
        (
            "target.within(center[0] + 1j * center[1], radius + pieces.wanted[1])",
            "target.within(center[0] + 1j * center[1], 0.5 * pieces.wanted[1])",
            "test_values_agree_with_the_table_and_the_maximum_is_kept",
        ),
    ),
    *within(
        "_distance/published/cube_intervals.py",
        "distance/published/test_cube_intervals.py",
        (
            "np.maximum(steps - 1, 0) ** 2, (steps + 1) ** 2",
            "steps**2, (steps + 1) ** 2",
            "test_intervals_hold_the_exact_distance_of_spheres",
        ),
        (
            "upper = None if high is None else root_between(high * self.unit**2)",
            "upper = None if high is None else root_between(low * self.unit**2)",
            "test_lengths_are_rounded_outward_by_one_float_or_not_at_all",
        ),
        (
            "Fraction(0) if self.exact or not outward else Fraction(rounding.gamma(8, dtype))",
            "Fraction(0)",
            "test_rounded_squares_get_the_room_of_five_roundings",
        ),
        (
            "proven = q.proven if safe else np.ones_like(q.proven)",
            "proven = np.ones_like(q.proven)",
            "test_the_paper_rule_is_wrong_where_cells_hold_no_point_and_the_safe_rule_is_not",
        ),
    ),
]
