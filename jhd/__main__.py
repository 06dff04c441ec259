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
_SHORT = {"--help": "-h", "--count": "-k", "--out": "-o"}
_FULL = errno.ENOSPC, errno.EFBIG, errno.EDQUOT
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
    option = word == "-" or word.startswith(("--", *_SHORT.values()))  # a single minus means standard input
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

    def take(self, words: str, **changes: str | dict[str, Any]) -> None:
        """Take these arguments and --json, in the order of the help; a change is another help, or other keywords."""
        types: dict[str, Any] = {"LENGTH": lengths.length, "FRACTION": lengths.fraction, "S": lengths.seconds}
        types |= {"N": int, "X": float, "X ...": _numbers}
        for word in (*words.split(), "--json"):
            kind, text, *others = _ARGUMENTS[word]
            if isinstance(kind, tuple):
                typed: dict[str, Any] = {"choices": kind, "default": kind[0]}
            else:
                typed = {"metavar": kind, "type": types.get(kind, _as_given)} if kind else {"action": "store_true"}
            change = changes.get(word.lstrip("-").replace("-", "_"), {})
            other: dict[str, Any] = {"help": change} if isinstance(change, str) else change
            keywords = {**typed, "help": text, **dict(*others), **other}
            self.add_argument(*filter(None, (_SHORT.get(word), word)), **keywords)


# The arguments: placeholder or choices (the first is the default; None for a switch), help, and keywords of argparse.
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "a": ("A", "first shape: a SHAPE, see below"),
    "b": ("B", "second shape: a SHAPE, see below"),
    "shape": ("SHAPE", "shape, see below"),
    "shapes": ("SHAPE", "shapes, see below", {"nargs": "+"}),
    "query": ("QUERY", "query shape or shapes, see below"),
    "target": (
        "TARGET",
        "curve: a .json, .svg, .igs, .iges, .geojson or .wkt file, font:NAME:LETTER, or SVG path data",
    ),
    "file": ("FILE", "certificate, written by jhd hausdorff or jhd minimum"),
    "coordinates": ("X", "coordinates of one point: X Y or X Y Z", {"nargs": "*"}),
    "kinds": ("KIND", f"kinds of shapes: {', '.join(_KINDS)} (default: all)", {"nargs": "*"}),
    "--box": (
        "X ...",
        "box of an implicit surface: LOWER UPPER for all axes, or three lower and then three upper ends",
    ),
    "--points": (
        "FILE",
        "point file (.xyz, .csv, .txt or .npy) instead of X; - or neither means rows on standard input",
    ),
    "--directed": (
        None,
        "directed distance, the largest distance from a point of A to B (default: larger of both directions)",
    ),
    "--method": (
        "NAME",
        "method, a class of jhd or jhd.published (default: BranchAndBound); an unknown name lists all",
    ),
    "--atol": ("LENGTH", "largest upper - lower (default: 1e-10 of the diagonal)"),
    "--rtol": ("FRACTION", "largest upper - lower, relative to upper; the larger tolerance counts (default: 0)"),
    "--max-seconds": ("S", "time in seconds after which the search ends with the bounds reached (default: none)"),
    "--threshold": (
        "LENGTH",
        "question: is the distance at most LENGTH? The exit status is the answer: 0 yes, 3 no, 1 undecided",
    ),
    "--quantile": ("FRACTION", "quantile to print, which must reach the tolerance too, for example 0.95 or 95%%"),
    "--tolerance": ("LENGTH", "largest certified Hausdorff distance", {"required": True}),
    "--degree": ("N", "degree of curves (default: 3), and of implicit surfaces in each variable (default: 2)"),
    "--smooth": (None, "continuous tangents at the joints (default: corners allowed)"),
    "--mode": (_MODES, "region that is refined: near the surface, or everywhere (default: band)"),
    "--sign": (_SIGNS, "rule that tells inside from outside (default: winding)"),
    "--count": ("N", "number of nearest shapes for each query (default: 1)", {"default": 1}),
    "--store": ("FOLDER", "folder for finished distances; a later call continues from it (default: none)"),
    "--jobs": ("N", "number of threads (default: one for each processor)"),
    "--plot": ("FILE", "file for a picture of {}; the suffix selects the format (.png, .svg, .pdf, ...)"),
    "--html": (
        "FILE",
        "file for an HTML page: walk along plane curves, or rotate shapes in space (with the extra jhd[web])",
    ),
    "--certificate": ("FILE", "file for a certificate of the bounds, which jhd verify checks"),
    "--surface": ("FILE", "file for the zero set of the field, with --resolution: .obj, .off, .ply or .stl"),
    "--resolution": ("N", "number of cells of the zero set along the longest side, 2 to 4096"),
    "--out": ("FILE", "file for the result: .json"),
    "--json": (None, "output as JSON only"),
}


def _parser() -> argparse.ArgumentParser:
    """The parser; options.command names the function in jhd._cli.commands."""
    raw = argparse.RawDescriptionHelpFormatter
    summary = (jhd.__doc__ or "").partition("\n")[0]
    parser = _Parser("jhd", description=summary, epilog=_EPILOG, formatter_class=raw)
    parser.add_argument("--version", action="version", version=f"jhd {jhd.__version__}")
    picture = "file for the picture of the demonstration (default: jhd-demo.png)"
    parser.add_argument("-o", "--out", dest="demo", metavar="FILE", help=picture)
    parser.set_defaults(command="demo", html=None)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    two, many = _SHAPES_EPILOG + _LENGTH_EPILOG, _MANY_EPILOG + _LENGTH_EPILOG
    shown, after = _ARGUMENTS["--plot"][1].format, "time in seconds after which {} (default: none)".format
    of_many = {"max_seconds": after("no further search begins"), "out": "file for the results: .csv or .json"}
    only = "method (default: BranchAndBound, the only one for this command)"

    _added(commands, "hausdorff distance", "Hausdorff distance of two shapes, with certified bounds", two).take(
        "a b --box --directed --method --atol --rtol --max-seconds --threshold --plot --html --certificate --out",
        plot=shown("both shapes, the witness and, for curves, the distance profiles"),
    )
    _added(commands, "minimum", "minimum distance of two shapes, with certified bounds", two).take(
        "a b --box --atol --rtol --max-seconds --threshold --plot --certificate --out",
        plot=shown("both shapes and their nearest points"),
    )
    purpose = "distribution of the distance to B over A: maximum, mean, RMS, quantiles"
    _added(commands, "deviation", purpose, two).take(
        "a b --box --atol --rtol --max-seconds --threshold --quantile --plot --html --out",
        a="shape over which distances are taken, not an implicit surface: a SHAPE, see below",
        b="shape to which distances are taken: a SHAPE, see below",
        atol="largest upper - lower of maximum, mean and RMS (default: 1e-6 of the diagonal)",
        rtol={"default": 1e-3, "help": _ARGUMENTS["--rtol"][1].replace("0)", "0.001)")},
        threshold="distance within which the fraction of A is printed",
        plot=shown("A colored by its distance to B, with a histogram"),
    )
    _added(commands, "pairwise", "two-sided Hausdorff distances of all pairs of many shapes", many).take(
        "shapes --store --box --method --atol --rtol --max-seconds --jobs --out", **of_many
    )
    purpose = "nearest of many shapes by the two-sided Hausdorff distance, certified"
    _added(commands, "nearest", purpose, many).take(
        "query shapes --count --plot --html --box --method --atol --rtol --max-seconds --jobs --out",
        shapes="shapes among which to search, see below",
        plot=shown("the first queries with their nearest shapes"),
        html="file for an HTML page with the same picture",
        method=only,
        **of_many,
    )
    _added(commands, "duplicates", "pairs of many shapes within a two-sided Hausdorff distance", many).take(
        "shapes --threshold --box --method --atol --rtol --max-seconds --jobs --out",
        threshold={"required": True, "help": "largest Hausdorff distance of a pair"},
        method=only,
        **of_many,
    )
    purpose = "fit of a curve by few segments, within a tolerance"
    _added(commands, "fit", purpose, _LENGTH_EPILOG.lstrip()).take(
        "target --tolerance --degree --smooth --max-seconds --out --plot --html",
        degree={"default": 3, "help": "degree of the segments (default: 3)"},
        max_seconds=after("the best fit so far is returned"),
        out="file for the fitted curve: .svg or .json",
        plot=shown("both curves, the witness and the distance profiles"),
    )
    both = "both shapes, each a SHAPE, to compare with the shapes of the certificate (default: none)"
    _added(commands, "verify", "check of a certificate in exact arithmetic", _SHAPES_EPILOG).take(
        "file shapes --box --max-seconds",
        shapes={"metavar": "A B", "nargs": "*", "help": both},
        max_seconds="time limit in seconds (default: none)",
    )
    _added(commands, "project", "nearest points of a shape to given points", _SHAPES_EPILOG).take(
        "shape coordinates --box --points --method --max-seconds --out",
        method=_ARGUMENTS["--method"][1].replace("BranchAndBound", "chosen by the kind of shape"),
        max_seconds=after("the finished points are printed"),
        out="file for the result: .csv or .json",
    )
    surface = "mesh, parametric surface or implicit surface: a SHAPE, see below"
    _added(commands, "field", "distance field of a surface on an octree", two).take(
        "shape --box --tolerance --max-seconds --out --mode --sign --surface --resolution",
        shape={"metavar": "SURFACE", "help": surface},
        tolerance="tolerance of the interpolation",
        max_seconds=after("the command fails and writes no field"),
        out={"required": True, "help": "file for the field: .npz"},
    )
    purpose = "compile functions for some kinds of shapes in advance, and keep them on disk"
    _added(commands, "precompile", purpose).take("kinds --degree")
    _added(commands, "doctor", "versions, devices, cache, and a self-check with a known distance").take("")
    return parser


def _added(commands: Any, names: str, purpose: str, epilog: str = "") -> _Parser:
    """A command with its aliases, whose purpose stands in the list of commands and in its own help."""
    name, *aliases = names.split()
    statuses = _STATUSES.get(name, "0 done; 1 bounds not closed; 2 invalid input.")
    described = {"help": purpose, "description": f"{purpose[0].upper()}{purpose[1:]}."}
    described["epilog"] = f"{epilog}\nExit status: {statuses}" if epilog else f"Exit status: {statuses}"
    raw = argparse.RawDescriptionHelpFormatter
    parser = commands.add_parser(name, aliases=aliases, formatter_class=raw, **described)
    parser.set_defaults(command=name)
    return parser


if __name__ == "__main__":
    sys.exit(main())
