"""The command line: `jhd` or `python -m jhd`; without a command it runs the demonstration.

Exit status: 0 done, and the requested property holds; 1 the bounds are true but wider than requested, a call is out of
time, or a certificate cannot be made or is not checked in time; 2 invalid input, with one line on stderr; 4 `jhd
verify` refuses one; 5 the self-check of `jhd doctor` fails; 70 unexpected error (JHD_TRACEBACK=1 shows its location);
130 interrupted, with the bounds reached, if any; 141 the reader of the output closed it. With --threshold: 0 certified
yes, 3 certified no, 1 undecided.
"""

import argparse
import errno
import os
import re
import sys
from difflib import get_close_matches
from typing import Any, NoReturn

# Light alone: this module answers --help while the package is not imported yet.
import jhd
from jhd._cli import lengths
from jhd._runtime.starting import INTERRUPTED

# The names of jhd._cli.warming and jhd._fields, written out, as their import takes seconds.
_KINDS = "plane", "space", "rational", "surfaces", "meshes"
_MODES, _SIGNS = ("band", "full"), ("winding", "pseudonormal", "none")
_SHORT = "-h", "-k", "-o"
_FULL = errno.ENOSPC, errno.EFBIG, errno.EDQUOT
_BOX_HELP = "box of an implicit surface: LOWER UPPER for all axes, or three lower and then three upper ends"
_SECONDS_HELP = "time in seconds after which the search ends with the bounds reached (default: none)"
_ATOL_HELP = "largest upper - lower (default: 1e-10 of the diagonal)"
_RTOL_HELP = "largest upper - lower, relative to upper; the larger tolerance counts (default: {})"
_OUT_HELP = "file for the {}: {}"
_THRESHOLD_HELP = "question: is the distance at most LENGTH? The exit status is the answer: 0 yes, 3 no, 1 undecided"
_METHOD_HELP = "method, a class of jhd or jhd.published (default: {}); an unknown name lists all"
_PLOT_HELP = "file for a picture of {}; the suffix selects the format (.png, .svg, .pdf, ...)"
_PAGE_HELP = "file for an HTML page: walk along plane curves, or rotate shapes in space (with the extra jhd[web])"
_CERTIFICATE_HELP = "file for a certificate of the bounds, which jhd verify checks"
_FILES_EPILOG = """\
SHAPE is one of
  a curve              .json, .svg, .igs, .iges, .geojson, .wkt file, font:NAME:LETTER, or SVG path data ("M 0 0 L 1 2")
  a parametric surface .json, .igs or .iges file
  a triangle mesh      .obj, .off, .ply, .stl, .glb, .gltf or .3mf file
  a point set          .xyz, .csv, .txt, .npy, .geojson or .wkt file, or .ply file without faces
"""
_SHAPES_EPILOG = f"""\
{_FILES_EPILOG}\
  an implicit surface  polynomial in x, y, z ("x**2 + y**2 + z**2 - 1"), with --box
"""
_MANY_EPILOG = f"""\
{_SHAPES_EPILOG}
For several shapes, give a folder (its .txt files are left out), a quoted pattern of files ("scans/*.ply"), or all
letters of a font (font:NAME:*).
"""
# Options that name a file, a folder or a method.
_NAMES = ("out", "plot", "html", "certificate", "surface", "store", "method")
# Other options whose values are words and no files.
_CHOICES = ("command", "mode", "sign")
# Exit statuses of commands, in their help.
_STATUSES = {
    "hausdorff": "0 done; 1 bounds not closed, or no certificate; 2 invalid input. With --threshold: 0 yes, 3 no, "
    "1 undecided.",
    "duplicates": "0 done; 1 some pairs undecided; 2 invalid input.",
    "fit": "0 done; 1 tolerance not reached; 2 invalid input.",
    "field": "0 done; 1 tolerance not reached, or out of time and no field; 2 invalid input.",
    "verify": "0 verified; 1 not checked in the time; 2 invalid input; 4 certificate refused.",
    "project": "0 done; 1 bounds not closed, or out of time; 2 invalid input.",
    "precompile": "0 done; 2 invalid input.",
    "doctor": "0 self-check passed; 5 self-check failed.",
}
_STATUSES |= {"minimum": _STATUSES["hausdorff"]}
_LENGTH_EPILOG = """\

LENGTH is a number in input units, or a percentage of the diagonal of the box around all given shapes, for example 0.1%.
"""
_EPILOG = f"""\
examples:
  jhd                                                 the demonstration; writes jhd-demo.png to this folder
  jhd hausdorff a.svg b.json --plot distance.png
  jhd hausdorff a.svg b.json --certificate proof.json
  jhd hausdorff "x**2/4 + y**2/4 - z**2/9" "x**2/16 + y**2/4 - z**2/9" --box -2 2
  jhd verify proof.json
  jhd fit "font:DejaVu Serif:s" --tolerance 5 --out s.svg
  jhd hausdorff "font:DejaVu Sans:a" "font:DejaVu Serif:a" --json
  jhd hausdorff a.ply b.obj
  jhd hausdorff scan.ply model.obj --directed --threshold 0.5%
  jhd minimum bunny.ply "x**2 + y**2 + z**2 - 1" --box -2 2
  jhd deviation scan.ply model.obj --threshold 0.1 --plot deviation.png
  jhd project a.svg 10 -2.5
  jhd nearest "font:DejaVu Serif:a" "font:DejaVu Sans:*" -k 3 --plot nearest.png
  jhd duplicates icons/ --threshold 0.5%
  jhd pairwise "scans/*.ply" --store distances
  jhd field bunny.ply --tolerance 0.001 --out bunny.npz
  jhd precompile plane rational --degree 3
  jhd doctor

{_SHAPES_EPILOG}{_LENGTH_EPILOG}
Exit status: 0 done; 1 bounds not closed, a tolerance not reached, out of time, or no certificate;
2 invalid input; 4 certificate refused; 5 self-check failed; 70 unexpected error; 130 interrupted, with the bounds
reached; 141 output closed by its reader. A question (`--threshold` of hausdorff and minimum) is answered by 0 yes,
3 no, 1 undecided.

Environment: JHD_CACHE=FOLDER is the folder of compiled functions, JHD_CACHE=0 keeps none. JAX_ENABLE_X64=0 computes in
float32. JHD_TRACEBACK=1 shows the location of an unexpected error.
"""


def main(argv: list[str] | None = None) -> int:
    """Run one command and return the exit status.

    Args:
        argv: the arguments without the name of the command. None means the arguments of the process.
    """
    try:
        status = _run(sys.argv[1:] if argv is None else argv)
        sys.stdout.flush()  # here, so that a reader who went away is noticed while it can be answered
        return status
    except KeyboardInterrupt:
        print("jhd: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # Nobody can read the rest of the buffer; Python would print an error about it when it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        if isinstance(error, TimeoutError) and error.errno is None:  # a time limit of ours, no error of a file
            print(f"jhd: {error}", file=sys.stderr)
            return 1
        # Errors of files have names, so a full disk without a name belongs to standard output.
        name = "standard output" if error.filename is None and error.errno in _FULL else error.filename
        return _bad_input(str(error) if error.strerror is None or name is None else f"{name}: {error.strerror}.")
    except (ValueError, TypeError, ImportError, MemoryError) as error:
        return _bad_input(str(error))
    except Exception as error:
        if os.environ.get("JHD_TRACEBACK"):
            raise
        # An unexpected error: it does not mean that the input or the bounds are wrong.
        kind, hint = type(error).__name__, "set JHD_TRACEBACK=1 to see its location"
        print("jhd: failed:", *f"{kind}: {error}".split(), f"({hint})", file=sys.stderr)
        return 70


def _run(argv: list[str]) -> int:
    try:
        options, _ = _parser().parse_known_args([_option_or_word(word) for word in _box_as_one(argv)])
    except SystemExit:  # argparse's way out of --help and --version; of errors it is ours
        return 0
    if options.demo is not None and options.command != "demo":
        raise ValueError(f"--out in front of {options.command} is for the demonstration; give it after the command.")
    _check_files(options)
    from jhd._cli.console import interrupts_heard, switch_cache_on

    with interrupts_heard():
        from jhd._cli import commands

        switch_cache_on()
        return getattr(commands, options.command)(options)


def _check_files(options: argparse.Namespace) -> None:
    """Raise ValueError if an option that names something is empty, or an input would be overwritten."""
    words = {name: value for name, value in vars(options).items() if isinstance(value, str)}
    for name in _NAMES:
        if words.get(name) == "":
            raise ValueError(f"--{name} is empty; give it a value, or leave it out.")
    several = [x for value in vars(options).values() if isinstance(value, list) for x in value if isinstance(x, str)]
    read = [value for name, value in words.items() if name not in (*_NAMES, *_CHOICES)] + several
    for name in _NAMES:
        file = words.get(name)
        if file is not None and os.path.isfile(file) and any(_is_same(file, other) for other in read):
            raise ValueError(f"--{name} would overwrite {file}, which is read; name another file.")


def _is_same(file: str, other: str) -> bool:
    try:
        return os.path.samefile(file, other)
    except (OSError, ValueError):  # no file, as a polynomial
        return False


def _bad_input(message: str) -> int:
    print("jhd: error:", " ".join(message.split()), file=sys.stderr)
    return 2


def _box_as_one(argv: list[str]) -> list[str]:
    """The numbers behind --box as one word, so that shapes may follow them."""
    if "--box" not in argv:
        return argv
    start = argv.index("--box") + 1
    stop = start
    while stop < len(argv) and _is_number(argv[stop]):
        stop += 1
    return [*argv[:start], *([" ".join(argv[start:stop])] if stop > start else []), *argv[stop:]]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(text: str) -> list[float]:
    """The numbers in a text, separated by spaces; argparse adds the name of the option to errors."""
    if not all(_is_number(word) for word in text.split()):
        raise argparse.ArgumentTypeError(f"needs numbers, as in --box -2 2; got {text.strip()!r}")
    return [float(word) for word in text.split()]


def _option_or_word(word: str) -> str:
    """The word, with a space before a minus that begins no option: argparse would take -1e-3 or -x**2 for one."""
    option = word == "-" or word.startswith(("--", *_SHORT))  # a single minus means standard input
    return f" {word}" if word.startswith("-") and not option else word


def _as_given(word: str) -> str:
    return word[1:] if word.startswith(" -") else word


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are ours: one line, without the usage. Options are not abbreviated."""

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, allow_abbrev=False, **options)

    def parse_known_args(self, *args: Any, **options: Any) -> Any:
        """Parse as argparse does. Unknown words raise ValueError; its message names the nearest option, if any."""
        found, unknown = super().parse_known_args(*args, **options)
        if unknown:
            known = re.findall(r"--[a-z-]+", self.format_usage())
            near = [option for word in unknown for option in get_close_matches(word, known, 1, 0.75)]
            hint = f"; nearest is {', '.join(near)}" if near else ""
            self.error(f"{self.prog} does not know: {' '.join(map(_as_given, unknown))}{hint}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    """The parser; options.command names the function in jhd._cli.commands."""
    raw = argparse.RawDescriptionHelpFormatter
    summary = (jhd.__doc__ or "").partition("\n")[0]
    parser = _Parser("jhd", description=summary, epilog=_EPILOG, formatter_class=raw)
    parser.add_argument("--version", action="version", version=f"jhd {jhd.__version__}")
    picture = "file for the picture of the demonstration (default: jhd-demo.png)"
    parser.add_argument("-o", "--out", dest="demo", metavar="FILE", help=picture)
    parser.set_defaults(command="demo")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")

    _add_distances(commands)
    _add_deviation(commands)
    _add_collections(commands)

    purpose = "fit of a curve by few segments, within a tolerance"
    fit = _added(commands, "fit", purpose, _LENGTH_EPILOG.lstrip())
    curve = "curve: a .json, .svg, .igs, .iges, .geojson or .wkt file, font:NAME:LETTER, or SVG path data"
    fit.add_argument("target", metavar="TARGET", help=curve)
    tolerance = "largest certified Hausdorff distance"
    fit.add_argument("--tolerance", type=lengths.length, required=True, metavar="LENGTH", help=tolerance)
    fit.add_argument("--degree", type=int, default=3, metavar="N", help="degree of the segments (default: 3)")
    smooth = "continuous tangents at the joints (default: corners allowed)"
    fit.add_argument("--smooth", action="store_true", help=smooth)
    seconds = "time in seconds after which the best fit so far is returned (default: none)"
    fit.add_argument("--max-seconds", type=lengths.seconds, metavar="S", help=seconds)
    _add_out(fit, "fitted curve", ".svg or .json")
    shown = "both curves, the witness and the distance profiles"
    fit.add_argument("--plot", metavar="FILE", help=_PLOT_HELP.format(shown))
    fit.add_argument("--html", metavar="FILE", help=_PAGE_HELP)

    verify = _added(commands, "verify", "check of a certificate in exact arithmetic", _SHAPES_EPILOG)
    verify.add_argument("file", metavar="FILE", help="certificate, written by jhd hausdorff or jhd minimum")
    both = "both shapes, each a SHAPE, to compare with the shapes of the certificate (default: none)"
    verify.add_argument("shapes", nargs="*", metavar="A B", type=_as_given, help=both)
    verify.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)
    verify.add_argument(
        "--max-seconds", type=lengths.seconds, metavar="S", help="time limit in seconds (default: none)"
    )

    _add_others(commands)
    for command in dict.fromkeys(commands.choices.values()):  # one of two names is there once
        command.add_argument("--json", action="store_true", help="output as JSON only")
    return parser


def _added(commands: Any, name: str, purpose: str, epilog: str | None = None, aliases: tuple[str, ...] = ()) -> Any:
    """A command, whose purpose stands in the list of commands and in its own help."""
    raw = argparse.RawDescriptionHelpFormatter
    described = {"help": purpose, "description": f"{purpose[0].upper()}{purpose[1:]}."}
    statuses = _STATUSES.get(name, "0 done; 1 bounds not closed; 2 invalid input.")
    ends = f"{epilog}\nExit status: {statuses}" if epilog else f"Exit status: {statuses}"
    parser = commands.add_parser(name, aliases=aliases, epilog=ends, formatter_class=raw, **described)
    parser.set_defaults(command=name)
    return parser


def _add_distances(commands: Any) -> None:
    """Hausdorff distance and minimum distance of two shapes."""
    epilog = _SHAPES_EPILOG + _LENGTH_EPILOG
    purpose = "Hausdorff distance of two shapes, with certified bounds"
    distance = _added(commands, "hausdorff", purpose, epilog, ("distance",))
    _add_shapes(distance)
    directed = "directed distance, the largest distance from a point of A to B (default: larger of both directions)"
    distance.add_argument("--directed", action="store_true", help=directed)
    distance.add_argument("--method", metavar="NAME", help=_METHOD_HELP.format("BranchAndBound"))
    _add_tolerances(distance)
    _add_max_seconds(distance)
    distance.add_argument("--threshold", type=lengths.length, metavar="LENGTH", help=_THRESHOLD_HELP)
    shown = "both shapes, the witness and, for curves, the distance profiles"
    distance.add_argument("--plot", metavar="FILE", help=_PLOT_HELP.format(shown))
    distance.add_argument("--html", metavar="FILE", help=_PAGE_HELP)
    distance.add_argument("--certificate", metavar="FILE", help=_CERTIFICATE_HELP)
    _add_out(distance, "result", ".json")

    minimum = _added(commands, "minimum", "minimum distance of two shapes, with certified bounds", epilog)
    _add_shapes(minimum)
    _add_tolerances(minimum)
    _add_max_seconds(minimum)
    minimum.add_argument("--threshold", type=lengths.length, metavar="LENGTH", help=_THRESHOLD_HELP)
    minimum.add_argument("--plot", metavar="FILE", help=_PLOT_HELP.format("both shapes and their nearest points"))
    minimum.add_argument("--certificate", metavar="FILE", help=_CERTIFICATE_HELP)
    _add_out(minimum, "result", ".json")


def _add_others(commands: Any) -> None:
    """Nearest points, fields, and the compiled functions on disk."""
    project = _added(commands, "project", "nearest points of a shape to given points", _SHAPES_EPILOG)
    project.add_argument("shape", metavar="SHAPE", type=_as_given, help="shape, see below")
    point = "coordinates of one point: X Y or X Y Z"
    project.add_argument("coordinates", metavar="X", nargs="*", type=float, help=point)
    project.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)
    rows = "point file (.xyz, .csv, .txt or .npy) instead of X; - or neither means rows on standard input"
    project.add_argument("--points", metavar="FILE", help=rows)
    project.add_argument("--method", metavar="NAME", help=_METHOD_HELP.format("chosen by the kind of shape"))
    _add_max_seconds(project, "time in seconds after which the finished points are printed (default: none)")
    _add_out(project, "result", ".csv or .json")

    field = _added(commands, "field", "distance field of a surface on an octree", _SHAPES_EPILOG + _LENGTH_EPILOG)
    surface = "mesh, parametric surface or implicit surface: a SHAPE, see below"
    field.add_argument("shape", metavar="SURFACE", type=_as_given, help=surface)
    field.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)
    tolerance = "tolerance of the interpolation"
    field.add_argument("--tolerance", type=lengths.length, required=True, metavar="LENGTH", help=tolerance)
    _add_max_seconds(field, "time in seconds after which the command fails and writes no field (default: none)")
    _add_out(field, "field", ".npz", required=True)
    refined = "region that is refined: near the surface, or everywhere (default: band)"
    field.add_argument("--mode", choices=_MODES, default="band", help=refined)
    sign = "rule that tells inside from outside (default: winding)"
    field.add_argument("--sign", choices=_SIGNS, default="winding", help=sign)
    surface = "file for the zero set of the field, with --resolution: .obj, .off, .ply or .stl"
    field.add_argument("--surface", metavar="FILE", help=surface)
    resolution = "number of cells of the zero set along the longest side, 2 to 4096"
    field.add_argument("--resolution", type=int, metavar="N", help=resolution)

    precompile = _added(
        commands, "precompile", "compile functions for some kinds of shapes in advance, and keep them on disk"
    )
    precompile.add_argument(
        "kinds", metavar="KIND", nargs="*", help=f"kinds of shapes: {', '.join(_KINDS)} (default: all)"
    )
    degree = "degree of curves (default: 3), and of implicit surfaces in each variable (default: 2)"
    precompile.add_argument("--degree", type=int, metavar="N", help=degree)

    _added(commands, "doctor", "versions, devices, cache, and a self-check with a known distance")


def _add_shapes(parser: Any, first: str = "first shape", second: str = "second shape") -> None:
    parser.add_argument("a", metavar="A", type=_as_given, help=f"{first}: a SHAPE, see below")
    parser.add_argument("b", metavar="B", type=_as_given, help=f"{second}: a SHAPE, see below")
    parser.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)


def _add_deviation(commands: Any) -> None:
    purpose = "distribution of the distance to B over A: maximum, mean, RMS, quantiles"
    parser = _added(commands, "deviation", purpose, _SHAPES_EPILOG + _LENGTH_EPILOG)
    _add_shapes(
        parser, "shape over which distances are taken, not an implicit surface", "shape to which distances are taken"
    )
    atol = "largest upper - lower of maximum, mean and RMS (default: 1e-6 of the diagonal)"
    _add_tolerances(parser, atol, 1e-3)
    _add_max_seconds(parser)
    within = "distance within which the fraction of A is printed"
    parser.add_argument("--threshold", type=lengths.length, metavar="LENGTH", help=within)
    quantile = "quantile to print, which must reach the tolerance too, for example 0.95 or 95%%"
    parser.add_argument("--quantile", type=lengths.fraction, metavar="FRACTION", help=quantile)
    shown = "A colored by its distance to B, with a histogram"
    parser.add_argument("--plot", metavar="FILE", help=_PLOT_HELP.format(shown))
    parser.add_argument("--html", metavar="FILE", help=_PAGE_HELP)
    _add_out(parser, "result", ".json")


def _add_tolerances(parser: Any, atol: str = _ATOL_HELP, rtol: float | None = None) -> None:
    parser.add_argument("--atol", type=lengths.length, metavar="LENGTH", help=atol)
    help_ = _RTOL_HELP.format("0" if rtol is None else f"{rtol:g}")
    parser.add_argument("--rtol", type=lengths.fraction, default=rtol, metavar="FRACTION", help=help_)


def _add_max_seconds(parser: Any, limit: str = _SECONDS_HELP) -> None:
    parser.add_argument("--max-seconds", type=lengths.seconds, metavar="S", help=limit)


def _add_out(parser: Any, content: str, suffixes: str, required: bool = False) -> None:
    help_ = _OUT_HELP.format(content, suffixes)
    parser.add_argument("-o", "--out", required=required, metavar="FILE", help=help_)


def _add_search(parser: Any, method: str = "method (default: BranchAndBound, the only one for this command)") -> None:
    """Options that all commands on collections have."""
    parser.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)
    parser.add_argument("--method", metavar="NAME", help=method)
    _add_tolerances(parser)
    _add_max_seconds(parser, "time in seconds after which no further search begins (default: none)")
    parser.add_argument("--jobs", type=int, metavar="N", help="number of threads (default: one for each processor)")
    _add_out(parser, "results", ".csv or .json")


def _add_collections(commands: Any) -> None:
    epilog = _MANY_EPILOG + _LENGTH_EPILOG
    pairwise = _added(commands, "pairwise", "two-sided Hausdorff distances of all pairs of many shapes", epilog)
    pairwise.add_argument("shapes", metavar="SHAPE", nargs="+", type=_as_given, help="shapes, see below")
    store = "folder for finished distances; a later call continues from it (default: none)"
    pairwise.add_argument("--store", metavar="FOLDER", help=store)

    nearest = _added(
        commands, "nearest", "nearest of many shapes by the two-sided Hausdorff distance, certified", epilog
    )
    nearest.add_argument("query", metavar="QUERY", type=_as_given, help="query shape or shapes, see below")
    nearest.add_argument(
        "shapes", metavar="SHAPE", nargs="+", type=_as_given, help="shapes among which to search, see below"
    )
    count = "number of nearest shapes for each query (default: 1)"
    nearest.add_argument("-k", "--count", type=int, default=1, metavar="N", help=count)
    shown = "the first queries with their nearest shapes"
    nearest.add_argument("--plot", metavar="FILE", help=_PLOT_HELP.format(shown))
    nearest.add_argument("--html", metavar="FILE", help="file for an HTML page with the same picture")

    duplicates = _added(commands, "duplicates", "pairs of many shapes within a two-sided Hausdorff distance", epilog)
    duplicates.add_argument("shapes", metavar="SHAPE", nargs="+", type=_as_given, help="shapes, see below")
    threshold = "largest Hausdorff distance of a pair"
    duplicates.add_argument("--threshold", type=lengths.length, required=True, metavar="LENGTH", help=threshold)
    _add_search(pairwise, _METHOD_HELP.format("BranchAndBound"))
    for command in (nearest, duplicates):
        _add_search(command)


if __name__ == "__main__":
    sys.exit(main())
