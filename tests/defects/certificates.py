"""Defects of jhd._distance.certificate, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_distance/certificate/verification/proofs.py",
        "distance/certificate/test_verification.py",
        (
            "- p.reach - q.reach",
            "+ p.reach + q.reach",
            "test_the_reach_of_a_point_near_a_surface_widens_the_distance_that_it_shows",
        ),
        (
            "Fraction(lower) * sides[name].unit + place.reach",
            "Fraction(lower) * sides[name].unit - place.reach",
            "test_the_reach_of_a_point_near_a_surface_widens_the_distance_that_it_shows",
        ),
    ),
    *within(
        "_distance/certificate/verification/proofs.py",
        "distance/certificate/test_verification.py",
        ('if entry["bound"] > claim["upper"]:', "if False:", "test_what_is_wrong_is_named"),
        (
            "if self.end is not None and time.monotonic() > self.end:",
            "if False:",
            "test_a_check_ends_at_its_limit_before_it_begins_or_within",
        ),
        (
            "if any(parts[k].last - parts[k].first > 1 for k in named):",
            "if False:",
            "distance/certificate/test_surface_certificates.py::test_a_part_without_zeros_is_apart_from_several_pieces",
        ),
    ),
    *within(
        "_distance/certificate/verification/inequalities.py",
        "distance/certificate/test_verification.py",
        (
            "whole * whole * sum(f.get(i, 0) ** 2 for f in e.coordinates) <= top * top * w * w",
            "sum(f.get(i, 0) ** 2 for f in e.coordinates) <= top * top * w * w",
            "test_a_bound_beyond_the_exact_one_is_refused_however_little",
        ),
        (
            "combined(weights, top * top, squares, -whole * whole)",
            "combined(weights, top * top, squares, -whole)",
            "test_an_exact_certificate_proves_its_claim",
        ),
    ),
    *within(
        "_distance/certificate/verification/apart.py",
        "distance/certificate/test_verification.py",
        ("if gap < 0 or gap * gap <", "if gap * gap <", "test_what_is_wrong_with_a_least_distance_is_named"),
        (
            "Fraction(bound) ** 2 * sum(x * x for x in n)",
            "Fraction(bound) ** 2",
            "test_what_is_wrong_with_a_least_distance_is_named",
        ),
        ("left.append((done + beside, *halves[1]))", "pass", "test_what_is_wrong_with_a_least_distance_is_named"),
        ("if next(numbered, None) is not None:", "if False:", "test_what_is_wrong_with_a_least_distance_is_named"),
    ),
    *within(
        "_distance/certificate/verification/cells.py",
        "distance/certificate/test_verification.py",
        ("if cell[0] > reached:", "if False:", "test_what_is_wrong_is_named"),
        ("while reached < 1 or follows:", "while follows:", "test_what_is_wrong_is_named"),
        (
            "left.append((name + other, half(triangle, other, depth)))",
            "pass",
            "test_what_is_wrong_with_surfaces_is_named",
        ),
        ("if len(cell) > MOST_CUTS:", "if False:", "test_what_is_wrong_with_surfaces_is_named"),
    ),
    *within(
        "_distance/certificate/verification/polynomials.py",
        "distance/certificate/test_verification.py",
        (
            "if any(f.get(corner, 0) < 0 for corner in _corners(split)):",
            "if False:",
            "test_what_is_wrong_is_named",
        ),
        (
            "parts += [(reduced(half), rest, depth + 1) for half, rest in _halves(f, split)]",
            "parts += [(reduced(half), rest, depth + 1) for half, rest in _halves(f, split)[:1]]",
            "test_both_halves_of_a_polynomial_are_looked_at",
        ),
    ),
    *within(
        "_distance/certificate/verification/convexity.py",
        "distance/certificate/test_surface_certificates.py",
        (
            "return plane >= 0 and _is_convex(f, domain, degree)",
            "return plane >= 0",
            "test_a_tangent_plane_proves_nothing_of_what_is_not_convex",
        ),
        ("return plane >= 0 and", "return", "test_a_polynomial_next_to_zero_inside_is_proven_by_a_plane"),
    ),
    *within(
        "_distance/certificate/verification/zeros.py",
        "distance/certificate/test_surface_certificates.py",
        ("if first * last > 0:", "if False:", "test_a_point_that_is_a_zero_of_an_even_polynomial_is_proven_exactly"),
        (
            "Fraction(root + (root * root < square), 1 << (bits + 64))",
            "Fraction(root, 1 << (bits + 64))",
            "distance/certificate/test_verification.py::test_the_length_of_a_way_is_rounded_up",
        ),
        (
            "inside = all(low <= t <= high",
            "inside = all(low <= t",
            "distance/certificate/test_verification.py::test_a_place_beyond_either_end_of_the_box_is_none_of_the_surface",
        ),
    ),
    *within(
        "_distance/certificate/verification/structure.py",
        "distance/certificate/test_verification.py",
        ("if not any(x > 0 for row in rows for x in row):", "if False:", "test_what_is_wrong_is_named"),
        ("if not any(normal):", "if False:", "test_what_is_wrong_with_a_least_distance_is_named"),
        (
            "if source.is_surface and not all(any(row[k % len(row)] > 0 for row in rows) for k in range(4)):",
            "if False:",
            "distance/certificate/test_surface_certificates.py::test_multipliers_that_vanish_at_a_corner_prove_nothing_of_a_surface",
        ),
        (
            'if "sha256" in shape and shape["sha256"] != digest(shape):',
            "if False:",
            "io/test_certificates.py::test_a_hash_that_is_not_that_of_the_arrays_is_refused",
        ),
    ),
    *within(
        "_distance/certificate/verification/values.py",
        "distance/certificate/test_verification.py",
        ("if isinstance(value, int) and abs(value) > 2**53:", "if False:", "test_what_is_wrong_is_named"),
        ("if min(values) <= 0:", "if min(values) < 0:", "test_what_is_wrong_is_named"),
    ),
]
