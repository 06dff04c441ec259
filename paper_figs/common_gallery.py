"""Captions of the figures, the gallery page made from them, and the contact sheet.

A figure's docstring ends in a paragraph `Caption: ...`, which describes the picture and gives the number that matters,
and in `Alt text: ...`, which describes the picture for readers who do not see it; `Alt text of PART: ...` describes
NAME_PART.png.
The minutes come from the experiment's docstring. This module draws nothing and does not import the package.
"""

import ast
import html
from pathlib import Path

HERE = Path(__file__).resolve().parent
GALLERY = HERE / "gallery"
EXPERIMENTS = HERE.parent / "experiments"
# Width of two columns in pixels, in a picture and in a small one, and the colors of a small picture: all small pictures
# together stay below 3 MB.
WIDTH, SMALL_WIDTH, SMALL_COLORS = 2067, 800, 256
# Small pictures that keep all their colors: the few grays of a palette draw rings on smooth shading.
SHADED = ("lin03_spheres",)

# Experiments whose numbers README.md and experiments/README.md state; these are kept beside the small pictures.
STATED = ("first_call", "collection_search", "duplicates", "workers")
# All figures, in the order of the page.
GROUPS = {
    "Distances of curves": [
        "cao14_open_closed",
        "cao14_closed_closed",
        "convergence",
        "sampling_versus_proof",
        "scaling",
        "throughput",
        "first_call",
        "point_bezier",
        "gradient_check",
    ],
    "Letters, conversions and collections": [
        "fonts",
        "flattening_check",
        "collection_search",
        "duplicates",
        "workers",
        "to_a_million",
    ],
    "Fits": [
        "quarter_circle",
        "degree_reduction",
        "outline_fit",
        "noisy_outline",
        "scan_with_outliers",
        "scaling_of_fits",
        "active_set",
        "registration",
        "latent_shapes",
        "fit_quadric",
        "scan_to_model",
    ],
    "Events, biarcs and trimming": [
        "kim10_table",
        "kim10_figures",
        "biarc_convergence",
        "two_sided_trimming",
    ],
    "Surfaces": [
        "algsurf_table",
        "ranges",
        "spurious_cells",
        "surface_gallery",
        "surface_distances",
        "surface_bounds",
        "certificates",
        "marching_cubes_check",
        "tessellation_check",
    ],
    "Meshes, fields and voxels": [
        "lin03_transform",
        "lin03_field",
        "lin03_spheres",
        "local_search_error",
        "mesh_peers",
        "mesh_hausdorff_figure",
    ],
}
_HEAD = """\
# Figures and experiments

`.venv/bin/python paper_figs/NAME.py` draws a figure, and runs `experiments/NAME.py` first if its numbers are missing.
`--smoke` makes a short run. `paper_figs/all.py` draws all figures, or those that you name, skips the ones that are up
to date, and writes a contact sheet. `--rerun` computes new numbers if the code has changed, and `--gallery` writes
this page and its small pictures. A small picture is shown if its full numbers belong to the code at that date.
Numbers that README files state are stored here as JSON.

`--seed N` and `--set NAME=VALUE` (a constant in capitals of the experiment) ask for other numbers; these are stored
in folders of their own. Experiments that take files or two shapes accept `--meshes FILE ...` or `--a SHAPE --b
SHAPE`, as the command line does: `paper_figs/cao14_open_closed.py --a "font:DejaVu Sans:a" --b b.svg`.
"""
_SOURCES = """\
## Figures of the sources

The sources print no data. The figures here show shapes of our own of the same kind and size.

| source | figure | here |
|---|---|---|
| Cao et al. 2014 | 1, the four cases | `kim10_figures`, second picture, (a) |
| | 2, 3, solving for one maximum | panels (c) and (d) of both examples; the sketches of the equations are not drawn |
| | 4; 5 | `cao14_open_closed`; `cao14_closed_closed` |
| AlgSurf | the example of two cones, its table | `algsurf_table` |
| | cells that are kept | `spurious_cells`, `ranges` |
| Kim et al. 2010 | 1 to 3, biarcs | `kim10_figures`, third picture, (a); how many, `biarc_convergence` |
| | 4, 5, cones about points | not drawn: cones about arcs contain them at the ends of an arc |
| | 6, 9; 11 to 16 | the third picture, (b), (c); (d) to (h) |
| | 7, 8 | `kim10_figures`, (b), (a); the second picture, (b) |
| | 10, 17 | (c), (d); the second picture, (d), with both curves trimmed; `two_sided_trimming` |
| | 18, table 1 | the second picture, (a); `kim10_table` |
| Lin and Wang 2003 | 1, 3, 4, templates | `lin03_transform`, second picture |
| | 2 | `lin03_transform`, (a) |
| | 5; 6, 8, the meshes given | `lin03_field`, second picture, (c); (a), (b) |
| | 7, 9, the surfaces extracted | `lin03_field`, (b), (d) |
| | table 1, with vertices | the table of `lin03_field` |
| | 10 | `lin03_spheres`, (a) |
| shortest distance to a Bezier curve | all | `point_bezier` |
"""


def names() -> list[str]:
    """Return the names of all figures, in the order of the page."""
    return [name for group in GROUPS.values() for name in group]


def pictures(folder: Path, name: str) -> list[Path]:
    """Return the existing pictures of a figure in a folder: its own, and the pictures of its parts."""
    files = [folder / f"{name}.png", *sorted(folder.glob(f"{name}_*.png"))]
    # The longer name of another figure may begin with this name.
    return [file for file in files if file.exists() and (file.stem == name or file.stem not in names())]


def caption(name: str) -> str:
    """Return the caption of a figure, in one line."""
    return _paragraph(HERE / f"{name}.py", "Caption: ")


def alt_text(name: str, picture: str) -> str:
    """Return the description of one picture of a figure, by the name of its file, in one line."""
    part = Path(picture).stem.removeprefix(name).removeprefix("_")
    return _paragraph(HERE / f"{name}.py", f"Alt text of {part}: " if part else "Alt text: ")


def takes(name: str) -> str:
    """Return the time that the full experiment takes."""
    return _paragraph(EXPERIMENTS / f"{name}.py", "Takes: ")


def question(name: str) -> str:
    """Return the question of the experiment."""
    return _docstring(EXPERIMENTS / f"{name}.py").split("\n")[0]


def page() -> str:
    """Return the gallery page."""
    parts = [_HEAD]
    for title, group in GROUPS.items():
        parts.append(f"## {title}\n")
        parts += [_entry(name) for name in group]
    return "\n".join([*parts, _SOURCES])


def _entry(name: str) -> str:
    text = caption(name)
    files = [file.name for file in pictures(GALLERY, name)]
    shown = "\n".join(f"![{alt_text(name, file)}]({file})" for file in files) or "Small picture not made."
    command = f"`.venv/bin/python paper_figs/{name}.py` · {takes(name)}"
    return f"### {name}\n\n{question(name)}\n\n{shown}\n\n{text}\n\n{command}\n"


def contact_sheet(pictures: dict[str, list[str]], told: dict[str, str]) -> str:
    """Return a page of HTML with all pictures and captions.

    Args:
        pictures: for each figure the files of its pictures, in the folder of the page.
        told: notes on figures by name, for example that the numbers are old or that the figure failed.
    """
    body = "\n".join(_figure(name, files, told.get(name, "")) for name, files in pictures.items())
    return _SHEET.replace("BODY", body)


def _figure(name: str, files: list[str], told: str) -> str:
    drawn = "".join(_image(file, alt_text(name, file)) for file in files)
    note = f'<p class="told">{html.escape(told)}</p>' if told else ""
    text = f"<b>{name}</b> {html.escape(caption(name))}"
    return f'<figure id="{name}">{drawn}{note}<figcaption>{text}</figcaption></figure>'


def _image(file: str, alt: str) -> str:
    return f'<a href="{file}"><img src="{file}" alt="{html.escape(alt)}" loading="lazy"></a>'


_SHEET = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>jhd: figures</title>
<style>
body { font: 15px/1.4 sans-serif; margin: 2em; display: grid; gap: 2em;
  grid-template-columns: repeat(auto-fill, minmax(28em, 1fr)); }
figure { margin: 0; }
img { max-width: 100%; }
.told { color: #b03000; }
</style>
BODY
</html>
"""


def _paragraph(file: Path, begin: str) -> str:
    """Return the part of a docstring from `begin` to the end of the paragraph, without `begin`, in one line."""
    for part in _docstring(file).split("\n\n"):
        lines = part.split("\n")
        for k, line in enumerate(lines):
            if line.startswith(begin):
                return " ".join(lines[k:]).removeprefix(begin)
    raise ValueError(f"{file}: no paragraph in the docstring begins with {begin!r}.")


def _docstring(file: Path) -> str:
    return ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
