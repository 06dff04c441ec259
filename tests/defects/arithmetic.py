"""Defects of jhd.arithmetic, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_arithmetic/balls.py",
        "arithmetic/test_balls.py",
        ("x - gamma(3, size.dtype) * size - 4", "x - 4", "test_the_ends_of_balls_lie_outside"),
        ("size - 4 * smallest_normal(size.dtype)", "size", "test_the_ends_of_balls_lie_outside"),
        (
            "size = jnp.max(jnp.sum(h.rad, axis=-1)) + gamma",
            "size = gamma",
            "test_the_least_eigenvalue_is_bounded_closely_if_a_matrix_is_singular",
        ),
        (
            "jnp.where(semidefinite(moved, jnp.zeros(n, bool)), shift, -jnp.inf)",
            "shift",
            "test_the_least_eigenvalue_is_bounded_closely_if_a_matrix_is_singular",
        ),
        ("+ error) * (1 + gamma(4, dtype)) + g", "+ error) + g", "test_the_hull_of_values_holds_each_with_its_error"),
        ("gamma(6, dtype) * size + _tiny", "_tiny", "test_the_hull_of_values_holds_each_with_its_error"),
        (
            "(x.rad + y.rad) * (1 + gamma(4, dtype))",
            "(x.rad + y.rad)",
            "test_sums_differences_and_products_hold_those_of_all_their_numbers",
        ),
        (
            "(1 + gamma(4, dtype)) + gamma(2, dtype) * jnp.abs(mid) + _tiny(dtype))\n\n\ndef minus",
            "(1 + gamma(4, dtype)) + _tiny(dtype))\n\n\ndef minus",
            "test_sums_differences_and_products_hold_those_of_all_their_numbers",
        ),
        (
            "rad * (1 + gamma(8, dtype)) + gamma(2",
            "rad + gamma(2",
            "test_sums_differences_and_products_hold_those_of_all_their_numbers",
        ),
        (
            "(1 + gamma(8, dtype)) + gamma(2, dtype) * jnp.abs(mid)",
            "(1 + gamma(8, dtype))",
            "test_sums_differences_and_products_hold_those_of_all_their_numbers",
        ),
        ("rad * (1 + gamma(n + 8, dtype))", "rad", "test_scalar_products_hold_those_of_all_their_numbers"),
        (" + gamma(n + 4, dtype) * sizes", "", "test_scalar_products_hold_those_of_all_their_numbers"),
        (" + gamma(4, dtype) * mid + _tiny", " + _tiny", "test_reciprocals_hold_those_of_all_their_numbers"),
        (
            "rad + gamma(2 * n + 8, dtype) * jnp.abs(mid)",
            "rad",
            "test_no_indefinite_matrix_is_taken_for_a_semidefinite_one",
        ),
    ),
    *within(
        "_arithmetic/rounding.py",
        "arithmetic/test_rounding.py",
        ("1.02 * operations", "1.0 * operations", "test_gamma_is_above_its_formula"),
        (" + 2 * operations * smallest_normal(m.dtype)", "", "test_gamma_is_above_its_formula"),
    ),
    *within(
        "_arithmetic/interval.py",
        "arithmetic/test_interval.py",
        (
            "(other.lower <= 0) & (other.upper >= 0)",
            "(other.lower < 0) & (other.upper > 0)",
            "test_division_by_an_interval_with_zero_as_an_end_is_the_whole_line",
        ),
        (
            "rounding.round_up(self.upper + other.upper)",
            "self.upper + other.upper",
            "test_an_operation_on_two_intervals_holds_the_exact_results",
        ),
        ("jnp.where(same, jnp.maximum(lower, 0.0), lower)", "lower", "test_signs_that_are_known_are_kept"),
        ("zero = (x == 0) | (y == 0)", "zero = x == 0", "test_zero_times_the_whole_line_is_zero"),
        (
            "jnp.maximum(-self.lower, self.upper)",
            "self.upper",
            "test_an_operation_on_one_interval_holds_the_exact_results",
        ),
        ("jnp.where(upper > 0, rounding.round_up(upper), 0.0)", "upper", "test_a_square_root_squared_holds_the_number"),
    ),
    *within(
        "_arithmetic/bernstein.py",
        "arithmetic/test_bernstein.py",
        (
            "return n * jnp.diff(coefficients, axis=axis)",
            "return (n + 1) * jnp.diff(coefficients, axis=axis)",
            "test_derivatives_are_within_two_roundings",
        ),
        (
            "jnp.where(level <= n - j, t0, t1)",
            "jnp.where(level < n - j, t0, t1)",
            "test_values_parts_and_halves_are_within_their_bound",
        ),
    ),
    *within(
        "_arithmetic/scaling.py",
        "arithmetic/test_scaling.py",
        ("some = square != 0", "some = square > 0", "test_a_length_of_what_is_no_number_is_none"),
    ),
    *within(
        "_arithmetic/rationals.py",
        "arithmetic/test_rationals.py",
        ("Fraction(root + 1)", "Fraction(root)", "test_a_root_lies_between_its_bounds_which_are_close"),
        ("-nu if x < 0 else 0.0", "0.0", "test_what_is_below_the_smallest_and_above_the_largest_normal_number"),
    ),
    *within(
        "_arithmetic/truncated.py",
        "arithmetic/test_truncated.py",
        (
            "jnp.where(near, rest, jnp.inf)",
            "rest",
            "test_reciprocals_stay_within_their_rests_and_know_nothing_beside_a_zero",
        ),
        ("total.rest + left", "total.rest", "test_reciprocals_stay_within_their_rests_and_know_nothing_beside_a_zero"),
        (
            "rest + jnp.sum(beyond, axis=0), gamma",
            "rest, gamma",
            "test_products_and_compositions_stay_within_their_rests",
        ),
        (
            "np.where(_tables(len(x.terms)).beyond, 1 + 2 * room, room)",
            "np.where(_tables(len(x.terms)).beyond, 0.0, room)",
            "test_products_and_compositions_stay_within_their_rests",
        ),
        (
            "(beyond + loose * slopes)",
            "beyond",
            "test_compositions_on_a_graph_stay_within_their_rests",
        ),
    ),
    *within(
        "_arithmetic/trivariate.py",
        "arithmetic/test_trivariate.py",
        (
            "rounding.absolute_error(roundings + 8, magnitude) + absolute",
            "absolute",
            "test_ranges_and_values_hold_every_exact_value",
        ),
        (
            "jnp.where((low <= 0) & (high >= 0), 0.0, jnp.minimum(p, q))",
            "jnp.minimum(p, q)",
            "test_a_square_over_zero_reaches_zero",
        ),
    ),
    *within(
        "_arithmetic/polynomial_roots.py",
        "arithmetic/test_polynomial_roots.py",
        ("rounding.round_down(c - error)", "c", "test_the_error_of_the_coefficients_is_counted"),
        ("jnp.where(v[0] > 0, x, 0.0)", "x", "test_each_root_lies_in_one_narrow_interval"),
        (
            "jnp.where(final | no_room, FINAL, 2 * table.boxes + 1)",
            "jnp.where(final, FINAL, 2 * table.boxes + 1)",
            "test_nothing_is_lost_when_the_table_is_full",
        ),
        (
            "jnp.where(halve, middle, new_upper)",
            "middle",
            "test_nothing_is_lost_when_the_table_is_full",
        ),
        (
            "RESULTS.where(found.full, RESULTS.capacity_reached, result)",
            "result",
            "test_nothing_is_lost_when_the_table_is_full",
        ),
    ),
    *within(
        "_arithmetic/isolated_zeros.py",
        "arithmetic/test_isolated_zeros.py",
        ("square - 4 * curved * value", "square + 4 * curved * value", "test_a_point_inside_a_sphere_is_there_or_not"),
        (
            "if any(place[k] != ends",
            "if False and any(place[k] != ends",
            "test_a_cap_that_a_face_cuts_off_next_to_a_simple_point_is_not_taken_for_it[33]",
        ),
    ),
]
