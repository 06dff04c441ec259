"""The command line: `jhd` or `python -m jhd`; without a command it is the demonstration.

Exit status: 0 done and what was asked for holds; 1 the bounds are true but wider than asked for (or the self-check of
`jhd doctor` fails, or `jhd verify` refuses a certificate); 2 bad input, with one line on stderr; 70 anything that was
not foreseen (JHD_TRACEBACK=1 shows where); 130 interrupted, with the bounds reached in place of the result where there
are any; 141 the reader of the output went away. With --threshold: 0 proven yes, 3 proven no, 1 undecided.
"""

import argparse
import errno
import os
import sys
from typing import Any, NoReturn

# Light alone: this module answers --help while the package is not imported yet.
import jhd
from jhd._cli import lengths
from jhd._runtime.starting import INTERRUPTED

# Those of jhd._cli.warming and jhd.fields, written out, as their import takes seconds.
_KINDS = "plane", "space", "rational", "surfaces", "meshes"
_MODES, _SIGNS = ("band", "full"), ("winding", "pseudonormal", "none")
_FULL = errno.ENOSPC, errno.EFBIG, errno.EDQUOT
_CURVE_HELP = "a curve: a JSON or SVG file, or font:NAME:LETTER"
_SHAPE_HELP = (
    f"{_CURVE_HELP}; or a parametric surface: a JSON file; or a mesh: an OBJ, OFF, PLY or STL file; or points: an XYZ, "
    "NPY or PLY file"
)
_OR_POLYNOMIAL = "; with --box a polynomial in x, y, z"
_MANY_HELP = "a shape; or a folder or a pattern of files (scans/*.ply), or all letters of a font: font:NAME:*"
_BOX_HELP = "polynomials: the box they are cut off at, its two ends for all axes, or three lower and three upper ones"
_ATOL_HELP = "tolerance on upper - lower, in input units or as a share of the diagonal"
_THRESHOLD_HELP = "answer only whether the distance is at most this: exit status 0 yes, 3 no, 1 undecided"
_METHOD_HELP = "the method, a class of jhd; an unknown name lists those there are"
_PAGE_HELP = "write one page for a browser: to walk along plane curves, or turn shapes in space (extra jhd[web])"
_EPILOG = """\
examples:
  jhd                                                 the demonstration; writes jhd-demo.png here
  jhd distance a.svg b.json --plot distance.png
  jhd distance a.svg b.json --certificate proof.json
  jhd distance "x**2/4 + y**2/4 - z**2/9" "x**2/16 + y**2/4 - z**2/9" --box -2 2
  jhd verify proof.json
  jhd fit "font:DejaVu Serif:s" --tolerance 5 --out s.svg
  jhd distance "font:DejaVu Sans:a" "font:DejaVu Serif:a" --json
  jhd distance a.ply b.obj
  jhd distance scan.ply model.obj --directed --threshold 0.5%
  jhd minimum bunny.ply "x**2 + y**2 + z**2 - 1" --box -2 2
  jhd deviation scan.ply model.obj --within 0.1 --plot deviation.png
  jhd project a.svg 10 -2.5
  jhd nearest "font:DejaVu Serif:a" "font:DejaVu Sans:*" --count 3 --plot nearest.png
  jhd duplicates icons/ --within 0.5
  jhd pairwise "scans/*.ply" --store distances
  jhd field bunny.ply --atol 0.001 --out bunny.npz
  jhd warm plane rational --degree 3
  jhd doctor

exit status: 0 done, 1 bounds not closed or certificate refused, 2 bad input, 130 interrupted, with the bounds reached;
with --threshold 0 yes, 3 no, 1 undecided
LENGTH is a number in input units, or a share of the diagonal of the box of the shapes, as 0.1%
JHD_CACHE=FOLDER is where compiled programs are kept, JHD_CACHE=0 keeps none; JAX_ENABLE_X64=0 means float32.
"""


def main(argv: list[str] | None = None) -> int:
    """Runs one command and returns the exit status.

    Args:
        argv: the arguments without the name of the program; those of the process by default.
    """
    try:
        status = _run(sys.argv[1:] if argv is None else argv)
        sys.stdout.flush()  # here, so that a reader who went away is noticed while it can be answered
        return status
    except KeyboardInterrupt:
        print("jhd: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # What is left in the buffer has nowhere to go; Python would complain about it at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        # Files are always named, so a full disk without a name is that of what is printed.
        name = "standard output" if error.filename is None and error.errno in _FULL else error.filename
        return _bad_input(str(error) if error.strerror is None or name is None else f"{name}: {error.strerror}.")
    except (ValueError, TypeError, ImportError, MemoryError) as error:
        return _bad_input(str(error))
    except Exception as error:
        if os.environ.get("JHD_TRACEBACK"):
            raise
        # Nothing of this is foreseen: neither the input nor the bounds are said to be wrong.
        kind, hint = type(error).__name__, "JHD_TRACEBACK=1 in the environment shows where"
        print("jhd: failed:", *f"{kind}: {error}".split(), f"({hint})", file=sys.stderr)
        return 70


def _run(argv: list[str]) -> int:
    try:
        options, unknown = _parser().parse_known_args([_option_or_word(word) for word in _box_as_one(argv)])
    except SystemExit:  # argparse's way out of --help and --version; of errors it is ours
        return 0
    if unknown:
        command = "jhd" if options.command == "demo" else f"jhd {options.command}"
        names = " ".join(_as_given(word) for word in unknown)
        raise ValueError(f"{command} does not know: {names} (see {command} --help)")
    from jhd.console import interrupts_heard

    with interrupts_heard():
        from jhd._cli import commands

        _switch_cache_on()
        return getattr(commands, options.command)(options)


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
    """The numbers of a text, apart by spaces; the name is in what argparse says of others."""
    if not all(_is_number(word) for word in text.split()):
        raise argparse.ArgumentTypeError(f"needs numbers, as in --box -2 2; got {text.strip()!r}")
    return [float(word) for word in text.split()]


def _option_or_word(word: str) -> str:
    """The word, with a space before a minus that begins no option: argparse takes -1e-3 and -x**2 for one otherwise."""
    return f" {word}" if word.startswith("-") and not word.startswith("--") and word not in ("-", "-h") else word


def _as_given(word: str) -> str:
    return word[1:] if word.startswith(" -") else word


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are ours: one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    """The parser; options.command names the function in jhd._cli.commands."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser("jhd", description=jhd.__doc__, epilog=_EPILOG, formatter_class=raw)
    parser.add_argument("--version", action="version", version=f"jhd {jhd.__version__}")
    parser.set_defaults(command="demo")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")

    _add_distances(commands)
    _add_deviation(commands)
    _add_collections(commands)

    fit = commands.add_parser("fit", help="fewer or lower-degree segments within a proven distance")
    fit.add_argument("target", metavar="TARGET", help=_CURVE_HELP)
    fit.add_argument("--tolerance", type=lengths.length, required=True, metavar="LENGTH", help="how far it may be")
    fit.add_argument("--degree", type=int, default=3, metavar="N", help="of the segments (default: 3)")
    fit.add_argument("--smooth", action="store_true", help="one tangent at the joints inside a contour")
    fit.add_argument("--out", metavar="FILE", help="write the fit: .svg, .json or .igs")
    fit.add_argument("--plot", metavar="FILE", help="draw both curves, the witness and the distance profiles")
    fit.add_argument("--html", metavar="FILE", help=_PAGE_HELP)
    fit.set_defaults(command="fit")

    verify = commands.add_parser("verify", help="check a certificate in exact arithmetic")
    verify.add_argument("file", metavar="FILE", help="what jhd distance --certificate wrote")
    verify.add_argument("shapes", nargs="*", metavar="A B", type=_as_given, help="the shapes that it has to be about")
    verify.add_argument("--seconds", type=float, metavar="S", help="give up after so long (default: never)")
    verify.set_defaults(command="verify")

    _add_others(commands)
    for command in commands.choices.values():
        command.add_argument("--json", action="store_true", help="print JSON and nothing else")
    return parser


def _add_distances(commands: Any) -> None:
    """The largest and the smallest distance of two shapes."""
    distance = commands.add_parser("distance", help="the Hausdorff distance of two shapes of any kinds")
    _add_shapes(distance)
    distance.add_argument("--directed", action="store_true", help="only the largest distance of points of A to B")
    distance.add_argument("--method", metavar="NAME", help=_METHOD_HELP)
    distance.add_argument("--atol", type=lengths.length, metavar="LENGTH", help=_ATOL_HELP)
    distance.add_argument("--threshold", type=lengths.length, metavar="LENGTH", help=_THRESHOLD_HELP)
    distance.add_argument("--plot", metavar="FILE", help="draw both, the witness and, of curves, the distance profiles")
    distance.add_argument("--html", metavar="FILE", help=_PAGE_HELP)
    distance.add_argument("--certificate", metavar="FILE", help="write what proves the bounds, for jhd verify")
    distance.set_defaults(command="distance")

    minimum = commands.add_parser("minimum", help="the smallest distance of two shapes of any kinds")
    _add_shapes(minimum)
    minimum.add_argument("--atol", type=lengths.length, metavar="LENGTH", help=_ATOL_HELP)
    minimum.add_argument("--threshold", type=lengths.length, metavar="LENGTH", help=_THRESHOLD_HELP)
    minimum.add_argument("--plot", metavar="FILE", help="draw both and the nearest points")
    minimum.add_argument("--certificate", metavar="FILE", help="write what proves the bounds, for jhd verify")
    minimum.set_defaults(command="minimum")


def _add_others(commands: Any) -> None:
    """Nearest points, fields, and what is kept on disk."""
    project = commands.add_parser("project", help="the nearest point of a shape of any kind to points")
    project.add_argument("shape", metavar="SHAPE", type=_as_given, help=_SHAPE_HELP + _OR_POLYNOMIAL)
    project.add_argument("coordinates", metavar="X", nargs="*", type=float, help="the point: X Y or X Y Z")
    project.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)
    project.add_argument("--points", metavar="FILE", help="points in rows instead; without X or with -, standard input")
    project.add_argument("--method", metavar="NAME", help=_METHOD_HELP)
    project.set_defaults(command="project")

    field = commands.add_parser("field", help="the distance field of a mesh on an octree")
    field.add_argument("mesh", metavar="MESH", help="an OBJ, OFF, PLY or STL file")
    field.add_argument("--atol", type=lengths.length, required=True, metavar="LENGTH", help="tolerance")
    field.add_argument("--out", required=True, metavar="FILE", help="where to: a name in .npz")
    field.add_argument("--mode", choices=_MODES, default="band", help="refine at the surface (default) or everywhere")
    field.add_argument("--sign", choices=_SIGNS, default="winding", help="how inside is told from outside")
    field.add_argument("--surface", metavar="FILE", help="write the zero set of the field: .obj, .off, .ply or .stl")
    field.add_argument("--resolution", type=int, metavar="N", help="cells along the longest side for that surface")
    field.set_defaults(command="field")

    warm = commands.add_parser("warm", help="compile the programs of some kinds of shapes and keep them")
    warm.add_argument("kinds", metavar="KIND", nargs="*", help=f"{', '.join(_KINDS)} (default: all of them)")
    warm.add_argument("--degree", type=int, metavar="N", help="of curves (default: 3) and polynomial surfaces (2)")
    warm.set_defaults(command="warm")

    doctor = commands.add_parser("doctor", help="versions, devices, what is kept, and a check with a known answer")
    doctor.set_defaults(command="doctor")


def _add_shapes(parser: Any, other: str = "the other one") -> None:
    parser.add_argument("a", metavar="A", type=_as_given, help=_SHAPE_HELP + _OR_POLYNOMIAL)
    parser.add_argument("b", metavar="B", type=_as_given, help=other)
    parser.add_argument("--box", type=_numbers, metavar="X ...", help=_BOX_HELP)


def _add_deviation(commands: Any) -> None:
    parser = commands.add_parser("deviation", help="the distance along a shape: mean, rms, quantiles, maximum")
    _add_shapes(parser, "the one that distances are taken to")
    parser.add_argument("--atol", type=lengths.length, metavar="LENGTH", help="gap of the bounds that may stay")
    parser.add_argument("--rtol", type=float, default=1e-3, metavar="SHARE", help="the same as a share (default: 1e-3)")
    parser.add_argument("--within", type=lengths.length, metavar="LENGTH", help="also the share of A that is this near")
    parser.add_argument("--plot", metavar="FILE", help="draw A in the colours of its distance, with a histogram")
    parser.add_argument("--html", metavar="FILE", help=_PAGE_HELP)
    parser.set_defaults(command="deviation")


def _add_collections(commands: Any) -> None:
    pairwise = commands.add_parser("pairwise", help="the Hausdorff distances of all pairs of many shapes")
    pairwise.add_argument("shapes", metavar="SHAPE", nargs="+", help=_MANY_HELP)
    pairwise.add_argument("--store", metavar="FOLDER", help="keep what is done there; another call goes on with it")
    pairwise.set_defaults(command="pairwise")

    nearest = commands.add_parser("nearest", help="the nearest of many shapes, proven")
    nearest.add_argument("query", metavar="QUERY", help="the shape, or shapes, whose neighbours are wanted, likewise")
    nearest.add_argument("shapes", metavar="SHAPE", nargs="+", help=_MANY_HELP)
    nearest.add_argument("--count", dest="k", type=int, default=1, metavar="N", help="how many (default: 1)")
    nearest.add_argument("--plot", metavar="FILE", help="draw the first queries with their nearest shapes")
    nearest.add_argument("--html", metavar="FILE", help="the same as a page for a browser")
    nearest.set_defaults(command="nearest")

    duplicates = commands.add_parser("duplicates", help="the pairs of many shapes that are within a distance")
    duplicates.add_argument("shapes", metavar="SHAPE", nargs="+", help=_MANY_HELP)
    duplicates.add_argument("--within", type=float, required=True, metavar="X", help="the distance, in input units")
    duplicates.set_defaults(command="duplicates")


def _switch_cache_on() -> None:
    """Lets JAX keep what it compiles around jhd's own programs too, beside them, unless it has a folder already."""
    import jax

    from jhd._runtime.storage import chosen_folder, made

    folder = chosen_folder()
    if folder is None or jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        return
    if not made(folder / "jax"):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


if __name__ == "__main__":
    sys.exit(main())
