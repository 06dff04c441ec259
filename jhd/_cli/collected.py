"""The commands that take many shapes, from files, folders, patterns and fonts."""

import glob
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

import jhd
from jhd._cli.comparisons import check_drawn, print_files
from jhd._cli.report import neighbors_picture
from jhd._results.solution import names_of, to_plain
from jhd.console import busy, exit_status, print_json
from jhd.decimals import interval_text
from jhd.io import load_glyphs, load_shape
from jhd.io.glyphs import parse_font_spec
from jhd.io.load import SHAPE_SUFFIXES

_ALL = ":*"


def pairwise(options: Namespace) -> int:
    """The distances of all pairs."""
    names, shapes = collected(options.shapes)
    with busy("computing; a first run compiles") as show:
        found = jhd.pairwise(shapes, store=options.store, progress=show)
    results = np.reshape(names_of(found.result), found.value.shape)
    if options.json:
        print_json(found, {**_lists(found, "value", "lower", "upper"), "result": results.tolist()}, names=names)
    else:
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            numbers = (found.value[i, j], found.lower[i, j], found.upper[i, j])
            print(_line(*numbers), names[i], names[j], *_unless_successful(results[i, j]), sep="\t")
    return exit_status(found)


def nearest(options: Namespace) -> int:
    """The nearest shapes of each query."""
    # The page holds a picture, which needs nothing else in space either.
    check_drawn(options, 2)
    queries, wanted = collected([options.query])
    names, shapes = collected(options.shapes)
    with busy("computing; a first run compiles") as show:
        found = jhd.nearest_shapes(wanted, shapes, options.k, progress=show)
    short = [short_name(name) for name in queries], [short_name(name) for name in names]
    for file in filter(None, (options.plot, options.html)):
        with busy("drawing"):
            neighbors_picture(file, wanted, shapes, found, short)
    results = names_of(found.result)
    ties = [[names[k] for k in tie] for tie in found.ties]
    if options.json:
        numbers = _lists(found, "index", "value", "lower", "upper")
        print_json(found, {**numbers, "ties": ties, "result": results, "computed": found.computed}, names=names)
    else:
        for row, query in enumerate(queries):
            for k, index in enumerate(found.index[row]):
                line = _line(found.value[row, k], found.lower[row, k], found.upper[row, k])
                print(line, query, names[index], *_unless_successful(results[row]), sep="\t")
            if ties[row]:
                print(f"possibly as near as the last one: {', '.join(ties[row])}")
        print_files(picture=options.plot, page=options.html)
    return exit_status(found)


def duplicates(options: Namespace) -> int:
    """The pairs within a distance."""
    names, shapes = collected(options.shapes)
    threshold = options.threshold.of(*shapes)
    with busy("computing; a first run compiles") as show:
        found = jhd.pairs_within(shapes, threshold=threshold, progress=show)
    if options.json:
        numbers = _lists(found, "index", "lower", "upper", "undecided")
        context = {"names": names, "threshold": threshold}
        print_json(found, {**numbers, "result": names_of(found.result), "computed": found.computed}, **context)
    else:
        for (i, j), lower, upper in zip(found.index, found.lower, found.upper, strict=True):
            print(interval_text(lower, upper, ".9g"), names[i], names[j], sep="\t")
        for i, j in found.undecided:
            print("undecided", names[i], names[j], sep="\t")
    return exit_status(found)


def collected(words: list[str]) -> tuple[list[str], list[Any]]:
    """Names and shapes for the words: a folder or a pattern of files, `font:NAME:*` for all letters, or one shape.

    Raises:
        ValueError: a folder or pattern has no files of shapes, or a word is no shape.
    """
    pairs = [pair for word in words for pair in _pairs_of(word)]
    return [name for name, _ in pairs], [shape for _, shape in pairs]


def _pairs_of(word: str) -> list[tuple[str, Any]]:
    if word.startswith("font:") and word.endswith(_ALL):
        font = word.removeprefix("font:").removesuffix(_ALL)
        return [(f"font:{font}:{letter}", curve) for letter, curve in load_glyphs(font).items()]
    if Path(word).is_dir():
        files = sorted(str(path) for path in Path(word).iterdir() if path.suffix.lower() in SHAPE_SUFFIXES)
    elif any(sign in word for sign in "*?[") and not word.startswith("font:"):
        files = sorted(glob.glob(word, recursive=True))
    else:
        files = [word]
    if not files:
        raise ValueError(f"{word}: no file of a shape found; see jhd --help for the file formats.")
    return [(file, load_shape(file)) for file in files]


def short_name(name: str) -> str:
    """The name of a shape in a picture: its file name, or its letter (by its number if fonts may lack it)."""
    if name.startswith("font:"):
        letter = parse_font_spec(name)[1]
        return letter if letter.isascii() else " ".join(f"U+{ord(sign):04X}" for sign in letter)
    return Path(name).name


def _line(value: float, lower: float, upper: float) -> str:
    return f"{value:.9g} {interval_text(lower, upper, '.9g')}"


def _unless_successful(result: str) -> list[str]:
    return [] if result == "successful" else [result]


def _lists(found: Any, *names: str) -> dict[str, Any]:
    return {name: to_plain(getattr(found, name)) for name in names}
