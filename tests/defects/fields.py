"""Defects of jhd._fields, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_fields/distance_transform.py",
        "fields/test_distance_transform.py",
        (
            "jnp.where(grid, -here, there)",
            "jnp.where(grid, here, there)",
            "test_the_signed_transform_is_the_difference_of_two",
        ),
        (
            "jnp.where(index[..., 0] < 0, jnp.inf, scale * root)",
            "scale * root",
            "test_without_features_distances_are_infinite",
        ),
        (
            "return least + d * d < jnp",
            "return least + d * d * d < jnp",
            "test_one_feature_far_away_is_found_by_every_voxel",
        ),
        (
            "if np.min(known) < smallest_normal(known.dtype):",
            "if False:",
            "test_sides_below_the_normal_numbers_are_no_zeros",
        ),
        ("if not np.all(known > 0):", "if not np.all(known >= 0):", "test_what_makes_no_sense_is_refused"),
    ),
    *within(
        "_fields/distance_map.py",
        "fields/test_distance_map.py",
        (
            "frame.length(rounding.gamma(_ROUNDINGS, dtype)) + deviation +",
            "frame.length(rounding.gamma(_ROUNDINGS, dtype)) +",
            "test_the_map_is_within_its_error_of_the_projected_distance",
        ),
        (
            "(least + 2 * half)[owner]",
            "(least + half)[owner]",
            "test_the_map_is_within_its_error_of_the_projected_distance",
        ),
        (
            " & (px * (ex + fx) + py * (ey + fy) >= 0)",
            "",
            "test_beyond_the_center_of_a_short_arc_its_ends_are_the_nearest",
        ),
        (
            "rounding.round_up(field.error + away)",
            "field.error",
            "test_anywhere_in_a_pixel_the_distance_is_within_reach_and_enclosed",
        ),
    ),
    *within(
        "_fields/adaptive_error.py",
        "fields/test_adaptive.py",
        (
            "np.max(boxes.values[:, None] + apart, axis=2) - low",
            "np.max(boxes.values[:, None] + 0 * apart, axis=2) - low",
            "test_one_value_that_is_off_is_in_the_proven_error",
        ),
    ),
    *within(
        "_fields/octree.py",
        "fields/test_octree.py",
        (
            "above[left[some]] |= exact >= 0",
            "above[left[some]] |= exact > 0",
            "test_a_plane_between_cells_is_proven_on_both_sides",
        ),
        ("& (above | below)[left]", "", "test_without_exact_signs_less_is_proven_and_nothing_else"),
    ),
]
