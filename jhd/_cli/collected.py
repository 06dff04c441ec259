"""The commands that take many shapes, from files, folders, patterns and fonts."""

import glob
import os
from argparse import Namespace
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import jhd
from jhd._cli.comparisons import check_drawn
from jhd._cli.console import busy, exit_status
from jhd._cli.options import box_of, check_box, check_writable, is_polynomial, read_shape, search_of, tolerances_of
from jhd._cli.output import TABLE_SUFFIXES, delivered, print_files
from jhd._cli.report import neighbors_picture
from jhd._io.errors import shown
from jhd._io.glyphs import parse_font_spec
from jhd._io.load import SHAPE_SUFFIXES
from jhd._results.solution import names_of, to_plain
from jhd._runtime.decimals import interval_text
from jhd._shapes.implicit import ImplicitSurface
from jhd.io import load_glyphs

_ALL = ":*"
# A text file next to shapes is rarely a point set.
_IN_FOLDERS = tuple(suffix for suffix in SHAPE_SUFFIXES if suffix != ".txt")


def pairwise(options: Namespace) -> int:
    """The distances of all pairs."""
    check_writable(options.out, *TABLE_SUFFIXES)
    (names, shapes), *_ = collections_of(options, options.shapes)
    method = search_of(options, *shapes)
    with _searching(options) as searched:
        found = jhd.pairwise(shapes, method=method, store=options.store, **searched)
    results = np.reshape(names_of(found.result), found.value.shape)
    rows = [
        (found.value[i, j], found.lower[i, j], found.upper[i, j], names[i], names[j], results[i, j])
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
    ]
    content = {**_lists(found, "value", "lower", "upper"), "result": results.tolist()}
    context = {**_asked(options, shapes), "store": options.store, "names": names}
    if not delivered(options, found, content, [("value", "lower", "upper", "a", "b", "result"), *rows], **context):
        _print_unless_written(options, (_line(*row) for row in rows))
    return exit_status(found)


def nearest(options: Namespace) -> int:
    """The nearest shapes of each query."""
    # The page holds a picture, which needs nothing else in space either.
    check_drawn(options, 2)
    check_writable(options.out, *TABLE_SUFFIXES)
    (asking, queries), (names, shapes) = collections_of(options, [options.query], options.shapes)
    if (options.plot or options.html) and any(isinstance(shape, ImplicitSurface) for shape in (*queries, *shapes)):
        raise ValueError("--plot and --html draw no implicit surfaces; leave them out.")
    method = search_of(options, *queries, *shapes)
    with _searching(options) as searched:
        found = jhd.nearest_shapes(queries, shapes, options.count, method, **searched)
    short = [short_name(name) for name in asking], [short_name(name) for name in names]
    for file in filter(None, (options.plot, options.html)):
        with busy("drawing"):
            neighbors_picture(file, queries, shapes, found, short)
    results = names_of(found.result)
    ties = [[names[k] for k in tie] for tie in found.ties]
    table: list[Any] = [("value", "lower", "upper", "query", "shape", "result")]
    lines = []
    for row, query in enumerate(asking):
        for k, index in enumerate(found.index[row]):
            numbers = found.value[row, k], found.lower[row, k], found.upper[row, k]
            table.append((*numbers, query, names[index], results[row]))
            lines.append(_line(*table[-1]))
        table += [("", "", "", query, name, "possible tie") for name in ties[row]]
        lines += [f"possibly as near as the last one: {', '.join(ties[row])}"] if ties[row] else []
    numbers = _lists(found, "index", "value", "lower", "upper")
    content = {**numbers, "ties": ties, "result": results, "computed": found.computed}
    context = {**_asked(options, queries + shapes), "count": options.count, "names": names}
    if not delivered(options, found, content, table, **context):
        _print_unless_written(options, lines)
        print_files(picture=options.plot, page=options.html)
    return exit_status(found)


def duplicates(options: Namespace) -> int:
    """The pairs within a distance."""
    check_writable(options.out, *TABLE_SUFFIXES)
    (names, shapes), *_ = collections_of(options, options.shapes)
    threshold, method = options.threshold.of(*shapes), search_of(options, *shapes)
    with _searching(options) as searched:
        found = jhd.pairs_within(shapes, method=method, threshold=threshold, **searched)
    rows = [
        (lower, upper, names[i], names[j], "within")
        for (i, j), lower, upper in zip(found.index, found.lower, found.upper, strict=True)
    ]
    rows += [("", "", names[i], names[j], "undecided") for i, j in found.undecided]
    numbers = _lists(found, "index", "lower", "upper", "undecided")
    content = {**numbers, "result": names_of(found.result), "computed": found.computed}
    context = {**_asked(options, shapes), "threshold": threshold, "names": names}
    if not delivered(options, found, content, [("lower", "upper", "a", "b", "answer"), *rows], **context):
        ends = (answer if lower == "" else interval_text(lower, upper, ".9g") for lower, upper, _, _, answer in rows)
        _print_unless_written(options, (f"{end}\t{row[2]}\t{row[3]}" for end, row in zip(ends, rows, strict=True)))
    return exit_status(found)


@contextmanager
def _searching(options: Namespace) -> Iterator[dict[str, Any]]:
    """The arguments that all collections have in common, while a message says that they are searched."""
    with busy("computing; a first run compiles") as show, threads(options.jobs) as executor:
        yield {"executor": executor, "max_seconds": options.max_seconds, "progress": show}


@contextmanager
def threads(jobs: int | None) -> Iterator[Executor | None]:
    """An executor of `jobs` threads, or None, the default of jhd, if jobs is None.

    Raises:
        ValueError: the number is not positive.
    """
    if jobs is None:
        yield None
        return
    if jobs < 1:
        raise ValueError(f"--jobs is {jobs}; needs at least 1.")
    with ThreadPoolExecutor(jobs) as executor:
        yield executor


def _asked(options: Namespace, shapes: list[Any]) -> dict[str, Any]:
    """The options that all collections have, as JSON names them."""
    asked = {"method": options.method or "BranchAndBound", "jobs": options.jobs}
    return {**asked, **tolerances_of(options, *shapes), **box_of(*shapes)}


def _print_unless_written(options: Namespace, lines: Iterable[str]) -> None:
    if options.out:
        print_files(results=options.out)
    else:
        for line in lines:
            print(line)


def collections_of(options: Namespace, *words: list[str]) -> list[tuple[list[str], list[Any]]]:
    """Names and shapes of each list of words, with the box of implicit surfaces.

    Raises:
        ValueError: a folder or pattern has no files of shapes, a word is no shape, or no surface needs the box.
    """
    found = [collected(some, options.box) for some in words]
    check_box(options.box, [shape for _, shapes in found for shape in shapes], "there is none among the shapes")
    return found


def collected(words: list[str], box: list[float] | None = None) -> tuple[list[str], list[Any]]:
    """Names and shapes for the words: a folder or a pattern of files, `font:NAME:*` for all letters, or one shape.

    Raises:
        ValueError: a folder or pattern has no files of shapes, or a word is no shape.
    """
    pairs = [pair for word in words for pair in _pairs_of(word, box)]
    return [name for name, _ in pairs], [shape for _, shape in pairs]


def _pairs_of(word: str, box: list[float] | None) -> list[tuple[str, Any]]:
    if word.startswith("font:") and word.endswith(_ALL):
        font = word.removeprefix("font:").removesuffix(_ALL)
        return [(f"font:{font}:{letter}", curve) for letter, curve in load_glyphs(font).items()]
    if os.path.isdir(word):
        files = sorted(str(path) for path in Path(word).iterdir() if path.suffix.lower() in _IN_FOLDERS)
    elif any(sign in word for sign in "*?[") and not word.startswith("font:"):
        files = sorted(glob.glob(word, recursive=True)) or [word] * is_polynomial(word)
    else:
        files = [word]
    if not files:
        raise ValueError(f"{word}: no file with a shape found; see jhd --help for the file formats.")
    return [(file, read_shape(shown(file), file, box)) for file in files]


def short_name(name: str) -> str:
    """The name of a shape in a picture: its file name, or its letter (by its number if fonts may lack it)."""
    if name.startswith("font:"):
        letter = parse_font_spec(name)[1]
        return letter if letter.isascii() else " ".join(f"U+{ord(sign):04X}" for sign in letter)
    return Path(name).name if Path(name).suffix.lower() in SHAPE_SUFFIXES else name


def _line(value: float, lower: float, upper: float, name: str, other: str, result: str) -> str:
    told = [] if result == "successful" else [result]
    return "\t".join([f"{value:.9g} {interval_text(lower, upper, '.9g')}", name, other, *told])


def _lists(found: Any, *names: str) -> dict[str, Any]:
    return {name: to_plain(getattr(found, name)) for name in names}
