"""Arguments, numbers, sizes and colors for print, common to all figures.

Sizes suit a journal: 85 mm for one column, 175 mm for two, 8 pt text. The palette is by Okabe & Ito; line styles,
markers and labels also tell the lines apart in gray. Figures are made inside the context `style()`, so nothing global
changes.
"""

import argparse
import json
import runpy
import subprocess
import sys
from contextlib import AbstractContextManager
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter

import jhd

BLACK, BLUE, ORANGE, GREEN, VERMILLION = "#000000", "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, GRAY = "#CC79A7", "#707070"
MM = 1 / 25.4
# Key in the metadata of a picture for the digests of its code and numbers.
ORIGIN = "Origin"
TEXT = 8

_HERE = Path(__file__).resolve().parent
EXPERIMENTS = _HERE.parent / "experiments"
# Experiments have a `common` of their own, so shared modules are run by their path.
_ORIGIN = runpy.run_path(str(EXPERIMENTS / "common_origin.py"))
_PARAMETERS = runpy.run_path(str(EXPERIMENTS / "common_parameters.py"))
_STYLE: dict[Any, Any] = {
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.labelsize": TEXT,
    "xtick.labelsize": TEXT,
    "ytick.labelsize": TEXT,
    "legend.fontsize": TEXT,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    # Text stays text in PDF files.
    "pdf.fonttype": 42,
}


def style() -> AbstractContextManager:
    """Return the context in which figures are made."""
    return mpl.rc_context(_STYLE)


class Picture:
    """One run of a figure: the numbers of its experiment, and the folder of its pictures.

    The experiment runs first if its numbers are missing or were computed with other options, or if they are outdated
    and --rerun is given.

    Args:
        file: the figure's `__file__`.
        text: its docstring, shown by --help.
    """

    def __init__(self, file: str, text: str | None):
        parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--smoke", action="store_true", help="shrink everything: a test that it runs")
        parser.add_argument("--out", type=Path, help="folder of pictures and numbers (default: the output folders)")
        parser.add_argument("--rerun", action="store_true", help="run the experiment again if its code has changed")
        # The experiment itself refuses the options that it does not take.
        _PARAMETERS["add_options"](parser, meshes=True, pair=True)
        options = parser.parse_args()
        self.file = Path(file).resolve()
        self.name = self.file.stem
        self.smoke: bool = options.smoke
        self.asked: dict[str, Any] = _PARAMETERS["asked"](options)
        part = Path("smoke" if options.smoke else "", "asked" if self.asked else "")
        self.folder: Path = options.out or _HERE / "output" / part
        self.folder.mkdir(parents=True, exist_ok=True)
        source = options.out or EXPERIMENTS / "output" / part
        self.results = source / f"{self.name}.json"
        if not self._are_those_asked_for() or (options.rerun and outdated(self.results)):
            self._run_experiment()
        self.numbers: dict[str, Any] = json.loads(self.results.read_text(encoding="utf-8"))
        self.outdated = outdated(self.results)
        if self.outdated:
            print(f"{self.name}: the numbers are old: {self.outdated}; --rerun takes new ones", file=sys.stderr)

    def _are_those_asked_for(self) -> bool:
        """Return True if numbers exist for the given seed, parameters and shapes."""
        if not self.results.exists():
            return False
        context = json.loads(self.results.read_text(encoding="utf-8"))["context"]
        return context.get("asked", {}) == self.asked

    def _run_experiment(self) -> None:
        script = EXPERIMENTS / f"{self.name}.py"
        flags = ["--smoke"] * self.smoke + _PARAMETERS["as_flags"](self.asked)
        done = subprocess.run([sys.executable, str(script), "--out", str(self.results.parent), *flags], check=False)
        if done.returncode:
            # The experiment has printed the reason.
            sys.exit(done.returncode)

    def path(self, suffix: str) -> Path:
        """Return the path of NAME with a suffix such as `.gif` or `_errors.png`, in the folder of the pictures."""
        return self.folder / f"{self.name}{suffix}"

    def save(self, figure: Figure, part: str = "") -> None:
        """Write the figure as .png and .pdf, and print the path; add a note at the right if the numbers are old."""
        with style():
            if self.outdated:
                note = f"old numbers: {self.outdated}"
                # At the side: legends outside the axes move if the figure grows below or above.
                look: dict[str, Any] = {"rotation": "vertical", "ha": "left", "va": "bottom", "gid": "outdated"}
                figure.text(1.005, 0.01, note, size=5, color=VERMILLION, **look)
            # The note lies outside, so that it covers nothing.
            size = "tight" if self.outdated else None
            origin = origin_of(self.file, self.results)
            figure.savefig(self.path(part + ".png"), dpi=300, bbox_inches=size, metadata={ORIGIN: origin})
            # No date in the file: equal numbers give equal bytes.
            figure.savefig(self.path(part + ".pdf"), bbox_inches=size, metadata={"CreationDate": None})
        print(self.path(part + ".png"))


def outdated(results: Path) -> str:
    """Say which code has changed since the results were written; empty if nothing has changed."""
    context = json.loads(results.read_text(encoding="utf-8"))["context"]
    return _ORIGIN["outdated"](context, EXPERIMENTS / f"{results.stem}.py")


def origin_of(script: Path, results: Path) -> str:
    """Return digests of the code that draws a picture and of its numbers."""
    code = _ORIGIN["code_of"](script)
    return " ".join([*code.values(), _ORIGIN["digest"]([results]), outdated(results)]).strip()


def certified_text(lower: float, upper: float, digits: int) -> str:
    """Return TeX for a number between two bounds: digits if both bounds round to them, else both, rounded outward."""
    if f"{lower:.{digits}f}" == f"{upper:.{digits}f}":
        return f"= {lower:.{digits}f}"
    low, high = outward(lower, upper, digits)
    return f"\\in [{low}, {high}]"


def middle_text(lower: float, upper: float) -> str:
    """Return TeX for the middle of two bounds and their largest distance from the written digits, rounded up."""
    half = max((upper - lower) / 2, 1e-15)
    digits = int(np.ceil(-np.log10(half)))
    middle = Decimal((lower + upper) / 2).quantize(Decimal(1).scaleb(-digits))
    off = max(Decimal(upper) - middle, middle - Decimal(lower))
    unit = Decimal(1).scaleb(off.adjusted())
    return f"{middle} ± {power_text(float(off.quantize(unit, ROUND_CEILING)))}"


def power_text(x: float, digits: int = 0) -> str:
    """Return TeX for a number as a multiple of a power of ten, with this number of decimals."""
    if x == 0:
        return "$0$"
    mantissa, exponent = f"{x:.{digits}e}".split("e")
    return rf"${mantissa}\cdot 10^{{{int(exponent)}}}$"


def outward(lower: float, upper: float, digits: int) -> tuple[str, str]:
    """Return both bounds with this number of decimals, rounded outward, so that the written bounds stay certified."""
    unit = Decimal(1).scaleb(-digits)
    low, high = (Decimal(x).quantize(unit, way) for x, way in ((lower, ROUND_FLOOR), (upper, ROUND_CEILING)))
    return f"{low}", f"{high}"


def grouped(number: float, form: str = ",") -> str:
    """Return a number as text, with thin spaces between groups of three digits if it is 10 000 or more."""
    text = format(number, form)
    whole = text.partition(".")[0].lstrip("-")
    return text.replace(",", "\N{THIN SPACE}" if len(whole) > len("9,999") else "")


def grouped_ticks() -> FuncFormatter:
    """Return a formatter of tick labels that writes numbers as `grouped` does."""
    return FuncFormatter(lambda x, _: grouped(x, ",.12g"))


def letter(ax: Axes, text: str, title: str = "") -> None:
    """Write the letter of a panel, bold, and its title above its left edge."""
    ax.set_title(f"$\\bf{{({text})}}$ {title}", loc="left", pad=3)


def freeze(figure: Figure) -> None:
    """Fix the layout, so that artists placed afterwards by pixels do not move."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    figure.draw_without_rendering()


def place_label(ax: Axes, point: Any, text: str, distance: float = 7.0) -> None:
    """Write next to a point, on the side that covers the least of the drawing; call `freeze` first."""
    halo = [withStroke(linewidth=2.0, foreground="white")]
    note = ax.annotate(text, point, (0, 0), textcoords="offset points", path_effects=halo, zorder=9, linespacing=1.15)
    others = [child for child in ax.texts if child is not note]
    lines = np.concatenate([_dense(ax, line) for line in ax.lines])
    best = np.inf
    chosen = (0.0, 0.0, "center", "center")
    for angle in np.arange(16) * np.pi / 8:
        x, y = np.cos(angle), np.sin(angle)
        ha = ("right", "center", "left")[int(np.sign(round(2 * x))) + 1]
        va = ("top", "center", "bottom")[int(np.sign(round(2 * y))) + 1]
        for reach in (1.0, 1.8, 3.0, 4.2):
            note.set(position=(reach * distance * x, reach * distance * y), ha=ha, va=va)
            box = note.get_window_extent().padded(3)
            cost = box.count_contains(lines) + reach
            cost += 1e4 * sum(box.overlaps(other.get_window_extent()) for other in others)
            cost += 1e3 * (4 - ax.bbox.count_contains(box.corners()))
            if cost < best:
                best, chosen = cost, (reach * distance * x, reach * distance * y, ha, va)
    note.set(position=chosen[:2], ha=chosen[2], va=chosen[3])


def _dense(ax: Axes, line: Line2D) -> np.ndarray:
    """Return points along a drawn line in pixels, about two pixels apart."""
    pixels = line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))
    if line.get_linestyle() == "None":
        return pixels[np.isfinite(pixels).all(axis=1)]
    steps = np.linspace(0, 1, 65)[:, None, None]
    dense = ((1 - steps) * pixels[:-1] + steps * pixels[1:]).reshape(-1, 2)
    return 2 * np.unique(np.round(dense[np.isfinite(dense).all(axis=1)] / 2), axis=0)


def scale_bar(ax: Axes, length: float, unit: str, place: tuple[float, float]) -> None:
    """Draw a bar of this length in data units, centered at a point in axes coordinates, with its length as text."""
    x, y = ax.transData.inverted().transform(ax.transAxes.transform(place))
    ends = [x - length / 2, x + length / 2]
    ax.plot(ends, [y, y], color=BLACK, linewidth=1.6, solid_capstyle="butt", gid="scale_bar")
    ax.annotate(f"{length:g} {unit}".strip(), (x, y), (0, -2.5), textcoords="offset points", ha="center", va="top")


def bezier(control_points: Any) -> jhd.BezierSegments:
    """Return segments from their stored control points."""
    return jhd.BezierSegments(np.asarray(control_points, dtype=float))


def shape(stored: dict[str, Any]) -> Any:
    """Return a shape from its numbers: a mesh, an implicit surface, patches or segments."""
    if "triangles" in stored:
        return jhd.TriangleMesh(stored["vertices"], stored["triangles"])
    if "coefficients" in stored:
        return jhd.ImplicitSurface(stored["coefficients"], stored["lower"], stored["upper"])
    net = np.asarray(stored["control_points"], dtype=float)
    return (jhd.BezierSegments if net.ndim == 3 else jhd.BezierPatches)(net, stored["weights"])


def _numbers(value: Any) -> Any:
    """Return stored numbers as an array, with NaN for null, which stands for numbers that are not finite."""
    found = np.asarray(value)
    return found.astype(float) if found.dtype == object else found


def solution(stored: dict[str, Any]) -> jhd.HausdorffSolution:
    """Return a solution from its stored numbers, for the functions of jhd.plot that take one."""
    witness = dict(stored["witness"])
    kinds = {"event": jhd.EVENTS, "direction": jhd.DIRECTIONS}
    members = {key: getattr(kind, witness.pop(key)) for key, kind in kinds.items()}
    arrays = {key: jnp.asarray(_numbers(value)) for key, value in witness.items()}
    bounds = (jnp.asarray(jnp.inf if stored[key] is None else stored[key]) for key in ("value", "lower", "upper"))
    result = getattr(jhd.RESULTS, stored["result"])
    stats = {key: jnp.asarray(value) for key, value in stored["stats"].items()}
    return jhd.HausdorffSolution(*bounds, witness=jhd.Witness(**arrays, **members), result=result, stats=stats)
