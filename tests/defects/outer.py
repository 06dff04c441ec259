"""Defects of the modules of jhd itself, of jhd.io, jhd._fitting and jhd.plot, and the tests that notice them."""

from tests.defects.runner import within

DEFECTS = [
    *within(
        "_io/svg_paths.py",
        "io/test_svg_paths.py",
        (
            "v.real * side.imag - v.imag * side.real < 0",
            "v.real * side.imag - v.imag * side.real > 0",
            "test_arcs_of_ellipses_are_arcs_in_any_degree_and_position",
        ),
    ),
    *within(
        "_io/path_text.py",
        "io/test_path_text.py",
        ("return bulge if sweep else -bulge", "return bulge", "test_an_arc_lies_on_its_ellipse_between_its_angles"),
        ("sine = min(1.0, ", "sine = (", "test_radii_that_are_too_small_are_scaled_up_to_a_half_turn"),
        (
            "if self.control is None or self.control[0] != kind:",
            "if self.control is None:",
            "test_polynomial_commands_agree_with_fonttools",
        ),
        ("if not math.isfinite(value):", "if False:", "test_errors_say_where_and_what"),
        ('if not drawing.contours and command not in "Mm":', "if False:", "test_errors_say_where_and_what"),
    ),
    *within(
        "_io/meshes.py",
        "io/test_meshes.py",
        ("if i == 0 or i < -count:", "if False:", "test_what_cannot_be_read_is_refused_in_one_line_with_its_place"),
        ("if np.abs(corners).max() > limit:", "if False:", "test_what_cannot_be_written_is_refused"),
    ),
    *within(
        "_io/ply.py",
        "io/test_meshes.py",
        (
            "if len(fields) != len(element.properties):",
            "if False:",
            "test_what_cannot_be_read_is_refused_in_one_line_with_its_place",
        ),
        ("if content[at:].strip():", "if False:", "test_what_cannot_be_read_is_refused_in_one_line_with_its_place"),
    ),
    *within(
        "_io/clouds.py",
        "io/test_clouds.py",
        ("if len(found.sizes):", "if False:", "test_a_ply_file_with_faces_is_no_point_cloud"),
    ),
    *within(
        "_io/outward.py",
        "io/test_outward.py",
        (
            "if shape.weights is not None and not homogeneous:",
            "if False:",
            "test_rational_shapes_go_to_scipy_in_homogeneous_form_alone",
        ),
        (
            "chain.shape[1] != 2 or len(chain) < 4 or np.any(chain[0] != chain[-1])",
            "chain.shape[1] != 2 or len(chain) < 4",
            "test_what_is_no_geometry_is_refused",
        ),
        (
            "if not area.is_valid or lost > 1e-9 * kept:",
            "if not area.is_valid:",
            "test_what_is_no_geometry_is_refused",
        ),
    ),
    *within(
        "_io/iges.py",
        "io/test_iges.py",
        ("if not shapes:", "if False:", "test_entities_that_cannot_be_read_are_refused_by_name_and_line"),
    ),
    *within(
        "_io/iges_file.py",
        "io/test_iges.py",
        (
            "if len(text) != _WIDTH:",
            "if False:",
            "test_a_layout_that_is_not_that_of_the_standard_is_refused_with_its_line",
        ),
        (
            "if bad or parameter == record or behind[:1] not in (parameter, record):",
            "if bad:",
            "test_a_layout_that_is_not_that_of_the_standard_is_refused_with_its_line",
        ),
    ),
    *within(
        "_runtime/archives.py",
        "io/test_hostile.py",
        (
            "if whole > _TIMES * size + _ALWAYS:",
            "if False:",
            "test_an_archive_that_would_fill_the_memory_is_refused_before_it_is_read",
        ),
        ("if dtype.hasobject:", "if False:", "test_an_archive_with_objects_of_python_says_so"),
        (
            "rows.reshape(shape[::-1]).T if by_column else",
            "rows.reshape(shape) if by_column else",
            "test_archives_are_read_as_numpy_reads_them",
        ),
    ),
    *within(
        "_runtime/files.py",
        "test_files.py",
        (
            "if target.exists():\n            part.chmod",
            "if False:\n            part.chmod",
            "test_a_file_is_replaced_with_its_mode_and_nothing_else_is_left",
        ),
        (
            "except BaseException:\n        part.unlink",
            "except ValueError:\n        part.unlink",
            "test_an_interruption_leaves_the_old_file_alone",
        ),
    ),
    *within(
        "_runtime/storage.py",
        "test_storage.py",
        (
            "return body if content[: len(_MARK) + _SUM] == _head(body) else None",
            "return body",
            "test_a_damaged_file_is_ignored_and_replaced",
        ),
        (
            'return "others can write to it" if found.st_mode & _OTHERS else None',
            "return None",
            "test_a_folder_that_others_can_write_is_refused",
        ),
        ("if not _ours(found):", "if False:", "test_a_file_that_others_can_write_and_a_link_are_not_read"),
        (
            "if abandoned or size > room:",
            "if size > room:",
            "test_what_a_killed_process_had_begun_to_write_goes_in_time",
        ),
        ('if chosen == "0":', "if False:", "test_the_environment_says_where"),
    ),
    *within(
        "_runtime/programs.py",
        "test_programs.py",
        (
            "*map(_plain, (kinds, context, options)),",
            "*map(_plain, (kinds, context)),",
            "test_static_arguments_are_told_apart_by_type_too",
        ),
        ("if known != name:", "if False:", "test_a_program_under_the_name_of_another_is_not_taken_for_it"),
        (
            "_constants(function.__module__), *current])",
            "*current])",
            "test_a_constant_that_somebody_set_has_a_program_of_its_own",
        ),
        (
            "if not any(mark in payload for mark in _CODE):",
            "if False:",
            "test_what_jax_has_read_from_its_own_cache_has_lost_its_code_and_is_not_kept",
        ),
    ),
    *within(
        "_runtime/compiled.py",
        "test_programs.py",
        (
            "_chosen() not in (None, host_device())",
            "_chosen() is not None",
            "test_a_program_is_read_in_a_call_of_the_host_as_well",
        ),
        (
            "return x if there == here else np.asarray(x)",
            "return x",
            "test_a_call_of_the_host_computes_on_a_device_that_no_program_occupies",
        ),
    ),
    *within(
        "_distance/normalization/host_callback.py",
        "test_programs.py",
        (
            "with subnormals_kept(), jax.default_device(device), jax.enable_x64(wide):\n            if rows:",
            "with jax.default_device(None), jax.enable_x64(wide):\n            if rows:",
            "test_a_call_of_the_host_computes_on_a_device_that_no_program_occupies",
        ),
    ),
    *within(
        "_distance/normalization/host_callback.py",
        "distance/test_scales.py",
        (
            "with subnormals_kept(), jax",
            "with jax",
            "test_compiled_functions_call_a_host_that_keeps_subnormal_numbers",
        ),
    ),
    *within(
        "_distance/nearest/curves.py",
        "distance/test_project.py",
        (
            "closed = lower >= state.best.upper - 8 * tolerance",
            "closed = lower >= 0",
            "test_very_uneven_weights_leave_close_bounds_or_none_that_are_called_so",
        ),
    ),
    *within(
        "_results/batches.py",
        "test_solution.py",
        ("np.empty(shape, bool)[entry]", "pass", "test_only_a_batch_has_an_index_and_only_within"),
        (
            "numbers if padded is None else numbers[np.asarray(padded)]",
            "numbers",
            "test_the_span_of_a_padded_batch_is_that_of_its_entries",
        ),
        (
            "return _ENDS.get(name, repr)(numbers.item())",
            'return f"{numbers.item():.9g}"',
            "test_display.py::test_notebooks_see_a_table_of_a_solution_and_the_lines_of_a_batch",
        ),
    ),
    *within(
        "_results/solution.py",
        "test_solution.py",
        (
            "if bool(self.answer == ANSWERS.undecided):",
            "if False:",
            "distance/test_decision.py::test_a_decision_counts_as_what_it_answers_and_an_undecided_one_as_nothing",
        ),
    ),
    *within(
        "_runtime/memory.py",
        "test_memory.py",
        (
            "return min(_of_the_system(), _of_the_group(), _of_the_process())",
            "return min(_of_the_system(), _of_the_group())",
            "test_the_limit_of_a_process_counts",
        ),
        ("if need > free:", "if False:", "test_a_table_of_pairs_is_refused_before_it_is_made"),
    ),
    *within(
        "_runtime/arrays.py",
        "test_arrays.py",
        ("if finite.all():", "if finite.any():", "test_the_first_row_that_is_not_finite_is_named"),
        (
            'if given.dtype.kind not in "fiub" and',
            'if given.dtype.kind not in "fiubc" and',
            "test_what_is_no_real_number_is_refused_with_its_type",
        ),
        (
            "return not is_trace_clean() and is_traced(values, jnp.zeros(()))",
            "return is_traced(values)",
            "test_operations_on_known_numbers_are_traced_inside_programs_alone",
        ),
    ),
    *within(
        "_runtime/decimals.py",
        "test_printed_bounds.py",
        (
            "_text(float(bound), spec, ROUND_FLOOR)",
            "_text(float(bound), spec, ROUND_CEILING)",
            "test_digits_in_full_give_the_same_number_back_and_are_rounded_outward",
        ),
        (
            "(off > 0) == (rounding",
            "(off > 0) != (rounding",
            "test_digits_in_full_give_the_same_number_back_and_are_rounded_outward",
        ),
    ),
    *within(
        "_runtime/compiled.py",
        "test_compiled.py",
        (
            "- MOST\n",
            "- 3 * MOST\n",
            "test_a_process_holds_a_stated_number_of_programs_and_those_used_last_stay",
        ),
    ),
    *within(
        "_runtime/programs.py",
        "test_programs.py",
        (
            "in (tuple, list, dict, set, frozenset):",
            "in (tuple, list, dict):",
            "test_an_unknown_part_of_a_context_has_a_text_if_its_class_says_how_it_is_pickled",
        ),
    ),
    *within(
        "_results/display.py",
        "test_display.py",
        (
            'return None if known else described(thing, "...")',
            "return None",
            "test_objects_print_with_whatever_jax_puts_into_them",
        ),
    ),
    *within(
        "_cli/lengths.py",
        "test_main_comparisons.py",
        (
            'return Length(number, "%" in text, text.strip())',
            "return Length(number, False, text.strip())",
            "test_a_length_is_a_number_or_a_share_of_the_diagonal",
        ),
        ("if not number >= least:", "if False:", "test_a_length_is_a_number_or_a_share_of_the_diagonal"),
    ),
    *within(
        "_runtime/forks.py",
        "test_forks.py",
        ("if _forked:", "if False:", "test_every_entry_refuses_a_forked_process"),
    ),
    *within(
        "_runtime/compiled.py",
        "test_compiled.py",
        ("if count > _SHARE * limit:", "if False:", "test_programs_are_dropped_near_the_limit_and_made_again"),
        (
            "if name not in flags and _is_option(name, value)}",
            "if _is_option(name, value)}",
            "test_flags_that_the_user_gave_to_the_compiler_go_before_the_level_of_a_program",
        ),
        (
            "if need > _ALWAYS:",
            "if False:",
            "test_memory.py::test_programs_that_would_take_too_much_are_refused_before_they_run",
        ),
    ),
    *within(
        "_fitting/subproblem.py",
        "fitting/test_subproblem.py",
        ("x[:-1] - 1, -x[:-1] - 1", "x[:-1] - 9, -x[:-1] - 9", "test_the_radius_bounds_each_parameter"),
        ("np.diag(price)", "0 * np.diag(price)", "test_a_price_keeps_multipliers_away"),
        ("0.5 * curved @ x[:-1]", "0.0 * curved @ x[:-1]", "test_no_sampled_step_is_better"),
    ),
    *within(
        "_fitting/soft.py",
        "fitting/test_soft.py",
        (
            "hard = carrying(found.upper, found.value)",
            "hard = found.value * (1 - 1e-6)",
            "test_it_lies_above_the_distance_by_at_most_its_smoothing",
        ),
        (
            "distance = jnp.minimum(_distances(of, b, long), top)",
            "distance = _distances(of, b, long)",
            "test_a_sample_whose_foot_is_too_far_counts_as_much_as_the_farthest_place",
        ),
        (
            "moves = (feet.segment != early.segment) | (jnp.abs(feet.t - early.t) > _STILL)",
            "moves = feet.segment != feet.segment",
            "test_feet_that_still_move_are_followed_on_however_many_there_are",
        ),
    ),
    *within(
        "_fitting/host_bounds.py",
        "fitting/test_host_bounds.py",
        ("below = away - radius -", "below = away -", "test_distances_of_dense_samples_are_between_the_bounds"),
        (
            "above = np.max(_distance(hull, feet[:, None]), axis=1) * rounded + off",
            "above = np.min(_distance(hull, feet[:, None]), axis=1) * rounded + off",
            "test_exact_distances_lie_between_the_bounds",
        ),
        (
            "if not _SMALLEST < max(first.largest, second.largest) < _LARGEST:",
            "if False:",
            "test_what_is_too_large_or_too_small_to_be_squared_has_no_bounds",
        ),
        (
            "HostBounds(max(there.lower, back.lower), max(there.upper, back.upper))",
            "HostBounds(max(there.lower, back.lower), there.upper)",
            "test_distances_of_dense_samples_are_between_the_bounds",
        ),
    ),
    *within(
        "_runtime/clock.py",
        "test_clock.py",
        ("if self.is_over():", "if False:", "test_an_evaluation_is_given_up_when_the_time_is_over"),
        ("now + (1 + _FOR_PROOF) * limit", "now + limit", "test_the_proof_has_a_tenth_of_the_time_more"),
    ),
    *within(
        "_fitting/annealing.py",
        "fitting/test_annealing.py",
        (
            "if statistic is not None and statistic != MaxDistance():",
            "if False:",
            "test_only_the_distance_of_curves_is_annealed_and_by_a_length",
        ),
    ),
]
