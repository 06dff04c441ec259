"""The commands of the command line: each takes the parsed options, prints, and returns the exit status.

Commands that measure shapes are in jhd._cli.comparisons, and are imported here by name.
"""

import json
import os
import platform
import sys
import time
from argparse import Namespace
from importlib.metadata import PackageNotFoundError, version

import jax

import jhd
from jhd._cli.collected import duplicates as duplicates
from jhd._cli.collected import nearest as nearest
from jhd._cli.collected import pairwise as pairwise
from jhd._cli.comparisons import check_drawn, directions_of, write_page
from jhd._cli.comparisons import deviation as deviation
from jhd._cli.comparisons import hausdorff as hausdorff
from jhd._cli.comparisons import minimum as minimum
from jhd._cli.comparisons import project as project
from jhd._cli.console import busy, device, exit_status, json_text, paced, precision, timed
from jhd._cli.options import box_of, check_picture, check_writable, curve_of, kind_of, read_shapes, shape_of
from jhd._cli.output import print_files
from jhd._cli.report import picture, shape_line, solution_text
from jhd._cli.warming import KINDS, preparations
from jhd._distance.certificate.verification import UncheckedCertificateError, sentence
from jhd._io.certificates import verify_file
from jhd._io.meshes import MESH_SUFFIXES
from jhd._results.solution import HausdorffSolution, name_of
from jhd._runtime import storage
from jhd._runtime.decimals import upper_text
from jhd._runtime.programs import refused
from jhd.io import save_curve, save_mesh
from jhd.progress import Progress

_PACKAGES = "jax", "jaxlib", "equinox", "optimistix", "numpy", "matplotlib"


def demo(options: Namespace) -> int:
    """Both directed distances between one letter in two fonts, as text and as a picture."""
    file, fonts = options.demo or "jhd-demo.png", {"Sans": "DejaVu Sans", "Serif": "DejaVu Serif"}
    check_picture(file)
    specs = [f"font:{font}:a" for font in fonts.values()]
    a, b = (curve_of(name, spec) for name, spec in zip("AB", specs, strict=True))
    print("The letter a in two fonts, in font units\n")
    print(shape_line("A", specs[0], a), shape_line("B", specs[1], b), sep="\n", end="\n\n")

    def both() -> list[HausdorffSolution]:
        return [jhd.directed_hausdorff(a, b, throw=False), jhd.directed_hausdorff(b, a, throw=False)]

    with busy("computing; the first run compiles"):
        (there, back), first = timed(both)
        _, again = timed(both)
    print(solution_text("directed distance from A to B", there, {"A": a, "B": b}), end="\n\n")
    print(solution_text("directed distance from B to A", back, {"B": b, "A": a}), end="\n\n")
    larger, name = max((there, "from A to B"), (back, "from B to A"), key=lambda pair: float(pair[0]))
    print(f"Hausdorff distance, the larger of the two: {float(larger)!r} {name}")
    print(f"time       {first:.2f} s with compilation, {again:.3f} s once compiled (both directions)")
    print(f"device     {device()}, {precision()}")
    with busy("drawing"):
        picture(file, a, b, (there, back), list(fonts), "font units")
    print_files(picture=file)
    return exit_status(there, back)


def fit(options: Namespace) -> int:
    """Fit of an outline by few segments within a tolerance, with its certified distance."""
    target = curve_of("TARGET", options.target)
    check_writable(options.out, ".svg", ".json")
    check_writable(options.plot)
    check_drawn(options, target.dim)
    tolerance = options.tolerance.of(target)
    start = time.perf_counter()
    with busy("fitting; a first run compiles") as show:
        limits = {"degree": options.degree, "smooth": options.smooth, "max_seconds": options.max_seconds}
        contours = jhd.fit_outline(target, tolerance, **limits, progress=show)
        shape = jhd.BezierSegments.join([contour.shape for contour in contours])
        error = jhd.hausdorff(target, shape, throw=False, progress=show)
    seconds = time.perf_counter() - start
    near = float(error.upper) <= tolerance
    status = 0 if near else max(1, exit_status(error))
    if options.out:
        save_curve(options.out, shape)
    if options.plot:
        with busy("drawing"):
            picture(options.plot, target, shape, directions_of(error))
    if options.html:
        write_page(options.html, target, shape, error)
    if options.json:
        asked = {"target": options.target, "tolerance": tolerance, **limits}
        facts = {"within": near, "segments": [contour.shape.count for contour in contours]}
        facts["results"] = [name_of(contour.result) for contour in contours]
        print(json_text(error, **asked, **facts, seconds=seconds))
        return status
    print(shape_line("A", options.target, target), shape_line("B", "fit", shape), sep="\n", end="\n\n")
    print(solution_text("Hausdorff distance", error, {"A": target, "B": shape}), end="\n\n")
    print(f"within     {tolerance!r}" if near else f"not certified to be within {tolerance!r}")
    print(f"time       {seconds:.2f} s with compilation")
    print_files(fit=options.out, picture=options.plot, page=options.html)
    return status


def verify(options: Namespace) -> int:
    """Check a certificate in exact arithmetic, optionally for given shapes, and print the proven bounds."""
    if len(options.shapes) not in (0, 2):
        raise ValueError(f"shapes after the certificate: {len(options.shapes)}; needs both shapes, or none.")
    shapes = read_shapes(dict(zip("AB", options.shapes, strict=False)), options.box)
    start = time.perf_counter()
    try:
        with busy("checking") as show:
            proven = verify_file(options.file, options.max_seconds, shapes, paced(show))
    except UncheckedCertificateError as error:
        print(f"jhd: not checked: {options.file}: {error}", file=sys.stderr)
        return 1
    except jhd.CertificateError as error:
        print(f"jhd: refused: {options.file}: {error}", file=sys.stderr)
        return 4
    seconds = time.perf_counter() - start
    if options.json:
        print(json.dumps({"file": options.file, "proven": proven._asdict(), "seconds": seconds}, indent=2))
        return 0
    print(f"proven: {sentence(proven)}, checked exactly in {seconds:.3f} s")
    return 0


def field(options: Namespace) -> int:
    """The adaptive distance field of a surface, stored; on request its zero set as a mesh."""
    shape = shape_of(options)
    if shape.dim != 3 or kind_of(shape) in ("curve", "set of points"):
        raise TypeError(f"SURFACE is a {kind_of(shape)}; needs a mesh or a surface.")
    if (options.surface is None) != (options.resolution is None):
        raise ValueError("--surface and --resolution go together; give both or none.")
    check_writable(options.out, ".npz")
    check_writable(options.surface, *MESH_SUFFIXES)
    tolerance = options.tolerance.of(shape)
    build = jhd.AdaptiveDistanceField.build
    with busy("building; a first run compiles") as show:
        asked = {"mode": options.mode, "sign": options.sign}
        made, seconds = timed(lambda: build(shape, tolerance, **asked, max_seconds=options.max_seconds, progress=show))
        made.save(options.out)
        error = made.sampled_error(shape)
        if options.surface:
            save_mesh(options.surface, made.to_mesh(options.resolution))
    if options.surface:
        asked |= {"surface": options.surface, "resolution": options.resolution}
    facts = {"leaves": made.leaves, "unresolved": made.unresolved, "sampled_error": error, "seconds": seconds}
    status = 0 if made.unresolved == 0 and error <= tolerance else 1
    if options.json:
        print(json.dumps({"shape": options.shape, "tolerance": tolerance, **asked, **box_of(shape), **facts}, indent=2))
        return status
    print(shape_line("A", options.shape, shape), end="\n\n")
    print(f"leaves     {made.leaves}; {made.unresolved} of them exceed {tolerance!r} at a test point")
    where = "near the surface" if options.mode == "band" else "in the box"
    print(f"error      {upper_text(error)}, the largest found at random points {where}")
    print(f"time       {seconds:.2f} s with compilation")
    print_files(field=options.out, surface=options.surface)
    return status


def doctor(options: Namespace) -> int:
    """Versions, devices, precision, the cache of compiled functions, and a self-check with a known distance."""
    facts = {
        "jhd": jhd.__version__,
        "python": f"{platform.python_version()} on {platform.platform()}",
        **{name: _version(name) for name in _PACKAGES},
        "devices": ", ".join(str(device) for device in jax.devices()) + f" ({jax.default_backend()})",
        "precision": precision(),
        "functions": _kept(),
        "JAX's cache": _cache(),
    }
    # The diagonal of a rectangle 4 by 3 against its base: the upper corner is 3 away, every other point less.
    base, diagonal = jhd.polyline([(0.0, 0.0), (4.0, 0.0)]), jhd.polyline([(0.0, 0.0), (4.0, 3.0)])
    solution = jhd.hausdorff(base, diagonal, throw=False)
    good = bool(float(solution.lower) <= 3.0 <= float(solution.upper)) and abs(float(solution) - 3.0) <= 1e-5
    if refused:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in sorted(refused.items()))
        facts["not kept"] = f"WARNING: compiled again in each process, because this JAX version is unknown ({reasons})"
    facts["self-check"] = f"{'passed' if good else 'FAILED'}: the distance is 3; computed {float(solution)!r}"
    if options.json:
        print(json.dumps({**facts, "passed": good}, indent=2))
    else:
        width = max(map(len, facts))
        print("\n".join(f"{name:<{width}}  {fact}" for name, fact in facts.items()))
    return 0 if good else 5


def precompile(options: Namespace) -> int:
    """Compile the functions for some kinds of shapes and keep them on disk, for later processes."""
    folder = storage.programs_folder()
    if folder is None:
        raise ValueError("JHD_CACHE is 0, or there is no home folder; set JHD_CACHE=FOLDER to keep compiled functions.")
    if jax.default_backend() != "cpu":
        raise ValueError(f"compiled functions are kept for CPUs only; this device is {device()}.")
    if not storage.made(folder):
        raise ValueError(f"{folder}: compiled functions are not kept there: {storage.refusal(folder)}.")
    unknown = [kind for kind in options.kinds if kind not in KINDS]
    if unknown:
        raise ValueError(f"unknown kind {unknown[0]!r}; there are {', '.join(KINDS)}.")
    if options.degree is not None and options.degree < 1:
        raise ValueError(f"--degree is {options.degree}; needs at least 1.")
    asked = preparations(options.kinds or list(KINDS), options.degree)
    rows = []
    with busy("preparing") as show:
        for done, (name, run) in enumerate(asked):
            show(Progress(name, done, len(asked)))
            rows.append({"name": name, "seconds": timed(run)[1]})
    if options.json:
        given = {"kinds": options.kinds or list(KINDS), "degree": options.degree}
        print(
            json.dumps(
                {**given, "folder": str(folder), **storage.contents(folder)._asdict(), "prepared": rows}, indent=2
            )
        )
        return 0
    width = max(len(row["name"]) for row in rows)
    print("\n".join(f"{row['name']:<{width}}  {row['seconds']:6.2f} s" for row in rows), end="\n\n")
    print(f"functions  {_kept()}")
    return 0


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _kept() -> str:
    """The folder of the compiled functions of jhd and its content, or the reason why it is not used."""
    folder = storage.programs_folder()
    if folder is None:
        return "not kept: JHD_CACHE is 0, or there is no home folder"
    if jax.default_backend() != "cpu":
        return "not kept: only for CPUs"
    if not folder.exists():
        return f"{folder} (does not exist yet)"
    reason = storage.refusal(folder)
    if reason is not None:
        return f"{folder} (not used: {reason})"
    files, size = storage.contents(folder)
    return f"{folder} ({size / 1e6:.1f} MB in {files} files, at most {storage.LIMIT / 1e6:.0f} MB)"


def _cache() -> str:
    """The cache folder of JAX itself, and its content."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if not folder:
        return "off"
    try:
        sizes = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file()]
    except OSError:
        return f"{folder} (does not exist yet)"
    return f"{folder} ({sum(sizes) / 1e6:.1f} MB in {len(sizes)} files)"
